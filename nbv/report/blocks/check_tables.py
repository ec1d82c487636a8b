# SPDX-License-Identifier: MIT
"""Tables and cards of a check against a design: verdicts, evidence, extras, accuracy, alignment."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from completion.asbuilt.findings import (
    HALF_95,
    VERDICTS,
    DesignCheck,
    ElementFinding,
    FaceFinding,
    Interval,
    Verdict,
    rounded,
)
from nbv.inspection.changes import Change
from nbv.inspection.next_stations import NextStations
from nbv.inspection.record import element_label
from nbv.inspection.verdict_colours import EXTRA_COLOUR, VERDICT_COLOURS
from nbv.report.blocks.coverage_tables import PLACE_COLUMNS, place_cells
from nbv.report.blocks.page import Bar, BarShare, Block, Card, Cell, Histogram, State, Table, Text
from nbv.report.blocks.verdict_plans import design_storeys
from nbv.report.viewer.check_view import worst_deviation
from nbv.run.wording import count, letters, percent, square_metres

WORST_FIRST: tuple[Verdict, ...] = (
    "deviates", "missing", "undecided", "hidden", "not seen", "not tested", "within",
)  # fmt: skip
_STATES: Mapping[Verdict, State] = {
    "within": "within", "deviates": "deviates", "undecided": "undecided", "missing": "missing",
    "hidden": "hidden", "not seen": "not-seen", "not tested": "not-tested",
}  # fmt: skip
_MEASURED = ("within", "deviates", "undecided")
_MANY_CARDS, _MOST_CARDS, _MOST_FACES = 30, 300, 3


def numbered(check: DesignCheck) -> dict[int, int]:
    """Return the numbers, from 1, of the elements that are not within, by surface id: the gravest first."""
    others = [finding for finding in check.elements if finding.verdict != "within"]
    others.sort(key=lambda one: WORST_FIRST.index(one.verdict))
    return {finding.surface: number for number, finding in enumerate(others, start=1)}


def millimetres(interval: Interval | None) -> str:
    """Return an interval in millimetres: its value, and its ends in brackets.

    Examples
    --------
    >>> millimetres(Interval(-0.0199, -0.0212, -0.0186))
    '-19.9 [-21.2, -18.6]'
    """
    if interval is None:
        return ""
    value, low, high = interval.texts()
    return f"{value} [{low}, {high}]"


def verdict_bar(check: DesignCheck) -> Bar:
    """Return how many elements got each verdict."""
    counts = Counter(finding.verdict for finding in check.elements)
    total = max(len(check.elements), 1)
    return Bar(
        "",
        tuple(
            BarShare(verdict, _STATES[verdict], counts[verdict] / total, str(counts[verdict]))
            for verdict in VERDICTS
            if counts[verdict]
        ),
    )


def counts_table(check: DesignCheck) -> Table:
    """Return a row for each class of each storey: how many elements got each verdict."""
    groups: dict[tuple[str, str], Counter[str]] = {}
    for finding in check.elements:
        key = (finding.element.storey, finding.element.ifc_class)
        groups.setdefault(key, Counter())[finding.verdict] += 1
    order = {storey.name: k for k, storey in enumerate(design_storeys(check.design))}
    shown = [verdict for verdict in VERDICTS if any(group[verdict] for group in groups.values())]
    rows = tuple(
        (
            Cell(storey or "none named"),
            Cell(kind or "none named"),
            Cell(str(group.total())),
            *(Cell(str(group[verdict]) if group[verdict] else "") for verdict in shown),
        )
        for (storey, kind), group in sorted(
            groups.items(), key=lambda one: (order.get(one[0][0], 0), one[0][1])
        )
    )
    return Table(("Storey", "Class", "#all", *(f"#{verdict}" for verdict in shown)), rows)


def elements_table(check: DesignCheck, numbers: Mapping[int, int], *, within: bool) -> tuple[Block, ...]:
    """Return a row for each element that is within, folded, or that is not."""
    chosen = [finding for finding in check.elements if (finding.verdict == "within") == within]
    chosen.sort(key=lambda one: numbers.get(one.surface, 0))
    if not chosen:
        return ()
    rows = tuple(_element_row(finding, numbers) for finding in chosen)
    columns = (
        "#No.", "Verdict", "Element", "Storey", "Class", "#tolerance T, mm", "#off by, mm [95 %]",
        "#measured, %", "LOA",
    )  # fmt: skip
    text = (
        f"{count(len(rows), 'element')} within tolerance"
        if within
        else f"{count(len(rows), 'element')} not within tolerance"
    )
    filters = ("Storey", "Class") if within else ("Verdict", "Storey", "Class")
    return (Table(columns, rows, text, is_folded=within, filters=filters),)


def _swatch(verdict: Verdict) -> str:
    """The colour of a verdict, with its hatching or dots, as a CSS background."""
    colour, name = VERDICT_COLOURS[verdict], verdict.replace(" ", "-")
    return f"var(--mark-{name}, {colour})"


def _element_row(finding: ElementFinding, numbers: Mapping[int, int]) -> tuple[Cell, ...]:
    element, number = finding.element, numbers.get(finding.surface)
    return (
        Cell("" if number is None else str(number)),
        Cell(finding.verdict, swatch=_swatch(finding.verdict)),
        Cell(element.name),
        Cell(element.storey),
        Cell(element.ifc_class),
        Cell(f"{1000 * finding.tolerance_m:g}"),
        Cell(_deviation(finding)),
        Cell(percent(finding.share.measured, 0), share=finding.share.measured, state="measured"),
        Cell(finding.loa_represented),
    )


def _deviation(finding: ElementFinding) -> str:
    """How far it is off: the worst corner of a face, or the shift of a displaced one and where it went."""
    worst = worst_deviation(finding) if finding.verdict in _MEASURED else None
    if worst is None or finding.kind != "displaced":
        return millimetres(worst)
    shift, way = worst.as_shift()
    return f"{millimetres(shift)} along {way}"


def _word(finding: ElementFinding) -> str:
    return f"{finding.verdict}: {finding.kind}" if finding.kind else finding.verdict


_MEANINGS: Mapping[Verdict, str] = {
    "within": "each corner of what was measured lies within the tolerance T with its 95 % interval, on 70 % "
    "of the measured area, a main face among it; how much was measured stands beside it",
    "deviates": "a corner lies beyond T by more than chance explains in so many tests",
    "undecided": "measured, but the interval holds T, or small faces alone were measured; an element that is "
    "off by exactly T stays undecided however often it is scanned",
    "missing": "beams went through the whole of its body",
    "hidden": "something that is not the element was measured before it",
    "not seen": "no station looked there, or the design itself stands before it",
    "not tested": "glass, which beams pass, and elements without any exposed face",
}


def meanings_table() -> Table:
    """Return what each verdict means, folded."""
    rows = tuple((Cell(verdict, swatch=_swatch(verdict)), Cell(text)) for verdict, text in _MEANINGS.items())
    rows += (
        (
            Cell("deviation"),
            Cell("along the outward normal of the design's face: positive stands proud of it"),
        ),
        (Cell("inferred"), Cell("continued behind what hides it, by completion; never part of a verdict")),
    )
    return Table(("Word", "Meaning"), rows, "What the words mean", is_folded=True)


def cards(check: DesignCheck, numbers: Mapping[int, int]) -> tuple[Block, ...]:
    """Return a card for each element that is not within: reason, deviations, beams, what hides it."""
    by_surface = {finding.surface: finding for finding in check.elements}
    stations = {name: f"{letters(k)} {name}" for k, name in enumerate(check.scans)}
    shown = [(number, by_surface[surface]) for surface, number in numbers.items()][:_MOST_CARDS]
    is_long = len(numbers) > _MANY_CARDS
    blocks: list[Block] = [
        Card(
            f"{number}  {element_label(finding.element)}",
            _STATES[finding.verdict],
            " \u00b7 ".join(part for part in (finding.element.storey, _word(finding)) if part),
            _evidence(finding, stations),
            is_open=finding.verdict in ("deviates", "missing") or not is_long,
        )
        for number, finding in shown
    ]
    if len(numbers) > _MOST_CARDS:
        blocks.append(Text(f"{len(numbers) - _MOST_CARDS} more elements are in check.json.", is_note=True))
    return tuple(blocks)


def _evidence(
    finding: ElementFinding, stations: Mapping[str, str]
) -> tuple[Bar | Text | Table | Histogram, ...]:
    """All that speaks for the verdict on an element."""
    faces = sorted(
        (face for face in finding.faces if face.is_tested and face.n_beams),
        key=lambda face: -abs(face.deviation.value) if face.deviation else 0.0,
    )
    is_measured = finding.verdict in _MEASURED
    in_place = is_measured and finding.kind != "displaced"  # beams near its faces are none of it
    return (
        Text(_as_sentence(finding.sentence)),
        *(_measures(finding) if is_measured else ()),
        *(_histogram(face, finding.tolerance_m) for face in faces[:_MOST_FACES] if in_place),
        *(() if in_place else _beams(finding)),
        *_hiders(finding, stations),
        *_inference(finding),
    )


def _as_sentence(text: str) -> str:
    """A reason with a capital and a full stop."""
    return f"{text[:1].upper()}{text[1:].rstrip('.')}." if text else ""


def _measures(finding: ElementFinding) -> tuple[Table, ...]:
    """Offset, tilt, bow, thickness and radius, those that there are, with their intervals."""
    offset = finding.offset
    if offset is not None and finding.kind == "displaced":
        offset = offset.as_shift()[0]
    held = [
        ("shift" if finding.kind == "displaced" else "offset", offset, "mm"),
        ("tilt", finding.tilt, "mrad"),
        ("bow", finding.bow, "mm"),
        ("thickness, measured minus designed", finding.thickness, "mm"),
        ("radius, measured minus designed", finding.radius, "mm"),
    ]
    rows = tuple(
        (
            Cell(name),
            Cell(f"{one.texts()[0]} {unit}"),
            Cell(f"{' to '.join(one.texts()[1:])} {unit}"),
            Cell("" if one.along is None else ", ".join(f"{part:.2f}" for part in one.along)),
        )
        for name, one, unit in held
        if one is not None
    )
    columns = ("Measure", "#value, unit", "#95 % interval, unit", "#direction x, y, z, \u22121 to 1")
    return (Table(columns, rows),) if rows else ()


def _histogram(face: FaceFinding, tolerance_m: float) -> Histogram:
    """Deviations of the beams on a face."""
    normal = ", ".join(f"{part:.2f}" for part in face.normal.tolist())
    name = f"{'main ' if face.is_main else ''}{face.kind}, {'axis' if face.kind == 'cylinder' else 'normal'}"
    label = (
        f"{count(face.n_beams, 'beam')} on a {name} ({normal}): deviation from the design. Dashed: tolerance."
    )
    interval = face.deviation
    if interval is not None:
        label += " Blue: 95 % interval of the worst corner."
    ends = None if interval is None else (1000 * interval.low, 1000 * interval.high)
    low, high = (1000 * end for end in face.histogram_m)
    return Histogram(
        label, tuple(face.histogram.tolist()), low, high, unit="mm", limit=1000 * tolerance_m, interval=ends
    )


def _beams(finding: ElementFinding) -> tuple[Bar, ...]:
    """What beams did at the body of an element."""
    beams = finding.beams
    parts: list[tuple[str, State, float]] = [
        ("ended on it", "within", beams.on_m2),
        ("went through it", "missing", beams.through_m2),
        ("ended before it", "hidden", beams.hidden_m2),
    ]
    total = sum(area for *_, area in parts)
    if not total:
        return ()
    shares = tuple(
        BarShare(label, state, area / total, f"{square_metres(area)} m\u00b2")
        for label, state, area in parts
        if area > 0
    )
    label = f"{count(beams.n_beams, 'beam')} towards its body, by the area across them"
    return (Bar(label, shares),)


def _hiders(finding: ElementFinding, stations: Mapping[str, str]) -> tuple[Table | Text, ...]:
    """What hides an element, from which stations, and why the rest was not seen."""
    rows = tuple(
        (
            Cell(one.by),
            Cell(", ".join(stations.get(name, name) for name in one.stations)),
            Cell(square_metres(one.area_m2)),
        )
        for one in finding.hidden
    )
    table = (Table(("Hidden by", "From stations", "#area, m\u00b2"), rows),) if rows else ()
    reasons = ", ".join(
        f"{reason} {percent(share, 0)} %"
        for reason, share in sorted(finding.not_seen.items(), key=lambda item: -item[1])
        if share > 0.005
    )
    measured = percent(finding.share.measured, 0)
    text = f"Exposed area {square_metres(finding.exposed_m2)} m\u00b2: measured {measured} %"
    return (*table, Text(f"{text}; not measured: {reasons}." if reasons else f"{text}.", is_note=True))


def _inference(finding: ElementFinding) -> tuple[Text, ...]:
    """What completion says, which takes no part in the verdict."""
    if finding.inference is None:
        return ()
    return (Text(f"Inferred, not measured, no part of the verdict. {finding.inference.sentence}"),)


def extras_blocks(check: DesignCheck) -> tuple[Block, ...]:
    """Return a row for each piece of measured surface that is no element."""
    if not check.extra:
        return (Text("All measured surface belongs to an element of the design."),)
    rows = tuple(
        (
            Cell(extra.name, swatch=EXTRA_COLOUR),
            Cell(square_metres(extra.area_m2)),
            Cell(" x ".join(f"{side:.2f}" for side in np.diff(extra.box_m, axis=0)[0])),
            Cell(", ".join(f"{part:.2f}" for part in extra.box_m.mean(axis=0))),
            Cell(extra.near),
            Cell(", ".join(extra.hides)),
            Cell(", ".join(extra.stations)),
        )
        for extra in check.extra
    )
    columns = (
        "Extra", "#area, m\u00b2", "#box x, y, z, m", "#its middle x, y, z, m", "Touches", "Hides",
        "Seen from",
    )  # fmt: skip
    return (Table(columns, rows),)


def loa_blocks(check: DesignCheck) -> tuple[Block, ...]:
    """Return how many elements lie in each band of accuracy."""
    bands = sorted(check.loa_bands_m.items(), key=lambda band: band[1])
    found = [
        Counter(getattr(finding, name) for finding in check.elements)
        for name in ("loa_represented", "loa_measured")
    ]
    names = {name: f"up to {1000 * end:g} mm" for name, end in bands}
    beyond = {name: "beyond" for counts in found for name in counts if name and name not in names}
    rows = tuple(
        (Cell(name), Cell(limit), *(Cell(str(counts[name])) for counts in found))
        for name, limit in {**names, **beyond}.items()
    )
    rows += ((Cell("nothing measured"), Cell(""), *(Cell(str(counts[""])) for counts in found)),)
    note = (
        "At 95 %. Represented accuracy: deviation of the worst measured corner and the half-width of its "
        "interval. Measured accuracy: that half-width alone. Publishers print different bands."
    )
    return (
        Table(("Band", "Limit", "#elements, represented", "#elements, measured"), rows),
        Text(note, is_note=True),
    )


def alignment_blocks(check: DesignCheck) -> tuple[Block, ...]:
    """Return how the scans were moved into the design, as a whole and one by one."""
    held = check.alignment
    numbers = (
        [
            " \u00b1 ".join(rounded((value, half), half, unit))
            for value, half in zip(values.tolist(), (HALF_95 * sd).tolist(), strict=True)
        ]
        for values, sd, unit in ((held.shift_m, held.shift_sd_m, 1e-3), (held.turn_deg, held.turn_sd_deg, 1))
    )
    moved = zip("xyz", *numbers, strict=True)
    whole = Table(
        ("Axis", "#shift of all scans, mm", "#turn of all scans, deg"),
        tuple(tuple(map(Cell, row)) for row in moved),
    )
    rows = tuple(
        (
            Cell(letters(k)),
            Cell(name),
            Cell(", ".join(f"{part:.2f}" for part in pose.translation)),
            Cell(", ".join(rounded(shift.tolist(), HALF_95 * float(held.shift_sd_m.max())))),
        )
        for k, (name, pose, shift) in enumerate(
            zip(check.scans, held.poses, held.station_shift_m, strict=True)
        )
    )
    columns = ("Scan", "Name", "#place x, y, z, m", "#further shift x, y, z, mm")
    return (
        Text(alignment_sentence(check)),
        *map(Text, held.sentences),
        *((whole,) if held.is_free else ()),
        Table(columns, rows),
    )


def alignment_sentence(check: DesignCheck) -> str:
    """Return what the alignment means for the verdicts."""
    if not check.alignment.is_free:
        return (
            "The scans were not moved as a whole: their control network holds, and an error of it counts as "
            "a deviation of the building."
        )
    return (
        "The scans were moved as a whole to fit the design, so a deviation that all elements share is in the "
        "alignment and in no verdict: a slab 10 mm high everywhere is the alignment's. Compare its shift "
        "with your control points."
    )


def changes_blocks(changes: Sequence[Change]) -> tuple[Block, ...]:
    """Return a row for each element or extra that is not as it was before."""
    if not changes:
        return (
            Text("Nothing changed since then: same verdicts, offsets within both intervals, same extras."),
        )
    rows = tuple(
        (
            Cell(change.element),
            Cell(change.before or "not there"),
            Cell(change.now or "not there"),
            Cell(millimetres(change.difference)),
            Cell(change.sentence),
        )
        for change in changes
    )
    columns = ("Element or extra", "Before", "Now", "#offset, now minus before, mm [95 %]", "What changed")
    return (Table(columns, rows),)


def next_blocks(following: NextStations) -> tuple[Block, ...]:
    """Return a row for each next station, then what to move, and what neither settles."""
    promised = {one.station: one for one in following.promised}
    rows = tuple(
        (
            Cell(str(number)),
            *place_cells(view.world_from_sensor),
            Cell(str(len(promised[number].elements)) if number in promised else ""),
            Cell(square_metres(view.predicted_gain_m2 or 0.0)),
        )
        for number, view in enumerate(following.plan.views, start=1)
    )
    columns = ("#Station", *PLACE_COLUMNS, "#elements settled", "#open area seen, m\u00b2")
    note = (
        f"With {following.plan.sensor.name}. The list ends because: {following.plan.stopped_because}. An "
        "element whose deviation is about its tolerance stays undecided from everywhere."
    )
    table = (Table(columns, rows),) if rows else ()
    return (*table, *map(Text, following.sentences()), Text(note, is_note=True))
