# SPDX-License-Identifier: MIT
"""Inferred points in E57 files: clouds apart from all scans, marked so that none is taken for measured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.checks import ColourArray, FloatArray, freeze_arrays

INFERRED = "unseen inferred points 1"
"""Format that the description of such a cloud names."""
EXTENSION = ("unseen", "https://unseen.invalid/e57/inferred/1")
"""Prefix and name of the fields that E57 itself does not know."""
_RANGES = {"surface": (0, 65535), "provenance": (0, 255)}


@dataclass(frozen=True, slots=True, eq=False)
class InferredPoints:
    """Points that nobody measured.

    Attributes
    ----------
    name : str
        Of the cloud, which in the file begins with "inferred".
    points : (n, 3) float
        World coordinates, metres.
    colour : (n, 3) uint8
        sRGB.
    surface, provenance : (n,) int
        As in hypothesised.ply.
    confidence, sd : (n,) float
        Probability that the surface is there, and predicted deviation in metres.
    legend : dict
        What the provenances mean.
    """

    name: str
    points: FloatArray
    colour: ColourArray
    surface: NDArray[np.int32]
    provenance: NDArray[np.int32]
    confidence: FloatArray
    sd: FloatArray
    legend: dict[str, str]

    def __post_init__(self) -> None:
        freeze_arrays(self)

    def columns(self) -> dict[str, Any]:
        """Return one array a field."""
        prefix = EXTENSION[0]
        columns: dict[str, Any] = {
            f"cartesian{axis}": np.ascontiguousarray(self.points[:, k]) for k, axis in enumerate("XYZ")
        }
        for k, name in enumerate(("Red", "Green", "Blue")):
            columns[f"color{name}"] = np.ascontiguousarray(self.colour[:, k])
        columns[f"{prefix}:surface"] = np.ascontiguousarray(self.surface, dtype=np.uint16)
        columns[f"{prefix}:provenance"] = np.ascontiguousarray(self.provenance, dtype=np.uint8)
        columns[f"{prefix}:confidence"] = np.ascontiguousarray(self.confidence, dtype=np.float32)
        columns[f"{prefix}:sd"] = np.ascontiguousarray(self.sd, dtype=np.float32)
        return columns

    def description(self) -> dict[str, Any]:
        """Return what the cloud's description says, ready for JSON."""
        return {
            "format": INFERRED,
            "warning": "nobody measured these points: they were inferred from knowledge of shape",
            "provenance": self.legend,
            "fields": {
                f"{EXTENSION[0]}:surface": "number of the surface in completion.json",
                f"{EXTENSION[0]}:provenance": "why it is there, see provenance",
                f"{EXTENSION[0]}:confidence": "probability that the surface is there",
                f"{EXTENSION[0]}:sd": "predicted standard deviation along the normal, metres",
            },
        }


def field_node(lib: Any, image_file: Any, name: str) -> Any:
    """Return the node of one of the extension's fields in the record of a point."""
    bounds = _RANGES.get(name.partition(":")[2])
    if bounds is None:
        return lib.FloatNode(image_file, 0.0, lib.E57_SINGLE)
    return lib.IntegerNode(image_file, 0, *bounds)
