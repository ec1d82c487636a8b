# SPDX-License-Identifier: MIT
"""Report of a run: a table by reader, the findings, and the files that made them."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path

from tests.robustness.fuzzing.supervision import KINDS, Tally, mutant_of
from tests.robustness.fuzzing.targets import TARGETS

_SHORT = {"outside the promise": "outside", "broken invariant": "broken", "unclear message": "unclear",
          "opened elsewhere": "elsewhere"}  # fmt: skip


def table(tallies: Sequence[Tally]) -> str:
    """Return a table in Markdown: files tried, read and refused by each reader, and findings by kind."""
    kinds = [kind for kind in KINDS if kind != "seed"]
    head = [
        "reader",
        "tried",
        "read",
        "refused",
        *(_SHORT.get(kind, kind) for kind in kinds),
        "peak MB",
        "files/s",
    ]
    rows = [
        [
            tally.target,
            f"{tally.tried:,}",
            f"{tally.read:,}",
            f"{tally.refused:,}",
            *(str(tally.found[kind]) for kind in kinds),
            f"{tally.peak_mb:.0f}",
            f"{tally.tried / max(tally.seconds, 1e-9):.0f}",
        ]
        for tally in tallies
    ]
    total = [f"{sum(getattr(tally, name) for tally in tallies):,}" for name in ("tried", "read", "refused")]
    sums = [str(sum(tally.found[kind] for tally in tallies)) for kind in kinds]
    peak = f"{max((tally.peak_mb for tally in tallies), default=0):.0f}"
    rows.append(["**all**", *total, *sums, peak, ""])
    lines = [" | ".join(row) for row in [head, ["---", *["--:"] * (len(head) - 1)], *rows]]
    return "\n".join(f"| {line} |" for line in lines)


def findings(tallies: Sequence[Tally]) -> list[str]:
    """Return a line for each kind and place of findings."""
    return [
        f"{tally.target} #{one['index']} {one['kind']}: {one['text']} [{one['place']}]"
        for tally in tallies
        for one in tally.findings
    ]


def save_findings(tallies: Sequence[Tally], seed: int, folder: Path) -> None:
    """Write the files that made the findings, a folder each, and `findings.json`."""
    records = [record for tally in tallies for record in tally.findings]
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "findings.json").write_text(json.dumps(records, indent=1), encoding="utf-8")
    for tally in tallies:
        seeds = TARGETS[tally.target].seeds() if tally.findings else []
        for record in tally.findings:
            if record["index"] >= 0:
                case = mutant_of(tally.target, len(seeds), seed, record).build(seeds)
                name = re.sub(r"\W+", "-", f"{tally.target} {record['kind']} {record['index']}")
                case.write(folder / name)
