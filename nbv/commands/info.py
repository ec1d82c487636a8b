# SPDX-License-Identifier: MIT
"""`unseen info`: what any file or output folder holds, with warnings."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from nbv.commands.description.outputs import describe_output, with_states
from nbv.commands.process.run import Shared, running
from scenes.io.describe import describe
from scenes.io.format import Units
from scenes.io.scan_files import split_index
from scenes.mesh.orientation import Axis
from scenes.run.atomic import write_json

_DEEPEST = 8


def run_info(
    shared: Shared,
    file: str,
    *,
    up: Axis,
    units: Units,
    intrinsics: tuple[float, ...] | None,
    depth_scale: float | None,
) -> None:
    """Describe `file` on stdout; with an output file also there, with a manifest."""
    default = Path(f"{Path(file.partition('#')[0]).name or 'input'}.info.json")
    with running("info", shared, default=str(default), is_folder=False, writes=shared.out is not None) as run:
        camera = None if intrinsics is None else (intrinsics[0], intrinsics[1], intrinsics[2], intrinsics[3])
        held = describe_output(split_index(file)[0])
        if held is None:
            held = with_states(describe(file, up=up, units=units, intrinsics=camera, depth_scale=depth_scale))
        lines = _lines(held)
        if shared.out is None:  # nothing is written, so there is nothing to make a manifest for
            run.say(held, lines)
            return
        run.read([file])
        write_json(run.path(), held)
        options = {"up": up, "units": units, "intrinsics": intrinsics, "depth_scale": depth_scale}
        run.finish(options, held, lines)


def _lines(held: dict[str, Any]) -> list[str]:
    """Return the description as lines of a table, warnings last."""
    rows = [(key, _text(value)) for key, value in held.items() if key not in ("warnings", "scans")]
    for scan in held.get("scans", []):
        rows.append((f"scan {scan['number']}", scan["name"]))
        rows += [(f"  {key}", _text(scan[key])) for key in scan if key not in ("number", "name", "bounds_m")]
    width = max(len(key) for key, _ in rows)
    lines = [f"{key:<{width}}  {text}" for key, text in rows]
    return lines + [f"warning: {text}" for text in held.get("warnings", [])]


def _text(value: Any, depth: int = 0) -> str:
    """Return a value in few characters; what lies deeper than people look as dots."""
    if depth > _DEEPEST:
        return "..."
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, dict):
        return ", ".join(f"{key} {_text(item, depth + 1)}" for key, item in value.items()) or "none"
    if isinstance(value, list):
        shown = ", ".join(
            f"[{_text(item, depth + 1)}]" if isinstance(item, list) else _text(item, depth + 1)
            for item in value[:8]
        )
        return shown + (f", ... ({len(value)})" if len(value) > 8 else "") or "none"
    return "none" if value is None else str(value)
