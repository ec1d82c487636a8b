# SPDX-License-Identifier: MIT
"""Report of a part: its surfaces, and what they are to each other."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from completion.fitting.result import SurfaceFit
from completion.parts.backs.pipeline import PartBack
from completion.parts.dimensions.dimension import PartDimensions
from completion.parts.dimensions.table import basis_text, preferred_text, symbol_text, value_text
from completion.parts.flat_part import FlatPart
from completion.parts.part import Part, kinds_text
from completion.parts.part_features import PartFeature
from completion.parts.profiles.drawing import drawn_sheet
from completion.parts.profiles.profile import Profile
from completion.parts.profiles.sheet_files import sheet_svg
from completion.relations.graph import RelationGraph, shared_directions
from completion.relations.relation import Relation, RelationKind, RelationStatus
from nbv.report.blocks.page import Block, Cell, Gallery, Headline, Page, PageSection, Table, Text
from nbv.report.blocks.surface_tables import FlatRow, flattening_blocks, relation_section
from nbv.report.figures.part_drawing import PartDrawing, dimension_pictures, height_pictures, part_pictures
from nbv.report.figures.picture import Picture
from nbv.report.figures.plots import Plot, Theme, drawn_plot
from nbv.report.part_back_report import back_sections
from nbv.report.viewer.part_view import part_view, shown_part
from nbv.run.wording import count, percent
from scenes.checks import FloatArray
from scenes.scan.colour import surface_colour

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
_BY = " \u00d7 "
_MOST_LISTED = 12  # surfaces of a dimension
_SHOWN_SD = 3.0  # of the ripple, at which the colours of heights end


def part_page(
    part: Part,
    title: str,
    flat: FlatPart | None = None,
    *,
    back: PartBack | None = None,
    dimensions: PartDimensions | None = None,
    profiles: Sequence[Profile] = (),
    features: Sequence[PartFeature] = (),
) -> Page:
    """Return the report of a part, flattened where it was, of its unseen sides, dimensions and profiles."""
    what = "vertices" if part.faces is not None else "points"
    share = float(np.mean(part.surface > 0)) if len(part.surface) else 0.0
    graph = part.relations
    holding = 0 if graph is None else sum(relation.holds for relation in graph.relations)
    headlines = [
        Headline(str(len(part.labels)), "", "surfaces"),
        Headline(f"{100 * share:.1f}", "%", f"of the {what} on them", "measured"),
        Headline(*_small_length(part.noise_m), f"noise of the {what}, estimated"),
    ]
    if graph is not None:
        headlines.append(Headline(str(holding), "", "relations accepted"))
        headlines.append(
            Headline(str(part.count_relations(RelationStatus.REJECTED)), "", "relations rejected")
        )
        headlines.append(
            Headline(str(graph.free), "", f"of {graph.unknowns} surface parameters left free by relations")
        )
    related = [part.measured[place] for place in part.related]
    names = [part.labels[place] for place in part.related]
    relations = () if graph is None else relation_section(graph, related, names)
    return Page(
        title=title,
        kicker="Report of a part",
        summary=_summary(part, what, holding) + ("" if dimensions is None else _size_text(dimensions)),
        headlines=tuple(headlines),
        bar=None,
        sections=(
            PageSection("The part by surface", _view(part)),
            *(() if back is None else back_sections(part, back)),
            *(() if dimensions is None else (PageSection("Dimensions", dimension_blocks(part, dimensions)),)),
            *((PageSection("Features", (_feature_table(features),)),) if features else ()),
            *_drawing(profiles, title),
            PageSection("Surfaces", _surface_blocks(part)),
            *(() if flat is None else (PageSection("Flattened", _flat_blocks(part, flat)),)),
            *relations,
            *_drawn_relations(part),
        ),
        warnings=(
            *part.warnings,
            *(() if flat is None else flat.doubts),
            *(() if dimensions is None else dimensions.doubts),
        ),
    )


def _feature_table(features: Sequence[PartFeature]) -> Table:
    """A row for each feature, those of a pattern after it."""
    every = [one for feature in features for one in (feature, *feature.members)]
    rows = [(Cell(one.name), Cell(one.size), Cell(_listed(one.surfaces))) for one in every[:_MOST_ROWS]]
    return Table(("Feature", "Size", "Of surfaces"), tuple(rows))


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
    return f"{text} {count(holding, 'relation')} between them {'was' if holding == 1 else 'were'} accepted."


def _size_text(dimensions: PartDimensions) -> str:
    """Overall sizes, and the volume where it is known, as a sentence."""
    sizes = [value_text(row, has_interval=False) for row in dimensions.of_kind("overall size")]
    volume = [f", its volume {value_text(row)}" for row in dimensions.of_kind("volume")]
    return f" Its overall size is {_BY.join(sizes)}{''.join(volume)}." if sizes else ""


def _view(part: Part) -> tuple[Block, ...]:
    """The part in three dimensions, and two pictures of it."""
    shown = shown_part(part)
    if not len(shown.mesh.faces):
        return (Text("There is nothing to show."),)
    pictures, camera = part_pictures(PartDrawing(shown.mesh, shown.place))
    return part_view(part, shown, (), camera), Gallery(pictures, 2)


def dimension_blocks(part: Part, dimensions: PartDimensions) -> tuple[Block, ...]:
    """A row for each dimension, and the main ones drawn on the part."""
    if not dimensions.rows:
        return (Text("There is none."),)
    place = {label: number for number, label in enumerate(part.labels, start=1)}
    rows = [
        (
            Cell(
                str(number), swatch=surface_colour(place[row.surfaces[0]]) if len(row.surfaces) == 1 else ""
            ),
            Cell(row.kind),
            Cell(symbol_text(row, has_interval=True)),
            Cell(_listed(row.surfaces)),
            Cell(basis_text(row)),
            Cell(row.note),
            Cell(preferred_text(row)),
            Cell("" if row.preferred is None else percent(row.preferred.probability)),
        )
        for number, row in enumerate(dimensions.rows[:_MOST_ROWS], start=1)
    ]
    columns = (
        "Number", "Dimension", "#value with 95 % interval, unit", "Of surfaces", "Known from", "Note",
        "Preferred value, a hypothesis", "#its probability, %",
    )  # fmt: skip
    note = (
        f"Overall sizes are along the part's frame: {dimensions.frame.note}. Intervals follow from the joint "
        "covariance of all surfaces, given the relations that hold. relations: these make it better known "
        "than its own points do; regular places: given that holes are equally spaced. A preferred value is "
        "what the dimension was probably meant to be; only --preferred impose changes anything to it."
    )
    if part.faces is not None:
        note += " Of a model's mesh they are the precision of its file, not that of a piece made to it."
    if len(dimensions.rows) > _MOST_ROWS:
        note += f" {len(dimensions.rows) - _MOST_ROWS} others are not shown; dimensions.csv holds them."
    table = Table(columns, tuple(rows)), Text(note, is_note=True)
    shown = shown_part(part)
    if not len(shown.mesh.faces):
        return table
    drawing = PartDrawing(shown.mesh, shown.place)
    return Gallery(dimension_pictures(drawing, dimensions), 1), *table


def _listed(labels: Sequence[int]) -> str:
    """Labels as text; many shortened."""
    return ", ".join(map(str, labels)) if len(labels) <= _MOST_LISTED else f"{len(labels)} surfaces"


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
                Cell(str(part.n_points(label))),
                Cell(millimetres(measured.rms)),
                Cell(before),
                Cell(after if after != before else ""),
                Cell(f"{moved[place]:.1f}" if place in moved else ""),
                Cell(", ".join(others)),
            )
        )
    columns = (
        "Surface", "Kind", "#points", "#rms, mm", "#size as measured, mm or \u00b0",
        "#size with relations, mm or \u00b0", "#moved, standard deviations", "On one surface with",
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


def _small_length(value_m: float) -> tuple[str, str]:
    """A length and its unit, short: micrometres below a hundredth of a millimetre."""
    return (
        (f"{max(1e6 * value_m, 1e-3):.2g}", "\u00b5m") if 0 < value_m < 1e-5 else (millimetres(value_m), "mm")
    )


def millimetres(value_m: float) -> str:
    """Metres as millimetres to three digits; what is less than a nanometre is nothing."""
    return f"{1000 * value_m:.3g}" if value_m >= 1e-9 else "0"
