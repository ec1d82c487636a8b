# SPDX-License-Identifier: MIT
"""`python -m benchmarks.completion.step [--noise 0] [--only tuning|held-out] [--files FOLDER] [NAMES...]`.

The parts of Fit4CAD (UNSEEN_DATA/parts) as STEP; a noise is a share of a part's diagonal. A line a part and a
summary: whether the file is valid when it is read back, whether it is a solid, why not, its volume against
what a rolling ball cannot enter of the cloud without noise, how exactly the relations that were claimed hold
in the file, CPU seconds and peak memory. Each part has a process of its own.
"""

from __future__ import annotations

import resource
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from scipy.spatial import cKDTree

from benchmarks.completion.step.kept import ReadBack, relation_error
from benchmarks.completion.step.volumes import ball_volume
from benchmarks.parts import parts, read_part, with_noise
from completion.parts.pipeline import divide_part, relate_part
from completion.parts.step_export import step_model
from scenes.checks import InputError

_BALL = 1.5  # times the largest of the usual gaps between points
_MM = 1e-3


def exported(path: Path, noise: float, seed: int, folder: Path | None) -> dict[str, Any]:
    """What one part comes to."""
    truth = read_part(path)
    points = with_noise(truth, noise, seed) * _MM
    found = relate_part(points, divide_part(points))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    began = time.process_time()
    out: dict[str, Any] = {"name": path.stem, "regions": len(found.fits)}
    try:
        model = step_model(found, path.stem)
    except InputError as error:
        return {**out, "valid": False, "solid": False, "reason": str(error), "faces": 0}
    out["seconds"] = time.process_time() - began
    after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    read = ReadBack(model.data)
    worst, n = relation_error(found, read, [one.number for one in model.faces if not one.reason])
    gap = float(np.quantile(cKDTree(truth.points).query(truth.points, k=7)[0][:, -1], 0.995))
    ball = ball_volume(truth.points * _MM, _BALL * gap * _MM)
    if folder is not None:
        (folder / f"{path.stem}.step").write_bytes(model.data)
    return {
        **out, **model.record(), "valid": model.is_valid and read.is_valid, "ball_m3": ball,
        "read_back": abs(read.volume_m3 / model.volume_m3 - 1) if model.n_solids else 0.0,
        "error": model.volume_m3 / ball - 1 if model.is_solid and ball > 0 else None,
        "relations": worst, "n_relations": n, "peak_mb": after / 1024, "grown_mb": (after - before) / 1024,
    }  # fmt: skip


def study(
    names: Annotated[list[str] | None, typer.Argument(help="Parts by name; all when not given.")] = None,
    noise: Annotated[float, typer.Option(min=0.0, help="Share of the diagonal.")] = 0.0,
    only: Annotated[str | None, typer.Option(help="tuning or held-out.")] = None,
    files: Annotated[Path | None, typer.Option(help="Folder for the STEP files.")] = None,
) -> None:
    """Print a line a part, and a summary."""
    chosen = [path for path in parts(only) if not names or path.stem in names]
    if not chosen:
        raise SystemExit("no parts; set UNSEEN_DATA")
    if files is not None:
        files.mkdir(parents=True, exist_ok=True)
    places = {path: place for place, path in enumerate(parts())}
    rows = list[dict[str, Any]]()
    for path in chosen:
        with ProcessPoolExecutor(1) as pool:
            rows.append(pool.submit(exported, path, noise, places[path], files).result())
        print(line(rows[-1]), flush=True)
    print("\n" + summary(rows))


def line(row: dict[str, Any]) -> str:
    """A part in words."""
    what = "solid" if row["solid"] else "open"
    valid = "valid" if row["valid"] else "NOT VALID"
    text = f"{row['name']}: {what}, {valid}, {row['faces']} faces of {row['regions']} regions"
    if row.get("error") is not None:
        text += f", volume {row['volume_m3'] * 1e6:.4f} cm3, {100 * row['error']:+.2f} % of the ball's"
    if "seconds" in row:
        text += f", relations {row['relations']:.1e} ({row['n_relations']}), gap {1e3 * row['gap_m']:.2g} mm"
        text += f", {row['seconds']:.1f} s, {row['peak_mb']:.0f} MB"
    return text + (f"; {row['reason']}" if row["reason"] else "")


def summary(rows: list[dict[str, Any]]) -> str:
    """All parts in words."""
    done = [row for row in rows if "seconds" in row]
    errors = np.abs([row["error"] for row in rows if row.get("error") is not None])
    why = Counter(
        "no face at all"
        if not row["faces"]
        else "a surface could not be trimmed"
        if "could not be trimmed" in row["reason"]
        else "a face ends in the open"
        for row in rows
        if not row["solid"]
    )
    seconds = [row["seconds"] for row in done]
    return "\n".join(
        [
            f"{len(rows)} parts: {sum(row['valid'] for row in rows)} valid, "
            f"{sum(row['solid'] for row in rows)} solids",
            "others: " + (", ".join(f"{n} {reason}" for reason, n in why.items()) or "none"),
            f"faces: {sum(row['faces'] for row in rows)} of {sum(row['regions'] for row in rows)} regions",
            f"volume off the ball's: median {100 * np.median(errors):.2f} %, "
            f"95 % {100 * np.quantile(errors, 0.95):.2f} %" if len(errors) else "no volume",
            f"volume read back: off by {max(row['read_back'] for row in done):.1e} at most",
            f"relations in the file: off by {max(row['relations'] for row in done):.1e} at most, of "
            f"{sum(row['n_relations'] for row in done)}",
            f"CPU s: median {np.median(seconds):.1f}, most {max(seconds):.1f}",
            f"peak memory {max(row['peak_mb'] for row in done):.0f} MB, of which the export "
            f"{max(row['grown_mb'] for row in done):.0f}",
        ]
    )  # fmt: skip


if __name__ == "__main__":
    typer.run(study)
