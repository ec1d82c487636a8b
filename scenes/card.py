# SPDX-License-Identifier: MIT
"""How values show themselves: a few lines of text, and a card of HTML for notebooks, on light and dark."""

from __future__ import annotations

import base64
import re
from collections.abc import Collection, Mapping, Sequence, Set
from dataclasses import MISSING, dataclass, fields, is_dataclass
from enum import Enum
from html import escape
from textwrap import wrap
from typing import Any, TypeVar

_WIDTH, _MOST_LINES = 78, 5  # of a value's text: characters of a line, and lines
_MOST_INNER, _SHORT, _MANY_FIELDS = 48, 6, 8  # characters of a field, entries that are told, fields
_UNBROKEN = "\0"  # stands for spaces where no line may be broken
_Kind = TypeVar("_Kind")
# the colours that reports use for the same things; blue and orange stay apart for the colour-blind
MEASURED, INFERRED, UNKNOWN, UNREACHABLE = "#9ea3a3", "#2e7acc", "#e69e1a", "#f2d9a8"


@dataclass(frozen=True, slots=True)
class CardPicture:
    """A picture of a card: PNG or SVG text, what it shows, and its width in CSS pixels."""

    content: bytes | str
    caption: str
    width: int

    def to_html(self) -> str:
        """Return a figure; SVG stands in the text itself, so that it takes the page's own colours."""
        caption = escape(self.caption)
        if isinstance(self.content, str):
            shown = self.content
        else:
            uri = "data:image/png;base64," + base64.b64encode(self.content).decode("ascii")
            shown = f'<img src="{uri}" alt="{caption}" width="{self.width}" style="max-width:100%"/>'
        note = f'<figcaption style="opacity:.7;font-size:85%">{caption}</figcaption>'
        return f'<figure style="margin:0;width:{self.width}px;max-width:100%">{shown}{note}</figure>'


@dataclass(frozen=True, slots=True)
class CardShare:
    """A part of the bar: what it is, how large a part of the whole (0..1), and its CSS colour."""

    label: str
    amount: float
    colour: str


@dataclass(frozen=True, slots=True)
class Card:
    """What a notebook shows of a value.

    Attributes
    ----------
    kind, title : str
        What it is, and its name.
    figures : sequence of (str, str)
        What is told, and its value with unit.
    bar : sequence of Share
        The whole at a glance; empty for none.
    pictures : sequence of CardPicture
        Small ones.
    note : str
        A sentence below.

    Examples
    --------
    >>> "a &lt;b&gt; c" in Card("Scan", "a <b> c", (("size", "2 x 3 pixels"),)).to_html()
    True
    """

    kind: str
    title: str
    figures: Sequence[tuple[str, str]]
    bar: Sequence[CardShare] = ()
    pictures: Sequence[CardPicture] = ()
    note: str = ""

    def to_html(self) -> str:
        """Return the card: no style sheet, no script; text and rules take the notebook's own colour."""
        cells = "".join(
            f'<span style="opacity:.7">{escape(label)}</span><span>{escape(value)}</span>'
            for label, value in self.figures
        )
        grid = (
            '<div style="display:grid;grid-template-columns:max-content auto;gap:1px 14px;'
            f'align-content:start">{cells}</div>'
        )
        drawn = "".join(picture.to_html() for picture in self.pictures)
        pictures = f'<div style="display:flex;flex-wrap:wrap;gap:10px 14px">{drawn}</div>' if drawn else ""
        note = f'<div style="opacity:.7;margin-top:6px">{escape(self.note)}</div>' if self.note else ""
        return (
            '<div class="unseen-card" style="font:13px/1.45 system-ui,sans-serif;color:inherit;'
            "display:inline-block;max-width:760px;padding:10px 14px;margin:4px 0;border-radius:8px;"
            'border:1px solid color-mix(in srgb,currentColor 25%,transparent)">'
            f'<div style="opacity:.7;font-size:85%">{escape(self.kind)}</div>'
            '<div style="font-weight:600;margin-bottom:6px;overflow-wrap:anywhere">'
            f"{escape(self.title)}</div>"
            f'{self._bar()}<div style="display:flex;flex-wrap:wrap;gap:10px 22px">{grid}{pictures}</div>'
            f"{note}</div>"
        )

    def _bar(self) -> str:
        """The bar and its key."""
        shares = [share for share in self.bar if share.amount > 0]
        if not shares:
            return ""
        parts = "".join(
            f'<div style="flex:{share.amount:.4f} 1 0;background:{share.colour}"></div>' for share in shares
        )
        key = "".join(
            '<span style="margin-right:14px;white-space:nowrap"><span style="display:inline-block;width:.7em;'
            f'height:.7em;border-radius:2px;background:{share.colour}"></span> {escape(share.label)}</span>'
            for share in shares
        )
        return (
            '<div style="display:flex;height:10px;border-radius:5px;overflow:hidden;min-width:260px">'
            f'{parts}</div><div style="margin:4px 0 8px">{key}</div>'
        )


def shown(kind: type[_Kind]) -> type[_Kind]:
    """Give a named tuple the text of a `Value`."""
    setattr(kind, "__repr__", lambda self: text_of_facts(kind.__name__, field_facts(self)))  # noqa: B010
    return kind


def text_of(value: Any) -> str:
    """Return the text of a value that has `_facts`, by its class's name."""
    return text_of_facts(type(value).__name__, value._facts())


def text_of_facts(name: str, facts: Sequence[tuple[str, str]]) -> str:
    """Return `name(label=value, ...)`, at most five lines and 400 characters; facts are not broken.

    Examples
    --------
    >>> text_of_facts("Walk", (("length", "3.5 m"),))
    'Walk(length=3.5 m)'
    """
    room = _WIDTH - len(name) - 2
    parts = [_shortened(f"{label}={value}", room).replace(" ", _UNBROKEN) for label, value in facts]
    lines = wrap(
        f"{name}({', '.join(parts)})",
        _WIDTH,
        subsequent_indent="    ",
        break_long_words=False,
        break_on_hyphens=False,
        max_lines=_MOST_LINES,
        placeholder=" ...)",
    )
    return "\n".join(lines).replace(_UNBROKEN, " ")


def brief(value: Any, *, inner: bool = True) -> str:
    """Return a value in a few words: an array by type and shape, a long sequence by its number of entries.

    `inner` values show their fields where there is room.

    Examples
    --------
    >>> import numpy as np
    >>> brief(np.zeros((4, 3))), brief(np.array([1.0, 0.25])), brief(("a", "b")), brief([0.5] * 9)
    ('float64 (4, 3)', '[1, 0.25]', "('a', 'b')", '9 float')
    """
    if hasattr(value, "dtype") and hasattr(value, "tolist"):  # of numpy, which help of commands does not load
        if value.shape and not (value.ndim == 1 and value.size <= _SHORT):
            return f"{value.dtype} {value.shape}"
        value = value.tolist()
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, str | bool | int | None):
        return _shortened(repr(value), _MOST_INNER)
    if isinstance(value, Mapping | Sequence | Set):
        return _brief_entries(value, inner=inner)
    if is_dataclass(value) and not isinstance(value, type):
        is_plain = type(value).__repr__ is text_of or not hasattr(value, "_facts")
        shown = [f"{name}={text}" for name, text in field_facts(value, inner=False)] if inner else ["..."]
        text = f"{type(value).__name__}({', '.join(shown)})" if is_plain else repr(value)
        return text if len(text) <= _MOST_INNER else f"{type(value).__name__}(...)"
    text = repr(value)
    return type(value).__name__ if " at 0x" in text or len(text) > _MOST_INNER else text


def _brief_entries(value: Collection[Any], *, inner: bool) -> str:
    """Entries where they are few and short, else how many there are, and of which kind the first is."""
    if len(value) <= _SHORT:
        each = [brief(entry, inner=inner) for entry in value]
        if isinstance(value, Mapping):
            each = [
                f"{key}: {brief(entry, inner=inner)}" for key, entry in zip(each, value.values(), strict=True)
            ]
        start, end = "()" if isinstance(value, tuple) else "[]" if isinstance(value, Sequence) else "{}"
        text = f"{start}{', '.join(each)}{',' if start == '(' and len(each) == 1 else ''}{end}"
        if len(text) <= _MOST_INNER:
            return text
    return f"{len(value)} {type(next(iter(value))).__name__}"


def field_facts(value: Any, *, inner: bool = True) -> list[tuple[str, str]]:
    """The fields in brief, private ones left out; of many, those at their defaults too."""
    if is_dataclass(value):
        defaults = {field.name: field.default for field in fields(value) if field.repr}
    else:
        defaults = {name: value._field_defaults.get(name, MISSING) for name in value._fields}
    held = {name: getattr(value, name) for name in defaults if not name.startswith("_")}
    if len(held) > _MANY_FIELDS:
        held = {name: one for name, one in held.items() if not _is_default(one, defaults[name])}
    return [(name, brief(one, inner=inner)) for name, one in held.items()]


def _is_default(value: object, default: object) -> bool:
    """Whether a field has its default, as far as that is told without looking at arrays."""
    simple = isinstance(value, str | bool | int | float) and type(value) is type(default)
    return value is default or (simple and value == default)


def _shortened(text: str, most: int) -> str:
    """The text on one line, its end left out where it is longer than `most` characters."""
    line = " ".join(text.split())
    return line if len(line) <= most else line[: most - 3] + "..."


class Value:
    """A base of dataclasses that shows itself: at most five lines of text, in notebooks the same as a card.

    What it tells are its fields, arrays by their shapes and other values by their names, unless the class has
    better `_facts`. Of many fields, those at their defaults are left out.

    Examples
    --------
    >>> import numpy as np
    >>> @dataclass(frozen=True)
    ... class Sheet(Value):
    ...     corners: np.ndarray
    ...     name: str = ""
    >>> Sheet(np.zeros((4, 3)))
    Sheet(corners=float64 (4, 3), name='')
    """

    __slots__ = ()
    __repr__ = text_of

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        setattr(cls, "__repr__", cls.__repr__)  # noqa: B010 - `dataclass` makes one where the class has none

    def _facts(self) -> list[tuple[str, str]]:
        """What is told: names and values with their units."""
        return field_facts(self)

    def _repr_html_(self) -> str:
        """What a notebook shows: the facts as a table."""
        words = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", type(self).__name__).capitalize()
        return Card(type(self).__module__.split(".")[0], words, self._facts()).to_html()
