# SPDX-License-Identifier: MIT
"""The picture of docs/guides/studies.md: errors of three instruments by range, of the study of scanners.

Run it with `python examples/plot_scan_study.py [--docs FOLDER] [--study FILE]`: it runs the study into a
temporary folder and puts the picture into FOLDER/pictures (default: docs).
"""

import argparse
import tempfile
from pathlib import Path

from nbv import read_study, run_scan_study, scan_results
from nbv.report.figures.plots import on_white
from nbv.report.scan_study_report import scan_study_page

ROOT = Path(__file__).resolve().parents[1]


def main() -> None:
    """Run the study and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--docs", type=Path, default=ROOT / "docs")
    parser.add_argument("--study", type=Path, default=ROOT / "examples/studies/scanners.toml")
    asked = parser.parse_args()
    spec = read_study(asked.study)
    with tempfile.TemporaryDirectory() as folder:
        results = scan_results(spec, run_scan_study(spec, Path(folder)))
    _, plots = scan_study_page(spec, results, asked.study.stem)
    (asked.docs / "pictures").mkdir(parents=True, exist_ok=True)
    (asked.docs / "pictures" / "scan_study.png").write_bytes(on_white(plots["error-by-range"]))
    for result in results:
        print(result.row["sensor"], result.row["poses"], f"{1e3 * result.row['sd_m']:.2f} mm")


if __name__ == "__main__":
    main()
