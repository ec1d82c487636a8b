# SPDX-License-Identifier: MIT
"""Extent as a table: what encloses and what was seen of a surface, and how far it may be continued."""

from dataclasses import replace

import numpy as np
import pytest

from completion.boundary.boundary_pixels import BoundaryPixels
from completion.boundary.continuation import ALL_CUES, Cue
from completion.evidence.evidence import Scans
from completion.extension.adjacency import Adjacency
from completion.extension.extent import Extent, find_extent, with_ends
from completion.extension.grid import farthest_hidden
from completion.fitting.result import SurfaceFit
from completion.merging.merged_surface import MergedSurface
from completion.observe.observation import Observation, PixelSet, ScanPixels, observe
from completion.observe.range_noise import RangeNoise
from completion.observe.rays import rays_of
from completion.observe.tolerance import EvidenceOptions
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Cylinder, Plane, Sphere

NOTHING = BoundaryPixels(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0, np.int8))
N = 4000  # points of a surface
WALL = Plane((0, 3, 0), (0, -1, 0))
ROOM = {
    "floor": Plane((0, 0, 0), (0, 0, 1)),
    "ceiling": Plane((0, 0, 2.5), (0, 0, -1)),
    "left": Plane((-2, 0, 0), (1, 0, 0)),
    "right": Plane((2, 0, 0), (-1, 0, 0)),
    "vault": Cylinder((0, 0, 0), (0, 1, 0), 2.5, concave=True),
    "outside": Plane((0, 0, 0.4), (0, 0, -1)),  # the wall lies on its outer side
}
SIDES = {"left": (-1, 0, 0), "right": (1, 0, 0), "floor": (0, 0, -1), "ceiling": (0, 0, 1)}


def extent_of(surface, points, *, others=(), enclosing=(), standing=0.0, meets=(), cues=ALL_CUES, cov=None):
    """The extent of a surface that was measured at `points`, with what else there is."""
    camera = PinholeProjection(len(points), 1 + len(others), 1.0, 1.0, 0.0, 0.0)
    held = np.tile(points, (camera.height, 1, 1))
    scan = RangeImage.from_points(held, camera, Pose.identity())
    seen = Observation(scan, RangeNoise(0.0, 0.0), rays_of(scan))
    first = np.zeros(held.shape[:2], dtype=np.bool_)
    first[0] = True
    none = np.zeros_like(first)
    size = 5 if isinstance(surface, Cylinder) else 3
    fit = SurfaceFit(surface, 0.001, np.zeros((size, size)) if cov is None else cov, len(points))
    merged = [MergedSurface(fit, ScanPixels.of([PixelSet.of(first)]), 1)]
    merged += [
        MergedSurface(SurfaceFit(one, 0.001, np.zeros((3, 3)), N), ScanPixels.of([PixelSet.of(none)]), 1)
        for one in others
    ]
    n = len(merged)
    encloses, met = np.zeros(n, dtype=np.bool_), np.zeros((n, n), dtype=np.bool_)
    encloses[list(enclosing)], met[0, list(meets)] = True, True
    adjacency = Adjacency(encloses, encloses, met, np.full(n, standing), np.zeros(n, dtype=np.bool_))
    return find_extent(0, merged, [NOTHING] * n, adjacency, [seen], cues=cues)


def scans_of(*seen: Observation) -> Scans:
    nobody = tuple(np.zeros(one.scan.shape, np.int32) for one in seen)
    return Scans(seen, nobody, EvidenceOptions().tolerance())


def wall_points():
    """Of a wall at y = 3: 2 m wide, 1.5 m high, half a metre above the floor and below the ceiling."""
    x, z = np.random.default_rng(0).uniform((-1, 0.5), (1, 2.0), (N, 2)).T
    return np.column_stack([x, np.full(N, 3.0), z])


def wall_extent(names, *, is_wall=True, **given) -> Extent:
    others = [ROOM[name] for name in names]
    enclosing = [*([0] if is_wall else []), *range(1, len(others) + 1)]
    return extent_of(WALL, wall_points(), others=others, enclosing=enclosing, **given)


def per_side(extent: Extent, values) -> dict[str, float]:
    """Values (2, 2) of the low and high sides along u and v, by the direction in the room."""
    result = {}
    for name, direction in SIDES.items():
        along = np.array([extent.chart.u_direction @ direction, extent.chart.v_direction @ direction])
        axis = int(np.argmax(np.abs(along)))
        result[name] = float(values[int(along[axis] > 0), axis])
    return result


def gaps(extent: Extent) -> dict[str, float]:
    """How far beyond what was measured each side ends, metres."""
    distance = np.stack([extent.own_low - extent.ends[0], extent.ends[1] - extent.own_high])
    return {side: gap for side, gap in per_side(extent, distance).items() if np.isfinite(gap)}


ENDS = {
    "nothing encloses": ([], {}, {}),
    "a floor ends it below": (["floor"], {}, {"floor": 0.5}),
    "a room ends it all around":
        (["floor", "ceiling", "left", "right"], {},
         {"floor": 0.5, "ceiling": 0.5, "left": 1.0, "right": 1.0}),
    "not what it lies on the outer side of": (["outside"], {}, {}),
    "a vault cuts it, but closes no side": (["vault"], {}, {}),
    "without the cue nothing ends it": (["floor"], {"cues": (Cue.MERGING,)}, {}),
}  # fmt: skip


@pytest.mark.parametrize("law", ENDS)
def test_enclosing_surfaces_end_a_wall(law):
    names, given, expected = ENDS[law]
    extent = wall_extent(names, **given)
    assert gaps(extent) == pytest.approx(expected, abs=0.02)
    assert len(extent.cuts) == (0 if law.startswith(("nothing", "not", "without")) else len(names))
    assert [shape for _, shape in extent.enclosures] == [ROOM[name] for name in names]
    assert extent.encloses


@pytest.mark.parametrize(
    ("is_wall", "standing", "probability"), [(True, 0.3, 1.0), (False, 0.3, 0.3), (False, 0.0, 0.0)]
)
def test_walls_go_on_to_their_end_and_objects_as_often_as_they_stand_there(is_wall, standing, probability):
    extent = wall_extent(["floor"], is_wall=is_wall, standing=standing)
    found = per_side(extent, extent.end_probability)
    assert found == {"floor": probability, "ceiling": 0.0, "left": 0.0, "right": 0.0}


WINDOW = {  # how far on, in metres: below, where the floor is, and above, where nothing is
    "a wall: to the floor, and by its diagonal": (True, 0.0, False, (0.5, 2.5)),
    "what stands on the floor: to it, and by its height": (False, 0.4, False, (0.5, 1.5)),
    "what stands nowhere: by its height, not through the floor": (False, 0.0, False, (0.5, 1.5)),
    "a wall that was seen to end above: not beyond": (True, 0.0, True, (0.5, 0.0)),
}


@pytest.mark.parametrize("law", WINDOW)
def test_a_continuation_is_considered_so_far(law):
    is_wall, standing, ended, expected = WINDOW[law]
    extent = wall_extent(["floor"], is_wall=is_wall, standing=standing)
    above = per_side(extent, np.arange(4).reshape(2, 2))["ceiling"]
    ends = extent.ended.copy()
    ends[np.unravel_index(int(above), (2, 2))] = ended
    extent = replace(extent, ended=ends)
    low, high = extent.window()
    found = per_side(extent, np.stack([extent.own_low - low, high - extent.own_high]))
    assert (found["floor"], found["ceiling"]) == pytest.approx(expected, abs=0.03)
    low, high = extent.known_window()
    known = per_side(extent, np.stack([extent.own_low - low, high - extent.own_high]))
    assert known["floor"] == pytest.approx(0.5 if is_wall or standing else 0.0, abs=0.02)
    assert known["ceiling"] == 0


EDITED = {"nearer than the floor": (0.3, 0.2, True), "beyond the floor": (-0.4, 0.5, False)}


@pytest.mark.parametrize("law", EDITED)
def test_a_person_sets_an_end_but_none_beyond_what_encloses(law):
    height, gap, by_edit = EDITED[law]
    extent = with_ends(wall_extent(["floor"], is_wall=False), [Plane((0, 0, height), (0, 0, 1))])
    assert gaps(extent)["floor"] == pytest.approx(gap, abs=0.02)
    assert per_side(extent, extent.by_edit)["floor"] == by_edit
    assert per_side(extent, extent.end_probability)["floor"] == by_edit


def test_creases_are_with_what_meets_it_and_does_not_enclose():
    board = Plane((0, 2.9, 0), (0, 0, 1))
    given = {"others": [board, ROOM["floor"]], "enclosing": [0, 2], "meets": [1, 2]}
    assert extent_of(WALL, wall_points(), **given).neighbours == (board,)
    assert extent_of(WALL, wall_points(), **given, cues=(Cue.ARCHITECTURAL,)).neighbours == ()


TURNS = {  # arc in degrees, concave, standard deviation of the radius over it, cues: whether it is closed
    "a quarter and more": (95.0, False, 0.01, ALL_CUES, True),
    "most of it": (300.0, False, 0.01, ALL_CUES, True),
    "less than a quarter": (85.0, False, 0.01, ALL_CUES, False),
    "a vault": (180.0, True, 0.01, ALL_CUES, False),
    "a radius that is hardly known": (180.0, False, 0.06, ALL_CUES, False),
    "without the cue": (180.0, False, 0.01, (Cue.MERGING,), False),
}


@pytest.mark.parametrize("law", TURNS)
def test_a_cylinder_closes_around_its_back(law):
    arc_deg, concave, relative_sd, cues, closes = TURNS[law]
    pipe = Cylinder((1, 2, 0), (0, 0, 1), 0.3, concave=concave)
    u = np.linspace(-0.5, 0.5, N) * np.radians(arc_deg) * pipe.radius
    points = pipe.from_uv(np.column_stack([u, np.linspace(0, 1, N)]))
    covariance = np.diag([0.0, 0.0, 0.0, 0.0, (relative_sd * pipe.radius) ** 2])
    extent = extent_of(pipe, points, cues=cues, cov=covariance)
    assert extent.full_turn is closes
    assert not extent.encloses
    low, high = extent.window()
    assert high[1] - low[1] == pytest.approx(3.0, abs=0.05)  # as far again at either end
    assert high[0] - low[0] == pytest.approx(np.radians(arc_deg) * pipe.radius, abs=0.02)


def test_other_shapes_have_no_extent():
    with pytest.raises(TypeError, match="no extent is known for a Sphere"):
        extent_of(Sphere((0, 0, 0), 1.0), wall_points())


@pytest.mark.parametrize("seed", range(4))
def test_the_farthest_hidden_places_are_those_of_the_plain_formula(seed):
    rng, camera = np.random.default_rng(seed), PinholeProjection.from_fov(61, 40, 80)
    scan = RangeImage(rng.uniform(1, 4, camera.shape), camera, Pose.identity(), sigma_m=0.0)
    seen, chart = observe(scan, Pose.identity()), Plane((0.3, 0, 3), (0.2, 0.1, -1))
    low, high = np.array([-1.2, -0.8]), np.array([1.0, 1.1])
    rays = seen.scan.rays()[::2, ::2].reshape(-1, 3)
    reach = chart.ray_ranges(np.zeros(3), rays)
    behind = np.isfinite(reach) & (scan.ranges[::2, ::2].ravel() < reach)
    uv = chart.to_uv(reach[behind, None] * rays[behind])
    uv = uv[((uv >= low) & (uv <= high)).all(axis=1)]
    found = farthest_hidden(chart, low, high, scans_of(seen, seen))
    np.testing.assert_allclose(found.min(axis=0), uv.min(axis=0), atol=1e-12)
    np.testing.assert_allclose(found.max(axis=0), uv.max(axis=0), atol=1e-12)
    assert farthest_hidden(chart, high, low, scans_of(seen)).shape == (0, 2)
