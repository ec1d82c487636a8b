# SPDX-License-Identifier: MIT
"""Card: a value as a small piece of HTML for notebooks; escaped, self-contained, on light and on dark."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

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
