# SPDX-License-Identifier: MIT
"""`unseen part`: a part's points or mesh as surfaces, and what these are to each other."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from completion.parts.division.reach import reached
from completion.parts.files import status_counts, write_part
from completion.parts.part import Part, kinds_text
from completion.parts.pipeline import MACHINED, model_part
from completion.relations.engine.relation import Status
from completion.relations.stated import StatedRelation, read_part_relations
from nbv.commands.process.run import Shared, running
from nbv.run.wording import count
from scenes.files.part_files import PartFile, read_part_file
from scenes.files.scan_files import Units


@dataclass(frozen=True, kw_only=True, slots=True)
class PartRequest:
    """What is asked for: `relations` "auto", "off" or a file; `noise_m` in metres, None if not known."""

    shape: str
    relations: str = "auto"
    noise_m: float | None = None
    ignores_labels: bool = False
    units: Units = "m"

    @property
    def files(self) -> tuple[str, ...]:
        """The files that are read."""
        stated = () if self.relations in ("auto", "off") else (self.relations,)
        return (self.shape, *stated)

    def stated(self) -> tuple[StatedRelation[int], ...]:
        """Return what a person states."""
        return tuple(one for file in self.files[1:] for one in read_part_relations(file))

    def options(self) -> dict[str, Any]:
        """Return the options for manifest and report; files by name."""
        return {**asdict(self), "shape": Path(self.shape).name, "relations": Path(self.relations).name}


def run_part(shared: Shared, request: PartRequest) -> None:
    """Divide a part into surfaces, relate them, and write part.json, relations.json, part.ply and report."""
    with running("part", shared, default="out/part", is_folder=True) as run:
        run.watch.enter("load")
        run.read(request.files)
        stated = request.stated()
        held = read_part_file(request.shape, request.units)
        run.will_call(reached, 10)
        part = _modelled(held, request, stated, run)
        run.warn(part.warnings)
        run.watch.enter("save")
        write_part(part, run.stage.folder, rows=held.rows, n_rows=held.n_rows)
        run.watch.enter("report")
        from nbv.report.part_report import part_page

        run.report(part_page(part, Path(request.shape).name), request.options())
        run.finish(request.options(), summary_of(part), lines_of(part))


def _modelled(
    held: PartFile, request: PartRequest, stated: tuple[StatedRelation[int], ...], run: Any
) -> Part:
    """The part, with what is doubtful of the file among its warnings."""
    labels = None if request.ignores_labels else held.label
    part = model_part(
        held.points if held.mesh is None else held.mesh,
        labels,
        normals=held.normals,
        noise_m=request.noise_m,
        relations=None if request.relations == "off" else MACHINED,
        stated=stated,
        progress=run.progress,
        journal=run.journal(request.options()),
    )
    return replace(part, warnings=(*held.warnings, *part.warnings))


def summary_of(part: Part) -> dict[str, Any]:
    """Return the headline numbers."""
    kinds = [fit.surface.kind for fit in part.fits]
    return {
        "points": len(part.points),
        "triangles": None if part.faces is None else len(part.faces),
        "surfaces": {kind: kinds.count(kind) for kind in sorted(set(kinds))},
        "without_surface": int((part.surface == 0).sum()),
        "noise_m": part.noise_m,
        "relations": None if part.relations is None else status_counts(part),
        "free": None if part.relations is None else part.relations.free,
        "warnings": list(part.warnings),
    }


def lines_of(part: Part) -> list[str]:
    """Return the headline numbers for people."""
    what = "vertices" if part.faces is not None else "points"
    share = float((part.surface > 0).mean())
    lines = [
        f"surfaces   {kinds_text(part.fits)}, with {100 * share:.1f} % of {len(part.points)} {what}",
        f"noise      {1000 * part.noise_m:.3g} mm, points {1000 * part.spacing_m:.3g} mm apart",
    ]
    graph = part.relations
    if graph is None:
        return lines
    holding = sum(one.holds for one in graph.relations)
    others = f"{part.numbered(Status.REJECTED)} rejected, {part.numbered(Status.UNDECIDED)} undecided"
    lines.append(f"relations  {count(holding, 'holds', 'hold')}; {others}")
    lines.append(f"free       {graph.free} of {graph.unknowns} parameters")
    return lines
