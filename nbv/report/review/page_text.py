# SPDX-License-Identifier: MIT
"""Text of the review page: its frame, and the script that asks the server and draws the view."""

from __future__ import annotations

from importlib import resources

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from nbv.report.blocks.page import VIEW_PARTS, joined_script, state_colours, style_of


def page_text(title: str, nonce: str) -> str:
    """Return the page as HTML; scripts and styles carry the `nonce` that its policy names."""
    folder = resources.files("nbv.report.review") / "page"
    environment = Environment(
        loader=PackageLoader("nbv.report.review", "page"), autoescape=True, undefined=StrictUndefined
    )
    return environment.get_template("review.html.j2").render(
        title=title,
        nonce=nonce,
        colours=state_colours(),
        style=Markup(style_of(has_view=True) + (folder / "review.css").read_text(encoding="utf-8")),
        script=Markup(joined_script(VIEW_PARTS, (folder / "review.js").read_text(encoding="utf-8"))),
    )
