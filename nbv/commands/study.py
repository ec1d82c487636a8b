# SPDX-License-Identifier: MIT
"""`unseen study`: scenes x sensors x requirements x planners x seeds; goes on where it stopped."""

from __future__ import annotations

from itertools import chain
from pathlib import Path
from typing import Any

from nbv.commands.options.planning import StudyOptions
from nbv.commands.options.shared import Shared
from nbv.commands.process import Run, start_run
from nbv.report.figures.plots import on_white
from nbv.report.scan_study_report import millimetres, scan_study_page
from nbv.report.study_report import spread, study_page
from nbv.run.wording import count, percent
from nbv.run.workers import workers_of
from nbv.scanning.sensor import missing_errors
from nbv.scanning.sensor_profile import load_sensor
from nbv.study.archive import part_of
from nbv.study.parts import run_part
from nbv.study.pipeline import (
    Columns,
    Outcome,
    Rows,
    check_results,
    groups_of,
    run_study,
    write_results,
    write_tables,
)
from nbv.study.scan_results import (
    CLASS_COLUMNS,
    SCAN_COLUMNS,
    SET_COLUMNS,
    SURFACE_COLUMNS,
    class_rows,
    scan_results,
)
from nbv.study.scans import run_scan_study
from nbv.study.spec import ScanStudySpec, StudySpec, common_share, read_study
from scenes.run.atomic import write_bytes


def run_study_file(shared: Shared, asked: StudyOptions) -> None:
    """Run a study file and write its plans, tables, plots and report."""
    file = asked.file
    part = asked.part
    with start_run(
        "study", shared, default=f"out/{Path(file).stem}", is_folder=True, writes=part is None
    ) as run:
        run.watch.enter("load")
        spec = read_study(file)
        poses = spec.poses if isinstance(spec, ScanStudySpec) else ()
        run.read([
            file,
            *(scene.scene for scene in spec.scenes),
            *(sensor.sensor for sensor in spec.sensors),
            *(one.file for one in poses if one.file is not None),
        ])  # fmt: skip
        check_results(spec.results)
        run.warn(chain.from_iterable(missing_errors(load_sensor(s.sensor), s.noise) for s in spec.sensors))
        if part is not None:
            _run_part(run, spec, asked=asked, part=part_of(part))
            return
        if isinstance(spec, ScanStudySpec):
            _run_scans(run, spec, asked)
            return
        with workers_of(asked.scheduler, shared.threads) as workers:
            outcomes = run_study(
                spec, run.out / "plans", first_seed=shared.seed, workers=workers, progress=run.progress
            )
        run.costs.update({outcome.case.name: dict(outcome.times) for outcome in outcomes if outcome.times})
        run.watch.enter("report")
        options = _options(spec)
        _write(run, spec, outcomes=outcomes, options=options, stem=Path(file).stem)
        run.finish(options, _summary(outcomes), _lines(outcomes, common_share(spec)))


def _write(
    run: Run, spec: StudySpec, outcomes: tuple[Outcome, ...], options: dict[str, Any], stem: str
) -> None:
    names = [f"plans/{outcome.case.name}.json" for outcome in outcomes]
    run.kept.update({name: run.out / name for name in names})
    write_results(outcomes, run.stage.folder, spec.results)
    page, plots = study_page(spec, outcomes, stem)
    for name, plot in plots.items():
        write_bytes(run.path(f"plots/{name}.png"), on_white(plot))
    run.report(page, options)


def _run_part(
    run: Run, spec: StudySpec | ScanStudySpec, *, asked: StudyOptions, part: tuple[int, int]
) -> None:
    """Do one part of a study's cases; the tables are written by a run without a part."""
    with workers_of(asked.scheduler, run.shared.threads) as workers:
        done, every = run_part(
            spec, run.out, part, first_seed=run.shared.seed, workers=workers, progress=run.progress
        )
    number, of = part
    lines = [
        f"part {number} of {of}: {count(done, 'case')} of {every} are there; run the study without --part "
        "when all parts are, for its tables and report"
    ]
    run.say(
        {"part": list(part), "cases": done, "cases_of_all_parts": every}, lines
    )  # side by side with others


def _run_scans(run: Run, spec: ScanStudySpec, asked: StudyOptions) -> None:
    """Run a study of scans and write its records, scans, tables, plots and report."""
    with workers_of(asked.scheduler, run.shared.threads) as workers:
        sets = run_scan_study(
            spec, run.out, first_seed=run.shared.seed, workers=workers, progress=run.progress
        )
    empty = [str(r["case"]) for one in sets for r in one.records if r.get("returns") == 0]
    if empty:
        run.warn([f"{count(len(empty), 'scan has', 'scans have')} no returns, the first of them {empty[0]}"])
    run.watch.enter("report")
    results = scan_results(spec, sets)
    cases = [case for one in sets for case in one.scans.scans]
    run.kept.update({f"records/{case.name}.json": run.out / f"records/{case.name}.json" for case in cases})
    run.kept.update({f"scans/{case.file.name}": case.file for case in cases if case.file})
    tables: dict[str, tuple[Rows, Columns]] = {
        "results": ([result.row for result in results], SET_COLUMNS),
        "scans": ([row for result in results for row in result.scans], SCAN_COLUMNS),
        "errors": (list(class_rows(results)), CLASS_COLUMNS),
        "surfaces": ([row for result in results for row in result.surfaces], SURFACE_COLUMNS),
    }
    write_tables(tables, run.stage.folder, spec.results)
    page, plots = scan_study_page(spec, results, Path(asked.file).stem)
    for name, plot in plots.items():
        write_bytes(run.path(f"plots/{name}.png"), on_white(plot))
    options = _options(spec)
    run.report(page, options)
    rows = [result.row for result in results]
    summary = {"sets": rows, "scans": len(cases), "failed": sum(bool(row["error"]) for row in rows)}
    lines = [
        f"{row['scene']}, {row['sensor']}, {row['poses']}, {row['requirement']}: "
        f"{count(row['scans'], 'scan')}, standard deviation {millimetres(row['sd_m']) or '-'} mm, "
        f"{percent(row['met'])} % of the area measured as required"
        for row in rows
    ]
    run.finish(options, summary, lines)


def _options(spec: StudySpec | ScanStudySpec) -> dict[str, Any]:
    """Return the study for manifest and report, files by name."""
    content = spec.model_dump(exclude_defaults=True, exclude={"title", "description", "name"})
    for kind, key in (("scenes", "scene"), ("sensors", "sensor"), ("poses", "file")):
        content[kind] = [
            {**entry.model_dump(exclude_defaults=True), key: Path(getattr(entry, key)).name}
            if getattr(entry, key) is not None
            else entry.model_dump(exclude_defaults=True)
            for entry in getattr(spec, kind, ())
        ]
    return {**content, "seeds": list(spec.seeds)}


def _summary(outcomes: tuple[Outcome, ...]) -> dict[str, Any]:
    """Return the headline numbers."""
    return {
        "cases": len(outcomes),
        "failed": sum(bool(outcome.error) for outcome in outcomes),
        "views": sum(outcome.n_views for outcome in outcomes),
    }


def _lines(outcomes: tuple[Outcome, ...], share: float) -> list[str]:
    """Return the headline numbers for people: a line for each planner in each setting."""
    groups = groups_of(outcomes)
    width = max(len(group.planner) for group in groups)
    lines = [f"{count(len(outcomes), 'plan')}; views until {100 * share:g} % of what can be is measured:"]
    setting = None
    for group in groups:
        if group.setting != setting:
            setting = group.setting
            lines.append(", ".join(setting))
        views = spread(group.views_to(share)) or "-"
        lines.append(f"  {group.planner:<{width}}  {views}")
    failed = sum(bool(outcome.error) for outcome in outcomes)
    if failed:
        lines.append(f"{count(failed, 'case')} could not be planned; report.html says why")
    return lines
