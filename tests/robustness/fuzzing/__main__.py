# SPDX-License-Identifier: MIT
"""Command line: `python -m tests.robustness.fuzzing` tries mutated files on every reader, prints a table."""

from __future__ import annotations

import argparse
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from tests.robustness.fuzzing.guided import is_installed, run_guided
from tests.robustness.fuzzing.report import findings, save_findings, table
from tests.robustness.fuzzing.supervision import Tally, supervise
from tests.robustness.fuzzing.targets import TARGETS


def main() -> int:
    """Run; the exit code is 1 where there are findings."""
    parser = argparse.ArgumentParser(prog="python -m tests.robustness.fuzzing", description=__doc__)
    parser.add_argument("--readers", nargs="*", default=[], help="parts of their names; all when not given")
    parser.add_argument("--files", type=int, default=20_000, help="mutants for each reader")
    parser.add_argument("--seconds", type=float, default=1e9, help="for the whole run")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument(
        "--guided", type=float, default=0, metavar="SECONDS", help="then so long with atheris"
    )
    parser.add_argument(
        "--out", type=Path, default=Path("out/fuzz"), help="folder for the table and what was found"
    )
    options = parser.parse_args()
    names = [name for name in TARGETS if not options.readers or any(part in name for part in options.readers)]
    begun = time.monotonic()

    def tell(line: str) -> None:
        print(line, file=sys.stderr, flush=True)

    def one(place: int) -> Tally:
        rest = begun + options.seconds - time.monotonic()
        share = max(rest, 0) * options.processes / max(1, len(names) - place)
        return supervise(names[place], options.files, options.seed, share, tell)

    with ThreadPoolExecutor(options.processes) as pool:
        tallies = list(pool.map(one, range(len(names))))
    save_findings(tallies, options.seed, options.out)
    text = table(tallies)
    (options.out / "table.md").write_text(text + "\n", encoding="utf-8")
    print(text)
    print(*findings(tallies), sep="\n")
    guided = _guided(names, options.guided, options.out) if options.guided else False
    return int(guided or any(tally.findings for tally in tallies))


def _guided(names: list[str], seconds: float, out: Path) -> bool:
    """Let atheris go on, where it is installed; tell whether it found something."""
    if not is_installed():
        print("atheris is not installed, so nothing is guided by coverage: pip install -e '.[fuzz]' (Linux)")
        return False
    done = [run_guided(name, out / "guided", max(10.0, seconds / len(names))) for name in names]
    print("| reader, guided | runs | branches | finding |\n| --- | --: | --: | --- |")
    for one in done:
        print(f"| {one['reader']} | {one['runs']:,} | {one['covered']} | {one['finding']} |")
    return any(one["finding"] for one in done)


if __name__ == "__main__":
    sys.exit(main())
