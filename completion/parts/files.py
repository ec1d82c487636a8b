# SPDX-License-Identifier: MIT
"""Files of a part: part.json, dimensions.csv, relations.json, part.ply and backs.ply."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from completion.export.step.pipeline import StepModel
from completion.flattening.flat import flat_record
from completion.parts.backs.assertion import Places
from completion.parts.backs.pipeline import PartBack
from completion.parts.closing import ClosedPart
from completion.parts.dimensions.dimension import PartDimensions
from completion.parts.dimensions.pipeline import dimensions_of
from completion.parts.dimensions.table import blend_records, dimension_records, dimensions_csv, frame_record
from completion.parts.flat_part import FlatPart
from completion.parts.part import Part
from completion.parts.part_features import features_of
from completion.parts.profiles.drawing import drawn_sheet
from completion.parts.profiles.profile import Profile, profile_record
from completion.parts.profiles.sheet_files import sheet_dxf, sheet_svg
from completion.relations.graph import FORMAT as RELATIONS_FORMAT
from completion.relations.graph import frame_records, freedom_record, relation_records, surface_record
from completion.relations.relation import RelationStatus
from scenes.checks import IntArray
from scenes.io.meshes.ply_writer import write_mesh_ply
from scenes.run.atomic import Stage, hold_lock, make_folder, write_bytes, write_json, write_text
from scenes.scan.colour import surface_bytes

FORMAT = "unseen-part/1"
PROFILES_FORMAT = "unseen-profiles/1"
_LEGEND = ["surface 0 none"]


def write_part(
    part: Part,
    folder: str | PathLike[str],
    *,
    rows: IntArray | None = None,
    n_rows: int | None = None,
    flat: FlatPart | None = None,
    step: StepModel | None = None,
    closed: ClosedPart | None = None,
    back: PartBack | None = None,
    dimensions: PartDimensions | None = None,
    profiles: Sequence[Profile] = (),
    title: str = "part",
) -> None:
    """Write part.json, dimensions.csv, relations.json and part.ply, all or none.

    relations.json where relations were looked for, and flat.ply where the part was flattened.

    Parameters
    ----------
    part : Part
        What to write.
    folder : str or path
        Made if it is not there.
    rows : (n,) int, optional
        Place of each point among all `n_rows` of the input, where some were left out: part.ply holds these
        as well, without coordinates (NaN) and on no surface.
    flat : FlatPart, optional
        The same part flattened (`flatten_part`): flat.ply has its points, or vertices and triangles, in the
        same order, with the properties surface, relief (1 where relief stayed) and moved (metres).
    step : StepModel, optional
        The same part as STEP (`completion.parts.step_export.step_model`): part.step, and part.features.step
        where it has features.
    closed : ClosedPart, optional
        Its mesh with holes closed (`close_holes`): closed.ply, if any was.
    back : PartBack, optional
        Its unseen sides (`find_back`): backs.ply with measured and inferred points, if any was inferred.
    dimensions : PartDimensions, optional
        Its dimensions (`dimensions_of`), where they are at hand.
    profiles : sequence of Profile
        What of it is swept (`profiles_of`): profiles.json, and drawing.svg and drawing.dxf, millimetres.
    title : str
        Of the drawing.

    Raises
    ------
    InputError
        The folder cannot be made or written, or another run writes there.
    """
    target = make_folder(folder)
    with hold_lock(target), Stage(target) as stage:
        dimensions = dimensions or dimensions_of(part)
        record = part_record(part, flat)
        record["dimensions"] = dimension_records(dimensions)
        record["features"] = [one.record() for one in features_of(part, dimensions, profiles)]
        record["blends"] = blend_records(dimensions)
        record["datum_frame"] = frame_record(dimensions.frame)
        record["warnings"] = [*record["warnings"], *dimensions.doubts]
        write_text(stage.path("dimensions.csv"), dimensions_csv(dimensions))
        if closed is not None:
            record["closing"] = closing_record(closed)
            if closed.n_closed:
                _write_closed(closed, stage)
        if back is not None:
            record["backs"] = back.record()
            if back.places is not None:
                _write_back(part, back.places, stage)
        if step is not None:
            write_bytes(stage.path("part.step"), step.data)
            if step.feature_data is not None:
                write_bytes(stage.path("part.features.step"), step.feature_data)
            record["step"] = step.record()
        write_json(stage.path("part.json"), record)
        if part.relations is not None:
            write_json(stage.path("relations.json"), relations_record(part))
        if profiles:
            record = {
                "format": PROFILES_FORMAT,
                "units": "m",
                "profiles": [profile_record(one) for one in profiles],
            }
            write_json(stage.path("profiles.json"), record)
            sheet = drawn_sheet(profiles, title)
            write_bytes(stage.path("drawing.svg"), sheet_svg(sheet, title).encode())
            write_bytes(stage.path("drawing.dxf"), sheet_dxf(sheet))
        every = _Places(rows, n_rows)
        surface = every.of(part.surface, 0)
        colour = surface_bytes(places_of(part, surface))
        channels = {"surface": surface, "red": colour[:, 0], "green": colour[:, 1], "blue": colour[:, 2]}
        points = every.of(part.points, np.nan)
        write_mesh_ply(stage.path("part.ply"), points, part.faces, channels, _LEGEND)
        if flat is not None:
            channels = {
                "surface": every.of(flat.surface.astype(np.int32), 0),
                "relief": every.of(flat.is_relief.astype(np.uint8), 0),
                "moved": every.of(flat.moved_m.astype(np.float32), 0.0),
            }
            points = every.of(flat.points, np.nan)
            write_mesh_ply(stage.path("flat.ply"), points, part.faces, channels, _LEGEND)
        stage.commit()


def _write_closed(closed: ClosedPart, stage: Stage) -> None:
    """Write the mesh with its holes closed."""
    state = closed.is_inferred.astype(np.uint8)
    record = {"surface": closed.surface, "state": state}
    legend = [*_LEGEND, "state 0 measured", "state 1 inferred: nobody measured it, and no beam vetoes it"]
    write_mesh_ply(
        stage.path("closed.ply"), closed.points, closed.faces, None, legend, face_properties=record
    )


def _write_back(part: Part, places: Places, stage: Stage) -> None:
    """Write measured points and those of unseen sides, apart by their state."""
    n = len(part.points)
    channels = {
        "surface": np.concatenate([part.surface, places.label.astype(np.int32)]),
        "state": (np.arange(n + len(places.points)) >= n).astype(np.uint8),
        "origin": np.concatenate([np.zeros(n, np.uint8), places.origin]),
        "probability": np.concatenate([np.ones(n, np.float32), places.probability.astype(np.float32)]),
        "sd": np.concatenate([np.full(n, part.noise_m, np.float32), places.sd_m.astype(np.float32)]),
    }
    legend = [
        *_LEGEND, "state 0 measured", "state 1 inferred: nobody measured it, a symmetry implies it",
        "origin 0 measured, 1 symmetry, 2 turn",
    ]  # fmt: skip
    points = np.concatenate([part.points, places.points])
    write_mesh_ply(stage.path("backs.ply"), points, None, channels, legend)


def closing_record(closed: ClosedPart) -> dict[str, Any]:
    """Return what part.json holds of the holes of a mesh."""
    return {
        "borders": closed.n_holes,
        "closed": closed.n_closed,
        "inferred_m2": closed.inferred_m2,
        "left": closed.left,
        "told": closed.told,
    }


class _Places(NamedTuple):
    """Rows (n,) of the used points among the `n_rows` of the input; None if every row was used."""

    rows: IntArray | None
    n_rows: int | None

    def of(self, values: NDArray[Any], without: float) -> NDArray[Any]:
        """Values (n_rows, ...) of all rows from values (n, ...) of used points; other rows get `without`."""
        if self.rows is None or self.n_rows is None:
            return values
        out = np.full((self.n_rows, *values.shape[1:]), without, dtype=values.dtype)
        out[self.rows] = values
        return out


def places_of(part: Part, surface: IntArray) -> IntArray:
    """Positions (n,), from 1, of labels (n,) in the labels of the part; 0 for points on no surface."""
    return np.where(surface > 0, np.searchsorted(part.labels, surface) + 1, 0)


def part_record(part: Part, flat: FlatPart | None = None) -> dict[str, Any]:
    """Return what part.json holds, metres, degrees: each surface where relations hold, and as measured.

    Where it was flattened, what became of each plane and of the whole.
    """
    graph = part.relations
    moved = dict(zip(part.related, graph.moved_sd, strict=True)) if graph is not None else {}
    flattened = {} if flat is None else {surface.label: flat_record(surface) for surface in flat.surfaces}
    surfaces: list[dict[str, Any]] = []
    for place, label in enumerate(part.labels):
        fit, measured = part.fits[place], part.measured[place]
        same = [other for other, group in zip(part.labels, part.groups, strict=True)
                if group == part.groups[place] and other != label]  # fmt: skip
        surfaces.append(
            {
                **surface_record(fit, label),
                "concave": bool(getattr(fit.surface, "concave", False)),
                "points": part.n_points(label),
                "rms_m": measured.rms,
                "same_surface": same,
                "measured": surface_record(measured, label) if place in moved else None,
                "moved_sd": moved.get(place),
            }
        )
        if label in flattened:
            surfaces[-1]["flattening"] = flattened[label]
    record = {
        "format": FORMAT,
        "units": "m",
        "surfaces": surfaces,
        "points": len(part.points),
        "without_surface": int((part.surface == 0).sum()),
        "triangles": None if part.faces is None else len(part.faces),
        "noise_m": part.noise_m,
        "spacing_m": part.spacing_m,
        "relations": None if graph is None else status_counts(part),
        "degrees_of_freedom": None if graph is None else freedom_record(graph),
        "warnings": list(part.warnings),
    }
    if flat is not None:
        record["flattening"] = whole_record(flat)
        record["warnings"] = [*part.warnings, *flat.doubts]
    return record


def whole_record(flat: FlatPart) -> dict[str, Any]:
    """Return what became of a part that was flattened, all its planes together."""
    return {
        "level": flat.level,
        "planes": sum(surface.is_flattened for surface in flat.surfaces),
        "planes_left": sum(not surface.is_flattened for surface in flat.surfaces),
        "relief_points": int(flat.is_relief.sum()),
        "moved_median_m": float(np.median(flat.moved_m[flat.moved_m > 0])) if flat.moved_m.any() else 0.0,
        "moved_max_m": float(flat.moved_m.max(initial=0.0)),
        "held_points": flat.n_held,
        "turned_over": flat.n_turned,
        "crossing_anew": flat.n_crossing,
    }


def relations_record(part: Part) -> dict[str, Any]:
    """Return what relations.json holds; the surfaces are those that relations were inferred of."""
    graph = part.relations
    if graph is None:
        return {"format": RELATIONS_FORMAT, "units": "m", "surfaces": [], "relations": []}
    names = [part.labels[place] for place in part.related]
    before = [part.measured[place] for place in part.related]
    return {
        "format": RELATIONS_FORMAT,
        "units": "m",
        "surfaces": [surface_record(fit, label) for fit, label in zip(graph.fits, names, strict=True)],
        "relations": relation_records(graph, before, names, up=graph.options.up),
        "direction_frames": frame_records(graph, names),
        "degrees_of_freedom": freedom_record(graph),
    }


def status_counts(part: Part) -> dict[str, int]:
    """How many relations came to each status."""
    return {status.value: part.count_relations(status) for status in RelationStatus}
