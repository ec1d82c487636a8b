# SPDX-License-Identifier: MIT
"""Panel files: the light model as model.ply, and its folds and corners as completion.json has them."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from completion.panels.model import FoldEdge, turned
from completion.result.completed_model import CompletedModel
from scenes.checks import FloatArray
from scenes.io.ply import write_mesh_ply


def write_panels_ply(path: str | PathLike[str], completion: CompletedModel, legend: Sequence[str]) -> None:
    """Write the light model in world coordinates, each facet with `surface`, `state` and `provenance`.

    Surface 0 is what no surface explains.

    Raises InputError: the file cannot be written.
    """
    panels = completion.panels()
    n_rest = len(panels.rest.faces)
    write_mesh_ply(
        path,
        completion.world_from_reference.apply(panels.vertices),
        np.concatenate([panels.faces, panels.rest.faces]).astype(np.int32),
        comments=("state 0 measured 1 inferred", *legend),
        face_properties={
            "surface": _padded(panels.face_surface, n_rest),
            "state": _padded((~panels.is_measured).astype(np.uint8), n_rest),
            "provenance": _padded(panels.face_provenance.astype(np.uint8), n_rest),
        },
    )


def _padded(values: NDArray[Any], n: int) -> NDArray[Any]:
    """Values of facets, with 0 for n more."""
    return np.pad(values, (0, n))


def panels_record(completion: CompletedModel) -> dict[str, Any]:
    """Return the folds, corners and facets of the light model; world coordinates, metres."""
    panels, world = completion.panels(), completion.world_from_reference
    turn = world.rotation
    return {
        "folds": [_fold(one, world.apply(one.points), turn) for one in panels.folds],
        "corners": [
            {
                "surfaces": list(one.surfaces),
                "point": world.apply(one.point[None])[0].tolist(),
                "covariance_m2": turned(one.covariance, turn).tolist(),
            }
            for one in panels.corners
        ],
        "panels": {
            "triangles": len(panels.faces),
            "rest_triangles": len(panels.rest.faces),
            "vertices": len(panels.vertices),
            "open_edges_m": dict(panels.open_m),
        },
    }


def _fold(fold: FoldEdge, points: FloatArray, turn: FloatArray) -> dict[str, Any]:
    return {
        "surfaces": list(fold.surfaces),
        "kind": fold.kind,
        "goes_on": list(fold.goes_on),
        "points": points.tolist(),
        "length_m": fold.length_m,
        "dihedral_deg": fold.dihedral_deg,
        "dihedral_sd_deg": fold.dihedral_sd_deg,
        "sd_m": fold.sd_m,
        "covariance_m2": turned(fold.covariance, turn).tolist(),
        "measured_share": fold.measured_share,
    }
