# SPDX-License-Identifier: MIT
"""`unseen check`: each element of a design within tolerance, deviating, missing, hidden or not seen."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from completion.asbuilt.findings import VERDICTS, DesignCheck
from completion.asbuilt.pipeline import CheckOptions
from completion.asbuilt.placement import place_on_design
from nbv.commands.options.scans import CheckCommandOptions
from nbv.commands.options.shared import Shared
from nbv.commands.process import Run, start_run
from nbv.inspection.checking import (
    CheckedDesign,
    check_design,
    compare_with,
    distinctly_named,
    in_frame_of,
    open_design,
    read_earlier,
    read_loa_bands,
)
from nbv.inspection.inference import infer_elements
from nbv.inspection.next_stations import plan_next_stations
from nbv.report.check_report import check_page
from nbv.report.figures.check_snapshots import check_snapshots
from nbv.run.wording import count
from nbv.scanning.sensor_profile import load_sensor
from nbv.scans.registering import ups_of, without_copies
from scenes.checks import InputError
from scenes.io.scan_request import GivenScans, read_request
from scenes.world.scene import Scene


def check_options(asked: CheckCommandOptions) -> CheckOptions:
    """Return what is asked of a check; bands of accuracy are read from their file."""
    bands = {} if asked.loa is None else {"loa_bands_m": read_loa_bands(asked.loa)}
    return CheckOptions(
        tolerance_m=asked.tolerances.get("", CheckOptions().tolerance_m),
        tolerances={pattern: value for pattern, value in asked.tolerances.items() if pattern},
        registration=asked.registration,
        align=asked.align == "yes",
        only=asked.only,
        without=asked.without,
        false_alarms=asked.false_alarms,
        no_return_is_free=asked.no_return == "free",
        sigma_m=asked.sigma_m,
        **bands,
    )


def run_check(shared: Shared, asked: CheckCommandOptions) -> None:
    """Check scans against a design, and write the verdicts, models, issues and report."""
    with start_run("check", shared, default="out/check", is_folder=True) as run:
        run.watch.enter("load")
        run.read(asked.inputs)
        options = check_options(asked)
        sensor = None if asked.next is None else load_sensor(asked.sensor)
        earlier = {} if asked.before is None else read_earlier(asked.before)
        scene = open_design(asked.design, up=asked.up, units=asked.design_units or asked.units)
        given, placement = _given_scans(run, scene, asked)
        record = {**asked.request().options(), "instruments": given.instruments, **asked.record()}
        # Check
        checked = check_design(
            scene, given.scans, options.tolerance_m, tolerances=options.tolerances, options=options,
            n_threads=shared.threads, progress=run.progress,
        )  # fmt: skip
        warnings = tuple(dict.fromkeys((*given.doubts, *placement, *checked.warnings)))
        run.warn(warnings)
        findings = replace(checked.findings, warnings=warnings)
        if asked.infer:
            run.watch.enter("infer")
            kept = [scan for scan in given.scans if scan.name in findings.scans]
            findings = infer_elements(findings, kept, n_threads=shared.threads)
        is_ifc = Path(asked.design).suffix.lower() == ".ifc"
        checked = replace(checked, findings=findings, source=Path(asked.design) if is_ifc else None)
        # Compare with an earlier check, and plan what is to be scanned next
        if asked.before is not None:
            checked = replace(checked, changes=compare_with(asked.before, earlier, findings))
        if asked.next is not None and sensor is not None:
            run.watch.enter("next stations")
            following = plan_next_stations(findings, sensor, n_stations=asked.next, n_threads=shared.threads)
            checked = replace(checked, next_stations=following)
        run.watch.enter("save")
        checked.write(run.path, bcf=asked.bcf, snapshots=check_snapshots(findings, shared.threads))
        run.watch.enter("report")
        run.report(check_page(checked, Path(asked.design).name, n_threads=shared.threads), record)
        run.finish(record, summary_of(checked), lines_of(checked))


def _given_scans(run: Run, scene: Scene, asked: CheckCommandOptions) -> tuple[GivenScans, Sequence[str]]:
    """Return the scans in the frame of the design, and what is to be told of their placement."""
    if not asked.register:
        given, turned = in_frame_of(scene, read_request(asked.request()))
        return replace(given, scans=distinctly_named(given.scans, given.names)), turned
    given, copies = without_copies(read_request(asked.request(), posed=False))
    given = replace(given, scans=distinctly_named(given.scans, given.names))
    upward, doubts = ups_of(given.scans, n_threads=run.shared.threads)
    placement = place_on_design(
        scene.element_mesh, given.scans, up=upward, n_threads=run.shared.threads, progress=run.progress
    )
    if not placement.is_placed:
        raise InputError(
            f"--register: the scans cannot be placed on {scene.name} ({'; '.join(placement.sentences)}); "
            "give scans of more of it, or their poses in its frame by --poses FILE"
        )
    placed = tuple(
        scan.with_facts(world_from_sensor=pose)
        for scan, pose in zip(given.scans, placement.poses, strict=True)
    )
    return replace(given, scans=placed), (*copies, *doubts, *placement.sentences)


def summary_of(checked: CheckedDesign) -> dict[str, Any]:
    """Return the headline numbers."""
    findings = checked.findings
    counts = Counter(finding.verdict for finding in findings.elements)
    following = checked.next_stations
    return {
        "elements": len(findings.elements),
        "verdicts": {verdict: counts[verdict] for verdict in VERDICTS},
        "extra": len(findings.extra),
        "faces_tested": findings.faces_tested,
        "z": findings.z,
        "false_alarms_expected": findings.false_alarms_expected,
        **({} if checked.changes is None else {"changes": len(checked.changes)}),
        **({} if following is None else {"next": list(following.sentences())}),
        "warnings": list(findings.warnings),
    }


def lines_of(checked: CheckedDesign) -> list[str]:
    """Return the headline numbers for people."""
    findings, following = checked.findings, checked.next_stations
    counts = Counter(finding.verdict for finding in findings.elements)
    told = ", ".join(f"{counts[verdict]} {verdict}" for verdict in VERDICTS if counts[verdict])
    lines = [
        f"{count(len(findings.elements), 'element')}: {told}",
        f"{count(findings.faces_tested, 'face')} tested at z = {findings.z:.2f}: "
        f'{findings.false_alarms_expected:g} wrong "deviates" expected in all',
        f"{count(len(findings.extra), 'surface is', 'surfaces are')} no element",
        _alignment_line(findings),
    ]
    if checked.changes is not None:
        lines.append(f"since the earlier check: {count(len(checked.changes), 'change')}")
    return lines + ([] if following is None else list(following.sentences()))


def _alignment_line(findings: DesignCheck) -> str:
    """Say how the scans were moved into the design."""
    if not findings.alignment.is_free:
        return "aligned: not at all, the control network holds"
    shift = findings.alignment.shift_text
    return f"aligned: all scans moved by {shift}; what all elements are off by is in this, in no verdict"
