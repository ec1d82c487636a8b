# SPDX-License-Identifier: MIT
"""The geometry kernel (Open CASCADE, by the optional package OCP): its surfaces from ours."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from scenes.checks import FloatArray, InputError
from scenes.formats.guard import import_extra
from scenes.surfaces.catalogue import Cone, Cylinder, Plane, Sphere, Surface, Torus
from scenes.surfaces.surface import cross

_MODULES = (
    "Bnd", "BRep", "BRepBndLib", "BRepBuilderAPI", "BRepCheck", "BRepClass3d", "BRepGProp", "BRepLib", "BRepMesh", "BRepTools",
    "GProp", "Geom", "GeomAPI", "IFSelect", "IntAna", "Interface", "Message", "Quantity", "STEPCAFControl",
    "STEPControl", "ShapeAnalysis", "ShapeFix", "TCollection", "TDataStd", "TDocStd", "TopAbs", "TopExp",
    "TopLoc", "TopoDS", "XCAFDoc", "collections", "gp",
)  # fmt: skip
_loaded: dict[str, SimpleNamespace] = {}


def kernel() -> SimpleNamespace:
    """Return the kernel's modules by name.

    Raises InputError: OCP is not installed; the message names the cure.
    """
    if "kernel" not in _loaded:
        import_extra("OCP", "step")
        found = {name: import_extra(f"OCP.{name}", "step") for name in _MODULES}
        _loaded["kernel"] = SimpleNamespace(**found)
    return _loaded["kernel"]


def kernel_point(point: FloatArray) -> Any:
    """A point (3,) of the kernel."""
    x, y, z = (float(one) for one in point)
    return kernel().gp.gp_Pnt(x, y, z)


def _axes(place: FloatArray, axis: FloatArray, zero: FloatArray) -> Any:
    gp = kernel().gp
    x, y, z = (float(one) for one in axis)
    a, b, c = (float(one) for one in zero)
    return gp.gp_Ax3(kernel_point(place), gp.gp_Dir(x, y, z), gp.gp_Dir(a, b, c))


def kernel_surface(surface: Surface, points: FloatArray) -> Any:
    """The kernel's surface, its seam where none of the region's points (n, 3) are, if there is such a place.

    Lengths are those of the surface.
    """
    geom = kernel().Geom
    if isinstance(surface, Plane):
        return geom.Geom_Plane(_axes(surface.point, surface.normal_direction, surface.u_direction))
    if isinstance(surface, Sphere):
        axis, zero = _free_meridian(surface.centre, points)
        return geom.Geom_SphericalSurface(_axes(surface.centre, axis, zero), surface.radius)
    if isinstance(surface, Cylinder):
        zero = _free_side(surface.point, surface.direction, points)
        return geom.Geom_CylindricalSurface(_axes(surface.point, surface.direction, zero), surface.radius)
    if isinstance(surface, Cone):
        zero = _free_side(surface.point, surface.direction, points)
        place = _axes(surface.point, surface.direction, zero)
        return geom.Geom_ConicalSurface(place, surface.half_angle, surface.radius)
    if isinstance(surface, Torus):
        zero = _free_side(surface.centre, surface.direction, points)
        place = _axes(surface.centre, surface.direction, zero)
        return geom.Geom_ToroidalSurface(place, surface.radius, surface.tube_radius)
    raise InputError(f"STEP export has no {surface.kind}")


def _free_side(place: FloatArray, axis: FloatArray, points: FloatArray) -> FloatArray:
    """The direction (3,) across the axis, in the middle of the widest sector without points."""
    least = int(np.argmin(np.abs(axis)))
    first = cross(axis, np.eye(3)[least])
    first /= np.linalg.norm(first)
    second = cross(axis, first)
    if not len(points):
        return first
    offset = points - place
    angle = np.sort(np.arctan2(offset @ second, offset @ first))
    gap = np.diff(np.append(angle, angle[0] + 2 * np.pi))
    widest = int(gap.argmax())
    if gap[widest] < np.radians(4.0):
        return first
    middle = angle[widest] + gap[widest] / 2
    return np.asarray(np.cos(middle) * first + np.sin(middle) * second)


def _free_meridian(centre: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Axis (3,) and zero direction (3,) of a sphere whose seam, half a great circle, is far from the points."""
    if not len(points):
        return np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
    unit = points - centre
    unit = unit / np.linalg.norm(unit, axis=1, keepdims=True)
    mean = unit.mean(axis=0)
    size = float(np.linalg.norm(mean))
    if size < 1e-3:
        return np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
    zero = -mean / size
    least = int(np.argmin(np.abs(zero)))
    first = cross(zero, np.eye(3)[least])
    first /= np.linalg.norm(first)
    second = cross(zero, first)
    best, chosen = -1.0, first
    for angle in np.arange(12) * np.pi / 12:
        axis = np.cos(angle) * first + np.sin(angle) * second
        side = cross(axis, zero)
        ahead, across, along = unit @ zero, unit @ side, unit @ axis
        in_plane = np.hypot(ahead, along)
        near = np.where(ahead > 0, in_plane, np.abs(along))
        clear = float(np.arccos(np.clip(near, -1, 1)).min()) + 0 * float(across[0])
        if clear > best + 1e-9:
            best, chosen = clear, axis
    return chosen, zero
