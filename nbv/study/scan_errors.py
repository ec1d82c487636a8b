# SPDX-License-Identifier: MIT
"""Scan errors: how far the points of a simulated scan lie off the true surface, by class of pixels.

The error of a point is its distance from the plane of the face that the middle of its beam met, metres,
positive on the sensor's side: bias, standard deviation and the 95 % of absolute errors are of those. A mixed
pixel is a return whose beam reaches a jump of depth, farther off than five robust standard deviations of
pixels at like incidence and the beam's radius, or one whose middle met nothing; it is counted, and left out
of the errors.
A pixel is lost when its middle met surface within the sensor's reach and nothing came back.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Self

import numpy as np
from scipy import ndimage

from nbv.scanning.beam import reflectivity_of_colour
from nbv.scanning.effects import Effects
from nbv.scanning.sensor import Sensor
from scenes.checks import BoolArray, FloatArray, InputError, IntArray, Value
from scenes.pose import Pose
from scenes.scan.colour import unit_colour
from scenes.scan.range_image import RangeImage, ScanTruth
from scenes.world.scene import Scene

CLASSES: Mapping[str, tuple[float, ...]] = {
    "all": (-np.inf, np.inf),
    "incidence_deg": (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0),
    "range_m": (0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, np.inf),
    "reflectivity": (0.0, 0.1, 0.2, 0.4, 0.6, 0.8, np.inf),
    "edge_px": (0.0, 1.5, 3.0, 6.0, np.inf),
}
"""By what pixels are told apart, and the limits of the classes; a class begins with its lower limit.

`edge_px` is the distance to the nearest jump of depth, pixels. Beside these the surfaces of the scene.
"""
BESIDE_PX = CLASSES["edge_px"][1]
_JUMP = 1.5  # of the pixels' spacing across the beams
_MANY_SD = 5.0
_MAD_SD = 1.4826  # of normal numbers
_LEAST_M, _DECADES, _FINE = 1e-8, 10, 100  # bins of absolute errors: decades, bins of each
_N_BINS = _DECADES * _FINE + 1


@dataclass(frozen=True, slots=True, eq=False)
class ErrorTally(Value):
    """Sums over the pixels of k classes, that of several scans being the sum of theirs.

    Attributes
    ----------
    counts : (k, 3) int
        Points with an error, mixed pixels, lost pixels.
    sums : (k, 2) float
        Of errors, metres, and of their squares.
    sizes : (k, m) int
        How many absolute errors fall into each of m bins, a hundred to a decade.
    """

    counts: IntArray
    sums: FloatArray
    sizes: IntArray

    @classmethod
    def of(cls, which: IntArray, k: int, error: FloatArray, *, mixed: BoolArray, lost: BoolArray) -> Self:
        """Return the tally of pixels (n,) of the classes `which`, -1 for none; error NaN where none is."""
        is_point = np.isfinite(error)
        groups = [which[kind & (which >= 0)] for kind in (is_point, mixed, lost)]
        counts = np.stack([np.bincount(group, minlength=k) for group in groups], axis=1)
        of, its = which[is_point & (which >= 0)], error[is_point & (which >= 0)]
        sums: FloatArray = np.stack([np.bincount(of, its, k), np.bincount(of, its**2, k)], axis=1)
        sizes = np.bincount(of * _N_BINS + _bins(np.abs(its)), minlength=k * _N_BINS)
        return cls(counts, sums, sizes.reshape(k, _N_BINS))

    def __add__(self, other: ErrorTally) -> ErrorTally:
        """Return the tally of the pixels of both."""
        return ErrorTally(self.counts + other.counts, self.sums + other.sums, self.sizes + other.sizes)

    def rows(self) -> list[dict[str, float | int]]:
        """Return each class: its points, their errors in metres, shares of mixed and lost pixels."""
        rows = list[dict[str, float | int]]()
        for (n, mixed, lost), (total, square), sizes in zip(self.counts, self.sums, self.sizes, strict=True):
            bias = total / n if n else np.nan
            spread = np.sqrt(max(square / n - bias**2, 0.0) * n / (n - 1)) if n > 1 else np.nan
            rows.append(
                {
                    "points": int(n),
                    "bias_m": float(bias),
                    "sd_m": float(spread),
                    "p95_m": _quantile(sizes, 0.95),
                    "mixed_share": float(mixed / (n + mixed)) if n + mixed else np.nan,
                    "lost_share": float(lost / (n + mixed + lost)) if n + mixed + lost else np.nan,
                }
            )
        return rows

    def to_json(self) -> dict[str, Any]:
        """Return the tally as a record; of the bins those that hold any."""
        return {
            "counts": self.counts.tolist(),
            "sums": self.sums.tolist(),
            "sizes": [{str(at): int(sizes[at]) for at in np.flatnonzero(sizes)} for sizes in self.sizes],
        }

    @classmethod
    def from_json(cls, record: Mapping[str, Any]) -> Self:
        """Return the tally of a record."""
        sizes = np.zeros((len(record["sizes"]), _N_BINS), np.int64)
        for row, held in zip(sizes, record["sizes"], strict=True):
            row[[int(at) for at in held]] = list(held.values())
        return cls(np.array(record["counts"], np.int64), np.array(record["sums"], np.float64), sizes)


def _bins(size: FloatArray) -> IntArray:
    """The bin (n,) of each absolute error, metres: the first is of all below 10 nm."""
    with np.errstate(divide="ignore"):
        at = np.floor(_FINE * np.log10(size / _LEAST_M)) + 1
    return np.asarray(np.clip(at, 0, _N_BINS - 1), np.int64)


def _quantile(sizes: IntArray, share: float) -> float:
    """The quantile of absolute errors from their bins (m,), metres; NaN without any."""
    summed = np.cumsum(sizes)
    if summed[-1] == 0:
        return float("nan")
    wanted = share * summed[-1]
    at = int(np.searchsorted(summed, wanted))
    if at == 0:
        return 0.0
    within = (wanted - summed[at - 1]) / sizes[at]
    return float(_LEAST_M * 10 ** ((at - 1 + within) / _FINE))


def tally_errors(
    scan: RangeImage, scene: Scene, sensor: Sensor, effects: Effects, *, true_pose: Pose | None = None
) -> dict[str, ErrorTally]:
    """Return the tallies of a simulated scan by each of `CLASSES`, and by "surface" of the scene.

    Parameters
    ----------
    scan : RangeImage
        With truth.
    scene : Scene
        What was scanned.
    sensor : Sensor
        Whose reach counts.
    effects : Effects
        Of the scan: the width of its beam.
    true_pose : Pose, optional
        Where the sensor stood, if it is said to have stood elsewhere.

    Raises
    ------
    InputError
        The scan has no truth.
    """
    if scan.truth is None:
        raise InputError(
            f"{scan.name or 'the scan'}: only a scan with truth has errors; simulate it with truth"
        )
    truth, valid = scan.truth, scan.valid
    met = truth.face >= 0
    normals, pose = _normals(truth, scene), true_pose or scan.world_from_sensor
    places = scan.projection.ray_grid().points(pose.rotation, pose.translation, truth.ranges)
    towards = np.sign(np.einsum("...i,...i->...", pose.translation - places, normals))
    both = valid & met
    error = np.where(both, towards * np.einsum("...i,...i->...", scan.points() - places, normals), np.nan)
    edge_px = _from_jump(places, normals, scan.projection.pixel_angle * truth.ranges)
    incidence_deg = np.degrees(truth.incidence)
    classes = {
        "all": np.zeros(scan.shape),
        "incidence_deg": incidence_deg,
        "range_m": truth.ranges,
        "reflectivity": _reflectivity(scan),
        "edge_px": edge_px,
    }
    radius = _beam_radius(truth, effects)
    beside = edge_px < BESIDE_PX + radius / (_finest_step(scan) * np.where(met, truth.ranges, 1.0))
    mixed = (valid & ~met) | (both & beside & _is_far(error, incidence_deg, radius))
    error[mixed] = np.nan
    in_reach = (truth.ranges >= sensor.min_range_m) & (truth.ranges <= sensor.max_range_m)
    lost = met & in_reach & ~valid
    which = {name: _class_of(values, CLASSES[name]) for name, values in classes.items()}
    which["surface"] = truth.surface.astype(np.int64)
    sizes = {name: len(CLASSES[name]) - 1 for name in CLASSES} | {"surface": len(scene.surfaces)}
    return {
        name: ErrorTally.of(which[name].ravel(), k, error.ravel(), mixed=mixed.ravel(), lost=lost.ravel())
        for name, k in sizes.items()
    }


def _normals(truth: ScanTruth, scene: Scene) -> FloatArray:
    """Unit normals (rows, columns, 3) of the faces that the middles of the beams met, NaN where none."""
    corners = scene.mesh.corners
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)
    return np.where((truth.face >= 0)[..., None], across[truth.face], np.nan)


def _from_jump(met: FloatArray, normals: FloatArray, spacing: FloatArray) -> FloatArray:
    """Distance (rows, columns) to the nearest pixel beside a jump of depth, pixels; inf where none is.

    Neighbours whose places (rows, columns, 3) are each farther off the other's plane than they are apart on
    one surface lie on either side of a jump; at a fold at least one of both is near.
    """
    missing = np.isnan(met[..., 0])
    beside = np.zeros(missing.shape, np.bool_)
    for axis in (0, 1):
        place, normal, apart, none = (np.moveaxis(a, axis, 0) for a in (met, normals, spacing, missing))
        step = np.diff(place, axis=0)
        off = [np.abs(np.einsum("...i,...i->...", step, one)) for one in (normal[1:], normal[:-1])]
        with np.errstate(invalid="ignore"):
            jump = np.minimum(*off) > _JUMP * np.maximum(apart[1:], apart[:-1])
        jump |= none[1:] != none[:-1]
        at = np.moveaxis(beside, axis, 0)
        at[1:] |= jump
        at[:-1] |= jump
    if not beside.any():
        return np.full(beside.shape, np.inf)
    return np.asarray(ndimage.distance_transform_edt(~beside) + 0.5)


def _beam_radius(truth: ScanTruth, effects: Effects) -> FloatArray:
    """Radius (rows, columns) of the beams where they met surface, metres; 0 where they have none."""
    ranges = np.where(truth.face >= 0, truth.ranges, 0.0)
    return np.zeros(ranges.shape) if effects.footprint is None else effects.footprint.diameter_m(ranges) / 2


def _finest_step(scan: RangeImage) -> float:
    """The lesser angle between middle beams of neighbours along a row or a column, radians."""
    directions = scan.projection.directions()
    steps = [np.linalg.norm(np.diff(directions, axis=axis), axis=-1) for axis in (0, 1)]
    return float(min((np.median(step) for step in steps if step.size), default=1.0))


def _is_far(error: FloatArray, incidence_deg: FloatArray, radius: FloatArray) -> BoolArray:
    """Which points lie farther off than errors at like incidence and the radius of the beam explain."""
    known = np.isfinite(error)
    which = np.where(known, _class_of(incidence_deg, CLASSES["incidence_deg"]), -1)
    spread = np.zeros(error.shape)
    for number in np.unique(which[which >= 0]):
        here = which == number
        middle = np.median(error[here])
        spread[here] = _MAD_SD * np.median(np.abs(error[here] - middle))
    with np.errstate(invalid="ignore"):
        return np.asarray(known & (np.abs(error) > _MANY_SD * spread + radius))


def _class_of(values: FloatArray, limits: Sequence[float]) -> IntArray:
    """The class of each value, -1 for NaN and what lies before the first."""
    at = np.searchsorted(limits, values, side="right") - 1
    at = np.where(values == limits[-1], len(limits) - 2, at)
    return np.asarray(np.where(np.isfinite(values) | (values == np.inf), at, -1), np.int64)


def _reflectivity(scan: RangeImage) -> FloatArray:
    """Share of light (rows, columns) that surfaces scatter, by their colours."""
    if scan.colour is None:
        return np.full(scan.shape, np.nan)
    return np.asarray(reflectivity_of_colour(unit_colour(scan.colour)))


def merged(tallies: Iterable[Mapping[str, ErrorTally]]) -> dict[str, ErrorTally]:
    """Return the sums of tallies of scans of one scene, by class."""
    total = dict[str, ErrorTally]()
    for tally in tallies:
        for name, part in tally.items():
            total[name] = total[name] + part if name in total else part
    return total


def class_labels(name: str, scene_names: Sequence[str]) -> list[str]:
    """Return how the classes of a kind are called in tables: "15 to 30", or a surface's name."""
    if name == "surface":
        return list(scene_names)
    if name == "all":
        return ["all"]
    limits = CLASSES[name]
    return [
        f"{low:g} or more" if np.isinf(high) else f"{low:g} to {high:g}" for low, high in pairwise(limits)
    ]
