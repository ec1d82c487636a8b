# SPDX-License-Identifier: MIT
"""Report of features: what was found, what was refused and why, and which sides were seen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from completion.features.engine.template import Features, FeatureStatus, SideState, TemplateFit
from nbv.report.blocks.page import Block, Cell, Gallery, Headline, Page, PageSection, State, Table, Text
from nbv.report.figures.picture import Picture, picture_of, range_colours
from nbv.run.plain_words import odds_text
from nbv.run.wording import count
from scenes.checks import FloatArray
from scenes.scan.colour import colour_bytes, surface_bytes, surface_colour
from scenes.scan.range_image import RangeImage

_MOST_ROWS, _MOST_REFUSED = 80, 12
_STATES: dict[FeatureStatus, State] = {
    FeatureStatus.FOUND: "measured",
    FeatureStatus.AMBIGUOUS: "unknown",
    FeatureStatus.NONE: "",
}
_WORDS = {FeatureStatus.FOUND: "found", FeatureStatus.AMBIGUOUS: "ambiguous", FeatureStatus.NONE: "refused"}
_BETWEEN = {"width": ("left", "right"), "height": ("bottom", "top")}
_NOTHING = 1e-9  # below which a number is rounding
_UNKNOWN = 100.0  # deviation from which on nothing is known
_PLACING = (
    "u", "v", "x", "y", "heading", "centre", "direction", "corner", "axis", "joint",
)  # fmt: skip
"""First words of what only places it."""


def feature_blocks(fits: Sequence[TemplateFit]) -> tuple[Text | Table, ...]:
    """Return a table of features with a sentence before it."""
    if not fits:
        return (Text("None was proposed."),)
    refused = [fit for fit in fits if fit.status is FeatureStatus.NONE]
    blocks = [fit for fit in fits if fit.status is not FeatureStatus.NONE][:_MOST_ROWS]
    shown = [*blocks, *refused[:_MOST_REFUSED]]
    rows = tuple(_row(fits.index(fit) + 1, fit) for fit in shown)
    columns = (
        "Feature", "Status", "Size, m or \u00b0", "Sides seen", "Not seen", "#times likelier",
        "#false, %", "Why",
    )  # fmt: skip
    left = len(fits) - len(shown)
    more = f" {count(left, 'more is', 'more are')} in features.json." if left else ""
    note = (
        "Size with one standard deviation. A side is seen where tiles along it confirm it: what bounds it "
        "was measured just outside, and nothing just inside. A side that nobody saw is not claimed. Times "
        "likelier: the measured points with the feature, compared to without it. False: how often one as "
        "good shows where there is none, of as many simulated nulls as there were."
    )
    return Table(columns, rows), Text(note + more, is_note=True)


def size_of(fit: TemplateFit) -> str:
    """Return the parameters of a feature with their deviations, for people."""
    sentences = []
    for name, value in zip(fit.names, fit.x, strict=True):
        sd = fit.deviation(name)
        if name.replace("_", " ").split()[0] in _PLACING or not np.isfinite(value):
            continue
        word = name.replace("_", " ")
        unit, scale = ("\u00b0", 180 / np.pi) if word.endswith("angle") else ("", 1.0)
        value, sd = scale * value, scale * sd
        value = 0.0 if abs(value) < _NOTHING else value
        if name in fit.held:
            sentences.append(f"{word} {value:.4g}{unit} (given)")
        elif set(_BETWEEN.get(name, ())) & set(fit.unseen):
            sentences.append(f"{word} at least {value:.3g}{unit}")
        elif np.isfinite(sd) and sd < _UNKNOWN:
            digits = int(np.clip(1 - np.floor(np.log10(sd)), 0, 6)) if sd > 0 else 4
            sentences.append(f"{word} {value:.{digits}f}{unit} \u00b1 {sd:.{digits}f}")
        else:
            sentences.append(f"{word} not seen")
    number = fit.geometry.get("count")
    return ", ".join([*([f"{number} of them"] if number is not None else []), *sentences])


def chance_of(fit: TemplateFit) -> str:
    """Return how probably one as good shows where there is no such feature, in percent; - if not known."""
    chance = fit.false_fit_probability
    return f"{100 * chance:.2g} %" if np.isfinite(chance) else "-"


def _row(number: int, fit: TemplateFit) -> tuple[Cell, ...]:
    seen = [side for side in fit.sides if side.state is SideState.CONFIRMED]
    sides = f"{len(seen)} of {len(fit.sides)}" if len(fit.sides) > 4 else ", ".join(s.name for s in seen)
    unseen = ", ".join(fit.unseen[:6]) + (" ..." if len(fit.unseen) > 6 else "")
    return (
        Cell(f"{number} {fit.kind}", swatch=surface_colour(number)),
        Cell(_WORDS[fit.status] + ("" if fit.is_complete else ", best so far"), state=_STATES[fit.status]),
        Cell(size_of(fit)),
        Cell(sides),
        Cell(unseen),
        Cell(odds_text(fit.evidence)),
        Cell(chance_of(fit).removesuffix(" %")),
        Cell(fit.reason),
    )


SEEN_COLOURS = {
    SideState.CONFIRMED: (40, 160, 70),
    SideState.CONTRADICTED: (200, 40, 40),
    SideState.UNSEEN: (230, 150, 20),
}
"""Of sides that are confirmed, contradicted, unseen; sRGB."""

_ORDER = ("bottom", "right", "top", "left")
_WIDE, _MOST_SHOTS, _SIDE = 900, 6, 820
_MOST_POINTS = 400_000
_CIRCLE = 72


def scan_shots(scans: Sequence[RangeImage], fits: Sequence[TemplateFit]) -> tuple[Picture, ...]:
    """Return a picture of each scan that openings are in, at most six, with their sides."""
    shown = [fit for fit in fits if "corners" in fit.geometry and fit.status is not FeatureStatus.NONE]
    pictures = []
    for scan in scans:
        image, n = _image(scan), 0
        scale = _WIDE / image.shape[1]
        image = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        for fit in shown:
            n += _draw_opening(image, scan, fit, scale)
        if n or len(scans) == 1:
            sentence = "Sides: green confirmed, red contradicted, orange seen by nobody."
            pictures.append(picture_of(image, f"{scan.name}: openings", sentence))
    return tuple(pictures[:_MOST_SHOTS])


def _image(scan: RangeImage) -> NDArray[np.uint8]:
    if scan.colour is not None:
        return np.ascontiguousarray(colour_bytes(scan.colour))
    colours, _, _ = range_colours(scan.ranges)
    return np.ascontiguousarray(np.rint(np.clip(colours[..., :3], 0, 1) * 255).astype(np.uint8))


def _draw_opening(image: NDArray[np.uint8], scan: RangeImage, fit: TemplateFit, scale: float) -> bool:
    """Draw the sides of an opening; whether any of it is in the picture."""
    corners, states = np.asarray(fit.geometry["corners"]), {side.name: side.state for side in fit.sides}
    t, is_any = np.linspace(0.0, 1.0, 60)[:, None], False
    for k, name in enumerate(_ORDER):
        places = corners[k] + t * (corners[(k + 1) % 4] - corners[k])
        pixels = scan.pixels(places)[:, ::-1] * scale
        for a, b in pairwise(pixels):
            if np.isfinite([a, b]).all() and np.linalg.norm(a - b) < image.shape[1] / 4:
                start, end = (tuple(np.rint(p).astype(int).tolist()) for p in (a, b))
                cv2.line(image, start, end, SEEN_COLOURS[states[name]], 3, cv2.LINE_AA)
                is_any = True
    return is_any


def point_shots(points: FloatArray, features: Features) -> tuple[Picture, ...]:
    """Return points (n, 3) as seen along two axes of theirs, coloured by feature, with holes and joints."""
    if not len(points):
        return ()
    feature, _ = features.of_points()
    step = max(1, len(points) // _MOST_POINTS)
    points_shown, colour = points[::step], surface_bytes(feature[::step])
    colour = np.where(feature[::step, None] > 0, colour, np.uint8(170))
    middle = points_shown.mean(axis=0)
    axes = np.linalg.svd(
        (points_shown - middle)[:: max(1, len(points_shown) // 20_000)], full_matrices=False
    )[2]
    shots = []
    for first, second, word in ((0, 1, "from its broadest side"), (0, 2, "from aside")):
        view = axes[[first, second]]
        flat = (points_shown - middle) @ view.T
        low, high = flat.min(axis=0), flat.max(axis=0)
        scale = 0.94 * _SIDE / max(float((high - low).max()), 1e-12)
        shape = np.maximum(np.ceil((high - low) * scale).astype(int) + 40, 60)
        image = np.full((shape[1], shape[0], 3), 255, np.uint8)

        at = _projection(middle, view, low, scale, height=int(shape[1]))
        place = at(points_shown)
        order = np.argsort(feature[::step], kind="stable")
        image[place[order, 1], place[order, 0]] = colour[order]
        for fit in features.fits:
            if fit.status is not FeatureStatus.NONE:
                _draw_lines(image, fit, at)
        sentence = "Coloured: points of features. Holes: green seen, orange seen by nobody, red filled."
        shots.append(picture_of(image, f"The points {word}", sentence))
    return tuple(shots)


def _projection(
    middle: FloatArray, view: FloatArray, low: FloatArray, scale: float, *, height: int
) -> Callable[[FloatArray], NDArray[np.int64]]:
    """What leads from places (n, 3) to columns and rows (n, 2) of a picture."""

    def at(places: FloatArray) -> NDArray[np.int64]:
        local = ((places - middle) @ view.T - low) * scale + 20
        flat = np.rint(np.column_stack([local[:, 0], height - 1 - local[:, 1]]))
        return np.asarray(flat, dtype=np.int64)

    return at


def _draw_lines(
    image: NDArray[np.uint8], fit: TemplateFit, at: Callable[[FloatArray], NDArray[np.int64]]
) -> None:
    """Draw the rims of holes and the line of a joint."""
    if "centres" in fit.geometry and "radius" in fit.geometry:
        centres, radius = np.asarray(fit.geometry["centres"]), float(str(fit.geometry["radius"]))
        across = _plane_of(fit, centres)
        turn = np.linspace(0, 2 * np.pi, _CIRCLE)
        ring = radius * (np.cos(turn)[:, None] * across[0] + np.sin(turn)[:, None] * across[1])
        states = [side.state for side in fit.sides] + [SideState.UNSEEN] * len(centres)
        for centre, state in zip(centres, states, strict=False):
            cv2.polylines(
                image, [at(centre + ring).astype(np.int32)], True, SEEN_COLOURS[state], 2, cv2.LINE_AA
            )
    if "joint" in fit.geometry:
        ends = at(np.asarray(fit.geometry["joint"])).astype(np.int32)
        cv2.polylines(image, [ends], False, SEEN_COLOURS[SideState.CONFIRMED], 3, cv2.LINE_AA)


def _plane_of(fit: TemplateFit, centres: FloatArray) -> FloatArray:
    """Two directions (2, 3) in the plane of the holes."""
    if "axis" in fit.geometry:
        normal = np.asarray(fit.geometry["axis"], dtype=np.float64)
        return np.asarray(np.linalg.svd(normal[None])[2][1:])
    return np.asarray(np.linalg.svd(centres - centres.mean(axis=0))[2][:2])


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
    numbers = {status: sum(fit.status is status for fit in features.fits) for status in FeatureStatus}
    unseen = sum(len(fit.unseen) for fit in features.found)
    shots: list[Block] = []
    if scans and (pictures := scan_shots(scans, features.fits)):
        shots.append(Gallery(pictures, 2))
    if any("corners" not in fit.geometry for fit in features.fits) or not scans:
        shots.append(Gallery(point_shots(points, features), 2))
    text = count(numbers[FeatureStatus.FOUND], "feature was", "features were")
    state = (
        "" if features.is_complete else " The search was ended before it was done: these are the best so far."
    )
    return Page(
        title=title,
        kicker="Report of features",
        summary=f"{text} found; looked for: {', '.join(kinds)}.{state}",
        headlines=(
            Headline(str(numbers[FeatureStatus.FOUND]), "", "found", "measured"),
            Headline(str(numbers[FeatureStatus.AMBIGUOUS]), "", "ambiguous", "unknown"),
            Headline(str(numbers[FeatureStatus.NONE]), "", "proposed and refused"),
            Headline(str(unseen), "", "sides of those found that nobody saw", "unknown"),
        ),
        bar=None,
        sections=(
            PageSection("Where they are", tuple(shots) or (Text("There is nothing to show."),)),
            PageSection("Features", feature_blocks(features.fits)),
        ),
        warnings=(*warnings, *features.doubts),
    )
