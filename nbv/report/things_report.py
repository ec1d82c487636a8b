# SPDX-License-Identifier: MIT
"""Things in the report of a completion: cards from the side that nobody saw, and a table of their sizes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from completion.backs.closed_things import ClosedThing
from completion.backs.intervals import Extent
from completion.backs.pipeline import Back
from completion.result.completion import Completion
from nbv.report.blocks.page import Cell, Gallery, Legend, PageSection, Table, Text
from nbv.report.figures.drawing import MeshDrawing, mark_hatched, paint_states
from nbv.report.figures.picture import INFERRED, MEASURED, Camera, Picture, aim, picture_of
from nbv.run.wording import count, square_metres
from scenes.mesh.labelled_mesh import LabelledMesh

_MOST_CARDS = 9
_MOST_ROWS = 60
_ONE_NUMBER_M = 0.01
_SHAPE = (300, 400)  # rows and columns of a card's picture
_RAISED_DEG = 25.0  # how far the eye stands above the thing
_MARGIN = 1.15
_PALE = (0.86, 0.86, 0.86)
_MEASURED, _INFERRED, _UNKNOWN = range(3)
_KINDS = {"mirror": "mirror", "axis": "axis", "turn": "turns"}


def things_sections(completion: Completion) -> tuple[PageSection, ...]:
    """Return a section on the things of a room; none where nobody asked, or none was found."""
    things = completion.things
    if not things:
        return ()
    closed = [(one, one.back) for one in things if one.back is not None]
    inferred = sum(one.inferred_m2 for one in things)
    sure = sum(bool(one.back and one.back.sure) for one in things)
    why = Counter(one.why_open for one in things if one.back is None)
    left = "".join(f" {n} left open: {text}." for text, n in sorted(why.items()))
    text = Text(
        f"{count(len(things), 'thing stands', 'things stand')} in the scans; "
        f"{count(len(closed), 'was', 'were')} closed, "
        f"{sure} by a symmetry that is sure enough to infer {square_metres(inferred)} m\u00b2 of their back "
        f"sides.{left}"
    )
    note = Text(
        "Each picture is from the side that no scan saw. Grey was measured, blue is implied by a "
        "symmetry, hatched faces only close the shape: they are unknown. Volume is what a thing takes up, "
        "with an 80 % interval; width, depth and height lie between what was measured and where its end "
        "was seen, a symmetry puts it, or a wall is.",
        is_note=True,
    )
    cards = tuple(_thing_picture(completion, *pair) for pair in closed[:_MOST_CARDS])
    more = len(closed) - _MOST_CARDS
    rest = (Text(f"{count(more, 'other is', 'others are')} in things/.", is_note=True),) if more > 0 else ()
    gallery = (Legend(), Gallery(cards, 3)) if cards else ()
    return (PageSection("Things and their back sides", (text, *gallery, *rest, _table(things), note)),)


def _table(things: Sequence[ClosedThing]) -> Table:
    """A row for each thing."""
    columns = (
        "Thing", "#width, m", "#depth, m", "#height, m", "Why that depth", "#volume, m\u00b3",
        "#80 % from, to, m\u00b3", "Symmetry", "#inferred, m\u00b2",
    )  # fmt: skip
    return Table(columns, tuple(_row(one) for one in things[:_MOST_ROWS]))


def _row(one: ClosedThing) -> tuple[Cell, ...]:
    size, name = one.thing.box.size, Cell(str(one.thing.index + 1))
    height = Cell(f"{size[2]:.2f}")
    back = one.back
    if back is None:
        seen = (Cell(f"{max(size[:2]):.2f}"), Cell(""), height)
        return (name, *seen, Cell(one.why_open), *(Cell(""),) * 4)
    extents, volume = back.extents, back.volume
    best = back.hypotheses[0] if back.hypotheses else None
    symmetry = "none" if best is None else f"{_KINDS[best.kind]}, {100 * best.probability:.0f} %"
    return (
        name,
        *(Cell(_told(extent)) for extent in (extents.width, extents.depth, extents.height)),
        Cell(extents.depth.why),
        Cell(f"{volume.closed:.2g}"),
        Cell(f"{volume.least:.2g}, {volume.most:.2g}"),
        Cell(symmetry, state="inferred" if back.sure else ""),
        Cell(square_metres(one.inferred_m2), state="inferred" if one.inferred_m2 else ""),
    )


def _told(extent: Extent) -> str:
    """An extent: one number where both ends are known to 10 mm, else from which to which."""
    if extent.most is None:
        return f"{extent.least:.2f} or more"
    if extent.most - extent.least <= _ONE_NUMBER_M:
        return f"{(extent.least + extent.most) / 2:.2f}"
    return f"{extent.least:.2f} to {extent.most:.2f}"


def _thing_picture(completion: Completion, one: ClosedThing, back: Back) -> Picture:
    """The picture of a thing, closed by `back`, from the side that the scans did not see."""
    shape, sure = back.shape, back.sure
    drawing = MeshDrawing(LabelledMesh(shape.vertices, shape.faces))
    layer = drawing.look(_behind(completion, one), _SHAPE)
    state = np.where(layer.hit, one.face_states[np.maximum(layer.face, 0)], -1)
    shade = drawing.shade(layer)
    image = paint_states(state, shade, {_MEASURED: MEASURED, _INFERRED: INFERRED, _UNKNOWN: _PALE})
    image = mark_hatched(image, state == _UNKNOWN)
    how = [f"{_KINDS[s.kind]}, {100 * s.probability:.0f} %" for s in sure]
    return picture_of(image, f"Thing {one.thing.index + 1}", " and ".join(how) or "no symmetry is sure")


def _behind(completion: Completion, one: ClosedThing) -> Camera:
    """A camera on the far side of a thing, raised, that holds all of it; z up."""
    vertices = one.back_points()
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    shown = [scan for scan, pixels in enumerate(one.thing.pixels) if len(pixels)]
    eyes = np.array([completion.drawn_scans[scan].origin for scan in shown])
    away = np.array([*(middle - eyes.mean(axis=0))[:2], 0.0])
    away /= max(float(np.linalg.norm(away)), 1e-9)
    raised = np.radians(_RAISED_DEG)
    out = np.cos(raised) * away + np.array([0.0, 0.0, np.sin(raised)])
    radius = float(np.linalg.norm(vertices - middle, axis=1).max())
    slope = _MARGIN * radius / (8 * radius) * np.array([_SHAPE[1] / _SHAPE[0], 1.0])
    return aim(middle + 8 * radius * out, middle, np.array([0.0, 0.0, 1.0]), slope, mirrored=False)
