# SPDX-License-Identifier: MIT
"""Pictures of a part: coloured by surface, by height over its planes, and with its main dimensions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes

from completion.parts.dimensions.dimension import PartDimension, PartDimensions
from completion.parts.dimensions.table import symbol_text
from nbv.report.figures.drawing import MeshDrawing, SeenFaces
from nbv.report.figures.labels import beside, boxes
from nbv.report.figures.picture import Camera, Picture, height_colours, overview_cameras, picture_of
from nbv.report.figures.plots import Theme, drawn_plot
from scenes.checks import BoolArray, FloatArray, IntArray
from scenes.mesh.labelled_mesh import Appearance, LabelledMesh
from scenes.rays.raycast import RayCaster
from scenes.scan.colour import surface_bytes

_WIDTH, _TRIAL_WIDTH = 760, 96
_HEIGHTS_DEG = (38.0, -38.0)
_GREY = 0.55  # of what has no height
_SIZE_M = 1.0  # at which a part is drawn, whatever its own


class PartDrawing:
    """A part ready for drawing: a mesh of which both sides are shown, and the surface (m,) of each face.

    It has the colours (m, 3, 3) of the faces' corners, or else those of the surfaces.
    """

    def __init__(self, mesh: LabelledMesh, place: IntArray, colour: FloatArray | None = None) -> None:
        low, high = mesh.bounds()
        scale = _SIZE_M / max(float(np.linalg.norm(high - low)), 1e-300)
        if colour is None:
            colour = np.repeat((surface_bytes(place) / 255.0)[:, None], 3, axis=1)
        self.scale, self.middle = scale, (low + high) / 2
        self.mesh = LabelledMesh(
            (mesh.vertices - self.middle) * scale,
            mesh.faces,
            appearance=Appearance(colour.astype(np.float32)),
        )
        self.place = place
        self._normals, self._centres = self.mesh.face_normals(), self.mesh.corners.mean(axis=1)
        self._caster = RayCaster(self.mesh.vertices, self.mesh.faces)
        self._best: dict[float, tuple[float, Camera]] = {}

    def best_camera(self, *heights_deg: float) -> Camera:
        """Return the camera of those all around at some heights that shows most, in the drawing's frame."""
        for height in heights_deg:
            if height not in self._best:
                cameras = overview_cameras(self.mesh.bounds(), height_deg=height)
                shown = [self._shown(camera) for camera in cameras]
                self._best[height] = max(shown), cameras[int(np.argmax(shown))]
        return max((self._best[height] for height in heights_deg), key=lambda pair: pair[0])[1]

    def look(self, camera: Camera, width: int) -> tuple[MeshDrawing, SeenFaces]:
        """Return what a camera sees; all faces turn their front to it."""
        towards = np.einsum("ij,ij->i", camera.origin - self._centres, self._normals)
        front = self._normals * np.where(towards < 0, -1.0, 1.0)[:, None]
        drawing = MeshDrawing(self.mesh, front, caster=self._caster)
        return drawing, drawing.look(camera, camera.shape(width))

    def _shown(self, camera: Camera) -> float:
        """How many surfaces a camera shows well, each by the root of its pixels."""
        _, seen = self.look(camera, _TRIAL_WIDTH)
        count = np.bincount(self.place[seen.face[seen.hit]])
        return float(np.sqrt(count[1:]).sum())

    def picture(self, camera: Camera, title: str, caption: str) -> Picture:
        """Return the picture that a camera takes."""
        drawing, seen = self.look(camera, _WIDTH)
        return picture_of(drawing.colour(seen), title, caption)

    def in_world(self, camera: Camera) -> Camera:
        """Return a camera of the drawing's frame in that of the part."""
        return Camera(camera.origin / self.scale + self.middle, camera.axes, camera.slope)


def part_pictures(drawing: PartDrawing) -> tuple[tuple[Picture, ...], Camera]:
    """Return pictures from above and from below, and the first camera in the part's own frame."""
    best = [drawing.best_camera(height) for height in _HEIGHTS_DEG]
    titles = ("The part, coloured by surface.", "From below.")
    captions = ("Grey belongs to no surface.", "The same from below.")
    pictures = tuple(drawing.picture(*triple) for triple in zip(best, titles, captions, strict=True))
    return pictures, drawing.in_world(best[0])


def height_pictures(
    mesh: LabelledMesh, place: IntArray, before: FloatArray, after: FloatArray, most_m: float
) -> tuple[Picture, ...]:
    """Return a part coloured by heights (n,) of its vertices over their planes, before and after a change.

    NaN where there is no plane; the scale ends at `most_m` metres either way.
    """
    drawings = [PartDrawing(mesh, place, _opaque(height_colours(heights, most_m))[mesh.faces])
                for heights in (before, after)]  # fmt: skip
    camera = drawings[0].best_camera(*_HEIGHTS_DEG)
    scale = f"{-1000 * most_m:.2g} mm (blue) to {1000 * most_m:.2g} mm (red) over each plane"
    return (
        drawings[0].picture(camera, "As measured", f"{scale}; grey is no plane."),
        drawings[1].picture(camera, "Flattened", "The same: planes are white, relief keeps its colour."),
    )


def _opaque(colours: FloatArray) -> FloatArray:
    """Colours (n, 3) of colours (n, 4) on grey."""
    return np.where(colours[:, 3:] > 0, colours[:, :3], _GREY)


_DRAWN = (
    "hole diameter", "pitch circle diameter", "outer diameter", "thickness", "pitch", "hole depth",
    "slot width", "fillet radius", "chamfer", "countersink diameter", "cone angle", "angle", "axis distance",
    "length", "ring diameter", "sphere diameter", "step", "axis to plane", "radius",
)  # fmt: skip
"""Kinds that are drawn beside overall sizes, the most telling first."""
_MOST_DRAWN = 12
_SHARP = 1_200  # pixels across a picture with dimensions, of which what is around the part is cut off
_MARGIN = 0.07  # of the part's extent around it, for texts
_OFFSET = 0.05  # of the width, by which overall sizes stand off the part
_NEAR = 0.01  # of the part's size, by which an end that is seen may lie behind what a ray meets
_FONT, _INCHES = 8.5, 8.4
_TEXT_SIZE = (0.0098, 0.028)  # of the width: a letter's width and a line's height


class _DrawnLine(NamedTuple):
    """A dimension in a picture: its ends (2, 2), widths from the left and top, its text, and its feet (2, 2).

    From the feet, on the part, lines lead to ends that stand off it.
    """

    ends: FloatArray
    text: str
    feet: FloatArray | None = None


def dimension_pictures(drawing: PartDrawing, dimensions: PartDimensions) -> tuple[Picture, ...]:
    """Return pictures from above and from below with the main dimensions, each drawn where it is seen."""
    pictures, drawn = [], set[int]()
    for height, title in zip(_HEIGHTS_DEG, ("The main dimensions.", "Others, from below."), strict=True):
        camera = drawing.best_camera(height)
        mesh, seen = drawing.look(camera, _SHARP)
        lines = [] if drawn else _overall_lines(drawing, camera, dimensions)
        for row in _main(dimensions.rows):
            line = _line(row, drawing, camera, seen)
            if line is not None and id(row) not in drawn and len(lines) < _MOST_DRAWN:
                drawn.add(id(row))
                lines.append(line)
        if lines:
            edges = _edges_behind(drawing, camera, seen, dimensions)
            pictures.append(_drawn(mesh.colour(seen), seen.hit, (lines, edges), title))
    return tuple(pictures)


def _main(rows: Sequence[PartDimension]) -> list[PartDimension]:
    """The dimensions that are drawn, the most telling kinds first."""
    chosen = [row for row in rows if row.kind in _DRAWN and np.isfinite(row.sd)]
    return sorted(chosen, key=lambda row: (_DRAWN.index(row.kind), -row.value))


def _projected(drawing: PartDrawing, camera: Camera, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Places (n, 2) of points in a picture, in its widths, and how far they are from the camera."""
    local = ((points - drawing.middle) * drawing.scale - camera.origin) @ camera.axes.T
    across = local[:, :2] / local[:, 2:] / camera.slope[0]
    high = float(camera.slope[1] / camera.slope[0])
    return np.column_stack([across[:, 0] + 1, across[:, 1] + high]) / 2, np.linalg.norm(local, axis=1)


def _line(row: PartDimension, drawing: PartDrawing, camera: Camera, seen: SeenFaces) -> _DrawnLine | None:
    """A dimension where nothing is before one of its ends; None where both are hidden."""
    place, away = _projected(drawing, camera, row.ends)
    return _DrawnLine(place, symbol_text(row)) if _is_seen(place, away, camera, seen).any() else None


def _is_seen(
    place: FloatArray, away: FloatArray, camera: Camera, seen: SeenFaces, behind: float = 0.0
) -> BoolArray:
    """Which places (n, 2) of a picture have nothing before what is `away` (n,) there, but for so much."""
    rows, columns = seen.face.shape
    column, line = np.floor(place * columns).astype(np.int64).T
    is_inside = (line >= 0) & (line < rows) & (column >= 0) & (column < columns)
    at = np.clip(line, 0, rows - 1), np.clip(column, 0, columns - 1)
    met = np.linalg.norm(seen.points[at] - camera.origin, axis=-1)
    return np.asarray(is_inside & (~seen.hit[at] | (away < met + _NEAR * _SIZE_M + behind)))


def _edges_behind(
    drawing: PartDrawing, camera: Camera, seen: SeenFaces, dimensions: PartDimensions
) -> list[FloatArray]:
    """The edges (n, 2) behind blends of two faces in a picture, where the blends are seen; else NaN."""
    edges = []
    for blend in dimensions.blends:
        place, away = _projected(drawing, camera, blend.edge)
        is_seen = _is_seen(place, away, camera, seen, behind=drawing.scale * blend.size_m)
        edges.append(np.where(is_seen[:, None], place, np.nan))
    return edges


def _overall_lines(drawing: PartDrawing, camera: Camera, dimensions: PartDimensions) -> list[_DrawnLine]:
    """Overall sizes along those edges of the part's box that lie outermost in the picture."""
    axes, rows = dimensions.frame.axes, dimensions.of_kind("overall size")
    along = (drawing.mesh.vertices / drawing.scale + drawing.middle) @ axes.T
    bounds = np.stack([along.min(axis=0), along.max(axis=0)])
    middle = _projected(drawing, camera, bounds.mean(axis=0)[None] @ axes)[0][0]
    lines = []
    for k, row in enumerate(rows):
        best, feet, outermost = np.zeros((2, 2)), np.zeros((2, 2)), -1.0
        for sides in np.ndindex(2, 2):
            ends = np.empty((2, 3))
            ends[:, k] = bounds[:, k]
            for other, side in zip([j for j in range(3) if j != k], sides, strict=True):
                ends[:, other] = bounds[side, other]
            place = _projected(drawing, camera, ends @ axes)[0]
            step = place[1] - place[0]
            normal = np.array([-step[1], step[0]]) / max(float(np.linalg.norm(step)), 1e-12)
            out = float(normal @ (place.mean(axis=0) - middle))
            if abs(out) > outermost:
                best, feet, outermost = place + _OFFSET * np.sign(out) * normal, place, abs(out)
        lines.append(_DrawnLine(best, symbol_text(row), feet))
    return lines


def _drawn(
    pixels: FloatArray, hit: BoolArray, drawn: tuple[Sequence[_DrawnLine], Sequence[FloatArray]], title: str
) -> Picture:
    """A picture with dimension lines and their texts beside them, none on another; and edges."""
    lines, edges = drawn
    ends = np.concatenate([line.ends for line in lines])
    shown = np.concatenate([np.argwhere(hit)[:, ::-1] / pixels.shape[1], ends])
    low, high = shown.min(axis=0), shown.max(axis=0)
    pad = _MARGIN * float((high - low).max())
    (left, top), (right, bottom) = low - pad, high + pad
    width = right - left
    middles = np.array([line.ends.mean(axis=0) for line in lines])
    sizes = width * np.array([(_TEXT_SIZE[0] * len(line.text), _TEXT_SIZE[1]) for line in lines])
    anchors = boxes(ends, np.full((len(ends), 2), 0.01 * width))
    places = beside(middles, sizes, 0.02 * width, anchors)

    def draw(axes: Axes, theme: Theme) -> None:
        axes.set_axis_off()
        extent = (0, 1, pixels.shape[0] / pixels.shape[1], 0)
        axes.imshow(pixels, extent=extent, interpolation="bilinear", zorder=0)
        axes.set_xlim(left, right)
        axes.set_ylim(bottom, top)
        for edge in edges:
            axes.plot(*edge.T, color=theme.ink, linewidth=0.6, linestyle=(0, (6, 3)), zorder=1)
        for line, place, middle in zip(lines, places, middles, strict=True):
            if np.linalg.norm(line.ends[1] - line.ends[0]) > 1e-3:
                arrow = {"arrowstyle": "<|-|>", "color": theme.ink, "linewidth": 0.9, "mutation_scale": 7}
                axes.annotate("", line.ends[1], line.ends[0], zorder=3,
                              arrowprops={**arrow, "shrinkA": 0, "shrinkB": 0})  # fmt: skip
            else:
                axes.plot(*middle, "o", color=theme.ink, markersize=3, zorder=3)
            for foot, end in () if line.feet is None else zip(line.feet, line.ends, strict=True):
                axes.plot(*np.stack([foot, end]).T, color=theme.faint, linewidth=0.6, zorder=2)
            axes.plot(*np.stack([middle, place]).T, color=theme.ink, linewidth=0.5, zorder=3)
            ground = {
                "boxstyle": "round,pad=0.15",
                "facecolor": theme.fill,
                "edgecolor": "none",
                "alpha": 0.85,
            }
            look: dict[str, Any] = {
                "ha": "center",
                "va": "center",
                "fontsize": _FONT,
                "color": theme.ink,
                "zorder": 5,
            }
            axes.annotate(line.text, place, **look, bbox=ground)

    caption = "\u2300 diameter, R radius; 6 \u00d7: of six alike. Intervals and all others are in the table."
    caption += " Broken lines: where faces meet behind their blends." if edges else ""
    return drawn_plot(draw, (_INCHES, _INCHES * (bottom - top) / width)).picture(title, caption)
