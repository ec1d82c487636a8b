# SPDX-License-Identifier: MIT
"""Extension as a table: what a scan sees of a wall, block by block, and why each block is in the model.

Seen:   . the wall   # something before it   o a beam went through   ? no echo
Filled: m measured   i interior   b between   e edges   a architectural   u user   - not in the model
"""

from dataclasses import replace

import numpy as np
import pytest

from completion.boundary.boundary_pixels import find_boundary_pixels
from completion.edits.application import EditedSurface
from completion.edits.edit import SurfaceEdits, Wish
from completion.evidence.evidence import Label, Scans
from completion.extension.extent import ExtensionRules, Extent, with_ends
from completion.extension.patch import Patch
from completion.extension.pipeline import extend
from completion.fitting.result import SurfaceFit
from completion.merging.merged_surface import MergedSurface
from completion.observe.observation import PixelSet, ScanPixels, observe
from completion.observe.tolerance import EvidenceOptions
from completion.observe.user_options import UserOptions
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Plane

BLOCK = 8  # pixels
DEPTH = {".": 3.0, "#": 1.5, "o": 5.0, "?": np.inf}
WALL = Plane((0, 0, 3), (0, 0, -1), (1, 0, 0))
EXACT = SurfaceFit(WALL, 0.0, np.zeros((3, 3)), 1000)
USUAL = EvidenceOptions().tolerance()
RULES = ExtensionRules(wishes=UserOptions(), max_cells=10_000)
SYMBOLS = "mibeafu"  # by the number of the provenance
UPRIGHT, SLANTED = Plane((0.86, 0, 0), (-1, 0, 0)), Plane((0.86, 0, 0), (-1, -0.6, 0))
NO_END = np.array([[-np.inf, -np.inf], [np.inf, np.inf]])


def camera(seen: str) -> PinholeProjection:
    rows = seen.split()
    return PinholeProjection.from_fov(BLOCK * len(rows[0]), BLOCK * len(rows), 60)


def centres(seen: str) -> np.ndarray:
    """Where on the wall the rays through the middles of the blocks (rows * columns, 3) meet it."""
    middle = slice(BLOCK // 2, None, BLOCK)
    ray = camera(seen).directions()[middle, middle].reshape(-1, 3)
    return ray / ray[:, 2:] * 3.0


def extended(seen: str, *, edits=None, accepts=None, cut=None, mode="standard", sd=0.0) -> Patch:
    """Extend the wall; `cut` is an enclosing plane that closes the right side."""
    projection = camera(seen)
    depth = np.array([[DEPTH[symbol] for symbol in row] for row in seen.split()])
    depth = np.kron(depth, np.ones((BLOCK, BLOCK)))
    scan = RangeImage(depth / projection.directions()[..., 2], projection, Pose.identity(), sigma_m=0.0)
    observation = observe(scan, Pose.identity())
    mask = depth == 3.0
    fit = replace(EXACT, covariance=np.diag([sd**2, 0.0, 0.0]))
    wall = MergedSurface(fit, ScanPixels.of([PixelSet.of(mask)]), 1)
    uv = WALL.to_uv(observation.scan.points()[mask])
    extent = Extent(
        chart=WALL, enclosures=(), cuts=(), neighbours=(), own_low=uv.min(axis=0), own_high=uv.max(axis=0),
        ends=NO_END, end_probability=np.zeros((2, 2)), ended=np.zeros((2, 2), dtype=np.bool_),
        full_turn=False, encloses=True,
    )  # fmt: skip
    if cut is not None:
        extent = replace(with_ends(extent, [cut]), by_edit=np.zeros((2, 2), bool))
    if accepts is not None:
        edits = SurfaceEdits(wishes=(Wish(accepts),))
    return extend(
        find_boundary_pixels(fit, wall.pixels, [observation], USUAL),
        extent,
        EditedSurface(wall, edits or SurfaceEdits()),
        fit,
        scans=Scans((observation,), (mask.astype(np.int32),), USUAL),
        number=1,
        rules=replace(RULES, wishes=UserOptions(mode=mode)),
    )


def rectangle(left: float, right: float, half_height: float = 1.0) -> np.ndarray:
    """Corners (4, 3) of an outline on the wall."""
    corners = [(left, -half_height), (right, -half_height), (right, half_height), (left, half_height)]
    return np.column_stack([corners, np.full(4, 3.0)])


def drawn(patch: Patch, seen: str) -> str:
    """The provenance of the cell in the middle of each block, as a picture."""
    points = centres(seen)
    index, cell = patch.grid.cells_of(points)
    number = np.full(len(points), -1)
    number[index] = patch.provenance.ravel()[cell]
    symbols = np.array([*SYMBOLS, "-"])[number].reshape(len(seen.split()), -1)
    return " ".join("".join(row) for row in symbols)


TABLE = {
    "a hidden place amid measured ones is interior":
        ("..... .###. .###. .....", {},
         "mmmmm miiim miiim mmmmm"),
    "parts that an occluder cuts apart are joined between":
        ("..##.. ..##.. ..##.. ..##..", {},
         "mmbbmm mmbbmm mmbbmm mmbbmm"),
    "where a beam went through nothing is filled, beside it something may be":
        ("...... .o###. .o###. ......", {},
         "mmmmmm m-iiim m-iiim mmmmmm"),
    "no echo is no occluder":
        ("..... .???. .???. .....", {},
         "mmmmm m---m m---m mmmmm"),
    "beside a large opening a narrow hidden place is too uncertain to be conservative about":
        ("........ .ooooo#. .ooooo#. ........", {"mode": "conservative"},
         "mmmmmmmm m------m m------m mmmmmmmm"),
    "own edges continue to their hidden corner":
        ("......oo ......oo ......oo ......oo ....###o ....###o oooo###o oooooooo", {},
         "mmmmmm-- mmmmmm-- mmmmmm-- mmmmmm-- mmmmie-- mmmmee-- -------- --------"),
    "it goes on to what ends it, and not beyond":
        ("....#### ....#### ....#### ....####", {"cut": UPRIGHT},
         "mmmmaa-- mmmmaa-- mmmmaa-- mmmmaa--"),
    "nor beyond a slanted one":
        ("....#### ....#### ....#### ....####", {"cut": SLANTED},
         "mmmmaaa- mmmmaa-- mmmmaa-- mmmma---"),
    "without anything that ends it, a wall is unknown far off":
        ("..###### ..###### ..###### ..######", {},
         "mma----- mma----- mma----- mma-----"),
    "a conservative continuation stays in the hull of what was measured":
        ("....#### ....#### ....#### ....####", {"cut": UPRIGHT, "mode": "conservative"},
         "mmmm---- mmmm---- mmmm---- mmmm----"),
    "conservatively too an interior hole is filled":
        ("..... .###. .###. .....", {"mode": "conservative"},
         "mmmmm miiim miiim mmmmm"),
    "a surface that is not known well enough is not continued":
        ("..... .###. .###. .....", {"sd": 0.03},
         "mmmmm m---m m---m mmmmm"),
    "what a person rejects stays as measured":
        ("..... .###. .###. .....", {"accepts": False},
         "mmmmm m---m m---m mmmmm"),
    "what a person accepts is filled":
        ("........ .ooooo#. .ooooo#. ........", {"mode": "conservative", "accepts": True},
         "mmmmmmmm m-----um m-----um mmmmmmmm"),
    "a person cannot overrule a beam":
        ("..... .ooo. .ooo. .....", {"accepts": True},
         "mmmmm m---m m---m mmmmm"),
    "nor fill where there was no echo":
        ("..... .???. .???. .....", {"accepts": True},
         "mmmmm m---m m---m mmmmm"),
    "nor continue what is not known well enough":
        ("..... .###. .###. .....", {"accepts": True, "sd": 0.03},
         "mmmmm m---m m---m mmmmm"),
    "nor go on beyond what ends the surface":
        ("....#### ....#### ....#### ....####",
         {"cut": UPRIGHT, "edits": SurfaceEdits(wishes=(Wish(True, rectangle(-1.7, 1.7)),))},
         "mmmmaa-- mmmmaa-- mmmmaa-- mmmmaa--"),
    "a person may draw where the surface is, apart from the rest of it":
        ("..###### ..###### ..###### ..######",
         {"edits": SurfaceEdits(wishes=(Wish(True, rectangle(0.45, 0.85)),))},
         "mma--u-- mma--u-- mma--u-- mma--u--"),
    "a person may set the end":
        ("....#### ....#### ....#### ....####",
         {"edits": SurfaceEdits(ends=(UPRIGHT,))},
         "mmmmuu-- mmmmuu-- mmmmuu-- mmmmuu--"),
    "what a person joined is the person's":
        ("..##.. ..##.. ..##.. ..##..", {"edits": SurfaceEdits(actions=("merge",))},
         "mmuumm mmuumm mmuumm mmuumm"),
    "in a declared opening there is nothing":
        ("..... .###. .###. .....", {"edits": SurfaceEdits(openings=(rectangle(-0.35, 0.35, 0.6),))},
         "mmmmm mi-im mi-im mmmmm"),
}  # fmt: skip


@pytest.mark.parametrize("law", TABLE)
def test_what_is_seen_says_what_is_filled(law):
    seen, given, expected = TABLE[law]
    assert drawn(extended(seen, **given), seen).split() == expected.split()


@pytest.mark.parametrize("law", TABLE)
def test_only_hidden_cells_are_filled_and_each_says_why(law):
    seen, given, _ = TABLE[law]
    patch = extended(seen, **given)
    at_edge = np.zeros(patch.grid.shape, dtype=np.bool_)  # of the view: their part in view is filled
    for trim in patch.trims:
        at_edge |= trim.cells & (patch.evidence.labels == Label.OUT)
    assert (patch.evidence.labels[patch.hypothesised & ~at_edge] == Label.OCCLUDED).all()
    assert not (patch.hypothesised & patch.observed).any()
    assert ((patch.provenance > 0) == patch.hypothesised).all()
    assert ((patch.provenance == 0) == patch.observed).all()


def test_no_picture_makes_a_beam_s_cell_filled():
    rng = np.random.default_rng(0)
    for _ in range(8):
        blocks = rng.choice([*"...#o?"], (6, 6))
        seen = " ".join("".join(row) for row in blocks)
        patch = extended(seen, accepts=True, mode="bold")
        pairs = zip(seen.replace(" ", ""), drawn(patch, seen).replace(" ", ""), strict=True)
        assert {filled for was, filled in pairs if was in "o?"} == {"-"}
