# SPDX-License-Identifier: MIT
"""Inferred area of real and simulated frames, and what came true; what is continued of things."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from benchmarks.cases.frames import (
    FURNISHED,
    HELD_OUT_HOUSES,
    HOUSES,
    JUDGED,
    REAL,
    WALKS,
    Known,
    Source,
    groups,
)
from benchmarks.cases.rooms import hypothesis_of
from benchmarks.metrics.continued import Continued, continued_area_of
from benchmarks.metrics.inferred import Samples, sample
from benchmarks.metrics.other_scans import TOLERANCE_M, is_there, score_by_others
from benchmarks.run import head, suite
from benchmarks.store import each
from completion import CompletionOptions, complete
from completion.result.completed_model import CompletedModel
from scenes.checks import BoolArray
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Plane

BINS = (0.0, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 1.0)
_N_RESAMPLES = 1000
_MOST_UNKNOWN = 0.7  # share of the area beyond which nothing is claimed
CELL_M = 0.02
_LEAST_PLANE_M2 = 0.02  # measured of a plane that counts as known


@dataclass(frozen=True, slots=True)
class Entry:
    """Inferred area of one surface, for one reason, of one tenth of the scale of confidence.

    `kind`, `reason`: of the surface; why the area was inferred. `right_m2`, `wrong_m2`, `unknown_m2`: of the
    area that was hidden from the frames, and not beside what they measured.
    """

    source: str  # of the frames
    frames: tuple[int, ...]  # those that were completed together, from 0
    surface: int  # its number, from 1
    kind: str
    role: str  # to the room; "" of most
    reason: str
    n_parts: int  # regions that it was joined from
    measured_m2: float  # its measured area
    confidence: float  # mean of the area
    right_m2: float
    wrong_m2: float
    unknown_m2: float


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of frames that were completed together."""

    entries: tuple[Entry, ...]  # what was inferred
    completed: CompletedModel  # the completion
    samples: Samples  # inferred area
    state: NDArray[np.int8]  # (n,) int8: For each sample: 1 right, -1 wrong, 0 unknown, 2 not counted
    # reference points that the frames did not see, and those of them that were inferred; the same of those on
    # planes of which the frames measured something
    found: tuple[int, ...]


def outcome(
    source: Source, frames: Sequence[int], options: CompletionOptions, *, by_truth: bool = True
) -> Outcome:
    """Complete some frames of a source, and hold what was inferred against the other ones, or the truth.

    The truth is asked where it is known, and `by_truth`.
    """
    scans = [source.frames[k] for k in frames]
    others = [scan for k, scan in enumerate(source.frames) if k not in frames]
    completed = complete(scans, options, rng=0)
    hypothesis = hypothesis_of(completed, scans)
    samples = sample(hypothesis, CELL_M)
    tolerance = max(TOLERANCE_M, 2 * source.registration_m)
    scored = score_by_others(scans, others, samples, tolerance_m=tolerance)
    state = scored.state
    if by_truth and isinstance(source, Known):
        state = np.where(
            state == 2, 2, np.where(is_there(samples.points, samples.normals, source.caster), 1, -1)
        ).astype(np.int8)
    entries = []
    tenth = np.clip((10 * samples.confidence).astype(np.int64), 0, 9)
    counted = state != 2
    keys = np.stack([samples.surface, samples.reason, tenth], axis=1)[counted]
    for key in np.unique(keys, axis=0):
        here = counted & (samples.surface == key[0]) & (samples.reason == key[1]) & (tenth == key[2])
        patch, areas = completed.patches[key[0]], samples.areas[here]
        entries.append(
            Entry(
                source=source.name,
                frames=tuple(frames),
                surface=int(key[0]) + 1,
                kind=type(patch.grid.surface).__name__.lower(),
                role=patch.limits.role,
                reason=hypothesis.reasons[key[1]],
                n_parts=patch.source.n_parts,
                measured_m2=patch.observed_m2,
                confidence=float(areas @ samples.confidence[here] / areas.sum()),
                right_m2=float(areas[state[here] == 1].sum()),
                wrong_m2=float(areas[state[here] == -1].sum()),
                unknown_m2=float(areas[state[here] == 0].sum()),
            )
        )
    planes = [
        patch.grid.surface.transform(completed.world_from_reference)
        for patch in completed.patches
        if isinstance(patch.grid.surface, Plane) and patch.observed_m2 >= _LEAST_PLANE_M2
    ]
    reachable = scored.reachable(planes, tolerance)
    found = tuple(
        int(np.count_nonzero(part & counts))
        for counts in (np.ones_like(reachable), reachable)
        for part in (counts, scored.is_found)
    )
    return Outcome(tuple(entries), completed, samples, state, found)


@dataclass(frozen=True, slots=True)
class Row:
    """Pooled entries.

    `right_m2`, `wrong_m2`, `unknown_m2`: square metres. `low`, `high`: 95 % interval of the precision,
    surfaces drawn anew with replacement (Efron & Tibshirani 1993).
    """

    name: str  # what they have in common
    n_surfaces: int  # surfaces with area that is known to be right or wrong
    right_m2: float
    wrong_m2: float
    unknown_m2: float
    stated: float  # mean confidence of what is known
    low: float
    high: float

    @property
    def precision(self) -> float:
        """Right over right and wrong area; NaN where neither is known."""
        known = self.right_m2 + self.wrong_m2
        return self.right_m2 / known if known > 0 else float("nan")

    @property
    def decides(self) -> bool:
        """Whether enough is known of the area for any claim."""
        area = self.right_m2 + self.wrong_m2 + self.unknown_m2
        return area > 0 and self.unknown_m2 <= _MOST_UNKNOWN * area


def pooled(name: str, entries: Sequence[Entry]) -> Row:
    """Pool some entries."""
    surfaces: dict[tuple[str, tuple[int, ...], int], list[float]] = {}
    stated = known = 0.0
    for one in entries:
        if one.right_m2 + one.wrong_m2 > 0:
            pair = surfaces.setdefault((one.source, one.frames, one.surface), [0.0, 0.0])
            pair[0] += one.right_m2
            pair[1] += one.wrong_m2
            stated += one.confidence * (one.right_m2 + one.wrong_m2)
            known += one.right_m2 + one.wrong_m2
    low = high = float("nan")
    if surfaces:
        areas = np.array(list(surfaces.values()))
        picks = np.random.default_rng(0).integers(0, len(areas), (_N_RESAMPLES, len(areas)))
        drawn = areas[picks].sum(axis=1)
        low, high = (float(value) for value in np.quantile(drawn[:, 0] / drawn.sum(axis=1), [0.025, 0.975]))
    return Row(
        name=name,
        n_surfaces=len(surfaces),
        right_m2=sum(one.right_m2 for one in entries),
        wrong_m2=sum(one.wrong_m2 for one in entries),
        unknown_m2=sum(one.unknown_m2 for one in entries),
        stated=stated / known if known else float("nan"),
        low=low,
        high=high,
    )


def rows_by(entries: Sequence[Entry], key: Callable[[Entry], str]) -> list[Row]:
    """Pool entries with the same key, in its order."""
    named = [(key(one), one) for one in entries]
    return [
        pooled(name, [one for own, one in named if own == name]) for name in sorted({n for n, _ in named})
    ]


def bin_of(entry: Entry) -> str:
    """Name the bin that an entry's confidence falls into."""
    at = int(np.clip(np.searchsorted(BINS, entry.confidence, side="right") - 1, 0, len(BINS) - 2))
    return f"{BINS[at]:.2f}-{BINS[at + 1]:.2f}"


def table(rows: Iterable[Row]) -> str:
    """Write rows as a Markdown table."""
    lines = [
        "| | surfaces | right m2 | wrong m2 | unknown m2 | precision | 95 % | stated | |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for one in rows:
        inside = one.low <= one.stated <= one.high and abs(one.stated - one.precision) <= 0.05
        verdict = "decides nothing" if not one.decides else "" if inside else "off"
        lines.append(
            f"| {one.name} | {one.n_surfaces} | {one.right_m2:.2f} | {one.wrong_m2:.2f} "
            f"| {one.unknown_m2:.2f} | {one.precision:.3f} | {one.low:.2f}-{one.high:.2f} "
            f"| {one.stated:.3f} | {verdict} |"
        )
    return "\n".join(lines)


@suite("ledger", smallest="--of open3d_redwood --every 5")
def ledger(
    of: list[str] | None = None,
    together: int = 1,
    every: int = 1,
    sigma_m: float | None = None,
    by_truth: bool = True,
) -> Iterator[str]:
    """Inferred area of real and simulated frames, and what other frames or the truth say of it.

    --of: real, judged, walks, furnished, houses, held-out-houses, or a source's name; --together: frames
    completed together; --every: of the groups; --no-by-truth: compare walks and houses with other frames.
    """
    entries: list[Entry] = []
    counts = np.zeros(4, np.int64)
    for source in chosen(of or ["real", "walks"]):
        sets = [list(frames) for frames in groups(len(source.frames), together)][::every]
        for frames, result in zip(sets, each(_judged, source.name, sets, sigma_m, by_truth), strict=True):
            entries += result.entries
            counts += result.found
            name = f"{source.name.replace(', ', '-').replace(' ', '-')}-{'-'.join(str(k) for k in frames)}"
            yield table([pooled(name, result.entries)]).splitlines()[-1]
    for key in (
        lambda entry: entry.source,
        lambda entry: entry.reason,
        lambda entry: entry.role or "nothing of the room",
        bin_of,
        lambda entry: f"{entry.reason} {bin_of(entry)}",
        lambda entry: f"{entry.role or 'nothing of the room'} {bin_of(entry)}",
    ):
        yield "\n" + table(rows_by(entries, key))
    yield "\n" + table([pooled("all", entries)])
    yield f"recall {counts[1] / max(counts[0], 1):.3f} of {counts[0]} reference points"
    yield f"recall {counts[3] / max(counts[2], 1):.3f} of {counts[2]} on planes that were measured"


class _Judged(NamedTuple):
    """Entries of frames completed together; reference points as in `Outcome`."""

    entries: tuple[Entry, ...]
    found: tuple[int, ...]


def _judged(name: str, frames: list[int], sigma_m: float | None, by_truth: bool) -> _Judged:
    """Complete frames of the source of a name together, and judge what was inferred."""
    (source,) = chosen([name])
    options = CompletionOptions(texture=False, registration_m=source.registration_m, sigma_m=sigma_m)
    result = outcome(source, frames, options, by_truth=by_truth)
    return _Judged(result.entries, result.found)


def chosen(kinds: Sequence[str]) -> list[Source]:
    """Return the sources of some kinds, or with some names, in their order."""
    kept: dict[str, Sequence[Source]] = {
        "real": REAL,
        "judged": JUDGED,
        "walks": WALKS,
        "furnished": FURNISHED,
        "houses": HOUSES,
        "held-out-houses": HELD_OUT_HOUSES,
    }
    named = (one for kind, held in kept.items() for one in held if {kind, one.name} & set(kinds))
    return list(dict.fromkeys(named))


OUTLINES = Path(__file__).parents[1] / "cases" / "chairs.json"
CHAIRS = ("chair", "armchair")
HOLE = "hole"
MOST_BEYOND_M2 = 0.05  # of a frame

Outline = Sequence[Sequence[float]]  # (column, row)


def masked_frames(path: Path = OUTLINES) -> Iterator[tuple[str, int, dict[str, list[Outline]]]]:
    """Yield source, frame (from 0), and by thing the outlines drawn on it."""
    for source, frames in json.loads(path.read_text("utf-8")).items():
        for frame, parts in frames.items():
            things: dict[str, list[Outline]] = {}
            for part in parts:
                things.setdefault(part["thing"], []).append(part["outline"])
            yield source, int(frame), things


def mask_of(outlines: Sequence[Outline], shape: tuple[int, int]) -> BoolArray:
    """Return which pixels of an image of a shape (rows, columns) lie in outlines."""
    image = Image.new("1", shape[::-1])
    for outline in outlines:
        ImageDraw.Draw(image).polygon([(float(x), float(y)) for x, y in outline], fill=1)
    return np.asarray(image, dtype=np.bool_)


def surfaces_in(completed: CompletedModel, mask: BoolArray) -> BoolArray:
    """Return which surfaces (n_patches,) of one scan have more than half of their pixels in a mask."""
    owner = completed.owners[0]
    n = len(completed.patches) + 1
    inside, all_ = np.bincount(owner[mask], minlength=n), np.bincount(owner.ravel(), minlength=n)
    return np.asarray(2 * inside[1:] > all_[1:], dtype=np.bool_)


def continued_in(
    scan: RangeImage, things: dict[str, list[Outline]], options: CompletionOptions
) -> dict[str, Continued]:
    """Complete a frame alone; return what was continued of each thing outlined on it."""
    completed = complete([scan], options, rng=0)
    hypothesis = hypothesis_of(completed, [scan])
    holes = mask_of(things.get(HOLE, ()), scan.shape)
    masks = {
        thing: mask_of(outlines, scan.shape) & ~holes for thing, outlines in things.items() if thing != HOLE
    }
    return {
        thing: continued_area_of(completed, hypothesis, surfaces_in(completed, mask))
        for thing, mask in masks.items()
    }


@suite("chairs", smallest="--frames 1")
def chairs(frames: int | None = None) -> Iterator[str]:
    """What is continued of chairs and sofas in real frames, on which they were outlined by hand."""
    sources = {one.name: one for one in REAL}
    worst: list[float] = []
    yield from head(
        "frame", "thing", "surfaces", "in enclosed holes m2", "on backs m2", "beyond m2", "of which"
    )
    for name, frame, things in list(masked_frames())[:frames]:
        source = sources[name]
        scan = source.frames[frame]
        found = continued_in(
            scan, things, CompletionOptions(texture=False, registration_m=source.registration_m)
        )
        for thing, one in found.items():
            why = ", ".join(f"{reason} {area:.3f}" for reason, area in one.beyond_by_reason.items()) or "-"
            yield (
                f"| {name} {frame} | {thing} | {one.n_surfaces} | {one.enclosed_m2:.3f} "
                f"| {one.turned_m2:.3f} | {one.beyond_m2:.3f} | {why} |"
            )
        worst.append(sum(one.beyond_m2 for thing, one in found.items() if thing in CHAIRS))
    kept = sum(beyond <= MOST_BEYOND_M2 for beyond in worst)
    yield (
        f"\n{kept} of {len(worst)} frames have at most {MOST_BEYOND_M2} m2 beyond on chairs; "
        f"{sum(worst):.3f} m2 in all, {max(worst):.3f} m2 at most"
    )
