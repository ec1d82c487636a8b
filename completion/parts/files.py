# SPDX-License-Identifier: MIT
"""Files of a part: part.json, relations.json and part.ply."""

from __future__ import annotations

from os import PathLike
from typing import Any

import numpy as np

from completion.parts.part import Part
from completion.relations.engine.relation import Status
from completion.relations.frames import frame_records
from completion.relations.record import FORMAT as RELATIONS_FORMAT
from completion.relations.record import freedom_record, relation_records, surface_record
from scenes.checks import IntArray
from scenes.formats.meshes.ply import write_mesh_ply
from scenes.run.atomic import make_folder, write_json
from scenes.run.staged_outputs import Stage, locked
from scenes.scan.palette import surface_bytes

FORMAT = "unseen-part/1"


def write_part(
    part: Part, folder: str | PathLike[str], *, rows: IntArray | None = None, n_rows: int | None = None
) -> None:
    """Write part.json, relations.json (where relations were looked for) and part.ply, all or none.

    Parameters
    ----------
    part : Part
        What to write.
    folder : str or path
        Made if it is not there.
    rows : (n,) int, optional
        Place of each point among all `n_rows` of the input, where some were left out: part.ply holds these
        as well, without coordinates (NaN) and on no surface.

    Raises
    ------
    InputError
        The folder cannot be made or written, or another run writes there.
    """
    target = make_folder(folder)
    with locked(target), Stage(target) as stage:
        write_json(stage.path("part.json"), part_record(part))
        if part.relations is not None:
            write_json(stage.path("relations.json"), relations_record(part))
        points, surface = part.points, part.surface
        if rows is not None and n_rows is not None:
            points, surface = np.full((n_rows, 3), np.nan), np.zeros(n_rows, dtype=np.int32)
            points[rows], surface[rows] = part.points, part.surface
        colour = surface_bytes(places_of(part, surface))
        told = {"surface": surface, "red": colour[:, 0], "green": colour[:, 1], "blue": colour[:, 2]}
        write_mesh_ply(stage.path("part.ply"), points, part.faces, told, ["surface 0 none"])
        stage.commit()


def places_of(part: Part, surface: IntArray) -> IntArray:
    """Places (n,) from 1 of labels (n,) among those of the part; 0 for none."""
    return np.where(surface > 0, np.searchsorted(part.labels, surface) + 1, 0)


def part_record(part: Part) -> dict[str, Any]:
    """Return what part.json holds, metres, degrees: each surface where relations hold, and as measured."""
    graph = part.relations
    moved = dict(zip(part.related, graph.moved_sd, strict=True)) if graph is not None else {}
    surfaces = []
    for place, label in enumerate(part.labels):
        fit, measured = part.fits[place], part.measured[place]
        same = [other for other, group in zip(part.labels, part.groups, strict=True)
                if group == part.groups[place] and other != label]  # fmt: skip
        surfaces.append(
            {
                **surface_record(fit, label),
                "concave": bool(getattr(fit.surface, "concave", False)),
                "points": int((part.surface == label).sum()),
                "rms_m": measured.rms,
                "same_surface": same,
                "measured": surface_record(measured, label) if place in moved else None,
                "moved_sd": moved.get(place),
            }
        )
    return {
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
    return {status.value: part.numbered(status) for status in Status}
