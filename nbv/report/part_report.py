# SPDX-License-Identifier: MIT
"""Report of a part: its surfaces, and what they are to each other."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from completion.fitting.result import SurfaceFit
from completion.parts.flat_part import FlatPart
from completion.parts.part import Part, kinds_text
from completion.parts.profiles.drawing import drawn_sheet
from completion.parts.profiles.profile import Profile
from completion.parts.profiles.sheet_files import sheet_svg
from completion.relations.graph import RelationGraph, shared_directions
from completion.relations.relation import Relation, RelationKind, RelationStatus
from nbv.report.blocks.page import Block, Cell, Gallery, Headline, Page, PageSection, Table, Text
from nbv.report.blocks.surface_tables import FlatRow, flattening_blocks, relation_section
from nbv.report.figures.drawing import MeshDrawing, SeenFaces
from nbv.report.figures.picture import Camera, Picture, height_colours, overview_cameras, picture_of
from nbv.report.figures.plots import Plot, Theme, drawn_plot
from nbv.report.viewer.part_view import part_view, shown_part
from nbv.run.wording import count
from scenes.checks import FloatArray, IntArray
from scenes.mesh.labelled_mesh import Appearance, LabelledMesh
from scenes.scan.colour import surface_bytes, surface_colour

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

    def cameras(self, height_deg: float) -> list[Camera]:
        """Return cameras all around, in the drawing's frame."""
        return overview_cameras(self.mesh.bounds(), height_deg=height_deg)

    def look(self, camera: Camera, width: int) -> tuple[MeshDrawing, SeenFaces]:
        """Return what a camera sees; all faces turn their front to it."""
        towards = np.einsum("ij,ij->i", camera.origin - self._centres, self._normals)
        drawing = MeshDrawing(self.mesh, self._normals * np.where(towards < 0, -1.0, 1.0)[:, None])
        return drawing, drawing.look(camera, camera.shape(width))

    def n_shown(self, camera: Camera) -> float:
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
    best = [_best(drawing, drawing.cameras(height)) for height in _HEIGHTS_DEG]
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
    camera = _best(drawings[0], [camera for height in _HEIGHTS_DEG for camera in drawings[0].cameras(height)])
    scale = f"{-1000 * most_m:.2g} mm (blue) to {1000 * most_m:.2g} mm (red) over each plane"
    return (
        drawings[0].picture(camera, "As measured", f"{scale}; grey is no plane."),
        drawings[1].picture(camera, "Flattened", "The same: planes are white, relief keeps its colour."),
    )


def _opaque(colours: FloatArray) -> FloatArray:
    """Colours (n, 3) of colours (n, 4) on grey."""
    return np.where(colours[:, 3:] > 0, colours[:, :3], _GREY)


def _best(drawing: PartDrawing, cameras: Sequence[Camera]) -> Camera:
    shown: FloatArray = np.array([drawing.n_shown(camera) for camera in cameras])
    return cameras[int(np.argmax(shown))]


MOST_SURFACES = 60
"""Surfaces, of which more are too many for a drawing."""
_GAP = 0.6  # between directions, of the step between surfaces
_PULL = 0.35  # of the way to the middle that a line keeps away from the ring
_SIZE = (6.2, 6.2)  # inches
_REJECTED = "#c8322b"
_RADII = "#2f8f5b"
_FAMILIES: tuple[tuple[str, str, tuple[RelationKind, ...]], ...] = (
    ("at right angles, at an angle", "line", ("perpendicular", "angle")),
    ("in one plane, on one axis, tangent", "accent", ("coplanar", "coaxial", "axis_in_plane", "tangent")),
    ("of one radius", _RADII, ("equal_radius", "equal_ring_radius")),
    ("apart, evenly spaced, images", "inferred", ("distance", "equal_distance", "regular", "symmetric")),
)


def relation_graph(graph: RelationGraph, names: Sequence[int], places: Sequence[int]) -> Plot:
    """Draw what n surfaces are to each other.

    A band outside joins surfaces of one direction; lines are the accepted relations between others, thin ones
    what these entail, and broken ones what was rejected.

    Parameters
    ----------
    graph : RelationGraph
        At most 60 surfaces.
    names, places : sequence of int
        What the report calls them (n,), and their places (n,) in the palette, from 1.
    """
    groups = shared_directions(graph)
    groups += [[number] for number in range(len(graph.fits)) if not any(number in group for group in groups)]
    angle = _angles(groups, len(graph.fits))
    at = np.stack([np.sin(angle), np.cos(angle)], axis=1)

    def draw(axes: Axes, theme: Theme) -> None:
        axes.set_axis_off()
        axes.set_aspect("equal")
        axes.set_xlim(-1.32, 1.32)
        axes.set_ylim(-1.5, 1.32)
        for numbers in groups:
            if len(numbers) > 1:
                round_ = np.linspace(angle[numbers[0]], angle[numbers[-1]], 40)
                axes.plot(1.2 * np.sin(round_), 1.2 * np.cos(round_), color=theme.faint, linewidth=3,
                          solid_capstyle="round")  # fmt: skip
        for relation in sorted(
            graph.relations, key=lambda relation: relation.status is RelationStatus.ACCEPTED
        ):
            colour = _colour(relation, theme)
            if colour:
                for index, two in _lines(relation):
                    _connect(axes, at[index], at[two], colour, relation.status)
        for number, (name, place) in enumerate(zip(names, places, strict=True)):
            axes.plot(*at[number], "o", color=surface_colour(place), markersize=9, zorder=4)
            axes.annotate(str(name), 1.1 * at[number], ha="center", va="center", fontsize=8, color=theme.ink)
        _legend(axes, theme)

    return drawn_plot(draw, _SIZE)


def _angles(groups: Sequence[Sequence[int]], n: int) -> FloatArray:
    """Where each of n surfaces is on the ring, radians from the top, those of a group side by side."""
    angle, step = np.zeros(n), 2 * np.pi / (n + _GAP * len(groups))
    here = 0.0
    for group in groups:
        for number in group:
            angle[number] = here
            here += step
        here += _GAP * step
    return angle


def _lines(relation: Relation) -> Iterator[tuple[int, int]]:
    """Which surfaces a relation's lines join: one after the other in a row, else by pairs."""
    surfaces = relation.surfaces
    yield from (
        pairwise(surfaces) if relation.kind == "regular" else zip(surfaces[::2], surfaces[1::2], strict=False)
    )


def _colour(relation: Relation, theme: Theme) -> str:
    """The colour of a relation's lines; none of what is not drawn."""
    if relation.status is RelationStatus.UNDECIDED:
        return ""
    if relation.status is RelationStatus.REJECTED:
        return _REJECTED
    return next((_of(name, theme) for _, name, kinds in _FAMILIES if relation.kind in kinds), "")


def _of(name: str, theme: Theme) -> str:
    """A colour by itself, or by its name in the theme."""
    return name if name.startswith("#") else str(getattr(theme, name))


def _connect(axes: Axes, first: FloatArray, two: FloatArray, colour: str, status: RelationStatus) -> None:
    """A line that bends towards the middle."""
    share = np.linspace(0, 1, 30)[:, None]
    middle = (1 - _PULL) * (first + two) / 2
    way = (1 - share) ** 2 * first + 2 * share * (1 - share) * middle + share**2 * two
    is_accepted, is_rejected = status is RelationStatus.ACCEPTED, status is RelationStatus.REJECTED
    axes.plot(
        *way.T,
        color=colour,
        linewidth=1.6 if is_accepted else 0.9,
        alpha=1.0 if is_accepted or is_rejected else 0.35,
        linestyle="--" if is_rejected else "-",
        zorder=3.5 if is_rejected else 3 if is_accepted else 2,
    )


def _legend(axes: Axes, theme: Theme) -> None:
    shown = [Line2D([], [], color=theme.faint, linewidth=3, label="one direction")]
    shown += [Line2D([], [], color=_of(name, theme), label=label) for label, name, _ in _FAMILIES]
    shown.append(Line2D([], [], color=_REJECTED, linestyle="--", label="rejected"))
    axes.legend(handles=shown, loc="lower center", ncols=2, frameon=False, fontsize=7.5, labelcolor=theme.ink)


_MOST_ROWS, _MOST_DIGITS = 200, 5
_SHOWN_SD = 3.0  # of the ripple, at which the colours of heights end


def part_page(part: Part, title: str, flat: FlatPart | None = None, profiles: Sequence[Profile] = ()) -> Page:
    """Return the report of one part, and of the same flattened where it was."""
    what = "vertices" if part.faces is not None else "points"
    share = float(np.mean(part.surface > 0)) if len(part.surface) else 0.0
    graph = part.relations
    holding = 0 if graph is None else sum(relation.holds for relation in graph.relations)
    headlines = [
        Headline(str(len(part.labels)), "", "surfaces"),
        Headline(f"{100 * share:.1f}", "%", f"of the {what} on them", "measured"),
        Headline(millimetres(part.noise_m), "mm", "noise of the points, estimated"),
    ]
    if graph is not None:
        headlines.append(Headline(str(holding), "", "relations hold"))
        headlines.append(
            Headline(str(part.count_relations(RelationStatus.REJECTED)), "", "relations rejected")
        )
        headlines.append(Headline(str(graph.free), "", f"of {graph.unknowns} parameters free"))
    related = [part.measured[place] for place in part.related]
    names = [part.labels[place] for place in part.related]
    relations = () if graph is None else relation_section(graph, related, names)
    return Page(
        title=title,
        kicker="Report of a part",
        summary=_summary(part, what, holding),
        headlines=tuple(headlines),
        bar=None,
        sections=(
            PageSection("The part by surface", _view(part)),
            *_drawing(profiles, title),
            PageSection("Surfaces", _surface_blocks(part)),
            *(() if flat is None else (PageSection("Flattened", _flat_blocks(part, flat)),)),
            *relations,
            *_drawn_relations(part),
        ),
        warnings=part.warnings if flat is None else (*part.warnings, *flat.doubts),
    )


def _drawing(profiles: Sequence[Profile], title: str) -> tuple[PageSection, ...]:
    """The drawing of what is swept; none where nothing is."""
    if not profiles:
        return ()
    sheet = drawn_sheet(profiles, title)
    picture = Picture(
        "Drawing of the profiles",
        "Millimetres; \u00b1: 95 % interval of the measurement. drawing.dxf holds the outlines at full size.",
        sheet_svg(sheet, title).encode(),
        round(4 * sheet.width_mm),
        round(4 * sheet.height_mm),
    )
    return (PageSection("Drawing", (Gallery((picture,), 1),)),)


def _drawn_relations(part: Part) -> tuple[PageSection, ...]:
    """The relations as a drawing; none where there are none, or too many surfaces."""
    graph = part.relations
    if graph is None or not graph.relations or len(part.related) > MOST_SURFACES:
        return ()
    names = [part.labels[place] for place in part.related]
    picture = relation_graph(graph, names, [place + 1 for place in part.related]).picture(
        "The relations of the surfaces, drawn",
        "Surfaces by their numbers and colours; those of one direction are side by side. Strong lines: "
        "relations that are imposed; faint lines: what these entail; broken lines: what was rejected.",
    )
    return (PageSection("The relations drawn", (Gallery((picture,), 1),)),)


def _summary(part: Part, what: str, holding: int) -> str:
    if not part.labels:
        return f"No surface was found in {count(len(part.points), what[:-1])}."
    text = f"{len(part.points)} {what} lie on {kinds_text(part.fits)}."
    n_unassigned = int((part.surface == 0).sum())
    if n_unassigned:
        text += f" {count(n_unassigned, 'lies', 'lie')} on none of them."
    if part.relations is None:
        return f"{text} Relations were not looked for."
    return f"{text} {count(holding, 'relation holds', 'relations hold')} between them."


def _view(part: Part) -> tuple[Block, ...]:
    """The part in three dimensions, and two pictures of it."""
    shown = shown_part(part)
    if not len(shown.mesh.faces):
        return (Text("There is nothing to show."),)
    pictures, camera = part_pictures(PartDrawing(shown.mesh, shown.place))
    return part_view(part, shown, (), camera), Gallery(pictures, 2)


def _flat_blocks(part: Part, flat: FlatPart) -> tuple[Block, ...]:
    """Heights over the planes before and after, and a row for each plane."""
    shown = shown_part(part)
    point = shown.vertex
    before, after = np.full(len(point), np.nan), np.full(len(point), np.nan)
    for surface in flat.surfaces:
        is_member, plane = (
            flat.surface[point] == surface.label,
            part.fits[part.labels.index(surface.label)].surface,
        )
        before[is_member] = plane.distance(part.points[point[is_member]])
        after[is_member] = plane.distance(flat.points[point[is_member]])
    done = [surface.ripple_sd_m for surface in flat.surfaces if surface.is_flattened]
    most_m = _SHOWN_SD * max(float(np.median(done)), 1e-9)
    rows = [
        FlatRow(str(surface.label), part.labels.index(surface.label) + 1, surface)
        for surface in flat.surfaces
    ]
    what, most = "points" if part.faces is None else "vertices", millimetres(float(flat.moved_m.max()))
    text = f"{int((flat.moved_m > 0).sum())} {what} were moved, by {most} mm at most."
    if part.faces is not None:
        text += (
            f" Of {len(part.faces)} triangles {flat.n_turned} turned over and {flat.n_crossing} cross others "
            f"that they did not cross; {flat.n_held} vertices were held back for that."
        )
    pictures = height_pictures(shown.mesh, shown.place, before, after, most_m)
    return Text(text), Gallery(pictures, 2), *flattening_blocks(rows)


def _surface_blocks(part: Part) -> tuple[Block, ...]:
    """A row for each surface."""
    if not part.labels:
        return (Text("None was found."),)
    moved = {} if part.relations is None else dict(zip(part.related, part.relations.moved_sd, strict=True))
    rows = []
    for place, label in enumerate(part.labels[:_MOST_ROWS]):
        fit, measured = part.fits[place], part.measured[place]
        others = [
            str(other)
            for other, group in zip(part.labels, part.groups, strict=True)
            if group == part.groups[place] and other != label
        ]
        before, after = size_text(measured), size_text(fit)
        rows.append(
            (
                Cell(str(label), swatch=surface_colour(place + 1)),
                Cell(fit.surface.kind + (", inner" if getattr(fit.surface, "concave", False) else "")),
                Cell(str(int((part.surface == label).sum()))),
                Cell(millimetres(measured.rms)),
                Cell(before),
                Cell(after if after != before else ""),
                Cell(f"{moved[place]:.1f}" if place in moved else ""),
                Cell(", ".join(others)),
            )
        )
    columns = (
        "Surface", "Kind", "#points", "#rms, mm", "#size as measured", "#size with relations", "#moved, sd",
        "On one surface with",
    )  # fmt: skip
    note = (
        "rms: distance of the points from the surface as measured. size: radius (R), radius of a torus' tube "
        "(r), both in mm, and half angle of a cone, with standard deviations; neighbours that err alike are "
        "allowed for. moved: how far relations moved the surface, in standard deviations."
    )
    if len(part.labels) > _MOST_ROWS:
        note += f" {len(part.labels) - _MOST_ROWS} others are not shown; part.json holds them."
    return Table(columns, tuple(rows)), Text(note, is_note=True)


def size_text(fit: SurfaceFit) -> str:
    """Radii and half angle of a surface with their standard deviations, in words."""
    deviations, surface = fit.parameter_deviations(), fit.surface
    parts = []
    for name, short in (("radius", "R"), ("tube_radius", "r")):
        if hasattr(surface, name):
            parts.append(f"{short} {_with_sd(1000 * getattr(surface, name), 1000 * deviations[name])}")
    if hasattr(surface, "half_angle"):
        angle = float(np.degrees(surface.half_angle))
        parts.append(f"{_with_sd(angle, deviations['half_angle_deg'])}\u00b0")
    return ", ".join(parts)


def _with_sd(value: float, sd: float) -> str:
    """A value to the digits that its standard deviation leaves, at most five after the point."""
    digits = int(np.clip(1 - np.floor(np.log10(sd)), 0, _MOST_DIGITS)) if sd > 0 else _MOST_DIGITS
    shown = f"{sd:.{digits}f}" if sd >= 10.0**-digits else f"<{10.0**-digits:.{digits}f}"
    return f"{value:.{digits}f} \u00b1 {shown}"


def millimetres(value_m: float) -> str:
    """Metres as millimetres to three digits; what is less than a nanometre is nothing."""
    return f"{1000 * value_m:.3g}" if value_m >= 1e-9 else "0"
