# SPDX-License-Identifier: MIT
"""Report of a registration: groups of scans, how well their poses are known, and what is not."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from completion.registration.network import Network
from completion.registration.registered import Registered
from completion.registration.verdict import Verdict
from nbv.report.figures.registration_plan import alternative_plan, registration_plan, residual_plan
from nbv.report.page.page import Block, Cell, Gallery, Headline, Page, Section, Table, Text
from nbv.report.pictures.picture import Picture
from nbv.run.wording import count
from scenes.scan.colour import surface_colour
from scenes.scan.range_image import RangeImage

_MOST_ROWS, _MOST_GROUPS, _MOST_DOUBTFUL = 300, 20, 6


def registration_page(
    found: Registered, scans: Sequence[RangeImage], names: Sequence[str], title: str
) -> Page:
    """Return the report of scans (n,) that were registered, or whose poses were checked."""
    placed = sum(found.group_of(number) is not None for number in range(len(scans)))
    held = sum(one.verdict is Verdict.REGISTERED for one in found.pairs)
    worst = max((one.violations for one in found.pairs if one.verdict is Verdict.REGISTERED), default=0.0)
    checked = found.level is None
    headlines = (
        Headline(str(len(scans)), "", "scans"),
        *(() if checked else (Headline(str(placed), "", "have a pose", "measured"),)),
        *(() if checked else (Headline(str(len(found.groups)), "", "groups"),)),
        Headline(str(held), "", f"of {len(found.pairs)} pairs agree"),
        Headline(f"{100 * worst:.1f}", "%", "contradicted at most, of these"),
    )
    plans = [
        picture
        for number, one in enumerate(found.groups[:_MOST_GROUPS])
        for picture in _plans(found, scans, one, number)
    ]
    summary = (
        f"Beams hardly contradict {held} of {count(len(found.pairs), 'pair', 'pairs')} in the poses given."
        if checked
        else f"{placed} of {count(len(scans), 'scan', 'scans')} have a pose, "
        f"in {count(len(found.groups), 'group', 'groups')}."
    )
    return Page(
        title=title,
        kicker="Check of poses" if checked else "Registration",
        summary=summary,
        headlines=headlines,
        bar=None,
        sections=(
            *((Section("From above", (Gallery(tuple(plans), 2),)),) if plans else ()),
            Section("Scans", (_scans(found, names),)),
            Section("Pairs", (*_pairs(found), *_alternatives(found, scans))),
        ),
        warnings=(),
    )


def _plans(
    found: Registered, scans: Sequence[RangeImage], network: Network, number: int
) -> Iterator[Picture]:
    """A group from above, and by how much its scans differ where they met."""
    world = scans[next(iter(network.group.poses))].world_from_sensor.matrix[:3]
    places = [found.places_of(scan) for scan in range(len(scans))]
    yield registration_plan(network, places, world).picture(
        f"Group {number + 1} from above",
        "What each scan measured, in its colour and by its number. Lines join scans that share surface.",
    )
    met, offsets = found.residuals_of(network)
    if len(met):
        yield residual_plan(met, offsets, world).picture(
            f"Group {number + 1}, what is left between its scans",
            f"Where tiles of two scans met, and how far apart they lie along their normals: "
            f"{1000 * float(np.median(np.abs(offsets))):.1f} mm in the median. Noise looks like salt and "
            "pepper; whole walls of one colour are bent, moved, or tell of a pose that is off.",
        )


def _alternatives(found: Registered, scans: Sequence[RangeImage]) -> Iterator[Block]:
    """The poses that pairs in doubt may have, from above."""
    doubtful = [one for one in found.pairs if one.verdict in (Verdict.AMBIGUOUS, Verdict.SLIDES)]
    places = [found.places_of(scan) for scan in range(len(scans))]
    for pair in doubtful[:_MOST_DOUBTFUL]:
        world = scans[pair.scans[0]].world_from_sensor.matrix[:3]
        first, second = (scan + 1 for scan in pair.scans)
        told = "slides" if pair.verdict is Verdict.SLIDES else "may stand so"
        yield Gallery(
            tuple(
                alternative_plan(pair, k, places, world).picture(
                    f"Scan {second} to {first}: {told} ({k + 1} of {len(pair.alternatives)})"
                )
                for k in range(len(pair.alternatives))
            ),
            3,
        )
    if len(doubtful) > _MOST_DOUBTFUL:
        yield Text(
            f"Poses of {len(doubtful) - _MOST_DOUBTFUL} more pairs in doubt are in registration.json, "
            "not drawn here."
        )


def _scans(found: Registered, names: Sequence[str]) -> Table:
    """A row for each scan: its group, and how well its pose is known."""
    rows = []
    for number, name in enumerate(names[:_MOST_ROWS]):
        group, covariance = found.group_of(number), found.covariance_of(number)
        turn = shift = ""
        if covariance is not None and np.isfinite(covariance).all():
            turn = f"{np.degrees(_largest(covariance[:3, :3])):.3f}"
            shift = f"{1000 * _largest(covariance[3:, 3:]):.1f}"
        rows.append(
            (
                Cell(str(number + 1), swatch=surface_colour(number + 1)),
                Cell(Path(name).name),
                Cell("by itself" if group is None else str(group + 1)),
                Cell(turn),
                Cell(shift),
            )
        )
    return Table(("Scan", "File", "Group", "#turn known to, deg", "#place known to, mm"), tuple(rows))


def _pairs(found: Registered) -> tuple[Block, ...]:
    """A row for each pair, those that are in doubt first."""
    order = [Verdict.AMBIGUOUS, Verdict.SLIDES, Verdict.REGISTERED, Verdict.NO_OVERLAP]
    pairs = sorted(found.pairs, key=lambda one: (order.index(one.verdict), one.scans))
    rows = [
        (
            Cell(" and ".join(str(number + 1) for number in one.scans)),
            Cell(one.verdict.value),
            Cell(f"{100 * one.overlap:.0f}"),
            Cell(f"{100 * one.violations:.1f}"),
            Cell(str(len(one.alternatives)) if one.verdict is Verdict.AMBIGUOUS else ""),
            Cell(one.reason),
        )
        for one in pairs[:_MOST_ROWS]
    ]
    columns = ("Scans", "Verdict", "#agrees, %", "#contradicted, %", "#poses possible", "Why")
    blocks: list[Block] = [Table(columns, tuple(rows))]
    if len(pairs) > _MOST_ROWS:
        blocks.append(Text(f"{len(pairs) - _MOST_ROWS} more pairs are in registration.json."))
    return tuple(blocks)


def _largest(covariance: np.ndarray) -> float:
    """The largest standard deviation of a covariance (3, 3)."""
    return float(np.sqrt(max(np.linalg.eigvalsh(covariance).max(), 0.0)))
