# SPDX-License-Identifier: MIT
"""Report of the unseen sides of a part: pictures, the symmetries that were tested, and the inferred faces."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from completion.parts.backs.pipeline import PartBack
from completion.parts.division.result import thin_points
from completion.parts.part import Part
from nbv.report.blocks.page import Block, Cell, Gallery, PageSection, Table, Text
from nbv.report.figures.part_drawing import PartDrawing
from nbv.report.figures.picture import INFERRED, MEASURED, Camera, Picture, overview_cameras
from nbv.report.viewer.part_view import point_squares, shown_part
from nbv.run.wording import percent
from scenes.checks import FloatArray, IntArray
from scenes.mesh.labelled_mesh import LabelledMesh

_MOST_ROWS, _MOST_POINTS, _TRIAL_WIDTH = 12, 40_000, 96
_HEIGHTS_DEG = 38.0, -38.0


def back_sections(part: Part, back: PartBack) -> tuple[PageSection, ...]:
    """Return the section of the unseen sides."""
    sentence = back.told[:1].upper() + back.told[1:] + "."
    blocks: list[Block] = [Text(sentence)]
    if back.places is not None:
        blocks.append(Gallery(back_pictures(part, back), 2))
    if back.hypotheses:
        blocks.append(_hypotheses(back))
    if back.faces:
        blocks.append(_faces(back))
    note = (
        "matched: share of the mirrored or turned surface that falls on measured surface of the same kind, "
        "within joint standard deviations; refuted: that a scanner looked through, or outside the outline of "
        "what it saw; unseen: behind what was measured. Inferred surface was never measured."
    )
    return (PageSection("Unseen sides", (*blocks, Text(note, is_note=True))),)


def _hypotheses(back: PartBack) -> Table:
    """A row for each of the most probable symmetries."""
    rows = []
    for one in back.hypotheses[:_MOST_ROWS]:
        e, way = one.evidence, ", ".join(f"{value + 0.0:.2f}" for value in one.direction)
        taken = one in back.chosen
        rows.append(
            (
                Cell("mirror plane" if one.kind == "mirror" else "axis"),
                Cell(one.relation),
                Cell(way),
                Cell(", ".join(map(str, one.surfaces))),
                *(Cell(percent(share)) for share in (e["matched"], e["free"] + e["beside"], e["hidden"])),
                Cell(percent(one.probability), state="inferred" if taken else ""),
                Cell("asserted" if taken else "not asserted"),
            )
        )
    return Table(
        ("Symmetry", "Relation", "Direction", "Of surfaces", "#matched, %", "#refuted, %", "#unseen, %",
         "#probability, %", "Result"), tuple(rows),
    )  # fmt: skip


def _faces(back: PartBack) -> Table:
    """A row for each inferred face, or rest of one."""
    rows = [
        (
            Cell(str(face.label)),
            Cell(face.surface.kind),
            Cell("new" if face.is_new else "goes on from what was measured", state="inferred"),
            Cell(f"{face.provenance} of surface {face.of}"),
            Cell(f"{1e4 * face.area_m2:.3g}"),
            Cell(f"{1000 * face.sd_m:.2g}"),
            Cell(percent(face.probability)),
        )
        for face in back.faces
    ]
    return Table(
        (
            "Surface",
            "Kind",
            "Inferred",
            "By",
            "#area, cm\u00b2",
            "#standard deviation, mm",
            "#probability, %",
        ),
        tuple(rows),
    )


def back_pictures(part: Part, back: PartBack) -> tuple[Picture, ...]:
    """Return pictures from the sides that show most and least of inferred surface."""
    shown = shown_part(part)
    parts = [(shown.mesh.vertices, shown.mesh.faces, MEASURED)]
    if back.places is not None:
        kept = thin_points(back.places.points, _MOST_POINTS)
        mesh = point_squares(back.places.points[kept], back.places.normals[kept])
        parts.append((mesh.vertices, mesh.faces, INFERRED))
    drawing = _drawing_of(parts)
    cameras = [
        one for height in _HEIGHTS_DEG for one in overview_cameras(drawing.mesh.bounds(), height_deg=height)
    ]
    share = [_inferred_pixels(drawing, camera) for camera in cameras]
    best, least = cameras[int(np.argmax(share))], cameras[int(np.argmin(share))]
    caption = "Grey was measured, blue is inferred."
    return (
        drawing.picture(best, "From the side that shows most of it.", caption),
        drawing.picture(least, "From the side that shows least of it.", caption),
    )


def _drawing_of(parts: Sequence[tuple[FloatArray, IntArray, tuple[float, float, float]]]) -> PartDrawing:
    """A drawing of meshes, each of vertices, triangles and one colour, by the numbers 1, 2, ..."""
    first = np.cumsum([0, *(len(vertices) for vertices, _, _ in parts)])
    faces = np.concatenate([faces + start for (_, faces, _), start in zip(parts, first[:-1], strict=True)])
    n = [len(faces) for _, faces, _ in parts]
    colour = np.repeat(np.array([colour for _, _, colour in parts]), n, axis=0)
    mesh = LabelledMesh(np.concatenate([vertices for vertices, _, _ in parts]), faces.astype(np.int32))
    place = np.repeat(np.arange(1, len(parts) + 1), n)
    return PartDrawing(mesh, place, np.repeat(colour[:, None], 3, axis=1))


def _inferred_pixels(drawing: PartDrawing, camera: Camera) -> int:
    """How much of inferred surface a camera sees."""
    _, seen = drawing.look(camera, _TRIAL_WIDTH)
    return int((drawing.place[seen.face[seen.hit]] == len(np.unique(drawing.place))).sum())
