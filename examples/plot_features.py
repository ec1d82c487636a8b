# SPDX-License-Identifier: MIT
"""A doorway found whole, half of it behind a box: its sides by what the beams say of each.

Run it with `python examples/plot_features.py [SCAN...] [-o FOLDER]`: it finds doorways, windows and niches in
the scans, or in a simulated scan of a wall with a doorway (5 mm of noise, 1 % of strays) when none is given,
prints them, and writes `features.png` into FOLDER/pictures (default: docs).
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

from benchmarks.cases.walls import opening_case
from completion import find_features
from nbv.commands.feature import lines_of
from nbv.report.feature_report import scan_shots
from scenes import read_scan

KINDS = ("doorway", "window", "niche")


def main(given: Sequence[str] | None = None) -> None:
    """Print the openings and write the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scans", nargs="*", type=Path, help="scans; of a simulated wall when none is given")
    parser.add_argument("-o", "--out", type=Path, default=Path("docs"), help="folder of the pictures")
    asked = parser.parse_args(given)
    (asked.out / "pictures").mkdir(parents=True, exist_ok=True)
    scans = [read_scan(path) for path in asked.scans] or [opening_case(102, "doorway", 0.5).scan]
    features = find_features(scans, KINDS)
    print("\n".join(lines_of(features)), flush=True)
    (asked.out / "pictures" / "features.png").write_bytes(scan_shots(scans, features.fits)[0].png)


if __name__ == "__main__":
    main()
