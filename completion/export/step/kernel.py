# SPDX-License-Identifier: MIT
"""The geometry kernel (Open CASCADE, by the optional package OCP): its surfaces from ours, and its files.

A STEP file holds a shape with named, coloured faces on layers; the same shape gives the same bytes.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from completion.export.step.entities import in_order
from completion.export.step.limits import TOLERANCE
from completion.fitting.patches.spline import SplinePatch
from scenes.checks import FloatArray, InputError
from scenes.run.libraries import import_extra
from scenes.scan.colour import surface_bytes
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
        record = {name: import_extra(f"OCP.{name}", "step") for name in _MODULES}
        printer = record["Message"].Message_Printer.get_type_descriptor_s()
        record["Message"].Message.DefaultMessenger_s().RemovePrinters(printer)  # it would talk on stdout
        _loaded["kernel"] = SimpleNamespace(**record)
    return _loaded["kernel"]


def kernel_errors() -> tuple[type[Exception], ...]:
    """What the kernel raises; its exceptions have no class in common here."""
    modules = kernel().Standard, kernel().StdFail
    errors = [getattr(module, name) for module in modules for name in dir(module)]
    return tuple(member for member in errors if isinstance(member, type) and issubclass(member, Exception))


def kernel_point(point: FloatArray) -> Any:
    """A point (3,) of the kernel."""
    x, y, z = (float(value) for value in point)
    return kernel().gp.gp_Pnt(x, y, z)


def _axes(place: FloatArray, axis: FloatArray, zero: FloatArray) -> Any:
    gp = kernel().gp
    x, y, z = (float(value) for value in axis)
    a, b, c = (float(value) for value in zero)
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


def interpolate(points: FloatArray, *, is_closed: bool) -> Any | None:
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
    return kernel().Geom.Geom_Line(kernel_point(middle), gp.gp_Dir(*(float(value) for value in way)))


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
    up, zero = (
        gp.gp_Dir(*(float(value) for value in row)) for row in (np.cross(frame[0], frame[1]), frame[0])
    )
    return kernel().Geom.Geom_Circle(gp.gp_Ax2(kernel_point(centre), up, zero), radius)


def axis_of(surface: Cylinder | Cone | Torus) -> tuple[FloatArray, FloatArray]:
    """A point (3,) of the axis that a surface turns about, and its direction (3,)."""
    return (surface.centre if isinstance(surface, Torus) else surface.point), surface.direction


def winding_number(place: FloatArray, axis: FloatArray, points: FloatArray) -> int:
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


_HEADER = re.compile(r"FILE_NAME\(.*?\);", re.DOTALL)
_NAME = "FILE_NAME('{name}','',(''),(''),'unseen','unseen','');"


class NamedFace(NamedTuple):
    """A face, its name, its layer, and its colour (8-bit sRGB)."""

    face: Any
    name: str
    layer: str
    colour: tuple[int, int, int]


class NamedShape(NamedTuple):
    """A product: its name, its shape in millimetres with named faces; or an assembly of `parts` instead."""

    name: str
    shape: Any | None = None
    faces: Sequence[NamedFace] = ()
    parts: Sequence[NamedShape] = ()


def step_bytes(whole: NamedShape) -> bytes:
    """Return a product, or a tree of products, as a STEP file (AP214) without date, user or system.

    Raises InputError: the kernel cannot write it.
    """
    modules = kernel()
    document = modules.TDocStd.TDocStd_Document(modules.TCollection.TCollection_ExtendedString("XmlOcaf"))
    _add_product(document, whole)
    modules.XCAFDoc.XCAFDoc_DocumentTool.ShapeTool_s(document.Main()).UpdateAssemblies()
    return in_order(_write_document(document, whole.name)).encode()


def _add_product(document: Any, of: NamedShape) -> Any:
    """Add a product, and those below it, to a document; return its label."""
    xcaf, text = kernel().XCAFDoc, kernel().TCollection.TCollection_ExtendedString
    set_name = kernel().TDataStd.TDataStd_Name.Set_s
    tool, colours, layers = (
        getattr(xcaf.XCAFDoc_DocumentTool, name)(document.Main())
        for name in ("ShapeTool_s", "ColorTool_s", "LayerTool_s")
    )
    root = tool.NewShape() if of.shape is None else tool.AddShape(of.shape, False)
    set_name(root, text(of.name))
    for face in of.faces:
        label = tool.AddSubShape(root, face.face)
        if label.IsNull():
            continue
        set_name(label, text(face.name))
        colours.SetColor(label, _colour(face.colour), xcaf.XCAFDoc_ColorType.XCAFDoc_ColorSurf)
        layers.SetLayer(label, text(face.layer))
    for part in of.parts:
        placed = tool.AddComponent(root, _add_product(document, part), kernel().TopLoc.TopLoc_Location())
        set_name(placed, text(part.name))
    return root


def _colour(colour: tuple[int, int, int]) -> Any:
    kind = kernel().Quantity
    red, green, blue = (number / 255 for number in colour)
    return kind.Quantity_Color(red, green, blue, kind.Quantity_TypeOfColor.Quantity_TOC_sRGB)


def _write_document(document: Any, name: str) -> str:
    static = kernel().Interface.Interface_Static
    writer = kernel().STEPCAFControl.STEPCAFControl_Writer()
    for key, value in (
        ("write.step.schema", "AP214IS"),
        ("write.step.unit", "MM"),
        ("xstep.cascade.unit", "MM"),
    ):
        static.SetCVal_s(key, value)
    static.SetIVal_s("write.surfacecurve.mode", 0)
    static.SetIVal_s("write.stepcaf.subshapes.name", 1)
    writer.SetNameMode(True)
    writer.SetColorMode(True)
    writer.SetLayerMode(True)
    if not writer.Transfer(document, kernel().STEPControl.STEPControl_StepModelType.STEPControl_AsIs):
        raise InputError("the geometry kernel could not translate the part to STEP")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "part.step"
        done = writer.Write(str(file))
        if done != kernel().IFSelect.IFSelect_ReturnStatus.IFSelect_RetDone or not file.is_file():
            raise InputError("the geometry kernel could not write the part as STEP")
        data = file.read_text("utf-8")
    safe = "".join(
        text if text.isascii() and text.isprintable() and text not in "'\\" else "_" for text in name
    )
    return _HEADER.sub(lambda _found: _NAME.format(name=safe), data, count=1)


_MM = 1000.0


def patch_step(patch: SplinePatch, name: str = "patch") -> bytes:
    """Return a patch in metres as a STEP file in millimetres: a B-spline face within its four boundaries.

    Raises
    ------
    InputError
        OCP is not installed (the message names the cure), or the kernel cannot write it.
    """
    surface = spline_surface(patch.scale_and_shift(_MM, np.zeros(3)))
    face = kernel().BRepBuilderAPI.BRepBuilderAPI_MakeFace(surface, TOLERANCE).Face()
    red, green, blue = surface_bytes(np.array([1]))[0].tolist()
    return step_bytes(NamedShape(name, face, [NamedFace(face, name, "MEASURED", (red, green, blue))]))


def spline_surface(patch: SplinePatch) -> Any:
    """Return the kernel's B-spline surface; lengths are those of the patch."""
    n, m, _ = patch.controls.shape
    held = kernel().collections.Array2_gp_Pnt(1, n, 1, m)
    for row in range(n):
        for column in range(m):
            held.SetValue(row + 1, column + 1, kernel_point(patch.controls[row, column]))
    knots, counts = zip(*(_knot_multiplicities(knot) for knot in patch.knots), strict=True)
    arguments = (*knots, *counts, *patch.degree, False, False)
    return kernel().Geom.Geom_BSplineSurface(held, *arguments)


def _knot_multiplicities(knots: FloatArray) -> tuple[Any, Any]:
    """The knots without repetition, and how often each stands there, as arrays of the kernel."""
    values, counts = np.unique(knots, return_counts=True)
    held = kernel().collections.Array1_double(1, len(values))
    times = kernel().collections.Array1_int(1, len(values))
    for place, (knot, count) in enumerate(zip(values.tolist(), counts.tolist(), strict=True), start=1):
        held.SetValue(place, knot)
        times.SetValue(place, count)
    return held, times
