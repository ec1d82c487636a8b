# SPDX-License-Identifier: MIT
"""Report of a registration: groups of scans, how well their poses are known, and what is not."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from completion.registration.motions import compose
from completion.registration.network import Network
from completion.registration.registered import PairVerdict, Registered
from completion.registration.verdict import Verdict
from nbv.report.blocks.page import Block, Cell, Gallery, Headline, Page, PageSection, Table, Text
from nbv.report.figures.picture import Picture
from nbv.report.figures.plots import Plot, Theme, drawn_plot
from nbv.run.wording import count
from scenes.checks import FloatArray
from scenes.scan.colour import surface_colour
from scenes.scan.range_image import RangeImage

_SIZE, _SMALL = (6.2, 6.2), (3.6, 3.6)  # inches
_SPREAD = 3.0  # median sizes of residuals at which colours end
_LEAST_MM = 1e-3


def registration_plan(network: Network, places: Sequence[FloatArray], world: FloatArray) -> Plot:
    """Draw the facets of each scan of a group from above, its place, and the pairs that share surface.

    Parameters
    ----------
    network : Network
        The group.
    places : sequence of (n, 3) float
        The facets of all scans, each in its own frame, metres.
    world : (3, 4) float
        The pose of the group's first scan in the world, whose z is up.
    """
    poses = {number: compose(world, pose) for number, pose in network.group.poses.items()}

    def draw(axes: Axes, theme: Theme) -> None:
        for number, pose in poses.items():
            _dots(axes, places[number], pose, surface_colour(number + 1))
        for edge in network.edges:
            ends = np.array([poses[number][:2, 3] for number in edge.scans])
            axes.plot(ends[:, 0], ends[:, 1], color=theme.ink, linewidth=0.8)
        for number, pose in poses.items():
            _station(axes, theme, number, pose)
        _label(axes)

    return drawn_plot(draw, _SIZE)


def residual_plan(places: FloatArray, offsets: FloatArray, world: FloatArray) -> Plot:
    """Draw from above by how much facets of scans are off where they met.

    Parameters
    ----------
    places : (n, 3) float
        Where they met, frame of the group, metres.
    offsets : (n,) float
        By how much, metres.
    world : (3, 4) float
        The pose of the group's frame in the world, whose z is up.
    """
    there = places @ world[:, :3].T + world[:, 3]
    end = max(_SPREAD * 1000 * float(np.median(np.abs(offsets))), _LEAST_MM)

    def draw(axes: Axes, theme: Theme) -> None:
        dots = axes.scatter(
            there[:, 0], there[:, 1], c=1000 * offsets, s=3, cmap="coolwarm", vmin=-end, vmax=end
        )
        bar = axes.figure.colorbar(dots, ax=axes, shrink=0.7)
        bar.set_label("behind the earlier scan, mm", color=theme.ink)
        bar.ax.tick_params(colors=theme.ink)
        _label(axes)

    return drawn_plot(draw, _SIZE)


def alternative_plan(pair: PairVerdict, number: int, places: Sequence[FloatArray], world: FloatArray) -> Plot:
    """Draw one of the poses that two scans may have to each other from above, in the first one's world.

    Parameters
    ----------
    pair : PairVerdict
        The two.
    number : int
        Which of its alternatives.
    places : sequence of (n, 3) float
        The facets of all scans, each in its own frame, metres.
    world : (3, 4) float
        The pose of the first scan.
    """
    first, second = pair.scans
    pose = compose(world, pair.alternatives[number])

    def draw(axes: Axes, theme: Theme) -> None:
        for scan, pose_here in ((first, world), (second, pose)):
            _dots(axes, places[scan], pose_here, surface_colour(scan + 1))
            _station(axes, theme, scan, pose_here)
        _label(axes)

    return drawn_plot(draw, _SMALL)


def _dots(axes: Axes, places: FloatArray, pose: FloatArray, colour: str) -> None:
    """Facets (n, 3) at a pose (3, 4)."""
    there = places @ pose[:, :3].T + pose[:, 3]
    axes.plot(there[:, 0], there[:, 1], ".", color=colour, markersize=1.6)


def _station(axes: Axes, theme: Theme, number: int, pose: FloatArray) -> None:
    """The place of a scan, with its number."""
    x, y = float(pose[0, 3]), float(pose[1, 3])
    axes.plot(x, y, "o", color=surface_colour(number + 1), markeredgecolor=theme.ink, zorder=4)
    axes.annotate(str(number + 1), (x, y), xytext=(6, 6), textcoords="offset points", color=theme.ink)


def _label(axes: Axes) -> None:
    axes.set_aspect("equal")
    axes.set_xlabel("x, m")
    axes.set_ylabel("y, m")


_MOST_ROWS, _MOST_GROUPS, _MOST_DOUBTFUL = 300, 20, 6


def registration_page(
    registration: Registered, scans: Sequence[RangeImage], names: Sequence[str], title: str
) -> Page:
    """Return the report of scans (n,) that were registered, or whose poses were checked."""
    placed = sum(registration.group_of(number) is not None for number in range(len(scans)))
    held = sum(pair.verdict is Verdict.REGISTERED for pair in registration.pairs)
    worst = max(
        (pair.violations for pair in registration.pairs if pair.verdict is Verdict.REGISTERED), default=0.0
    )
    checked = registration.level is None
    headlines = (
        Headline(str(len(scans)), "", "scans"),
        *(() if checked else (Headline(str(placed), "", "have a pose", "measured"),)),
        *(() if checked else (Headline(str(len(registration.groups)), "", "groups"),)),
        Headline(str(held), "", f"of {count(len(registration.pairs), 'pair')} agree"),
        Headline(f"{100 * worst:.1f}", "%", "contradicted at most, of these"),
    )
    plans = [
        picture
        for number, group in enumerate(registration.groups[:_MOST_GROUPS])
        for picture in _plans(registration, scans, group, number)
    ]
    summary = (
        f"Beams hardly contradict {held} of {count(len(registration.pairs), 'pair', 'pairs')} "
        "in the poses given."
        if checked
        else f"{placed} of {count(len(scans), 'scan', 'scans')} have a pose, "
        f"in {count(len(registration.groups), 'group', 'groups')}."
    )
    return Page(
        title=title,
        kicker="Check of poses" if checked else "Registration",
        summary=summary,
        headlines=headlines,
        bar=None,
        sections=(
            *((PageSection("From above", (Gallery(tuple(plans), 2),)),) if plans else ()),
            PageSection("Scans", (_scans(registration, names),)),
            PageSection("Pairs", (*_pairs(registration), *_alternatives(registration, scans))),
        ),
        warnings=(),
    )


def _plans(
    registration: Registered, scans: Sequence[RangeImage], network: Network, number: int
) -> Iterator[Picture]:
    """A group from above, and by how much its scans differ where they met."""
    world = scans[next(iter(network.group.poses))].world_from_sensor.matrix[:3]
    places = [registration.places_of(scan) for scan in range(len(scans))]
    yield registration_plan(network, places, world).picture(
        f"Group {number + 1} from above",
        "What each scan measured, in its colour and by its number. Lines join scans that share surface.",
    )
    met, offsets = registration.residuals_of(network)
    if len(met):
        yield residual_plan(met, offsets, world).picture(
            f"Group {number + 1}, what is left between its scans",
            f"Where tiles of two scans met, and how far apart they lie along their normals: "
            f"{1000 * float(np.median(np.abs(offsets))):.1f} mm in the median. Noise looks like salt and "
            "pepper; whole walls of one colour are bent, moved, or tell of a pose that is off.",
        )


def _alternatives(registration: Registered, scans: Sequence[RangeImage]) -> Iterator[Block]:
    """The poses that pairs in doubt may have, from above."""
    doubtful = [pair for pair in registration.pairs if pair.verdict in (Verdict.AMBIGUOUS, Verdict.SLIDES)]
    places = [registration.places_of(scan) for scan in range(len(scans))]
    for pair in doubtful[:_MOST_DOUBTFUL]:
        world = scans[pair.scans[0]].world_from_sensor.matrix[:3]
        first, second = (scan + 1 for scan in pair.scans)
        sentence = "slides" if pair.verdict is Verdict.SLIDES else "may stand so"
        yield Gallery(
            tuple(
                alternative_plan(pair, k, places, world).picture(
                    f"Scan {second} to {first}: {sentence} ({k + 1} of {len(pair.alternatives)})"
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


def _scans(registration: Registered, names: Sequence[str]) -> Table:
    """A row for each scan: its group, and how well its pose is known."""
    rows = []
    for number, name in enumerate(names[:_MOST_ROWS]):
        group, covariance = registration.group_of(number), registration.covariance_of(number)
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
    columns = (
        "Scan", "File", "Group", "#standard deviation of turn, \u00b0", "#standard deviation of place, mm",
    )  # fmt: skip
    return Table(columns, tuple(rows))


def _pairs(registration: Registered) -> tuple[Block, ...]:
    """A row for each pair, those that are in doubt first."""
    order = [Verdict.AMBIGUOUS, Verdict.SLIDES, Verdict.REGISTERED, Verdict.NO_OVERLAP]
    pairs = sorted(registration.pairs, key=lambda verdict: (order.index(verdict.verdict), verdict.scans))
    rows = [
        (
            Cell(" and ".join(str(number + 1) for number in pair.scans)),
            Cell(pair.verdict.value),
            Cell(f"{100 * pair.overlap:.0f}"),
            Cell(f"{100 * pair.violations:.1f}"),
            Cell(str(len(pair.alternatives)) if pair.verdict is Verdict.AMBIGUOUS else ""),
            Cell(pair.reason),
        )
        for pair in pairs[:_MOST_ROWS]
    ]
    columns = ("Scans", "Verdict", "#agrees, %", "#contradicted, %", "#poses possible", "Why")
    blocks: list[Block] = [Table(columns, tuple(rows))]
    if len(pairs) > _MOST_ROWS:
        blocks.append(Text(f"{len(pairs) - _MOST_ROWS} more pairs are in registration.json."))
    return tuple(blocks)


def _largest(covariance: np.ndarray) -> float:
    """The largest standard deviation of a covariance (3, 3)."""
    return float(np.sqrt(max(np.linalg.eigvalsh(covariance).max(), 0.0)))
