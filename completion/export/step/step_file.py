# SPDX-License-Identifier: MIT
"""STEP files: a shape with named, coloured faces on layers; the same shape gives the same bytes."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from completion.export.step.kernel import kernel, kernel_point
from completion.fitting.patches.patch import SplinePatch
from scenes.checks import FloatArray, InputError
from scenes.scan.colour import surface_bytes

_HEADER = re.compile(r"FILE_NAME\(.*?\);", re.DOTALL)
_NAME = "FILE_NAME('{name}','',(''),(''),'unseen','unseen','');"


class NamedFace(NamedTuple):
    """A face, its name, its layer, and its colour (8-bit sRGB)."""

    face: Any
    name: str
    layer: str
    colour: tuple[int, int, int]


def step_bytes(shape: Any, faces: Sequence[NamedFace], name: str) -> bytes:
    """Return a shape in millimetres as a STEP file (AP214) without date, user or system.

    Raises InputError: the kernel cannot write it.
    """
    document, tool = _document(shape, name)
    xcaf, text = kernel().XCAFDoc, kernel().TCollection.TCollection_ExtendedString
    colours = xcaf.XCAFDoc_DocumentTool.ColorTool_s(document.Main())
    layers = xcaf.XCAFDoc_DocumentTool.LayerTool_s(document.Main())
    root = tool.FindShape(shape)
    for one in faces:
        label = tool.AddSubShape(root, one.face)
        if label.IsNull():
            continue
        kernel().TDataStd.TDataStd_Name.Set_s(label, text(one.name))
        colours.SetColor(label, _colour(one.colour), xcaf.XCAFDoc_ColorType.XCAFDoc_ColorSurf)
        layers.SetLayer(label, text(one.layer))
    return _written(document, name)


def _document(shape: Any, name: str) -> tuple[Any, Any]:
    text = kernel().TCollection.TCollection_ExtendedString
    document = kernel().TDocStd.TDocStd_Document(text("XmlOcaf"))
    tool = kernel().XCAFDoc.XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
    label = tool.AddShape(shape, False)
    kernel().TDataStd.TDataStd_Name.Set_s(label, text(name))
    return document, tool


def _colour(colour: tuple[int, int, int]) -> Any:
    kind = kernel().Quantity
    red, green, blue = (one / 255 for one in colour)
    return kind.Quantity_Color(red, green, blue, kind.Quantity_TypeOfColor.Quantity_TOC_sRGB)


def _written(document: Any, name: str) -> bytes:
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
    safe = "".join(one if one.isascii() and one.isprintable() and one not in "'\\" else "_" for one in name)
    return _HEADER.sub(lambda _found: _NAME.format(name=safe), data, count=1).encode()


_MM = 1000.0
_TOLERANCE = 1e-6  # mm


def patch_step(patch: SplinePatch, name: str = "patch") -> bytes:
    """Return a patch in metres as a STEP file in millimetres: a B-spline face within its four boundaries.

    Raises
    ------
    InputError
        OCP is not installed (the message names the cure), or the kernel cannot write it.
    """
    surface = spline_surface(patch.moved(_MM, np.zeros(3)))
    face = kernel().BRepBuilderAPI.BRepBuilderAPI_MakeFace(surface, _TOLERANCE).Face()
    red, green, blue = surface_bytes(np.array([1]))[0].tolist()
    return step_bytes(face, [NamedFace(face, name, "MEASURED", (red, green, blue))], name)


def spline_surface(patch: SplinePatch) -> Any:
    """Return the kernel's B-spline surface; lengths are those of the patch."""
    n, m, _ = patch.controls.shape
    held = kernel().collections.Array2_gp_Pnt(1, n, 1, m)
    for row in range(n):
        for column in range(m):
            held.SetValue(row + 1, column + 1, kernel_point(patch.controls[row, column]))
    knots, counts = zip(*(_counted(one) for one in patch.knots), strict=True)
    told = (*knots, *counts, *patch.degree, False, False)
    return kernel().Geom.Geom_BSplineSurface(held, *told)


def _counted(knots: FloatArray) -> tuple[Any, Any]:
    """The knots without repetition, and how often each stands there, as arrays of the kernel."""
    values, counts = np.unique(knots, return_counts=True)
    held = kernel().collections.Array1_double(1, len(values))
    times = kernel().collections.Array1_int(1, len(values))
    for place, (knot, count) in enumerate(zip(values.tolist(), counts.tolist(), strict=True), start=1):
        held.SetValue(place, knot)
        times.SetValue(place, count)
    return held, times
