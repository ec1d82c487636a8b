# SPDX-License-Identifier: MIT
"""Page of a scan: what the scanner saw, and of a simulated one how far it erred."""

from __future__ import annotations

import numpy as np

from nbv.report.figures.plots import range_colours
from nbv.report.page.page import Gallery, Headline, Page, Section, Text
from nbv.report.pictures.picture import Picture, picture_of
from scenes.scan.range_image import RangeImage
from scenes.scan.thumbnail import upright


def scan_page(scan: RangeImage, seed: int = 0) -> Page:
    """Return the page of a scan: ranges, colours, and where there is truth, incidence and range error."""
    known = scan.ranges[scan.valid]
    rows, columns = scan.shape
    pictures = tuple(_pictures(scan))
    return Page(
        title=scan.name,
        kicker="Scan",
        summary=(
            f"{known.size} of {scan.ranges.size} pixels brought a range back, {_span(scan)}. "
            "What no beam reached is not in it."
        ),
        headlines=(
            Headline(f"{rows} x {columns}", "", "pixels, rows x columns"),
            Headline(f"{100 * known.size / scan.ranges.size:.1f}", "%", "of them with a return", "measured"),
            Headline(*_noise(scan), "standard deviation of the range noise"),
        ),
        bar=None,
        sections=(
            Section("What the scanner saw", (Gallery(pictures, min(len(pictures), 2)),)),
            *((Section("How far it erred", (Text(_error(scan)),)),) if scan.truth is not None else ()),
        ),
        options={
            "projection": scan.projection.kind,
            "stands_at_m": [round(float(part), 4) for part in scan.origin],
            "sensor": scan.sensor or "not known",
            "effects": scan.noise or "not known",
        },
        seed=seed,
    )


def _pictures(scan: RangeImage) -> list[Picture]:
    """The scan's channels as a person would see them."""
    colours, low, high = range_colours(upright(scan.ranges, scan.projection))
    note = f"{low:.2f} m (yellow) to {high:.2f} m (violet); empty where nothing came back."
    pictures = [picture_of(colours, "Range", note)]
    if scan.colour is not None:
        pictures.append(picture_of(upright(scan.colour, scan.projection), "Colour"))
    if scan.truth is not None:
        angle = np.where(scan.valid, np.degrees(scan.truth.incidence), np.inf)
        colours, low, high = range_colours(upright(angle, scan.projection))
        note = f"{low:.0f}\u00b0 (yellow) to {high:.0f}\u00b0 (violet) between ray and normal."
        pictures.append(picture_of(colours, "True incidence", note))
    return pictures


def _span(scan: RangeImage) -> str:
    known = scan.ranges[scan.valid]
    return f"{known.min():.3f} to {known.max():.3f} m" if known.size else "so there is nothing to show"


def _noise(scan: RangeImage) -> tuple[str, str]:
    """Value and unit of the headline."""
    return ("not known", "") if scan.sigma_m is None else (f"{1000 * scan.sigma_m:.3g}", "mm")


def _error(scan: RangeImage) -> str:
    """Measured against true ranges, in a sentence."""
    error = scan.range_error()
    error = error[np.isfinite(error)]
    if not error.size:
        return "No pixel has both a measured and a true range."
    rms, worst = np.sqrt(np.mean(error**2)), np.abs(error).max()
    return (
        f"Measured minus true range over {error.size} pixels: mean {1000 * error.mean():.3f} mm, "
        f"root mean square {1000 * rms:.3f} mm, largest {1000 * worst:.3f} mm."
    )
