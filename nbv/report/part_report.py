# SPDX-License-Identifier: MIT
"""Report of a part: its surfaces, and what they are to each other."""

from __future__ import annotations

import numpy as np

from completion.fitting.result import SurfaceFit
from completion.parts.flat_part import FlatPart
from completion.parts.part import Part, kinds_text
from completion.relations.engine.relation import Status
from nbv.report.blocks.flattening_blocks import FlatRow, flattening_blocks
from nbv.report.blocks.relation_blocks import relation_section
from nbv.report.figures.relation_graph import MOST_SURFACES, relation_graph
from nbv.report.page.page import Block, Cell, Gallery, Headline, Page, Section, Table, Text
from nbv.report.pictures.part_shots import PartDrawing, height_pictures, part_pictures
from nbv.report.viewer.part_view import part_view, shown_part
from nbv.run.wording import count
from scenes.scan.colour import surface_colour

_MOST_ROWS, _MOST_DIGITS = 200, 5
_SHOWN_SD = 3.0  # of the ripple, at which the colours of heights end


def part_page(part: Part, title: str, flat: FlatPart | None = None) -> Page:
    """Return the report of one part, and of the same flattened where it was."""
    what = "vertices" if part.faces is not None else "points"
    share = float(np.mean(part.surface > 0)) if len(part.surface) else 0.0
    graph = part.relations
    holding = 0 if graph is None else sum(one.holds for one in graph.relations)
    headlines = [
        Headline(str(len(part.labels)), "", "surfaces"),
        Headline(f"{100 * share:.1f}", "%", f"of the {what} on them", "measured"),
        Headline(millimetres(part.noise_m), "mm", "noise of the points, estimated"),
    ]
    if graph is not None:
        headlines.append(Headline(str(holding), "", "relations hold"))
        headlines.append(Headline(str(part.numbered(Status.REJECTED)), "", "relations rejected"))
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
            Section("The part by surface", _view(part)),
            Section("Surfaces", _surface_blocks(part)),
            *(() if flat is None else (Section("Flattened", _flat_blocks(part, flat)),)),
            *relations,
            *_drawn_relations(part),
        ),
        warnings=part.warnings if flat is None else (*part.warnings, *flat.doubts),
    )


def _drawn_relations(part: Part) -> tuple[Section, ...]:
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
    return (Section("The relations drawn", (Gallery((picture,), 1),)),)


def _summary(part: Part, what: str, holding: int) -> str:
    if not part.labels:
        return f"No surface was found in {count(len(part.points), what[:-1])}."
    text = f"{len(part.points)} {what} lie on {kinds_text(part.fits)}."
    rest = int((part.surface == 0).sum())
    if rest:
        text += f" {count(rest, 'lies', 'lie')} on none of them."
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
    for one in flat.surfaces:
        own, plane = flat.surface[point] == one.label, part.fits[part.labels.index(one.label)].surface
        before[own] = plane.distance(part.points[point[own]])
        after[own] = plane.distance(flat.points[point[own]])
    done = [one.ripple_sd_m for one in flat.surfaces if one.is_flattened]
    most_m = _SHOWN_SD * max(float(np.median(done)), 1e-9)
    rows = [FlatRow(str(one.label), part.labels.index(one.label) + 1, one) for one in flat.surfaces]
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
    told, surface = fit.parameter_deviations(), fit.surface
    parts = []
    for name, short in (("radius", "R"), ("tube_radius", "r")):
        if hasattr(surface, name):
            parts.append(f"{short} {_with_sd(1000 * getattr(surface, name), 1000 * told[name])}")
    if hasattr(surface, "half_angle"):
        angle = float(np.degrees(surface.half_angle))
        parts.append(f"{_with_sd(angle, told['half_angle_deg'])}\u00b0")
    return ", ".join(parts)


def _with_sd(value: float, sd: float) -> str:
    """A value to the digits that its standard deviation leaves, at most five after the point."""
    digits = int(np.clip(1 - np.floor(np.log10(sd)), 0, _MOST_DIGITS)) if sd > 0 else _MOST_DIGITS
    shown = f"{sd:.{digits}f}" if sd >= 10.0**-digits else f"<{10.0**-digits:.{digits}f}"
    return f"{value:.{digits}f} \u00b1 {shown}"


def millimetres(value_m: float) -> str:
    """Metres as millimetres to three digits; what is less than a nanometre is nothing."""
    return f"{1000 * value_m:.3g}" if value_m >= 1e-9 else "0"
