# SPDX-License-Identifier: MIT
"""Bytes and seconds of a report with a million faces in its 3-D view; opened in Chromium where that is."""

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from nbv.report.page.page import Page, Section
from nbv.report.pictures import picture
from nbv.report.viewer.block import Viewer
from nbv.report.viewer.layers import Category, Classes, Layer, Numbers, Sightings

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
from tests.helpers.browser import CHROMIUM, Browser

_MOST_BYTES = 12e6
_CATEGORIES = (
    Category("measured", picture.MEASURED),
    Category("unknown", picture.UNKNOWN, "hatched"),
    Category("out of reach", (0.96, 0.86, 0.66)),
)


def terrain(n_side: int, noise_m: float = 0.002, n_views: int = 30) -> Viewer:
    """Return a view of a wavy, noisy sheet with 2 (n_side - 1)^2 faces at UTM coordinates, seen by views."""
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:n_side, :n_side] * (10.0 / n_side)
    z = 0.3 * np.sin(x) * np.cos(1.3 * y) + rng.normal(0, noise_m, x.shape)
    vertices = np.stack([x, y, z], axis=-1).reshape(-1, 3) + [5e5, 5e6, 100.0]
    k = np.arange(n_side * n_side).reshape(n_side, n_side)
    a, b, c, d = (part.ravel() for part in (k[:-1, :-1], k[:-1, 1:], k[1:, 1:], k[1:, :-1]))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    middle = vertices[faces].mean(axis=1) - vertices.min(axis=0)
    place = (middle[:, 0] // 0.07 * 144 + middle[:, 1] // 0.07).astype(np.int64)
    n = int(place.max()) + 1
    seen = rng.random((n, n_views)) < 0.3
    start = np.concatenate([[0], np.cumsum(seen.sum(axis=1))])
    angle = rng.uniform(0, 90, int(start[-1]))
    best = np.full(n, np.inf)
    np.minimum.at(best, np.repeat(np.arange(n), seen.sum(axis=1)), angle)
    best[~np.isfinite(best)] = np.nan
    state = rng.integers(0, 3, n).astype(np.uint16)
    channels = (
        Classes(
            key="state",
            label="State",
            categories=_CATEGORIES,
            values=state,
            since=rng.integers(0, n_views, n),
            before=1,
            can_hide=True,
        ),
        Numbers(key="quality", label="Best incidence", unit="\u00b0", values=best, low=0, high=90, digits=1),
        Numbers(
            key="views", label="Views that see it", unit="", values=seen.sum(axis=1) * 1.0, low=1, high=20
        ),
    )
    sightings = Sightings(start, np.nonzero(seen)[1] + 1, angle)
    layer = Layer(
        key="surface",
        label="",
        vertices=vertices,
        faces=faces,
        paint=_CATEGORIES[0],
        place=place,
        channels=channels,
        sightings=sightings,
    )
    return Viewer("A sheet.", (layer,), is_room=False, met=tuple(np.linspace(0, 1, n_views + 1)))


def page_of(viewer: Viewer) -> Page:
    """Return a page with a view on it."""
    return Page(
        title="Sheet",
        kicker="Benchmark",
        summary="",
        headlines=(),
        bar=None,
        sections=(Section("View", (viewer,)),),
        options={},
        seed=0,
    )


def main() -> None:
    """Write, open and step through reports of 100,000 and of a million faces."""
    print(f"{'faces':>9} {'file, MB':>9} {'write, s':>9} {'open, s':>8} {'recolour, s':>12} {'pick, s':>8}")
    with tempfile.TemporaryDirectory() as folder:
        browser = Browser(Path(folder) / "profile") if CHROMIUM else None
        for n_side in (225, 708):
            viewer, file = terrain(n_side), Path(folder) / "report.html"
            begin = time.perf_counter()
            page_of(viewer).write(file)
            spent, size = time.perf_counter() - begin, file.stat().st_size
            row = f"{len(viewer.layers[0].faces):9,d} {size / 1e6:9.2f} {spent:9.2f}"
            print(row, *(opened(browser, file) if browser else ("no Chromium",)), flush=True)
            assert size <= _MOST_BYTES
        if browser:
            browser.close()


def opened(browser: Browser, file: Path) -> tuple[str, str, str]:
    """Seconds until the view is there, until it has another colour, and until a point is read out."""
    begin = time.perf_counter()
    tab = browser.open(file)
    tab.wait_for("document.querySelector('figure.view').view", 60)
    tab.pixels("canvas")
    shown = time.perf_counter() - begin
    view = "document.querySelector('figure.view').view"
    timed = (
        "(() => {{ const t = performance.now(); {view}.{what}; return (performance.now() - t) / 1000; }})()"
    )
    recolour = tab.run(timed.format(view=view, what="setMode('quality')"))
    pick = tab.run(timed.format(view=view, what="pick(0, 0)"))
    assert not tab.complaints()
    tab.close()
    return f"{shown:8.2f}", f"{recolour:12.2f}", f"{pick:8.2f}"


if __name__ == "__main__":
    main()
