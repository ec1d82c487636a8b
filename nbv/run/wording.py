# SPDX-License-Identifier: MIT
"""Wording: numbers with their nouns, the same in summaries, reports and reasons."""


def count(n: int, noun: str, plural: str = "") -> str:
    """Return a number with its noun, and with what follows it where that changes with the number.

    Parameters
    ----------
    n : int
        How many.
    noun : str
        What one of them is called.
    plural : str
        What all other numbers of them are called; the noun with an s when not given.

    Examples
    --------
    >>> count(1, "view"), count(25, "view"), count(0, "patch", "patches")
    ('1 view', '25 views', '0 patches')
    >>> count(1, "view measures", "views measure")
    '1 view measures'
    """
    return f"{n} {noun if n == 1 else plural or noun + 's'}"
