# SPDX-License-Identifier: MIT
"""Report of a completion: what was measured, what was inferred from it, and how sure that is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from completion.export import display_mesh
from completion.extension import Patch
from completion.pipeline import Completion
from completion.verification import Verification
from nbv.plots import range_colours
from nbv.report.camera import Camera, aside_cameras, overview_cameras
from nbv.report.drawing import Canvas, Layer, mark_inferred, mark_unknown, passes_hidden
from nbv.report.edit_blocks import edit_sections
from nbv.report.page import (
    Bar,
    Block,
    Cell,
    Gallery,
    Headline,
    Legend,
    Page,
    Section,
    Share,
    State,
    Table,
    Text,
    count,
    square_metres,
)
from nbv.report.picture import Picture, picture_of, segment_pixels, surface_colour, upright
from nbv.report.verification_blocks import verification_sections
from scenes.checks import BoolArray, FloatArray
from scenes.mesh import Appearance, LabelledMesh
from scenes.projection import SphericalProjection
from scenes.range_image import RangeImage

_WIDTH, _TRIAL_WIDTH = 760, 96
_MOST_SCANS = 3  # of which pictures are shown
_CAMERA_LIKE = np.radians(80.0)  # field of view up to which a step aside shows what a scan saw
_INFERRED = 1  # surface of inferred faces in the mesh for display


def completion_page(
    completion: Completion,
    title: str,
    options: Mapping[str, Any],
    seed: int,
    n_threads: int | None = None,
    verification: Verification | None = None,
) -> Page:
    """Return the report of one completion, with what later scans say of the first one's, if that is known."""
    observed, inferred = completion.observed_m2, completion.hypothesised_m2
    violation = completion.free_space_violation_m2
    headlines = (
        Headline(square_metres(observed), "m\u00b2", "measured surface", "measured"),
        Headline(square_metres(inferred), "m\u00b2", "inferred behind occluders", "inferred"),
        Headline(str(len(completion.patches)), "", "surfaces recognised"),
        Headline(square_metres(violation), "m\u00b2", "inferred where a beam went through"),
    )
    return Page(
        title=title,
        kicker="Completion report",
        summary=_summary(completion),
        headlines=headlines,
        bar=area_bar(completion),
        sections=(
            Section("Before and after", before_and_after(completion, n_threads)),
            Section("What the scanner saw", scan_pictures(completion)),
            Section("Surfaces", surface_blocks(completion)),
            *edit_sections(completion),
            *verification_sections(completion, verification),
        ),
        options=options,
        seed=seed,
    )


def _summary(completion: Completion) -> str:
    observed, inferred = completion.observed_m2, completion.hypothesised_m2
    scans = count(len(completion.observations), "scan")
    if not completion.patches:
        return f"No surface was recognised in {scans}, so nothing was inferred."
    share = f" (+{100 * inferred / observed:.1f} %)" if observed > 0 else ""
    text = (
        f"{scans[0].upper()}{scans[1:]} measured {square_metres(observed)} m\u00b2 on "
        f"{count(len(completion.patches), 'surface')}; "
        f"{square_metres(inferred)} m\u00b2 more{share} were inferred where something stood in front."
    )
    violation = completion.free_space_violation_m2
    if not inferred:
        return text
    if violation == 0:
        return text + " No measured beam passes through what was inferred."
    return text + f" Of that, {square_metres(violation)} m\u00b2 contradict a measured beam."


def area_bar(completion: Completion) -> Bar:
    """Measured against inferred area."""
    pairs: tuple[tuple[State, float], ...] = (
        ("measured", completion.observed_m2),
        ("inferred", completion.hypothesised_m2),
    )
    total = max(sum(area for _, area in pairs), 1e-12)
    return Bar(
        "",
        tuple(Share(name, name, area / total, f"{square_metres(area)} m\u00b2") for name, area in pairs),
    )


def scan_pictures(completion: Completion) -> tuple[Block, ...]:
    """Colour, range and surfaces of the first scans, as the scanner saw them."""
    blocks: list[Block] = []
    pairs = list(zip(completion.observations, completion.owners, strict=True))
    for seen, owner in pairs[:_MOST_SCANS]:
        pictures = []
        view = partial(upright, projection=seen.scan.projection)
        name = "" if len(pairs) == 1 else f"{seen.scan.name}: "
        if seen.scan.colour is not None:
            colour = np.nan_to_num(view(seen.scan.colour))
            pictures.append(picture_of(colour, f"{name}Colour"))
        colours, low, high = range_colours(view(seen.scan.ranges))
        scale = f"{low:.2f} m (yellow) to {high:.2f} m (violet); empty where nothing came back."
        pictures.append(picture_of(colours, f"{name}Range", scale))
        segments = segment_pixels(view(owner), view(seen.valid))
        pictures.append(
            picture_of(segments, f"{name}Surfaces", "Coloured as in the table below; grey belongs to none.")
        )
        blocks.append(Gallery(tuple(pictures), columns=len(pictures)))
    if len(pairs) > _MOST_SCANS:
        blocks.append(Text(f"The other {len(pairs) - _MOST_SCANS} scans are not shown.", is_note=True))
    return tuple(blocks)


def before_and_after(completion: Completion, n_threads: int | None = None) -> tuple[Block, ...]:
    """The model as measured, with inferred area, and with inferred area marked, from the same viewpoint."""
    scans = [seen.scan.transformed(completion.world_from_reference) for seen in completion.observations]
    mesh = display_mesh(completion)
    if not len(mesh.faces):
        return (Text("There is no surface to show."),)
    stage = _Stage.of(mesh, scans, n_threads)
    single = _is_single_camera(scans)
    cameras = aside_cameras(scans[0]) if single else overview_cameras(solid_bounds(mesh))
    best = max(range(len(cameras)), key=lambda k: stage.shown(cameras[k]))
    opposite = best ^ 1 if single else (best + len(cameras) // 2) % len(cameras)
    where = "Seen from a step aside of the scanner." if single else "Seen from outside, near walls left out."
    pictures = stage.shoot(cameras[best], where)
    turned = replace(stage.shoot(cameras[opposite], "")[2], caption="The same from the other side.")
    return Legend(), Gallery((*pictures, turned), 2)


def _is_single_camera(scans: list[RangeImage]) -> bool:
    """Tell whether there is one scan, and that of no more than a camera would see."""
    if len(scans) != 1:
        return False
    projection = scans[0].projection
    if isinstance(projection, SphericalProjection):
        spans = np.ptp(projection.azimuths), np.ptp(projection.elevations)
        return bool(max(spans) <= _CAMERA_LIKE)
    return True


@dataclass(frozen=True, slots=True, eq=False)
class _Stage:
    """The model with and without inferred area, ready for drawing."""

    before: Canvas
    after: Canvas
    scans: list[RangeImage]

    @classmethod
    def of(cls, mesh: LabelledMesh, scans: list[RangeImage], n_threads: int | None) -> _Stage:
        front = fronts(mesh, scans)
        kept = np.flatnonzero(mesh.face_surface != _INFERRED)
        before = Canvas(part_of(mesh, kept), front[kept], n_threads)
        return cls(before, Canvas(mesh, front, n_threads), scans)

    def is_inferred(self, layer: Layer) -> BoolArray:
        """Pixels that show inferred area."""
        labels = self.after.mesh.face_surface
        return np.asarray(layer.hit & (labels[np.maximum(layer.face, 0)] == _INFERRED), dtype=np.bool_)

    def shown(self, camera: Camera) -> tuple[int, int]:
        """How much inferred area, and how much at all, a camera shows."""
        layer = self.after.look(camera, camera.shape(_TRIAL_WIDTH))
        return int(self.is_inferred(layer).sum()), int(layer.hit.sum())

    def shoot(self, camera: Camera, where: str) -> tuple[Picture, Picture, Picture]:
        """Return the pictures before, after, and after with inferred area marked."""
        shape = camera.shape(_WIDTH)
        beside = not _is_single_camera(self.scans) and len(self.scans) > 1
        bounds = _inner(solid_bounds(self.after.mesh))
        first, last = self.before.look(camera, shape), self.after.look(camera, shape)
        hidden = passes_hidden(camera, ~first.hit, self.scans, bounds, beside_counts=beside)
        inferred, colour = self.is_inferred(last), self.after.colour(last)
        unknown_before, unknown_after = (hidden | inferred) & ~first.hit, hidden & ~last.hit
        marked = mark_inferred(colour, inferred, self.after.shade(last))
        return (
            picture_of(mark_unknown(self.before.colour(first), unknown_before), "Measured.", where),
            picture_of(
                mark_unknown(colour, unknown_after), "Completed.", "With what was inferred, texture and all."
            ),
            picture_of(
                mark_unknown(marked, unknown_after),
                "Completed, marked.",
                "What was inferred is blue; nothing is known where it is hatched.",
            ),
        )


def _inner(bounds: FloatArray) -> FloatArray:
    """Return a box 1 % smaller, so that its own walls hide nothing in it."""
    inner: FloatArray = bounds.mean(axis=0) + 0.99 * (bounds - bounds.mean(axis=0))
    return inner


def solid_bounds(mesh: LabelledMesh) -> FloatArray:
    """Bounds (2, 3) of the mesh without its most remote half percents."""
    return np.quantile(mesh.vertices, [0.005, 0.995], axis=0)


def fronts(mesh: LabelledMesh, scans: list[RangeImage]) -> FloatArray:
    """Normals (m, 3) of the faces' fronts: a single scanner's side where measured, else the winding's."""
    normals = mesh.face_normals()
    if len(scans) != 1:
        return normals
    towards = scans[0].origin - mesh.corners.mean(axis=1)
    away = np.einsum("ij,ij->i", normals, towards) < 0
    normals[away & (mesh.face_surface != _INFERRED)] *= -1
    return normals


def part_of(mesh: LabelledMesh, kept: Any) -> LabelledMesh:
    """Return the mesh with some of its faces."""
    look = mesh.appearance
    part = None
    if look is not None:
        part = Appearance(
            look.corner_colour[kept],
            look.images,
            None if look.face_image is None else look.face_image[kept],
            None if look.corner_uv is None else look.corner_uv[kept],
        )
    return LabelledMesh(mesh.vertices, mesh.faces[kept], mesh.face_surface[kept], part)


def surface_blocks(completion: Completion) -> tuple[Block, ...]:
    """A row for each surface."""
    if not completion.patches:
        return (Text("None was recognised."),)
    rows = tuple(_row(number, patch) for number, patch in enumerate(completion.patches, start=1))
    columns = ("Surface", "Kind", "#measured, m\u00b2", "#inferred, m\u00b2", "#rms, mm", "#radius, mm")
    note = (
        "rms: distance of the measured points from the fitted surface. Radii carry their standard deviation "
        "from the fit. Inferred area is a hypothesis: completion.json says why each boundary ends there."
    )
    return Table(columns, rows), Text(note, is_note=True)


def _row(number: int, patch: Patch) -> tuple[Cell, ...]:
    fit = patch.source.fit
    whole = max(patch.observed_m2 + patch.hypothesised_m2, 1e-12)
    radius = getattr(fit.surface, "radius", None)
    spread = fit.parameter_deviations().get("radius")
    text = "" if radius is None else f"{1000 * radius:.1f}"
    if isinstance(spread, float):
        text += f" \u00b1 {1000 * spread:.2g}"
    return (
        Cell(str(number), swatch=surface_colour(number)),
        Cell(fit.surface.kind),
        Cell(square_metres(patch.observed_m2), share=patch.observed_m2 / whole, state="measured"),
        Cell(square_metres(patch.hypothesised_m2), share=patch.hypothesised_m2 / whole, state="inferred"),
        Cell(f"{1000 * fit.rms:.2f}" if fit.rms >= 5e-6 else "<0.01"),
        Cell(text),
    )
