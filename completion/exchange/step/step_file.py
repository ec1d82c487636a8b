# SPDX-License-Identifier: MIT
"""STEP files: a shape with named, coloured faces on layers; the same shape gives the same bytes."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from completion.exchange.step.curves.kernel import kernel
from scenes.checks import InputError

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
