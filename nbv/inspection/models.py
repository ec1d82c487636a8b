# SPDX-License-Identifier: MIT
"""A check as models: points by deviation, the design by verdict, the IFC file with more properties."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

import numpy as np

from completion.asbuilt.findings import POINT_STATES, DesignCheck, ElementFinding
from nbv.inspection.record import element_label
from nbv.inspection.verdict_colours import EXTRA_COLOUR, VERDICT_COLOURS, rgb_of
from scenes.checks import ColourArray, FloatArray
from scenes.io.meshes.glb_writer import glb_of
from scenes.io.meshes.ifc import TypedValue, write_ifc_properties
from scenes.io.meshes.ply_writer import write_mesh_ply
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.mesh.mesh_parts import MeshPart, parts_of
from scenes.run.atomic import write_bytes

_BEFORE, _BEHIND, _LEVEL = (
    np.array(rgb_of(c)) for c in ("#b2182b", "#2166ac", "#f7f7f7")
)  # RdBu, ColorBrewer
_NOT_COMPARED = np.array(rgb_of("#9a9a9a"))
_FULL_COLOUR = 2.0  # tolerances
_QUADS = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
_BOX_FACES = np.array([(q[0], q[k], q[k + 1]) for q in _QUADS for k in (1, 2)], np.int64)


def write_deviation_ply(path: str | PathLike[str], check: DesignCheck) -> None:
    """Write the points of a check as PLY: x, y, z in double precision, colours, and what is known of each.

    `element` is the surface id, -1 for none; `deviation_m` how far it is before the design's surface, NaN for
    none; `state` an index of `POINT_STATES`. Red is before the surface, blue behind it, in full at twice the
    element's tolerance; extras have their colour, the rest is grey. Comments name states and elements.

    Raises InputError: the file cannot be written.
    """
    cloud = check.cloud
    red, green, blue = deviation_colours(check).T
    properties = {
        "element": cloud.element.astype(np.int32),
        "deviation_m": cloud.deviation_m.astype(np.float32),
        "state": cloud.state.astype(np.uint8),
        "red": red,
        "green": green,
        "blue": blue,
    }
    comments = [
        "metres, in the frame of the design; deviation_m along outward normals",
        *(f"state {k} {name}" for k, name in enumerate(POINT_STATES)),
        *(
            f"element {k} {' '.join(f'{element_label(one)} {one.global_id}'.split())}"
            for k, one in enumerate(check.design.elements)
        ),
    ]
    write_mesh_ply(path, cloud.points, vertex_properties=properties, comments=comments)


def deviation_colours(check: DesignCheck) -> ColourArray:
    """Return sRGB (n, 3) uint8 of a check's points by their deviation over the tolerance of their element."""
    cloud = check.cloud
    tolerance = np.full(len(check.design.elements) + 1, np.nan)  # the last: of no element
    for finding in check.elements:
        tolerance[finding.surface] = finding.tolerance_m
    share = np.clip(cloud.deviation_m / (_FULL_COLOUR * tolerance[cloud.element]), -1, 1)[:, None]
    known = np.isfinite(share)
    share = np.where(known, share, 0.0)
    colours = _LEVEL + np.abs(share) * (np.where(share > 0, _BEFORE, _BEHIND) - _LEVEL)
    colours = np.where(known, colours, _NOT_COMPARED)
    colours[cloud.state == POINT_STATES.index("extra")] = rgb_of(EXTRA_COLOUR)
    painted: ColourArray = np.rint(255 * colours).astype(np.uint8)
    return painted


def write_design_glb(path: str | PathLike[str], check: DesignCheck) -> None:
    """Write the design as GLB, y up: a node an element by its class and name, coloured by verdict.

    Extras are boxes. Elements that were not checked have the colour of those that are not tested.

    Raises InputError: the file cannot be written.
    """
    design, verdicts = check.design, {finding.surface: finding.verdict for finding in check.elements}
    plain = LabelledMesh(design.mesh.vertices, design.mesh.faces, design.mesh.face_surface)
    names = _unique([element_label(one) or f"element {k}" for k, one in enumerate(design.elements)])
    parts = [
        _painted(part, VERDICT_COLOURS[verdicts.get(part.surface, "not tested")])
        for part in parts_of(plain, names)
    ]
    for extra in check.extra:
        box = MeshPart(extra.name, _corners(extra.box_m), _BOX_FACES, -1)
        parts.append(_painted(box, EXTRA_COLOUR))
    write_bytes(path, glb_of(parts))


def _unique(names: list[str]) -> list[str]:
    """Names, numbered where others have them before."""
    taken: dict[str, int] = {}
    told = []
    for name in names:
        taken[name] = taken.get(name, 0) + 1
        told.append(name if taken[name] == 1 else f"{name} ({taken[name]})")
    return told


def _corners(box_m: FloatArray) -> FloatArray:
    """Corners (8, 3) of a box (2, 3)."""
    x, y, z = box_m.T
    return np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1).reshape(-1, 3)


def _painted(part: MeshPart, colour: str) -> MeshPart:
    rgb = np.rint(255 * np.array(rgb_of(colour))).astype(np.uint8)
    return MeshPart(part.name, part.vertices, part.faces, part.surface, np.tile(rgb, (len(part.vertices), 1)))


def write_ifc_copy(path: str | PathLike[str], source: str | PathLike[str], check: DesignCheck) -> int:
    """Write a copy of the design's IFC file with a property set `Unseen_Check` for each element.

    Lengths are in the file's unit; what is not known is left out. Returns how many elements have one now.

    Raises InputError: the source cannot be read, or the file cannot be written.
    """
    held = {one.element.global_id: _properties(one) for one in check.elements if one.element.global_id}
    return write_ifc_properties(Path(source), Path(path), "Unseen_Check", held)


def _properties(finding: ElementFinding) -> dict[str, TypedValue]:
    """What the property set of an element holds."""
    offset = finding.offset
    given: dict[str, TypedValue | None] = {
        "Verdict": ("IfcLabel", finding.verdict),
        "Kind": ("IfcLabel", finding.kind) if finding.kind else None,
        "Tolerance": ("IfcLengthMeasure", finding.tolerance_m),
        "Offset": None if offset is None else ("IfcLengthMeasure", offset.value),
        "OffsetLow": None if offset is None else ("IfcLengthMeasure", offset.low),
        "OffsetHigh": None if offset is None else ("IfcLengthMeasure", offset.high),
        "MeasuredShare": ("IfcNormalisedRatioMeasure", min(max(finding.share.measured, 0.0), 1.0)),
        "LOA": ("IfcLabel", finding.loa_represented) if finding.loa_represented else None,
        "Sentence": ("IfcText", finding.sentence) if finding.sentence else None,
    }
    return {name: value for name, value in given.items() if value is not None}
