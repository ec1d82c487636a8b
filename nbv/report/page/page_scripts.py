# SPDX-License-Identifier: MIT
"""Scripts and styles of the page, and the policy under which a browser runs these and loads nothing."""

from __future__ import annotations

import base64
import hashlib
from functools import cache
from importlib import resources

_TABLES = ("sorting",)
_VIEW = (
    "decoding", "camera", "painting", "picking", "drawing", "panel", "gestures", "stations", "viewer",
    "start",
)  # fmt: skip


@cache
def script_of(*, has_view: bool) -> str:
    """Return the page's script: sortable tables, and the 3-D view where there is one."""
    names = (*_TABLES, *(_VIEW if has_view else ()))
    folder = resources.files("nbv.report.viewer") / "scripts"
    parts = [(folder / f"{name}.js").read_text(encoding="utf-8") for name in names]
    return '(() => {\n"use strict";\n' + "\n".join(parts) + "})();\n"


@cache
def style_of(*, has_view: bool) -> str:
    """Return the page's style sheet."""
    page = (resources.files("nbv.report.page") / "templates" / "style.css").read_text(encoding="utf-8")
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
