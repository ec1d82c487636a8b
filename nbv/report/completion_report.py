# SPDX-License-Identifier: MIT
"""Report of a completion: what was measured, what was inferred from it, and how sure that is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from completion.export.decisions import Advice, DecisionSheet, told_rule
from completion.export.dimension import Dimension
from completion.extension.patch import Patch
from completion.features.engine.template import FeatureStatus
from completion.registration.correction import Registration
from completion.result.completion import Completion
from completion.result.flat_scans import whole_flattening
from nbv.report.blocks.coverage_tables import scans_table
from nbv.report.blocks.page import (
    Bar,
    BarShare,
    Block,
    Cell,
    Gallery,
    Headline,
    Legend,
    Page,
    PageSection,
    State,
    Table,
    Text,
)
from nbv.report.blocks.surface_tables import FlatRow, flattening_blocks, relation_section
from nbv.report.feature_report import feature_blocks
from nbv.report.figures.completion_shots import ModelDrawings, is_single_camera
from nbv.report.figures.picture import (
    Camera,
    Picture,
    aside_cameras,
    height_colours,
    overview_cameras,
    picture_of,
    range_colours,
    segment_pixels,
)
from nbv.report.things_report import things_sections
from nbv.report.viewer.scan_views import completion_view
from nbv.run.wording import count, square_metres
from scenes.checks import FloatArray
from scenes.run.mapping import trim
from scenes.scan.colour import colour_bytes, surface_colour
from scenes.scan.thumbnail import turn_upright

_MOST_ROWS = 60
_STATES: dict[Advice, State] = {"rely": "measured", "check": "unknown", "do not build": "inferred"}
_UNITS = {"m": "m", "m2": "m\u00b2", "m3": "m\u00b3"}


def decision_sections(sheet: DecisionSheet) -> tuple[PageSection, ...]:
    """Return a section with what may be relied on; none where there is no dimension."""
    if not sheet.dimensions:
        return ()
    sections = list(zip(sheet.dimensions, sheet.advice, strict=True))
    rows = tuple(_dimension_row(dimension, word) for dimension, word in sections[:_MOST_ROWS])
    sentence = ", ".join(f"{n} \u00d7 {word}" for word, n in sheet.counts().items() if n)
    doubt = f" {sheet.told_doubt}" if sheet.told_doubt else ""
    blocks = [Text(f"{count(len(sections), 'dimension')}: {sentence}.{doubt} {told_rule(sheet.tolerance_m)}")]
    columns = (
        "Dimension", "Surfaces", "#value, unit", "#from, unit", "#to (95 %), unit", "measured, %", "Advice",
    )  # fmt: skip
    table = Table(columns, rows)
    note = (
        "Intervals hold noise, what surfaces share by one sensor and by their relations, how well the scans "
        "are placed, and the systematic errors of sensors of this kind."
    )
    left = len(sections) - _MOST_ROWS
    more = f" {count(left, 'more is', 'more are')} in decisions.csv." if left > 0 else ""
    return (PageSection("What to rely on", (*blocks, table, Text(note + more, is_note=True))),)


def _dimension_row(dimension: Dimension, word: Advice) -> tuple[Cell, ...]:
    digits = int(np.clip(np.ceil(-np.log10(max(dimension.half, 1e-12))) + 1, 2, 4))
    ends = (dimension.low, dimension.high) if np.isfinite(dimension.half) else ()
    numbers = [f"{dimension.value:.{digits}f}", *(f"{end:.{digits}f}" for end in ends), *("not known",) * 2][
        :3
    ]
    of = Cell(f"thing {dimension.thing}")
    if dimension.thing is None:
        of = Cell(" ".join(map(str, dimension.surfaces)), swatch=surface_colour(dimension.surfaces[0]))
    return (
        Cell(dimension.kind),
        of,
        *(Cell(f"{text} {_UNITS[dimension.unit]}" if text[-1].isdigit() else text) for text in numbers),
        Cell(f"{100 * dimension.measured_share:.0f}", share=dimension.measured_share, state="measured"),
        Cell(word, state=_STATES[word]),
    )


_MOST_FLAT_SCANS = 3  # of which pictures are shown
_SHOWN_SD = 3.0  # of the ripple, at which the colours of heights end
_LEAST_M = 1e-6


def flattening_sections(completion: Completion) -> tuple[PageSection, ...]:
    """Return a section on what flattening did; none where nobody asked."""
    scans = completion.flattened
    if not scans:
        return ()
    record = whole_flattening(scans)
    text = (
        f"{count(record['planes'], 'plane was', 'planes were')} flattened along the rays of their pixels, in "
        f"observed.ply and completed.glb; what is inferred does not depend on it. Ripple fell from "
        f"{1000 * record['ripple_before_m']:.2f} to {1000 * record['ripple_after_m']:.2f} mm rms, "
        f"{count(record['relief_areas'], 'area')} of relief stayed. {record['turned_over']} triangles turned "
        f"over, {record['crossing_anew']} cross others that they did not cross."
    )
    rows = [
        FlatRow(f"{surface.label}" + (f", scan {scan}" if len(scans) > 1 else ""), surface.label, surface)
        for scan, held in enumerate(scans, start=1)
        for surface in held.surfaces
    ]
    galleries = [_gallery(completion, scan) for scan in range(min(len(scans), _MOST_FLAT_SCANS))]
    return (PageSection("Flattened", (Text(text), *galleries, *flattening_blocks(rows))),)


def _gallery(completion: Completion, scan: int) -> Block:
    """Heights over their planes of the pixels of a scan, from 0, before and after."""
    seen, owner, flat = completion.observations[scan], completion.owners[scan], completion.flattened[scan]
    done = [surface for surface in flat.surfaces if surface.is_flattened]
    most_m = max(
        _SHOWN_SD * float(np.median([surface.ripple_sd_m for surface in done])) if done else 0.0, _LEAST_M
    )
    before, after = (np.full(owner.shape, np.nan) for _ in range(2))
    for surface in done:
        pixel = np.flatnonzero(owner == surface.label)
        plane, points = completion.patches[surface.label - 1].source.fit.surface, seen.points_at(pixel)
        before.ravel()[pixel] = plane.distance(points)
        moved = points + flat.shift_m.ravel()[pixel, None] * seen.rays_at(pixel)
        after.ravel()[pixel] = plane.distance(moved)
        trim()
    pose = completion.drawing_from_reference @ seen.scan.world_from_sensor
    view = partial(turn_upright, projection=seen.scan.projection, pose=pose)
    name = f"{seen.scan.name}: " if len(completion.flattened) > 1 else ""
    scale = (
        f"{-1000 * most_m:.2g} mm (blue) to {1000 * most_m:.2g} mm (red) over each plane; empty elsewhere."
    )

    def height_image(heights: FloatArray) -> FloatArray:
        return height_colours(view(heights), most_m)

    return Gallery(
        (
            picture_of(height_image(before), f"{name}as measured", scale),
            picture_of(height_image(after), f"{name}flattened", "White is plane; relief keeps its colour."),
        ),
        columns=2,
    )


_MOST_SCANS = 3  # of which pictures are shown
_MOST_PAIRS = 20  # of scans whose poses are compared


def completion_page(
    completion: Completion,
    title: str,
    decisions: DecisionSheet | None = None,
    *,
    n_threads: int | None = None,
    first_scan: Mapping[str, Any] | None = None,
) -> Page:
    """Return the report of one completion, with the decisions of `completion.decisions()` or others.

    `first_scan` is what later scans say of what the first one alone inferred, as completion.json holds it.
    """
    observed, inferred = completion.observed_m2, completion.hypothesised_m2
    violation = completion.free_space_violation_m2
    headlines = (
        Headline(square_metres(observed), "m\u00b2", "measured surface", "measured"),
        Headline(square_metres(inferred), "m\u00b2", "inferred behind occluders", "inferred"),
        Headline(str(len(completion.patches)), "", "surfaces recognised"),
        Headline(square_metres(violation), "m\u00b2", "inferred where a beam went through"),
    )
    return Page(
        title=title,
        kicker="Completion report",
        summary=_summary(completion),
        headlines=headlines,
        bar=area_bar(completion),
        sections=(
            PageSection("Before and after", before_and_after(completion, n_threads)),
            *decision_sections(completion.decisions() if decisions is None else decisions),
            PageSection("What the scanner saw", (*scan_pictures(completion), scans_of(completion))),
            PageSection("Surfaces", surface_blocks(completion)),
            *things_sections(completion),
            *feature_sections(completion),
            *flattening_sections(completion),
            *relation_sections(completion),
            *pose_sections(completion.registration),
            *edit_sections(completion),
            *verification_sections(first_scan),
        ),
        warnings=completion.warnings,
    )


def feature_sections(completion: Completion) -> tuple[PageSection, ...]:
    """Return a section on the openings that were fitted whole; none where none was accepted or in doubt."""
    sections = [fit for fit in completion.features if fit.status is not FeatureStatus.NONE]
    if not sections:
        return ()
    return (PageSection("Doorways and windows", feature_blocks(completion.features)),)


def _summary(completion: Completion) -> str:
    observed, inferred = completion.observed_m2, completion.hypothesised_m2
    scans = count(len(completion.observations), "scan")
    if not completion.patches:
        return f"No surface was recognised in {scans}, so nothing was inferred."
    share = f" (+{100 * inferred / observed:.1f} %)" if observed > 0 else ""
    text = (
        f"{scans[0].upper()}{scans[1:]} measured {square_metres(observed)} m\u00b2 on "
        f"{count(len(completion.patches), 'surface')}; "
        f"{square_metres(inferred)} m\u00b2 more{share} were inferred where something stood in front."
    )
    violation = completion.free_space_violation_m2
    if not inferred:
        return text
    if violation == 0:
        return text + " No measured beam passes through what was inferred."
    return text + f" Of that, {square_metres(violation)} m\u00b2 contradict a measured beam."


def area_bar(completion: Completion) -> Bar:
    """Measured against inferred area."""
    pairs: tuple[tuple[State, float], ...] = (
        ("measured", completion.observed_m2),
        ("inferred", completion.hypothesised_m2),
    )
    total = max(sum(area for _, area in pairs), 1e-12)
    return Bar(
        "",
        tuple(BarShare(name, name, area / total, f"{square_metres(area)} m\u00b2") for name, area in pairs),
    )


def scan_pictures(completion: Completion) -> tuple[Block, ...]:
    """Colour, range and surfaces of the first scans, as the scanner saw them."""
    blocks: list[Block] = []
    pairs = list(zip(completion.observations, completion.owners, strict=True))
    for seen, owner in pairs[:_MOST_SCANS]:
        pictures = []
        pose = completion.drawing_from_reference @ seen.scan.world_from_sensor
        view = partial(turn_upright, projection=seen.scan.projection, pose=pose)
        name = "" if len(pairs) == 1 else f"{seen.scan.name}: "
        if seen.scan.colour is not None:
            colour = colour_bytes(view(seen.scan.colour))
            pictures.append(picture_of(colour, f"{name}Colour"))
        colours, low, high = range_colours(view(seen.scan.ranges))
        scale = f"{low:.2f} m (yellow) to {high:.2f} m (violet); empty where nothing came back."
        pictures.append(picture_of(colours, f"{name}Range", scale))
        segments = segment_pixels(view(owner), view(seen.valid))
        pictures.append(
            picture_of(segments, f"{name}Surfaces", "Coloured as in the table below; grey belongs to none.")
        )
        blocks.append(Gallery(tuple(pictures), columns=len(pictures)))
        trim()
    if len(pairs) > _MOST_SCANS:
        blocks.append(
            Text(
                f"{count(len(pairs) - _MOST_SCANS, 'other scan is', 'other scans are')} not shown.",
                is_note=True,
            )
        )
    return tuple(blocks)


def scans_of(completion: Completion) -> Table:
    """A row for each scan."""
    return scans_table(completion.scans, z_up=completion.up.drawing_from_world)


def before_and_after(completion: Completion, n_threads: int | None = None) -> tuple[Block, ...]:
    """The model in three dimensions, and as measured, with inferred area, and with that marked."""
    drawn = _draw_model(completion, n_threads)  # what it was drawn with is gone before the view is made
    if drawn is None:
        return (Text("There is no surface to show."),)
    camera, pictures = drawn
    trim()
    view = completion_view(completion, is_room=not is_single_camera(completion.scans), camera=camera)
    return view, Legend(), Gallery(pictures, 2)


def _draw_model(completion: Completion, n_threads: int | None) -> tuple[Camera, tuple[Picture, ...]] | None:
    """From where a model is best seen, and its pictures; None where there is no surface."""
    stage = ModelDrawings.of(completion, n_threads)
    if stage.is_empty:
        return None
    single = is_single_camera(stage.scans)
    cameras = aside_cameras(stage.scans[0]) if single else overview_cameras(stage.bounds)
    best = max(range(len(cameras)), key=lambda k: stage.count_shown(cameras[k]))
    opposite = best ^ 1 if single else (best + len(cameras) // 2) % len(cameras)
    where = "Seen from a step aside of the scanner." if single else "Seen from outside, near walls left out."
    pictures = stage.shoot(cameras[best], where)
    turned = replace(stage.shoot_marked(cameras[opposite]), caption="The same from the other side.")
    return cameras[best], (*pictures, turned)


def surface_blocks(completion: Completion) -> tuple[Block, ...]:
    """A row for each surface."""
    if not completion.patches:
        return (Text("None was recognised."),)
    rows = tuple(_row(number, patch) for number, patch in enumerate(completion.patches, start=1))
    columns = ("Surface", "Kind", "#measured, m\u00b2", "#inferred, m\u00b2", "#rms, mm", "#radius, mm")
    note = (
        "rms: distance of the measured points from the fitted surface. Radii carry their standard deviation "
        "from the fit. Inferred area is a hypothesis: completion.json says why each boundary ends there."
    )
    return Table(columns, rows), Text(" ".join((note, *_assumptions(completion))), is_note=True)


def _assumptions(completion: Completion) -> tuple[str, ...]:
    """How uneven surfaces were taken to be, and which were left out."""
    sentences, choice = (
        [f"Surfaces were taken to be flat to {1000 * completion.flatness_m:.2g} mm."],
        completion.choice,
    )
    others = count(choice.n_left_out, "other is", "others are")
    has_least = choice.is_stated and choice.min_area_m2 > 0
    if choice.only or has_least:
        wanted = ", ".join(choice.only) or "surfaces of all kinds"
        least = f" of at least {choice.min_area_m2:g} m\u00b2" if has_least else ""
        sentences.append(f"Only {wanted}{least} were asked for; {others} shown as measured, without number.")
    elif choice.n_left_out:
        small, least = count(choice.n_left_out, "plane", "planes"), square_metres(choice.min_area_m2)
        sentences.append(
            f"{small} of less than {least} m\u00b2, no floor, wall or ceiling, shown as measured, without "
            "number (--min-area 0 continues them)."
        )
    return tuple(sentences)


def _row(number: int, patch: Patch) -> tuple[Cell, ...]:
    fit = patch.source.fit
    whole = max(patch.observed_m2 + patch.hypothesised_m2, 1e-12)
    radius = getattr(fit.surface, "radius", None)
    spread = fit.parameter_deviations().get("radius")
    text = "" if radius is None else f"{1000 * radius:.1f}"
    if isinstance(spread, float):
        text += f" \u00b1 {1000 * spread:.2g}"
    return (
        Cell(str(number), swatch=surface_colour(number)),
        Cell(patch.limits.role or fit.surface.kind),
        Cell(square_metres(patch.observed_m2), share=patch.observed_m2 / whole, state="measured"),
        Cell(square_metres(patch.hypothesised_m2), share=patch.hypothesised_m2 / whole, state="inferred"),
        Cell(f"{1000 * fit.rms:.2f}" if fit.rms >= 5e-6 else "<0.01"),
        Cell(text),
    )


_AREAS = ("confirmed_m2", "refuted_m2", "hidden_m2")


def relation_sections(completion: Completion) -> tuple[PageSection, ...]:
    """Return a section with the relations of the surfaces; none without."""
    relations = completion.relations
    if relations is None:
        return ()
    stayed = sum(not moved for moved in relations.is_moved)
    return relation_section(relations.graph, relations.before, relations.numbers, stayed=stayed)


def pose_sections(registration: Registration) -> tuple[PageSection, ...]:
    """Return a section with a row for each pair of scans that measured the same; none without such."""
    pairs = sorted(registration.pairs, key=lambda pair: -pair.offset_m)
    if not pairs:
        return ()
    rows = tuple(
        (
            Cell(f"{pair.first + 1} and {pair.second + 1}"),
            Cell(square_metres(pair.overlap_m2)),
            Cell(f"{1000 * pair.offset_m:.1f} \u00b1 {1000 * pair.offset_sd_m:.1f}"),
            Cell(f"{1000 * pair.left_m:.1f}"),
            Cell(square_metres(pair.contradicted_m2)),
            Cell(square_metres(pair.still_contradicted_m2)),
        )
        for pair in pairs[:_MOST_PAIRS]
    )
    columns = (
        "Scans", "#both measured, m\u00b2", "#apart as given, mm", "#apart as used, mm",
        "#contradicted as given, m\u00b2", "#contradicted as used, m\u00b2",
    )  # fmt: skip
    n_hidden = len(pairs) - _MOST_PAIRS
    note = (
        "apart: how far the poses set what both measured apart, along its normals (root mean square). "
        "contradicted: measured by one scan, though beams of the other went through."
        + (f" {count(n_hidden, 'other pair is', 'other pairs are')} not shown." if n_hidden > 0 else "")
    )
    return (PageSection("Do the poses agree?", (Table(columns, rows), Text(note, is_note=True))),)


def edit_sections(completion: Completion) -> tuple[PageSection, ...]:
    """A section with a row for each edited surface; none without edits."""
    if not completion.edits:
        return ()
    rows = []
    for number, surface in enumerate(completion.surfaces, start=1):
        if surface.patch.verdict.actions:
            effect = surface.effect
            areas = (effect.filled_m2, effect.vetoed_m2, effect.measured_m2)
            cells = tuple(Cell(square_metres(area)) for area in areas)
            name = Cell(str(number), swatch=surface_colour(number))
            rows.append((name, Cell(", ".join(surface.patch.verdict.actions)), *cells))
    columns = ("Surface", "Edits", "#filled, m\u00b2", "#stays empty, m\u00b2", "#measured, m\u00b2")
    note = (
        "filled: inferred because a person says so, whatever the method's confidence. stays empty: accepted, "
        "but beams went through it, which nobody may overrule. measured: inside a declared opening or beyond "
        "an end that was set, and kept."
    )
    blocks: tuple[Block, ...] = (Table(columns, tuple(rows)), Text(note, is_note=True))
    return (PageSection("What a person said", blocks),)


def verification_sections(first_scan: Mapping[str, Any] | None) -> tuple[PageSection, ...]:
    """Return a section with a row for each surface of which something was inferred; none without such."""
    if first_scan is None:
        return ()
    rows = []
    for surface in first_scan["surfaces"]:
        if sum(surface[area] for area in _AREAS) > 0:
            number = surface["surface"]
            name = Cell(str(number), swatch=surface_colour(number)) if number else Cell("none now")
            rows.append((name, *(Cell(square_metres(surface[area])) for area in _AREAS)))
    rows.append((Cell("all"), *(Cell(square_metres(first_scan[area])) for area in _AREAS)))
    columns = ("Surface", "#confirmed, m\u00b2", "#refuted, m\u00b2", "#still hidden, m\u00b2")
    note = (
        "What the first scan alone had inferred. confirmed: another scan measured the surface there. "
        "refuted: beams of another scan went through, so it is not in this model. still hidden: no other "
        "scan sees it."
    )
    blocks = (Table(columns, tuple(rows)), Text(note, is_note=True))
    return (PageSection("What the other scans say of the first one", blocks),)
