# SPDX-License-Identifier: MIT
"""Page: the parts that a report is made of, and their rendering as one HTML file."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, ClassVar, Literal

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from nbv.inspection.verdict_colours import VERDICT_COLOURS
from nbv.report.figures.picture import INFERRED, MEASURED, MODELLED, UNKNOWN, Picture
from nbv.report.viewer.encoding import encode_view
from nbv.report.viewer.layers import Viewer
from nbv.run.manifest import versions
from nbv.run.wording import percent_within, square_metres
from scenes.run.atomic import write_text
from scenes.scan.doubts import merge_sentences

State = Literal[
    "", "measured", "modelled", "inferred", "unknown", "unreachable",
    "within", "deviates", "undecided", "missing", "hidden", "not-seen", "not-tested",
]  # fmt: skip


@dataclass(frozen=True, slots=True)
class Headline:
    """One of the large figures at the top: its value as text, unit, what it is, and whose colour it takes."""

    value: str
    unit: str
    label: str
    state: State = ""


def headline_of(share: float, error: float, label: str, state: State = "") -> Headline:
    """Return the figure of a share of area, in percent, with its standard error."""
    value, within = percent_within(share, error).split(" ", 1)
    return Headline(value, f"{within} %", label, state)


@dataclass(frozen=True, slots=True)
class BarShare:
    """A part of a bar: `amount` in the bar's own unit, and as text."""

    label: str
    state: State
    amount: float
    text: str


@dataclass(frozen=True, slots=True)
class Bar:
    """A whole cut into its shares."""

    label: str
    shares: tuple[BarShare, ...]
    kind: ClassVar[str] = "bar"


def shares_bar(parts: Iterable[tuple[str, State, float]], total_m2: float) -> Bar:
    """Return the bar of a whole area in square metres, by label, state and share of each part."""
    shares = [BarShare(*part, f"{square_metres(part[2] * total_m2)} m\u00b2") for part in parts]
    return Bar("", tuple(shares))


@dataclass(frozen=True, slots=True)
class Text:
    """A paragraph; a note is set smaller."""

    text: str
    is_note: bool = False
    kind: ClassVar[str] = "text"


@dataclass(frozen=True, slots=True)
class Gallery:
    """Pictures side by side; the widest ones take a row of their own."""

    pictures: tuple[Picture, ...]
    columns: int = 3
    kind: ClassVar[str] = "gallery"


@dataclass(frozen=True, slots=True)
class Legend:
    """The colour code."""

    states: tuple[State, ...] = ("measured", "inferred", "unknown")
    kind: ClassVar[str] = "legend"


@dataclass(frozen=True, slots=True)
class Cell:
    """A cell of a table: text, the colour of a swatch before it, a share 0..1 drawn as a small bar."""

    text: str
    swatch: str = ""
    share: float | None = None
    state: State = ""


@dataclass(frozen=True, slots=True)
class Table:
    """A table; columns whose title begins with "#" are numbers, set to the right.

    Rows can be chosen by the values of columns whose titles are `filters`. Rows after the `first` are folded
    on a screen, and can be searched.
    """

    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    caption: str = ""
    is_folded: bool = False
    filters: tuple[str, ...] = ()
    kind: ClassVar[str] = "table"
    first: ClassVar[int] = 20


@dataclass(frozen=True, slots=True)
class Histogram:
    """Counts in equal bins from `low` to `high` in a unit, with limits either side of 0 and an interval."""

    label: str
    counts: tuple[int, ...]
    low: float
    high: float
    unit: str
    limit: float
    interval: tuple[float, float] | None = None
    kind: ClassVar[str] = "histogram"

    def at(self, value: float) -> float:
        """Where a value is along the axis, percent; what lies beyond it is at its end."""
        return 100 * min(max((value - self.low) / (self.high - self.low), 0.0), 1.0)

    @property
    def heights(self) -> tuple[float, ...]:
        """Percent of the highest bin, at least 3 where there is anything."""
        most = max(*self.counts, 1)
        return tuple(max(100 * n / most, 3.0) if n else 0.0 for n in self.counts)

    @property
    def ticks(self) -> tuple[float, ...]:
        """Numbers below the axis."""
        inner = (-self.limit, 0.0, self.limit) if self.at(self.limit) - 50 > 6 else (0.0,)
        return tuple(value for value in (self.low, *inner, self.high) if self.low <= value <= self.high)


@dataclass(frozen=True, slots=True)
class Card:
    """What is known of one thing: its title, the colour of its state, a word for that, and blocks."""

    title: str
    state: State
    word: str
    blocks: tuple[Bar | Text | Table | Histogram, ...]
    is_open: bool = True
    kind: ClassVar[str] = "card"


Block = Bar | Text | Gallery | Legend | Table | Histogram | Card | Viewer


@dataclass(frozen=True, slots=True)
class PageSection:
    """A part of the page under its own heading."""

    title: str
    blocks: tuple[Block, ...]


@dataclass(frozen=True, slots=True)
class Page:
    """A report.

    `kicker` says above the title what kind of report it is, `summary` in a sentence or two the result, and at
    most six `headlines` and the `bar` tell it in figures. `options` are what was asked for, without times and
    paths, `inputs` the name and SHA-256 of each input file, `warnings` what the reader should know first.
    """

    title: str
    kicker: str
    summary: str
    headlines: tuple[Headline, ...]
    bar: Bar | None
    sections: tuple[PageSection, ...]
    options: Mapping[str, Any] = field(default_factory=dict)
    seed: int = 0
    warnings: tuple[str, ...] = field(default=())
    inputs: tuple[tuple[str, str], ...] = field(default=())

    def to_html(self) -> str:
        """Return the page as one HTML text that needs nothing else."""
        template = _environment().get_template("report.html.j2")
        rows = [(key.replace("_", " "), plain_text(value)) for key, value in self.options.items()]
        script = script_of(has_view=self.has_view)
        return template.render(
            page=self,
            warnings=merge_sentences(self.warnings),
            options=rows,
            versions=versions(),
            colours=state_colours(),
            script=Markup(script),
            style=Markup(style_of(has_view=self.has_view)),
            policy=policy(script),
        )

    @property
    def has_view(self) -> bool:
        """Whether there is a 3-D view on it."""
        return any(isinstance(block, Viewer) for section in self.sections for block in section.blocks)

    def write(self, path: Path) -> None:
        """Write the page."""
        write_text(path, self.to_html())


def plain_text(value: Any) -> str:
    """Return an option's value for people.

    Examples
    --------
    >>> plain_text(None), plain_text(True), plain_text([1.0, 2.5]), plain_text({"fov_deg": 60.0})
    ('default', 'yes', '1, 2.5', 'fov_deg 60')
    """
    if value is None:
        return "default"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {plain_text(item)}" for key, item in value.items())
    if isinstance(value, Sequence) and not isinstance(value, str):
        return ", ".join(plain_text(item) for item in value) or "none"
    return str(value)


def state_colours() -> dict[str, str]:
    """Return the colours of states and verdicts by name, as `#rrggbb`."""
    pairs = (("measured", MEASURED), ("modelled", MODELLED), ("inferred", INFERRED), ("unknown", UNKNOWN))
    states = {name: "#" + "".join(f"{round(255 * part):02x}" for part in rgb) for name, rgb in pairs}
    return states | {name.replace(" ", "-"): colour for name, colour in VERDICT_COLOURS.items()}


def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("nbv.report", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["encoded"] = encode_view
    return environment


_TABLES = ("filtering", "sorting", "sideways")
VIEW_PARTS = (
    "decoding", "camera", "painting", "picking", "drawing", "panel", "gestures", "stations", "viewer",
)  # fmt: skip
"""Parts of the script that draw a 3-D view."""


@cache
def script_of(*, has_view: bool) -> str:
    """Return the page's script: tables that are sorted, filtered and scrolled, and the 3-D view, if any."""
    return joined_script((*_TABLES, *((*VIEW_PARTS, "start") if has_view else ())))


def joined_script(names: Sequence[str], more: str = "") -> str:
    """Return parts of the page's script by name, then `more`, as one that leaves no names behind."""
    folder = resources.files("nbv.report") / "templates"
    parts = [(folder / f"{name}.js").read_text(encoding="utf-8") for name in names]
    return '(() => {\n"use strict";\n' + "\n".join([*parts, *([more] if more else [])]) + "})();\n"


@cache
def style_of(*, has_view: bool) -> str:
    """Return the page's style sheet."""
    page = (resources.files("nbv.report") / "templates" / "style.css").read_text(encoding="utf-8")
    view = (resources.files("nbv.report.viewer") / "view.css").read_text(encoding="utf-8")
    return page + view if has_view else page


def policy(script: str) -> str:
    """Return the content security policy: this script alone runs, and nothing is loaded from anywhere.

    Examples
    --------
    >>> policy("").split("; ")[3]
    "script-src 'sha256-47DEQpj8HBSa+/TImW+5JCeuQeRkm5NMpJWZG3hSuFU='"
    """
    digest = base64.b64encode(hashlib.sha256(script.encode("utf-8")).digest()).decode("ascii")
    return (
        "default-src 'none'; img-src data:; style-src 'unsafe-inline'; "
        f"script-src 'sha256-{digest}'; base-uri 'none'; form-action 'none'"
    )
