# SPDX-License-Identifier: MIT
"""Checking: scans against a design in one call, and what was found, ready to be saved and shown."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, get_args

from completion.asbuilt import limits
from completion.asbuilt.findings import DesignCheck, ElementFinding, Extra
from completion.asbuilt.misfits import agreeing
from completion.asbuilt.pipeline import CheckOptions, check_against_design
from completion.export.bcf import BcfVersion
from nbv.inspection.bcf_topics import write_bcf
from nbv.inspection.changes import Change, changes_since
from nbv.inspection.models import write_design_glb, write_deviation_ply, write_ifc_copy
from nbv.inspection.next_stations import NextStations
from nbv.inspection.record import FORMAT, check_record, elements_csv
from nbv.run.showing import show_report
from nbv.run.wording import count
from scenes.checks import InputError, Value
from scenes.io.checks.documents import read_json, read_toml
from scenes.io.checks.guard import guard_reading
from scenes.io.formats.format import Units
from scenes.io.scan_request import GivenScans, ScanRequest, read_request
from scenes.io.scene_files import load_scene, open_scene
from scenes.mesh.design import ElementMesh, MapConversion
from scenes.mesh.orientation import Axis, world_from_file_up
from scenes.run.atomic import Stage, hold_lock, make_folder, write_json, write_text
from scenes.run.libraries import table_of
from scenes.run.steps import Progress
from scenes.scan.range_image import RangeImage
from scenes.world.scene import Scene

_MOST_BANDS = 20


@dataclass(frozen=True, slots=True, eq=False)
class CheckedDesign(Value):
    """A design that was checked against scans.

    Attributes
    ----------
    findings : DesignCheck
        All that was found.
    source : Path, optional
        The design's file, where it is IFC.
    conversion : MapConversion, optional
        Which was applied to the design.
    next_stations : NextStations, optional
        Where to scan next, where that was asked for.
    changes : sequence of Change, optional
        What is not as in an earlier check, where there was one.
    """

    findings: DesignCheck
    source: Path | None = None
    conversion: MapConversion | None = None
    next_stations: NextStations | None = None
    changes: Sequence[Change] | None = None

    def _facts(self) -> list[tuple[str, str]]:
        """How many elements came to which verdict, by how many scans."""
        verdicts = Counter(element.verdict for element in self.elements)
        return [
            ("elements", f"{len(self.elements)} by {count(len(self.findings.scans), 'scan')}"),
            *((verdict, str(n)) for verdict, n in sorted(verdicts.items())),
            ("surface of no element", f"{len(self.extra)} pieces"),
            ("false alarms expected", f"{self.findings.false_alarms_expected:.2g}"),
        ]

    @property
    def elements(self) -> tuple[ElementFinding, ...]:
        """The verdict on each element, in the design's order."""
        return self.findings.elements

    @property
    def extra(self) -> tuple[Extra, ...]:
        """Measured surface that is no element, largest first."""
        return self.findings.extra

    @property
    def warnings(self) -> tuple[str, ...]:
        """What to know, a sentence each."""
        return self.findings.warnings

    def to_pandas(self) -> Any:
        """Return the elements of `elements.csv` as a `pandas.DataFrame`; raises InputError without pandas."""
        return table_of(elements_csv(self.findings))

    def record(self) -> dict[str, Any]:
        """Return what check.json holds."""
        record = check_record(self.findings)
        if self.changes is not None:
            record["changes"] = [change.sentence for change in self.changes]
        if self.next_stations is not None:
            record["next"] = self.next_stations.to_json()
        return record

    def write(
        self,
        path: Callable[[str], Path],
        *,
        bcf: BcfVersion = "3.0",
        snapshots: Mapping[int | str, bytes] | None = None,
    ) -> None:
        """Write the files of `save`, each to the path that `path` returns for its name.

        `snapshots` are PNGs for the issues, by surface ids.
        """
        write_json(path("check.json"), self.record())
        write_text(path("elements.csv"), elements_csv(self.findings))
        write_deviation_ply(path("deviation.ply"), self.findings)
        write_design_glb(path("design.glb"), self.findings)
        write_bcf(
            path("issues.bcf"), self.findings, version=bcf, snapshots=snapshots, conversion=self.conversion
        )
        if self.source is not None:
            write_ifc_copy(path("design-checked.ifc"), self.source, self.findings)
        if self.next_stations is not None:
            write_json(path("plan.json"), self.next_stations.plan.to_json())

    def save(self, folder: str | os.PathLike[str]) -> None:
        """Write check.json, elements.csv, deviation.ply, design.glb and issues.bcf (BCF 3.0).

        Of an IFC design also design-checked.ifc, with a property set for each element; plan.json where next
        stations were asked for. The files appear together once all are written.

        Raises
        ------
        InputError
            The folder cannot be made or written, or another run writes there.
        """
        with hold_lock(make_folder(folder)), Stage(make_folder(folder)) as stage:
            self.write(stage.path)
            stage.commit(last="check.json")

    def show(self, *, n_threads: int | None = None) -> Path:
        """Show the full report; see `nbv.show`."""
        return show_report(self, n_threads=n_threads)


def check_design(
    design: str | os.PathLike[str] | Scene | ElementMesh,
    scans: Sequence[str | os.PathLike[str] | RangeImage],
    tolerance_m: float = 0.01,
    *,
    tolerances: Mapping[str, float] | None = None,
    options: CheckOptions | None = None,
    before: str | os.PathLike[str] | None = None,
    n_threads: int | None = None,
    progress: Progress | None = None,
) -> CheckedDesign:
    """Check whether each element of a design is there and within its tolerance, and how sure that is.

    Parameters
    ----------
    design : path, Scene or ElementMesh
        IFC, or a mesh whose parts have names; metres.
    scans : sequence of paths or of RangeImage
        Registered, in the frame of the design up to centimetres.
    tolerance_m : float
        How far an element may be from its place, metres.
    tolerances : mapping, optional
        Other tolerances by a pattern of class or name, as shells match files: {"IfcDoor*": 0.005}.
    options : CheckOptions, optional
        All else; its tolerances are not used.
    before : path, optional
        check.json of an earlier check, to tell what changed since.
    n_threads : int, optional
        Threads that cast; the result does not depend on it.
    progress : callable, optional
        Called with a stage, how much of it is done, and of how much.

    Returns
    -------
    CheckedDesign
        `.elements`, `.extra`; `.save(folder)` writes them, `.show()` shows the report.

    Raises
    ------
    InputError
        Unusable files or options; scans of another place.
    """
    earlier = {} if before is None else read_earlier(before)
    scene = None if isinstance(design, ElementMesh) else _scene_of(design)
    held, source, conversion, doubts = _opened(design, scene)
    given = [scan for scan in scans if isinstance(scan, RangeImage)]
    if len(given) < len(scans):
        if given:
            raise InputError(f"{len(given)} of {len(scans)} scans are no paths; give paths or RangeImages")
        request = read_request(ScanRequest(tuple(os.fspath(scan) for scan in scans)))  # type: ignore[arg-type]  # none is a RangeImage here
        turned: tuple[str, ...] = ()
        if scene is not None:
            request, turned = in_frame_of(scene, request)
        given = list(distinctly_named(request.scans, request.names))
        doubts = (*doubts, *request.doubts, *turned)
    given = list(distinctly_named(given))
    asked = replace(options or CheckOptions(), tolerance_m=tolerance_m, tolerances=dict(tolerances or {}))
    findings = check_against_design(held, given, asked, n_threads=n_threads, progress=progress)
    findings = replace(findings, warnings=tuple(dict.fromkeys((*doubts, *findings.warnings))))
    changes = None if before is None else compare_with(before, earlier, findings)
    return CheckedDesign(findings, source, conversion, changes=changes)


def _scene_of(design: str | os.PathLike[str] | Scene) -> Scene:
    return design if isinstance(design, Scene) else open_design(os.fspath(design))


def _opened(
    design: str | os.PathLike[str] | Scene | ElementMesh, scene: Scene | None
) -> tuple[ElementMesh, Path | None, MapConversion | None, tuple[str, ...]]:
    """Return a design, its file where that is IFC, the conversion that was applied, and its warnings."""
    if isinstance(design, ElementMesh):
        return design, None, None, ()
    scene = scene or _scene_of(design)
    is_ifc = not isinstance(design, Scene) and Path(design).suffix.lower() == ".ifc"
    conversion = None if scene.design is None else scene.design.conversion
    return scene.element_mesh, Path(design) if is_ifc else None, conversion, scene.warnings  # type: ignore[arg-type]  # a path where it is IFC


def open_design(spec: str, *, up: Axis | None = None, units: Units = "m") -> Scene:
    """Return the scene of a design: `builtin:NAME`, or a file, bodies that are inside out turned."""
    if spec.startswith("builtin:"):
        return open_scene(spec)
    return load_scene(spec, up=up, units=units, design=True)


def in_frame_of(scene: Scene, given: GivenScans) -> tuple[GivenScans, tuple[str, ...]]:
    """Return scans in the world of a design, whose z is up, and what is to be said of it.

    Scans of a design whose file has another axis up may have that axis up, too, or z as scanners have: more
    of their beams end on the design in one of both. IFC is z up by its specification.

    Raises
    ------
    InputError
        Far more of their beams would end on the design with another axis of its file up.
    """
    turned, file_up, mesh = given.with_z_up(scene.file_up), scene.file_up, scene.element_mesh.mesh
    if scene.design is not None and scene.design.schema:
        return turned, ()
    fits = agreeing(mesh, turned.scans)
    if file_up != "z" and agreeing(mesh, given.scans) >= fits + limits.FITS_UNIT:
        return given, (
            f"the scans are z up, the file of the design {file_up} up: only the design was turned",
        )
    of_file = world_from_file_up(file_up).inverse()
    for axis in get_args(Axis) if fits < limits.FITS_UP else ():
        others = agreeing(mesh.transform(world_from_file_up(axis) @ of_file), given.scans)
        if axis != file_up and others >= fits + limits.FITS_UNIT:
            raise InputError(
                f"{scene.name}: the up axes of the scans and of the design differ: {fits:.0%} of the beams "
                f"end on it with {file_up} of its file up, {others:.0%} with {axis}; give --up {axis}"
            )
    return turned, ()


def distinctly_named(scans: Sequence[RangeImage], names: Sequence[str] = ()) -> tuple[RangeImage, ...]:
    """Return scans that have `names` (n,), or numbers, where their own names are not all different."""
    if len({scan.name for scan in scans}) == len(scans):
        return tuple(scans)
    others = [Path(name).name for name in names] or [f"scan {k}" for k in range(1, len(scans) + 1)]
    return tuple(scan.with_facts(name=name) for scan, name in zip(scans, others, strict=True))


def read_earlier(before: str | os.PathLike[str]) -> dict[str, Any]:
    """Return what a check.json holds; raises InputError for other files."""
    path = Path(before)
    with guard_reading(path, "an earlier check"):
        held = read_json(path, dict)
        if held.get("format") != FORMAT:
            raise InputError("is no check of a design; name the check.json of an earlier check")
        return held


def compare_with(
    before: str | os.PathLike[str], earlier: Mapping[str, Any], findings: DesignCheck
) -> Sequence[Change]:
    """Return what changed since an `earlier` check, which was read from `before`; a damaged one is named."""
    with guard_reading(Path(before), "an earlier check"):
        return changes_since(earlier, findings)


def read_loa_bands(path: str | os.PathLike[str]) -> Mapping[str, float]:
    """Return bands of accuracy from a TOML or JSON file: name = upper end in metres.

    Raises
    ------
    InputError
        Neither TOML nor JSON, an end that is no positive number, two alike, none or more than 20 of them.
    """
    file = Path(path)
    with guard_reading(file, "bands of accuracy"):
        held = read_json(file, dict) if file.suffix.lower() == ".json" else read_toml(file)
        bands = held.get("bands", held)
        if not isinstance(bands, Mapping) or not 0 < len(bands) <= _MOST_BANDS:
            raise InputError(f"holds no bands; write 1 to {_MOST_BANDS} lines like LOA30 = 0.015, metres")
        for name, end in bands.items():
            if isinstance(end, bool) or not isinstance(end, int | float) or not 0 < end < float("inf"):
                raise InputError(
                    f"{name} ends at {end!r}; write its upper end in metres, like {name} = 0.015"
                )
        ends = sorted(bands.items(), key=lambda band: band[1])
        for (name, end), (other, same) in pairwise(ends):
            if end == same:
                raise InputError(
                    f"{name} and {other} both end at {end:g} m; give each band an end of its own"
                )
        return {name: float(end) for name, end in ends}
