# SPDX-License-Identifier: MIT
"""Files of a drawing: SVG at the paper's size, and DXF at the part's own, both in millimetres."""

from __future__ import annotations

import io
from xml.sax.saxutils import escape

import ezdxf
import numpy as np

from completion.export.dxf import fixed_marks
from completion.parts.profiles.drawing import Circle, Item, Sheet, Stroke, scale_text
from scenes.checks import FloatArray

_STYLE = """
svg { background: #fff; font-family: Helvetica, Arial, sans-serif; }
path, circle { fill: none; stroke: #000; stroke-width: 0.18; stroke-linejoin: round; }
.outline { stroke-width: 0.5; }
.cut { stroke-width: 0.5; }
.centre { stroke: #7a3fa0; stroke-dasharray: 6 1 1 1; }
.dimension { stroke: #1f5fbf; stroke-width: 0.13; }
text { fill: #000; paint-order: stroke; stroke: #fff; stroke-width: 0.5; }
""".strip()
_LAYERS = {"outline": (7, 50, "CONTINUOUS"), "cut": (7, 50, "CONTINUOUS"), "centre": (6, 18, "CENTER"),
           "dimension": (5, 13, "CONTINUOUS"), "frame": (8, 25, "CONTINUOUS")}  # fmt: skip


def sheet_svg(sheet: Sheet, title: str) -> str:
    """Return a sheet as SVG of its own size; the same sheet, the same text."""
    size = f'width="{_n(sheet.width_mm)}mm" height="{_n(sheet.height_mm)}mm"'
    return "\n".join(
        [
            '<?xml version="1.0" encoding="UTF-8"?>',
            f'<svg xmlns="http://www.w3.org/2000/svg" {size} '
            f'viewBox="0 0 {_n(sheet.width_mm)} {_n(sheet.height_mm)}" data-scale="{sheet.scale:g}">',
            f"<title>{escape(title)}, {scale_text(sheet.scale)}</title>",
            f"<style>{_STYLE}</style>",
            *(_drawn(item, sheet.height_mm) for item in sheet.items),
            "</svg>\n",
        ]
    )


def _drawn(item: Item, height: float) -> str:
    if isinstance(item, Circle):
        x, y = item.centre
        return f'<circle class="{item.layer}" cx="{_n(x)}" cy="{_n(height - y)}" r="{_n(item.radius)}"/>'
    if isinstance(item, Stroke):
        places = item.places * [1.0, -1.0] + [0.0, height]
        steps = [f"M{_n(places[0][0])} {_n(places[0][1])}"]
        following = [*range(1, len(places)), *([0] if item.is_closed else [])]
        for k, two in enumerate(following):
            steps.append(_step(places[k], places[two], float(item.bulge[k])))
        return f'<path class="{item.layer}" d="{"".join(steps)}{"Z" if item.is_closed else ""}"/>'
    x, y = item.place
    turn = f' transform="rotate({_n(-item.turn_deg)} {_n(x)} {_n(height - y)})"' if item.turn_deg else ""
    return (
        f'<text x="{_n(x)}" y="{_n(height - y)}" font-size="{_n(item.size_mm)}" text-anchor="{item.anchor}"'
        f"{turn}>{escape(item.text)}</text>"
    )


def _step(start: FloatArray, end: FloatArray, bulge: float) -> str:
    """A line, or an arc by its bulge, anticlockwise positive with y up."""
    if not bulge:
        return f"L{_n(end[0])} {_n(end[1])}"
    radius = float(np.linalg.norm(end - start)) * (1 + bulge**2) / (4 * abs(bulge))
    return f"A{_n(radius)} {_n(radius)} 0 {int(abs(bulge) > 1)} {int(bulge < 0)} {_n(end[0])} {_n(end[1])}"


def _n(value: float) -> str:
    """A number of millimetres to the thousandth, without needless digits."""
    return f"{round(float(value), 3) + 0.0:g}"


def sheet_dxf(sheet: Sheet) -> bytes:
    """Return a sheet as DXF (AutoCAD 2010), millimetres, at the part's own size; the same one the same bytes.

    Outlines and cuts are closed polylines whose arcs are bulges, and circles, on layers OUTLINE and CUT, as
    cutting machines take them; CENTRE, DIMENSION, FRAME and TEXT are for people.
    """
    with fixed_marks():
        document = ezdxf.new("R2010", setup=["linetypes"])
        document.units, document.header["$MEASUREMENT"] = 4, 1
        document.header["$LTSCALE"] = 0.25 / sheet.scale
        for name, (colour, weight, line) in _LAYERS.items():
            document.layers.add(name.upper(), color=colour, linetype=line, lineweight=weight)
        document.layers.add("TEXT", color=7)
        space, own = document.modelspace(), 1 / sheet.scale
        for item in sheet.items:
            if isinstance(item, Circle):
                space.add_circle(
                    (own * item.centre).tolist(), own * item.radius, dxfattribs={"layer": item.layer.upper()}
                )
            elif isinstance(item, Stroke):
                rows = np.column_stack([own * item.places, item.bulge]).tolist()
                space.add_lwpolyline(
                    rows, format="xyb", close=item.is_closed, dxfattribs={"layer": item.layer.upper()}
                )
            else:
                text = (
                    item.text.replace("\u2300", "%%c")
                    .replace("\u00b1", "%%p")
                    .replace("\u00b0", "%%d")
                    .replace("\u00d7", "x")
                )
                entity = space.add_text(
                    text,
                    height=own * item.size_mm * 0.72,
                    rotation=item.turn_deg,
                    dxfattribs={"layer": "TEXT"},
                )
                align = {"start": "LEFT", "middle": "CENTER", "end": "RIGHT"}[item.anchor]
                entity.set_placement(
                    (own * item.place).tolist(), align=ezdxf.enums.TextEntityAlignment[align]
                )
        corner = (own * sheet.width_mm, own * sheet.height_mm)
        space.reset_extents((0.0, 0.0, 0.0), (*corner, 0.0))
        document.set_modelspace_vport(1.2 * corner[1], (corner[0] / 2, corner[1] / 2))
        for kind in sorted(document.entitydb.dxf_types_in_use()):  # the library would go by a set's order
            document.classes.add_class(kind)
        text_io = io.StringIO()
        document.write(text_io)
    return document.encode(text_io.getvalue())
