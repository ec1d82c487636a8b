# SPDX-License-Identifier: MIT
"""Report of features: what was found, what was refused and why, and which sides were seen."""

from __future__ import annotations

from collections.abc import Sequence

from completion.templates.engine.features import Features
from completion.templates.engine.template import Status
from nbv.report.blocks.feature_blocks import feature_blocks
from nbv.report.page.page import Block, Gallery, Headline, Page, Section, Text
from nbv.report.pictures.feature_shots import point_shots, scan_shots
from nbv.run.wording import count
from scenes.checks import FloatArray
from scenes.scan.range_image import RangeImage


def feature_page(
    features: Features,
    title: str,
    kinds: Sequence[str],
    *,
    points: FloatArray,
    scans: Sequence[RangeImage] = (),
    warnings: Sequence[str] = (),
) -> Page:
    """Return the report of the features of `points` (n, 3), or of scans."""
    numbers = {status: sum(fit.status is status for fit in features.fits) for status in Status}
    unseen = sum(len(fit.unseen) for fit in features.found)
    shots: list[Block] = []
    if scans and (pictures := scan_shots(scans, features.fits)):
        shots.append(Gallery(pictures, 2))
    if any("corners" not in fit.geometry for fit in features.fits) or not scans:
        shots.append(Gallery(point_shots(points, features), 2))
    found = count(numbers[Status.FOUND], "feature was", "features were")
    state = (
        "" if features.is_complete else " The search was ended before it was done: these are the best so far."
    )
    return Page(
        title=title,
        kicker="Report of features",
        summary=f"{found} found of {', '.join(kinds)}.{state}",
        headlines=(
            Headline(str(numbers[Status.FOUND]), "", "found", "measured"),
            Headline(str(numbers[Status.AMBIGUOUS]), "", "ambiguous", "unknown"),
            Headline(str(numbers[Status.NONE]), "", "proposed and refused"),
            Headline(str(unseen), "", "sides of those found that nobody saw", "unknown"),
        ),
        bar=None,
        sections=(
            Section("Where they are", tuple(shots) or (Text("There is nothing to show."),)),
            Section("Features", feature_blocks(features.fits)),
        ),
        warnings=(*warnings, *features.doubts),
    )
