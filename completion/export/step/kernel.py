# SPDX-License-Identifier: MIT
"""The geometry kernel (Open CASCADE, by the optional package OCP): its surfaces from ours."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from scenes.checks import FloatArray, InputError
from scenes.io.guard import import_extra
from scenes.surfaces.catalogue import Cone, Cylinder, Plane, Sphere, Surface, Torus
from scenes.surfaces.surface import cross, perpendicular

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


def chord_lengths(points: FloatArray, is_closed: bool) -> FloatArray:
    """Lengths (n,) along the chords of points (n, 3), with that of the way back where they close (n + 1,)."""
    whole = np.concatenate([points, points[:1]]) if is_closed else points
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(whole, axis=0), axis=1))])


def interpolated(points: FloatArray, *, is_closed: bool) -> Any | None:
    """The spline through points (n, 3); None where the kernel finds none."""
    array = kernel().collections.HArray1_gp_Pnt(1, len(points))
    for place, point in enumerate(points, start=1):
        array.SetValue(place, kernel_point(point))
    knots = chord_lengths(points, is_closed)
    held = kernel().collections.HArray1_double(1, len(knots))
    for place, knot in enumerate(knots, start=1):
        held.SetValue(place, float(knot))
    try:
        made = kernel().GeomAPI.GeomAPI_Interpolate(array, held, is_closed, 1e-9)
        made.Perform()
    except kernel_errors():  # points that coincide
        return None
    return made.Curve() if made.IsDone() else None


def line_through(points: FloatArray, exact: float) -> Any | None:
    """The line that points (n, 3) are on, to `exact`; None where they are not."""
    middle = points.mean(axis=0)
    way = np.linalg.svd(points - middle)[2][0]
    off = points - middle - np.outer((points - middle) @ way, way)
    if np.linalg.norm(off, axis=1).max() > exact:
        return None
    gp = kernel().gp
    return kernel().Geom.Geom_Line(kernel_point(middle), gp.gp_Dir(*(float(one) for one in way)))


def circle_through(points: FloatArray, exact: float) -> Any | None:
    """The circle that points (n, 3) are on, to `exact`; None where they are not."""
    middle = points.mean(axis=0)
    frame = np.linalg.svd(points - middle)[2]
    flat = (points - middle) @ frame.T
    if np.abs(flat[:, 2]).max() > exact:
        return None
    terms = np.column_stack([2 * flat[:, :2], np.ones(len(flat))])
    a, b, c = np.linalg.lstsq(terms, (flat[:, :2] ** 2).sum(axis=1), rcond=None)[0]
    radius = float(np.sqrt(max(c + a * a + b * b, 0.0)))
    if np.abs(np.hypot(flat[:, 0] - a, flat[:, 1] - b) - radius).max() > exact:
        return None
    gp = kernel().gp
    centre = middle + a * frame[0] + b * frame[1]
    up, zero = (gp.gp_Dir(*(float(one) for one in row)) for row in (np.cross(frame[0], frame[1]), frame[0]))
    return kernel().Geom.Geom_Circle(gp.gp_Ax2(kernel_point(centre), up, zero), radius)


def axis_of(surface: Cylinder | Cone | Torus) -> tuple[FloatArray, FloatArray]:
    """A point (3,) of the axis that a surface turns about, and its direction (3,)."""
    return (surface.centre if isinstance(surface, Torus) else surface.point), surface.direction


def winding(place: FloatArray, axis: FloatArray, points: FloatArray) -> int:
    """How often closed points (n, 3) go round an axis."""
    first = plain_zero(axis)
    return turns_of(np.arctan2((points - place) @ cross(axis, first), (points - place) @ first))


def tube_angles(torus: Torus, points: FloatArray) -> FloatArray:
    """Angles (n,) about the tube, 0 on the outer circle."""
    offset = points - torus.centre
    height = offset @ torus.direction
    out = np.linalg.norm(offset - np.outer(height, torus.direction), axis=1) - torus.radius
    return np.asarray(np.arctan2(height, out))


def turns_of(angle: FloatArray) -> int:
    """How often closed angles (n,) go round."""
    step = np.diff(np.append(angle, angle[0]))
    return round(float(((step + np.pi) % (2 * np.pi) - np.pi).sum()) / (2 * np.pi))
