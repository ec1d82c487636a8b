# SPDX-License-Identifier: MIT
"""The gallery in small: every script that makes the pictures of the docs, run with little to do.

Run it with `python examples/gallery.py [NAME...] [-o FOLDER]` (`make gallery`): it writes small pictures into
FOLDER (default: out/gallery), says how long each took, and ends with an error where one failed. The pictures
in docs are made by the same scripts without these arguments. Scripts that need data that is absent say so.
"""

import argparse
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SMALL = {
    "plot_architecture": ["--docs", "{out}"],
    "plot_scanner": ["--docs", "{out}", "--scale", "0.15"],
    "plot_instruments": ["--docs", "{out}"],
    "plot_walk": ["--docs", "{out}", "--seconds", "1"],
    "plot_textures": ["--docs", "{out}", "--quick"],
    "plot_junctions": ["--docs", "{out}"],
    "plot_own_template": ["--docs", "{out}"],
    "plot_fitting_metrics": ["--docs", "{out}", "--trials", "4", "--workers", "2"],
    "plot_completion": ["chair_before_wall", "-o", "{out}"],
    "plot_surface_textures": ["wall_with_window", "-o", "{out}"],
    "plot_before_after": [
        *["{out}/completions"] * 2,
        "--make",
        "{out}/completions",
        "--only",
        "redwood",
        "-o",
        "{out}",
    ],
    "plot_segmentation": ["-o", "{out}"],
    "plot_parts": ["-o", "{out}"],
    "plot_features": ["-o", "{out}"],
    "plot_step": ["-o", "{out}"],
    "plot_patches": ["-o", "{out}"],
    "plot_evolution": ["-o", "{out}", "--seeds", "2"],
    "plot_registration": ["-o", "{out}"],
    "plot_panels": ["-o", "{out}"],
    "plot_exchange": ["-o", "{out}"],
    "plot_holes": ["--docs", "{out}"],
    "plot_decisions": ["-o", "{out}"],
    "plot_check": ["-o", "{out}"],
    "plot_ifc": ["-o", "{out}"],
    "plot_flattening": ["--docs", "{out}", "--seeds", "0"],
    "plot_simulated_against_real": ["--docs", "{out}"],
    "plot_report": ["--docs", "{out}"],
    "plot_floor_plan": ["--docs", "{out}", "--spacing", "0.4"],
    "plot_view_planning": ["--docs", "{out}", "--quick"],
    "plot_inference_study": ["--docs", "{out}", "--starts", "1", "--cases", "two_occluders, panorama"],
    "plot_scan_study": ["--docs", "{out}"],
    "plot_paper_study": ["--docs", "{out}", "--starts", "1", "--spacing", "0.8", "--threads", "2"],
}  # the quickest first


def run(name: str, out: Path) -> bool:
    """Run one script and tell whether it went well."""
    begin = time.perf_counter()
    words = [word.format(out=out) for word in SMALL[name]]
    done = subprocess.run([sys.executable, str(ROOT / "examples" / f"{name}.py"), *words], check=False)
    print(
        f"{name}: {'done' if done.returncode == 0 else 'FAILED'}, {time.perf_counter() - begin:.0f} s",
        flush=True,
    )
    return done.returncode == 0


def main(arguments: list[str] | None = None) -> None:
    """Run the scripts named, or all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help="scripts to run; all when none is named")
    parser.add_argument("-o", "--out", type=Path, default=ROOT / "out/gallery")
    asked = parser.parse_args(arguments)
    unknown = [name for name in asked.names if name not in SMALL]
    if unknown:
        parser.error(f"there is no {unknown[0]}; there are {', '.join(SMALL)}")
    asked.out.mkdir(parents=True, exist_ok=True)
    failed = [name for name in asked.names or SMALL if not run(name, asked.out)]
    if failed:
        sys.exit(f"failed: {', '.join(failed)}")


if __name__ == "__main__":
    main()
