# SPDX-License-Identifier: MIT
"""The geometry kernel (Open CASCADE, by the optional package OCP): its surfaces from ours."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from scenes.checks import FloatArray, InputError
from scenes.io.guard import import_extra
from scenes.surfaces.catalogue import Cone, Cylinder, Plane, Sphere, Surface, Torus
from scenes.surfaces.surface import perpendicular

_MODULES = (
    "BRep", "BRepAdaptor", "BRepBuilderAPI", "BRepCheck", "BRepClass3d", "BRepGProp", "BRepLib", "BRepMesh",
    "GProp", "Geom", "Geom2d", "GeomAPI", "IFSelect", "Interface", "Message", "Quantity", "STEPCAFControl",
    "STEPControl", "ShapeFix", "Standard", "StdFail", "TCollection", "TDataStd", "TDocStd", "TopAbs",
    "TopExp", "TopLoc", "TopoDS", "XCAFDoc", "collections", "gp",
)  # fmt: skip
_loaded: dict[str, SimpleNamespace] = {}


def kernel() -> SimpleNamespace:
    """Return the kernel's modules by name.

    Raises InputError: OCP is not installed; the message names the cure.
    """
    if "kernel" not in _loaded:
        import_extra("OCP", "step")
        found = {name: import_extra(f"OCP.{name}", "step") for name in _MODULES}
        printer = found["Message"].Message_Printer.get_type_descriptor_s()
        found["Message"].Message.DefaultMessenger_s().RemovePrinters(printer)  # it would talk on stdout
        _loaded["kernel"] = SimpleNamespace(**found)
    return _loaded["kernel"]


def kernel_errors() -> tuple[type[Exception], ...]:
    """What the kernel raises; its exceptions have no class in common here."""
    modules = kernel().Standard, kernel().StdFail
    found = [getattr(module, name) for module in modules for name in dir(module)]
    return tuple(one for one in found if isinstance(one, type) and issubclass(one, Exception))


def kernel_point(point: FloatArray) -> Any:
    """A point (3,) of the kernel."""
    x, y, z = (float(one) for one in point)
    return kernel().gp.gp_Pnt(x, y, z)


def _axes(place: FloatArray, axis: FloatArray, zero: FloatArray) -> Any:
    gp = kernel().gp
    x, y, z = (float(one) for one in axis)
    a, b, c = (float(one) for one in zero)
    return gp.gp_Ax3(kernel_point(place), gp.gp_Dir(x, y, z), gp.gp_Dir(a, b, c))


def kernel_surface(surface: Surface, zero: FloatArray | None = None, axis: FloatArray | None = None) -> Any:
    """The kernel's surface; lengths are those of the surface.

    `zero` (3,) is the direction from its axis to its seam; a sphere's axis (3,) may be given as well. Raises
    InputError: a surface of another kind.
    """
    geom = kernel().Geom
    if isinstance(surface, Plane):
        return geom.Geom_Plane(_axes(surface.point, surface.normal_direction, surface.u_direction))
    if isinstance(surface, Sphere):
        up = np.array([0.0, 0.0, 1.0]) if axis is None else axis
        place = _axes(surface.centre, up, plain_zero(up) if zero is None else zero)
        return geom.Geom_SphericalSurface(place, surface.radius)
    if not isinstance(surface, Cylinder | Cone | Torus):
        raise InputError(f"STEP export has no {surface.kind}")
    side = plain_zero(surface.direction) if zero is None else zero
    if isinstance(surface, Torus):
        place = _axes(surface.centre, surface.direction, side)
        return geom.Geom_ToroidalSurface(place, surface.radius, surface.tube_radius)
    place = _axes(surface.point, surface.direction, side)
    if isinstance(surface, Cylinder):
        return geom.Geom_CylindricalSurface(place, surface.radius)
    return geom.Geom_ConicalSurface(place, surface.half_angle, surface.radius)


def plain_zero(axis: FloatArray) -> FloatArray:
    """A direction (3,) across an axis, the same one for both ways of the axis."""
    largest = int(np.argmax(np.abs(np.round(axis, 9))))
    return perpendicular(axis if axis[largest] > 0 else -axis)
