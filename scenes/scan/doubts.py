# SPDX-License-Identifier: MIT
"""Doubts about scans in one list: what several scans share stands once, with their number."""

from __future__ import annotations

import re
from collections.abc import Sequence

_NUMBER = re.compile(r"\d+(?:[.,]\d+)*")


def merge_warnings(named: Sequence[tuple[str, Sequence[str]]]) -> list[str]:
    """Return the warnings of scans, each given with its name, in order.

    Those of several scans that differ in numbers alone become one, with the numbers of the first scan.

    Examples
    --------
    >>> merge_warnings([("a", ["no pose"]), ("b", ["no pose"]), ("c", ["3 points were left out"])])
    ['2 of 3 scans: no pose', 'c: 3 points were left out']
    >>> merge_warnings([("a", ["3 points were left out"]), ("b", ["4 points were left out"])])
    ['2 of 2 scans, as a: 3 points were left out']
    """
    groups: dict[str, list[tuple[str, str]]] = {}
    for name, texts in named:
        for key, text in {_NUMBER.sub("#", text): text for text in texts}.items():
            groups.setdefault(key, []).append((name, text))
    return [_sentence(group, len(named)) for group in groups.values()]


def merge_sentences(texts: Sequence[str]) -> list[str]:
    """Return warnings in order, each once; those that differ in the name before a colon alone become one.

    Examples
    --------
    >>> merge_sentences(["a: no pose", "far away", "b: no pose", "far away", "c: no pose", "d: no pose"])
    ['a, b and 2 others: no pose', 'far away']
    """
    names: dict[str, list[str]] = {}
    for text in dict.fromkeys(texts):
        name, colon, rest = text.partition(": ")
        names.setdefault(rest if colon else text, []).extend([name] if colon else [])
    return [f"{_listed(those)}: {rest}" if those else rest for rest, those in names.items()]


def _listed(names: Sequence[str]) -> str:
    shown = [*names] if len(names) < 4 else [*names[:2], f"{len(names) - 2} others"]
    return shown[0] if len(shown) == 1 else f"{', '.join(shown[:-1])} and {shown[-1]}"


def _sentence(group: Sequence[tuple[str, str]], n_scans: int) -> str:
    name, first = group[0]
    if len(group) == 1:
        return f"{name}: {first}"
    whose = "" if all(text == first for _, text in group) else f", as {name}"
    return f"{len(group)} of {n_scans} scans{whose}: {first}"
