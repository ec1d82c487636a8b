# SPDX-License-Identifier: MIT
"""What a STEP file keeps: its surfaces read back, and how exactly the relations that were claimed hold."""

from __future__ import annotations

import tempfile
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np

from completion.exchange.step.brep import is_valid, volume_of
from completion.exchange.step.curves.kernel import kernel
from completion.parts.part import Part
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Surface


class ReadBack:
    """A STEP file as the kernel reads it; lengths in metres."""

    def __init__(self, data: bytes) -> None:
        modules = kernel()
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "read.step"
            file.write_bytes(data)
            reader = modules.STEPControl.STEPControl_Reader()
            reader.ReadFile(str(file))
            reader.TransferRoots()
            self.shape = reader.OneShape()
        self.is_valid = is_valid(self.shape)
        self.volume_m3 = abs(volume_of(self.shape)) * 1e-9
        self.surfaces = [_told(one) for one in _surfaces(self.shape)]

    def nearest(self, surface: Surface) -> tuple[str, FloatArray, FloatArray] | None:
        """Kind, place and axis of the surface in the file that is nearest to one of the part."""
        same = [one for one in self.surfaces if one[0] == surface.kind]
        if not same:
            return None
        return min(same, key=lambda one: _apart(one, surface))


def _surfaces(shape: Any) -> list[Any]:
    modules, found = kernel(), list[Any]()
    walk = modules.TopExp.TopExp_Explorer(shape, modules.TopAbs.TopAbs_ShapeEnum.TopAbs_FACE)
    while walk.More():
        found.append(modules.BRep.BRep_Tool.Surface_s(modules.TopoDS.TopoDS.Face(walk.Current())))
        walk.Next()
    return found


def _told(surface: Any) -> tuple[str, FloatArray, FloatArray]:
    names = {"Plane": "plane", "Cylindrical": "cylinder", "Conical": "cone", "Spherical": "sphere"}
    word = type(surface).__name__.removeprefix("Geom_").removesuffix("Surface")
    axis = surface.Position().Axis()
    place = np.array(axis.Location().Coord()) / 1000
    return names.get(word, "torus"), place, np.array(axis.Direction().Coord())


def _apart(one: tuple[str, FloatArray, FloatArray], surface: Surface) -> float:
    """How far a surface of a file is from one of a part: along the normal, or across the axis."""
    _, place, axis = one
    own = getattr(surface, "normal_direction", getattr(surface, "direction", None))
    at: FloatArray = np.asarray(getattr(surface, "point", getattr(surface, "centre", None)))
    gap = place - at
    if surface.kind == "sphere" or own is None:
        return float(np.linalg.norm(gap))
    turned = float(np.linalg.norm(np.cross(own, axis)))
    if surface.kind == "plane":
        return turned + abs(float(gap @ own))
    return turned + float(np.linalg.norm(gap - (gap @ own) * own))


def relation_error(part: Part, read: ReadBack, numbers: Collection[int]) -> tuple[float, int]:
    """Largest deviation (radians, metres) of relations that hold between two surfaces, and their number.

    Of parallel, perpendicular, coaxial and coplanar ones, those of surfaces by whose numbers there is a face.
    """
    worst, n = 0.0, 0
    for one in () if part.relations is None else part.relations.relations:
        if not one.holds or one.kind not in ("parallel", "perpendicular", "coaxial", "coplanar"):
            continue
        if not {part.labels[part.related[k]] for k in one.surfaces} <= set(numbers):
            continue
        pair = [read.nearest(part.fits[part.related[k]].surface) for k in one.surfaces]
        if any(each is None for each in pair):
            continue
        (_, p, a), (_, q, b) = (each for each in pair if each is not None)
        off = abs(float(a @ b)) if one.kind == "perpendicular" else float(np.linalg.norm(np.cross(a, b)))
        gap = q - p
        if one.kind == "coaxial":
            off = max(off, float(np.linalg.norm(gap - (gap @ a) * a)))
        if one.kind == "coplanar":
            off = max(off, abs(float(gap @ a)))
        worst, n = max(worst, off), n + 1
    return worst, n
