# SPDX-License-Identifier: MIT
"""DXF: facets, folds, corners, openings, a plan and sections on layers that are measured or inferred."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import ezdxf
import numpy as np
from ezdxf.document import Drawing
from ezdxf.layouts import Modelspace
from ezdxf.math import Matrix44
from numpy.typing import NDArray

from completion.export.building.cut import CutLine, UprightCut, plan_of, sections_of
from completion.export.building.limits import NEARLY_ALL
from completion.export.building.model import BuildingModel, matrix_text
from completion.export.dimension import Dimension
from completion.export.room_dimensions import RoomStamp, told_area
from scenes.checks import FloatArray
from scenes.io.formats.format import METRES_PER_UNIT, Units

_VERSION = "R2010"  # what current CAD programs and those of fifteen years ago read
_APP = "UNSEEN"  # name of the extended data: what a program that does not know it leaves alone
_WHITE, _BLUE, _RED, _GREEN, _GREY, _MAGENTA = 7, 5, 1, 3, 8, 6  # colours by index
_DASH = 0.2  # of the line type's own length, 0.6 m
_AT = 0.3  # along a dimension, where its text is: those of two widths cross in the middle
_TEXT_M, _GAP_M = 0.15, 1.0  # height of titles; between the plan and the sections beside it
_UNITS = {"in": 1, "ft": 2, "mm": 4, "cm": 5, "m": 6, "us-ft": 21}  # of $INSUNITS, DXF reference 2018
_INVISIBLE = (1, 2, 8)  # flags of the edges of a 3DFACE whose fourth corner is the third again


def dxf_of(
    model: BuildingModel,
    units: Units = "m",
    widths: Sequence[Dimension] = (),
    stamps: Sequence[RoomStamp] = (),
) -> bytes:
    """Return a model as DXF (AutoCAD 2010) in a unit of length; the same model gives the same bytes.

    `widths` become dimensions (DIMENSION-MEASURED, DIMENSION-INFERRED), `stamps` texts (ROOM).
    Model space holds, where they are, facets (3DFACE on MEASURED-<KIND> and INFERRED-<KIND>; edges between
    two of one surface and state are invisible), folds (FOLD-MEASURED: at least 95 % of the length was
    measured on both sides; else FOLD-INFERRED), corners (points on CORNER), outlines of openings (OPENING)
    and the plan (PLAN-MEASURED, PLAN-INFERRED, PLAN-REST) at its height, and outlines of things
    (THING-MEASURED, THING-INFERRED, THING-UNKNOWN). Sections (SECTION-...) lie flat
    beside it. Extended data "UNSEEN" holds the surface and provenance of a facet, the surfaces, measured
    share and deviation of a fold, the deviation of a corner, and the surface of a line. Where the drawing is
    turned against the scans' world, the custom property `drawing_from_world` says how, row by row.
    """
    with fixed_marks():
        document = ezdxf.new(_VERSION, setup=["linetypes"])
        document.units = _UNITS[units]
        document.header["$MEASUREMENT"] = int(units in ("mm", "cm", "m"))
        document.appids.add(_APP)
        if matrix := matrix_text(model.drawing_from_world):
            document.header.custom_vars.append("drawing_from_world", matrix)
        space = document.modelspace()
        _add_facets(space, model)
        _add_folds(space, model)
        _add_openings(space, model)
        _add_things(space, model)
        plan, sections = plan_of(model), sections_of(model)
        _add_lines(space, plan.lines, "PLAN")
        told = plan.caption if units == "m" else f"{plan.caption} The drawing is in {units}."
        _add_sections(space, model, sections, told)
        metre = 1 / METRES_PER_UNIT[units]
        _scale(space, metre)
        _add_dimensions(space, widths, metre)
        _add_stamps(space, stamps, metre)
        _finish(document, model, metre)
        for kind in sorted(document.entitydb.dxf_types_in_use()):  # the library would go by a set's order
            document.classes.add_class(kind)
        text = io.StringIO()
        document.write(text)
    return document.encode(text.getvalue())


def _add_facets(space: Modelspace, model: BuildingModel) -> None:
    hidden = _inner_edges(model)
    for face, edges, number, why in zip(
        model.vertices[model.faces].tolist(),
        hidden.tolist(),
        model.surface.tolist(),
        model.provenance.tolist(),
        strict=True,
    ):
        flags = sum(flag for flag, inner in zip(_INVISIBLE, edges, strict=True) if inner)
        layer = f"{'INFERRED' if why else 'MEASURED'}-{model.kinds[number].upper()}"
        entity = space.add_3dface([*face, face[2]], dxfattribs={"layer": layer, "invisible_edges": flags})
        entity.set_xdata(_APP, [(1071, number), (1071, why)])


def _add_folds(space: Modelspace, model: BuildingModel) -> None:
    for fold in model.folds:
        state = "MEASURED" if fold.measured_share >= NEARLY_ALL else "INFERRED"
        entity = space.add_polyline3d(fold.points.tolist(), dxfattribs={"layer": f"FOLD-{state}"})
        numbers = [(1071, number) for number in fold.surfaces]
        entity.set_xdata(_APP, [*numbers, (1040, fold.measured_share), (1041, fold.sd_m)])
    for place, sd in zip(model.corners.tolist(), model.corner_sd_m.tolist(), strict=True):
        space.add_point(place, dxfattribs={"layer": "CORNER"}).set_xdata(_APP, [(1041, sd)])


def _add_openings(space: Modelspace, model: BuildingModel) -> None:
    for opening in model.openings:
        entity = space.add_polyline3d(opening.points.tolist(), close=True, dxfattribs={"layer": "OPENING"})
        sizes = [(1041, opening.width_m), (1041, opening.height_m)]
        entity.set_xdata(_APP, [(1071, opening.surface), (1000, opening.kind), *sizes])


def _add_things(space: Modelspace, model: BuildingModel) -> None:
    """Outlines of things on what they stand on."""
    for thing in model.things:
        level = float(thing.vertices[:, 2].min())
        for state, line in thing.outline:
            how = {"layer": f"THING-{state.upper()}", "elevation": level}
            space.add_lwpolyline(line.tolist(), dxfattribs=how).set_xdata(_APP, [(1071, thing.number)])


def _add_lines(space: Modelspace, lines: Sequence[CutLine], name: str) -> None:
    for line in lines:
        state = ("MEASURED" if line.is_measured else "INFERRED") if line.surface else "REST"
        level = float(line.points[0, 2])
        entity = space.add_lwpolyline(
            line.points[:, :2].tolist(), dxfattribs={"layer": f"{name}-{state}", "elevation": level}
        )
        entity.set_xdata(_APP, [(1071, line.surface)])


def _add_sections(
    space: Modelspace, model: BuildingModel, sections: Sequence[UprightCut], plan_told: str
) -> None:
    """Sections flat below the plan, one under the other, and where they cut as lines in it."""
    drawn = model.drawn
    if not len(drawn):
        return _add_text(space, plan_told, np.zeros(2))
    (left, bottom, _), (_, top, _) = drawn.min(axis=0), drawn.max(axis=0)
    _add_text(space, plan_told, np.array([left, top + 5 * _TEXT_M]))
    for section in sections:
        reach = (drawn - section.point) @ section.along
        ends = section.point[:2] + np.outer([reach.min() - 0.3, reach.max() + 0.3], section.along[:2])
        space.add_line(ends[0].tolist(), ends[1].tolist(), dxfattribs={"layer": "SECTION-PLACE"})
        for end in ends:
            _add_text(space, section.name, end, "SECTION-PLACE")
        heights = np.concatenate([line.points[:, 2] for line in section.lines] or [section.point[2:]])
        bottom -= _GAP_M + float(np.ptp(heights))
        move = np.array([left - reach.min(), bottom - heights.min()])
        _add_lines(space, [_flat(line, section, move) for line in section.lines], "SECTION")
        title = f"Section {section.name} - {section.name}"
        _add_text(space, title, np.array([left, bottom - 2 * _TEXT_M]))
    return None


def _flat(line: CutLine, section: UprightCut, move: FloatArray) -> CutLine:
    """A line of a section laid into the plane z = 0, moved: to the right along it, upwards as height."""
    right = (line.points - section.point) @ section.along
    points = np.column_stack([right + move[0], line.points[:, 2] + move[1], np.zeros(len(right))])
    return CutLine(points, line.surface, line.kind, line.is_measured)


def _add_text(space: Modelspace, text: str, place: FloatArray, layer: str = "TEXT") -> None:
    space.add_text(text, height=_TEXT_M, dxfattribs={"layer": layer, "insert": (*place.tolist(), 0.0)})


def _scale(space: Modelspace, metre: float) -> None:
    """Scale all to the unit of which a metre has `metre`."""
    for entity in space if metre != 1 else ():
        entity.transform(Matrix44.scale(metre))


def _add_dimensions(space: Modelspace, widths: Sequence[Dimension], metre: float) -> None:
    """Widths of rooms as dimensions, in the unit of which a metre has `metre`."""
    for width in widths:
        state = "MEASURED" if width.measured_share == 1 else "INFERRED"
        axis = int(np.abs(width.ends[1] - width.ends[0]).argmax())  # text reads from below or from the right
        ends = metre * width.ends[np.argsort(width.ends[:, axis])]
        along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        digits, size = 3 if metre == 1 else 1, metre * _TEXT_M
        text = f"{metre * width.value:.{digits}f}"
        if np.isfinite(width.half):
            step = 10.0**-digits
            text += f" %%p{max(np.ceil(metre * width.half / step - 1e-9) * step, step):.{digits}f}"
        style = {"dimtxt": size, "dimasz": 0.6 * size, "dimgap": 0.3 * size, "dimtad": 1, "dimexo": 0.0}
        how = {"layer": f"DIMENSION-{state}"}
        drawn = space.add_aligned_dim(
            ends[0].tolist(), ends[1].tolist(), 0.0, text, override=style, dxfattribs=how
        )
        beside = 0.8 * size * np.array([-along[1], along[0], 0.0])
        drawn.set_location((ends[0] + _AT * (ends[1] - ends[0]) + beside).tolist(), relative=False)
        drawn.render()
        drawn.dimension.set_xdata(
            _APP, [*((1071, number) for number in width.surfaces), (1040, width.low), (1040, width.high)]
        )


def _add_stamps(space: Modelspace, stamps: Sequence[RoomStamp], metre: float) -> None:
    """Name, area and height of each closed room, a line each, beside its middle, where widths are."""
    for stamp in stamps:
        lines = [stamp.name, told_area(stamp.area)]
        lines += [] if stamp.height_m is None else [f"height {stamp.height_m:.2f} m"]
        for k, text in enumerate(lines):
            x, y, z = stamp.area.ends[0] + _TEXT_M * np.array([2.0, -2.5 - 1.6 * k, 0.0])
            how = {"layer": "ROOM", "insert": (metre * x, metre * y, metre * z)}
            space.add_text(text, height=metre * _TEXT_M, dxfattribs=how)


def _finish(document: Drawing, model: BuildingModel, metre: float) -> None:
    """Say how layers look, and where to look first, in the unit of which a metre has `metre`."""
    space = document.modelspace()
    document.header["$LTSCALE"] = _DASH * metre
    for name in sorted({entity.dxf.layer for entity in space}):
        dashed = (
            "DASHED"
            if "INFERRED" in name
            else "DOT"
            if "UNKNOWN" in name
            else "CENTER"
            if name == "SECTION-PLACE"
            else "CONTINUOUS"
        )
        colour = {"OPENING": _GREEN, "CORNER": _MAGENTA, "FOLD-MEASURED": _RED}.get(name, _WHITE)
        colour = _BLUE if "INFERRED" in name else _GREY if "REST" in name or "UNKNOWN" in name else colour
        heavy = 50 if name in ("PLAN-MEASURED", "SECTION-MEASURED") else 25
        document.layers.add(name, color=colour, linetype=dashed, lineweight=heavy)
    if len(model.faces):
        low, high = metre * model.drawn.min(axis=0), metre * model.drawn.max(axis=0)
        extents = tuple(low.tolist()), tuple(high.tolist())
        space.reset_extents(*extents)  # the header is written from these, unless they begin at 0, 0, 0
        document.header["$EXTMIN"], document.header["$EXTMAX"] = extents
        middle, size = (low + high) / 2, float((high - low)[:2].max())
        document.set_modelspace_vport(1.5 * size, (float(middle[0]), float(middle[1])))


def _inner_edges(model: BuildingModel) -> NDArray[np.bool_]:
    """Which edges (m, 3) of the facets part two of one surface and one state."""
    corners = model.faces
    edges = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=2), axis=2).reshape(-1, 2)
    face_states = np.repeat(np.column_stack([model.surface, ~model.is_measured]), 3, axis=0)
    _, index, count = np.unique(
        np.column_stack([edges, face_states]), axis=0, return_inverse=True, return_counts=True
    )
    return np.asarray(count[index.ravel()] > 1).reshape(-1, 3)


@contextmanager
def fixed_marks() -> Iterator[None]:
    """No dates and identifiers of a run in what is written."""
    options = ezdxf.options
    before = options.write_fixed_meta_data_for_testing
    options.write_fixed_meta_data_for_testing = True
    try:
        yield
    finally:
        options.write_fixed_meta_data_for_testing = before
