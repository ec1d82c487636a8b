# SPDX-License-Identifier: MIT
"""Report of a study of scans: how exact points are and how dense, and what they show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from nbv.report.blocks.page import Block, Cell, Gallery, Headline, Page, PageSection, Table, Text
from nbv.report.figures.plots import Plot, Theme, drawn_plot
from nbv.report.study_report import colour_of, drop_constant_columns
from nbv.run.wording import count, percent
from nbv.study.scan_errors import class_labels, merged
from nbv.study.scan_results import SetResult
from nbv.study.spec import ScanStudySpec

_DRAWN: Mapping[str, str] = {
    "incidence_deg": "incidence, degrees", "range_m": "range, metres",
    "reflectivity": "share of light scattered", "edge_px": "distance from a jump of depth, pixels",
}  # fmt: skip
_LEAST_POINTS = 30  # of a class that is drawn


def scan_study_page(
    spec: ScanStudySpec, results: Sequence[SetResult], fallback_title: str
) -> tuple[Page, dict[str, Plot]]:
    """Return the report, and its plots by name; `fallback_title` is for a study without title and name."""
    plots = {f"error-by-{by.split('_')[0]}": _error_plot(results, by) for by in _DRAWN}
    failed = [result for result in results if result.row["error"]]
    completed = _completed_section(results) if spec.complete else ()
    registered = _registered_section(results) if spec.register_scans else ()
    page = Page(
        title=spec.title or spec.name or fallback_title,
        kicker="Study of scans",
        summary=" ".join(part for part in (spec.description.strip(), _summary(results)) if part),
        headlines=_headlines(results),
        bar=None,
        sections=(
            PageSection("Errors across the surface", (_gallery(plots), *_error_notes())),
            PageSection("Sets of scans", (_sets_table(results), Text(_SET_NOTE, is_note=True))),
            *completed,
            *registered,
            PageSection("Every scan", (_scans_table(results),)),
        ),
        warnings=tuple(f"{result.row['set']}: {result.row['error']}" for result in failed),
    )
    return page, plots


def _sensors(results: Sequence[SetResult]) -> list[str]:
    return list(dict.fromkeys(str(result.row["sensor"]) for result in results))


def _error_plot(results: Sequence[SetResult], by: str) -> Plot:
    """Standard deviation of the points' errors by class, a colour for each sensor."""
    labels, sensors = class_labels(by, ()), _sensors(results)

    def draw(axes: Axes, _theme: Theme) -> None:
        used = np.zeros(len(labels), np.bool_)
        for number, sensor in enumerate(sensors):
            found = {
                r.found.scans.name: r.tallies for r in results if r.row["sensor"] == sensor and r.tallies
            }
            if not found:
                continue
            rows = merged({by: tallies[by]} for tallies in found.values())[by].rows()
            drawn = np.array([row["points"] >= _LEAST_POINTS for row in rows])
            used |= drawn
            at = np.flatnonzero(drawn)
            values = 1e3 * np.array([row["sd_m"] for row in rows])[at]
            axes.plot(at, values, "o-", markersize=4, color=colour_of(number), label=sensor)
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter("{x:g}")
        axes.set_xticks(range(len(labels)), labels, rotation=20, ha="right", fontsize=8)
        last = int(np.flatnonzero(used).max()) if used.any() else 0
        axes.set_xlim(-0.4, last + 0.4)
        axes.set_xlabel(_DRAWN[by])
        axes.set_ylabel("standard deviation, mm")
        axes.legend(
            loc="lower left", bbox_to_anchor=(0, 1), ncols=2, frameon=False, fontsize=8, borderaxespad=0.2
        )

    return drawn_plot(draw, (5.4, 3.6))


def _gallery(plots: Mapping[str, Plot]) -> Gallery:
    pictures = [plots[f"error-by-{by.split('_')[0]}"].picture(f"By {text}.") for by, text in _DRAWN.items()]
    return Gallery(tuple(pictures), 2)


def _error_notes() -> tuple[Block, ...]:
    text = (
        "Standard deviations across the surface: the error of a point is its distance from the plane of the "
        "face that the middle of its beam met. "
        f"Classes of fewer than {_LEAST_POINTS} points are not drawn. Mixed pixels, beside a jump of depth "
        "and farther off than errors and the beam's width explain, are counted and left out; errors.csv has "
        "all classes."
    )
    return (Text(text, is_note=True),)


def millimetres(value: Any) -> str:
    """Return metres as text in millimetres, three digits; "" for none."""
    return "" if value is None or not np.isfinite(value) else f"{1e3 * float(value):.3g}"


def _percents(value: Any) -> str:
    return "" if value is None or not np.isfinite(value) else percent(float(value))


def _density(row: Mapping[str, Any]) -> str:
    """Density on half of the area, and on 95 % of it."""
    half, most = row["density_50_per_m2"], row["density_5_per_m2"]
    return "" if half is None or most is None else f"{half:,.0f} ({most:,.0f})"


_SET_NOTE = (
    "Bias, standard deviation and the 95 % of absolute errors are across the surface, mixed pixels left out. "
    "Lost: the beam met surface within reach and nothing came back. Points per m\u00b2: of all scans "
    "together, reached on half and (in brackets) on 95 % of the area that was seen. Met: measured as the "
    "requirement asks. Minutes: of all scans by the instrument's speed, without set-up."
)


def _sets_table(results: Sequence[SetResult]) -> Table:
    """A row for each set and requirement."""
    sensors, rows = _sensors(results), list[list[Cell]]()
    for result in results:
        row = result.row
        rows.append(
            [
                Cell(row["scene"]),
                Cell(row["sensor"], swatch=colour_of(sensors.index(row["sensor"]))),
                Cell(row["poses"]),
                Cell(row["requirement"]),
                Cell(str(row["seed"])),
                Cell(str(row["scans"])),
                Cell("" if row["scan_time_s"] is None else f"{row['scan_time_s'] / 60:.3g}"),
                *(Cell(millimetres(row[name])) for name in ("bias_m", "sd_m", "p95_m")),
                *(Cell(_percents(row[name])) for name in ("mixed_share", "lost_share")),
                Cell(_density(row)),
                Cell(_percents(row["seen"])),
                Cell(_percents(row["met"]), share=row["met"], state="measured"),
            ]
        )  # fmt: skip
    columns = (
        "Scene", "Sensor", "Poses", "Requirement", "#Seed", "#scans", "#minutes",
        "#bias, mm", "#standard deviation, mm", "#95 %, mm", "#mixed, %", "#lost, %", "points per m\u00b2",
        "#seen, %", "#met, %",
    )  # fmt: skip
    return drop_constant_columns(columns, rows, n_fixed=5)


def _completed_section(results: Sequence[SetResult]) -> tuple[PageSection, ...]:
    """What completion adds to each set, and to each kind of surface."""
    rows = [
        [
            *(Cell(str(result.row[name])) for name in ("scene", "sensor", "poses", "requirement", "seed")),
            Cell(_percents(result.row["met"]), share=result.row["met"], state="measured"),
            *(Cell(_percents(result.row[name])) for name in ("modelled", "inferred", "unknown")),
            Cell(f"{result.row['inferred_m2']:.3g}"),
            Cell(_percents(result.row["inferred_right"])),
        ]
        for result in results
    ]
    columns = ("Scene", "Sensor", "Poses", "Requirement", "#Seed", "#met, %", "#modelled, %", "#inferred, %",
               "#unknown, %", "#inferred, m\u00b2", "#of it right, %")  # fmt: skip
    note = (
        "Modelled: seen, though not as required, on a surface that is known exactly enough. Inferred: within "
        "2 cm of surface that nobody saw. Right: the share of inferred surface within 2 cm of the true one. "
        "surfaces.csv tells each surface of the scene apart."
    )
    table = drop_constant_columns(columns, rows, n_fixed=5)
    return (PageSection("Completed", (table, Text(note, is_note=True))),)


def _registered_section(results: Sequence[SetResult]) -> tuple[PageSection, ...]:
    """How many scans of each set registration placed, and how far off their poses are."""
    each = {result.found.scans.name: result for result in results}.values()
    rows = [
        [
            *(Cell(str(result.row[name])) for name in ("scene", "sensor", "poses", "seed")),
            Cell(f"{result.row['placed'] or 0} of {result.row['scans']}"),
            Cell(millimetres(result.row["pose_shift_m"])),
            Cell("" if (turn := result.row["pose_turn_deg"]) is None else f"{turn:.3f}"),
        ]
        for result in each
    ]
    columns = ("Scene", "Sensor", "Poses", "#Seed", "#Scans placed", "#shift, mm", "#turn, \u00b0")
    note = (
        "How far the poses that registration found lie from the true ones, beside the first scan of their "
        "group; root mean squares. It starts from the poses that the scans are said to have, and from none."
    )
    table = drop_constant_columns(columns, rows, n_fixed=4)
    return (PageSection("Registered", (table, Text(note, is_note=True))),)


def _scans_table(results: Sequence[SetResult]) -> Table:
    """A row for each scan and requirement."""
    rows = list[tuple[Cell, ...]]()
    for row in (row for result in results for row in result.scans):
        rows.append(
            (
                *(
                    Cell(str(row[name]))
                    for name in ("scene", "sensor", "poses", "requirement", "seed", "scan")
                ),
                Cell(", ".join(f"{row[name]:.2f}" for name in ("x_m", "y_m", "z_m"))),
                Cell("" if row["error"] else f"{row['points']:,}"),
                *(Cell(millimetres(row[name])) for name in ("bias_m", "sd_m", "p95_m")),
                *(Cell(_percents(row[name])) for name in ("mixed_share", "lost_share", "seen", "met")),
            )
        )
    columns = (
        "Scene", "Sensor", "Poses", "Requirement", "#Seed", "#Scan", "At, m", "#points", "#bias, mm",
        "#standard deviation, mm", "#95 %, mm", "#mixed, %", "#lost, %", "#seen, %", "#met, %",
    )  # fmt: skip
    return Table(columns, tuple(rows))


def _headlines(results: Sequence[SetResult]) -> tuple[Headline, ...]:
    sets = list({result.found.scans.name: result for result in results}.values())
    met = [float(result.row["met"]) for result in results]
    low, high = percent(min(met)), percent(max(met))
    points = sum(int(result.row["points"] or 0) for result in sets)
    spreads = [millimetres(result.row["sd_m"]) for result in sets if result.row["points"]]
    spreads.sort(key=float)
    span = (
        "" if not spreads else spreads[0] if spreads[0] == spreads[-1] else f"{spreads[0]}\u2013{spreads[-1]}"
    )
    return (
        Headline(str(sum(int(result.row["scans"]) for result in sets)), "", "scans"),
        Headline(f"{points / 1e6:.3g}", "million", "points with an error"),
        Headline(span or "-", "mm", "standard deviation across the surface, by set"),
        Headline(
            low if low == high else f"{low}\u2013{high}", "%", "of the area measured as required, by set"
        ),
    )


def _summary(results: Sequence[SetResult]) -> str:
    """The best set in a sentence."""
    usable = [result for result in results if result.row["points"]]
    if not usable:
        return "No scan has a point."
    best = max(usable, key=lambda result: float(result.row["met"]))
    row = best.row
    return (
        f"Most is measured as required by {row['sensor']} from {row['poses']} "
        f"({count(row['scans'], 'scan')}): "
        f"{percent(float(row['met']))} % of {row['total_m2']:.4g} m\u00b2, with a standard deviation of "
        f"{millimetres(row['sd_m'])} mm across the surface."
    )
