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


def percent(fraction: float, digits: int = 1) -> str:
    """Return a fraction as percent, without the sign: never rounded up to 100 or down to 0.

    Examples
    --------
    >>> percent(0.99996), percent(1.0), percent(0.00001), percent(0.5)
    ('>99.9', '100', '<0.1', '50.0')
    """
    if fraction >= 1 or fraction <= 0:
        return f"{100 * min(max(fraction, 0), 1):.0f}"
    text, step = f"{100 * fraction:.{digits}f}", 10**-digits
    if float(text) >= 100:
        return f">{100 - step:.{digits}f}"
    return text if float(text) > 0 else f"<{step:.{digits}f}"


def percent_within(fraction: float, error: float) -> str:
    """Return a fraction as percent with its standard error, without the sign.

    Examples
    --------
    >>> percent_within(0.82893, 0.0007), percent_within(0.5, 0.12), percent_within(1.0, 0.00005)
    ('82.89 \u00b1 0.07', '50 \u00b1 12', '100 \u00b1 0.01')
    """
    points = 100 * error
    digits = 0 if points >= 10 else 1 if points >= 1 else 2
    least = 10.0**-digits
    return f"{percent(fraction, digits)} \u00b1 {max(points, least if error > 0 else 0.0):.{digits}f}"


def square_metres(area: float) -> str:
    """Return an area in square metres with two to four digits.

    Examples
    --------
    >>> square_metres(132.456), square_metres(5.6789), square_metres(0.01234), square_metres(0.0)
    ('132.5', '5.68', '0.012', '0')
    """
    if area <= 0:
        return "0"
    small = f"{area:.3f}" if area >= 0.001 else "<0.001"
    return f"{area:.1f}" if area >= 100 else f"{area:.2f}" if area >= 1 else small


def letters(number: int) -> str:
    """Return a name for a station that was given, counted from 0.

    Examples
    --------
    >>> letters(0), letters(25), letters(26)
    ('A', 'Z', 'AA')
    """
    return (letters(number // 26 - 1) if number >= 26 else "") + chr(ord("A") + number % 26)


def duration(seconds: float) -> str:
    """Return a time in words: seconds, minutes, or hours and minutes.

    Examples
    --------
    >>> duration(20), duration(600), duration(7500)
    ('20 s', '10 min', '2 h 05 min')
    """
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"
