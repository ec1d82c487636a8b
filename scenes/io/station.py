# SPDX-License-Identifier: MIT
"""Station: points that lost their pixel grid, as the range image of a scanner that stood in a known place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # its parts load when they are first used
from numpy.typing import NDArray

from scenes import limits
from scenes.checks import BoolArray, ColourArray, FloatArray, InputError, check_point, check_points
from scenes.io.guard import check_size
from scenes.pose import Pose
from scenes.scan.colour import colour_type
from scenes.scan.projection import SphericalProjection
from scenes.scan.range_image import POINTS_SENSOR, RangeImage, saturation_start, saturation_warning

_N_SAMPLE = 20_000  # points whose neighbours are looked at
_BINS = 1 << 19  # of angles, whose spectrum shows the steps


@dataclass(frozen=True, slots=True, eq=False)
class AngleGrid:
    """Pixels that points fall into.

    Attributes
    ----------
    pole : (3,) float
        The axis that the scanner turned about: the image's up.
    projection : SphericalProjection
        In a sensor frame whose y is against the pole and whose z is `forward`.
    forward : (3,) float
        At right angles to the pole.
    row, column : (n,) int64
        The pixel of each point.
    """

    pole: FloatArray
    projection: SphericalProjection
    forward: FloatArray
    row: NDArray[np.int64]
    column: NDArray[np.int64]

    @property
    def flat(self) -> NDArray[np.int64]:
        """Flat pixel (n,) of each point."""
        return self.row * self.projection.shape[1] + self.column

    @property
    def kept(self) -> float:
        """Share of the points that have a pixel of their own."""
        return len(np.unique(self.flat)) / len(self.row)


def find_grid(rays: FloatArray, poles: Sequence[FloatArray]) -> AngleGrid | None:
    """Return the grid of azimuths and elevations that unit `rays` (n, 3) lie on, None where there is none.

    About each pole the angles' spectrum tells whether they come in steps: where they do, a wave of that
    length has all angles at the same phase. The grid that gives most points a pixel of their own counts, if
    they are at least 95 %, and their image has no more than a fifth of holes.
    """
    grids = [grid for grid in (_grid_about(rays, pole) for pole in poles) if grid is not None]
    best = max(grids, key=lambda grid: grid.kept, default=None)
    return best if best is not None and best.kept >= limits.NEARLY_ALL else None


def swept_poles(rays: FloatArray) -> list[FloatArray]:
    """Return axes (3,) that the points may have been swept about, by unit rays (n, 3) in the file's order.

    Two points that follow each other in a column span a plane with the axis; the way from one to the next in
    a row is at right angles to it. None where too few points follow each other closely.
    """
    poles = []
    for across in (np.cross(rays[:-1], rays[1:]), np.diff(rays, axis=0)):
        length = np.linalg.norm(across, axis=1)
        near = (length > 1e-9) & (length < limits.APART)
        if near.sum() >= limits.FEWEST_POINTS:
            unit = across[near] / length[near, None]
            pole = np.linalg.eigh(unit.T @ unit)[1][:, 0]
            poles.append(np.asarray(pole * np.copysign(1.0, pole[int(np.argmax(np.abs(pole)))])))
    return poles


def is_filled(filled: BoolArray, share: float) -> bool:
    """Tell whether so many of the pixels (rows, columns) between filled ones are filled."""
    between = scipy.ndimage.binary_closing(np.pad(filled, 2), np.ones((3, 3)))[2:-2, 2:-2]
    return bool(filled.sum() >= share * between.sum())


def neighbour_steps(angles: FloatArray) -> FloatArray:
    """Median angle (2,) to the next point sideways and upwards, of azimuths, elevations (n, 2), radians."""
    flat = angles.copy()
    flat[:, 0] *= np.cos(angles[:, 1])
    sample = np.linspace(0, len(flat) - 1, min(_N_SAMPLE, len(flat))).astype(np.int64)
    _, near = scipy.spatial.cKDTree(flat).query(flat[sample], k=9)
    way = np.abs(flat[near[:, 1:]] - flat[sample, None])
    is_level = way[..., 0] >= way[..., 1]
    steps = []
    for axis, chosen in ((0, is_level), (1, ~is_level)):
        nearest = np.where(chosen & (way[..., axis] > 1e-9), way[..., axis], np.inf).min(axis=1)
        known = nearest[np.isfinite(nearest)]
        steps.append(float(np.median(known)) if len(known) else np.inf)
    smaller = min(steps) if np.isfinite(min(steps)) else 1e-3
    return np.array([value if np.isfinite(value) else smaller for value in steps])


def _grid_about(rays: FloatArray, pole: FloatArray) -> AngleGrid | None:
    forward = rays.mean(axis=0) - (rays.mean(axis=0) @ pole) * pole
    if np.linalg.norm(forward) < 1e-6:
        forward = np.eye(3)[int(np.argmin(np.abs(pole)))]
        forward = forward - (forward @ pole) * pole
    forward = forward / np.linalg.norm(forward)
    azimuth = np.arctan2(rays @ np.cross(forward, pole), rays @ forward)
    elevation = np.arcsin(np.clip(rays @ pole, -1.0, 1.0))
    level = np.abs(elevation) < limits.LEVEL_ANGLE
    if level.sum() < limits.FEWEST_POINTS:
        return None
    wide, high = neighbour_steps(np.column_stack([azimuth, elevation])[level])
    across, up = _comb(azimuth[level], wide), _comb(elevation, high)
    if across is None or up is None:
        return None
    turn = round(2 * np.pi / across[0])
    if abs(turn * across[0] - 2 * np.pi) < across[0] / 4:
        across = 2 * np.pi / turn, across[1]
    beside = np.cos(elevation) > 2 * up[0]  # at the pole itself every azimuth is as good
    column, azimuths = _number_steps(azimuth, *across, beside)
    row, elevations = _number_steps(elevation, *up, beside | True)
    if len(azimuths) > turn:  # the seam of a full turn
        column, azimuths = column % turn, azimuths[:turn]
    if min(len(azimuths), len(elevations)) < 2 or np.ptp(azimuths) >= 2 * np.pi + 1e-9:
        return None
    filled = np.zeros((len(elevations), len(azimuths)), np.bool_)
    filled[row, column] = True
    if not is_filled(filled, limits.FILLED):
        return None
    projection = SphericalProjection(azimuths, elevations[::-1])
    return AngleGrid(pole, projection, forward, len(elevations) - 1 - row, column)


def _number_steps(
    angles: FloatArray, step: float, phase: float, telling: BoolArray
) -> tuple[NDArray[np.int64], FloatArray]:
    """Number (n,) of each angle's step, from the least to the largest of those that tell; their angles."""
    number = np.rint((angles - phase) / step).astype(np.int64)
    first, last = int(number[telling].min()), int(number[telling].max())
    steps = np.arange(first, last + 1, dtype=np.float64)
    return np.clip(number, first, last) - first, np.asarray(phase + step * steps)


def _comb(angles: FloatArray, near: float) -> tuple[float, float] | None:
    """Step and phase of angles (n,) that come in steps of about `near`, radians; None where they do not."""
    span = float(np.ptp(angles))
    length = 4 * span  # four times as many waves as differ from each other
    if not _BINS * near > 16 * length or span < 4 * near:
        return None
    count, _ = np.histogram(angles - angles.min(), bins=_BINS, range=(0.0, length))
    strength = np.abs(np.fft.rfft(count)) / len(angles)
    low, high = int(length / (limits.WIDEST_STEP * near)), int(length / (limits.NARROWEST_STEP * near))
    waves = np.arange(max(low, 8), min(high, len(strength) - 1))
    if not len(waves) or strength[waves].max() < limits.SHARP:
        return None
    first = int(waves[np.argmax(strength[waves] >= limits.FUNDAMENTAL * strength[waves].max())])
    peak = first + int(np.argmax(strength[first : first + 5]))  # up the slope of the first strong one
    sample = angles[:: max(1, len(angles) // (2 * _N_SAMPLE))]

    def at(wave: float) -> complex:
        return complex(np.exp(2j * np.pi * wave / length * sample).mean())

    wave = float(
        scipy.optimize.minimize_scalar(
            lambda shift: -abs(at(shift)), bounds=(peak - 1.0, peak + 1.0), method="bounded"
        ).x
    )
    return length / wave, float(np.angle(at(wave))) * length / (2 * np.pi * wave)


_WIDER = 1.2  # from one try to the next


def scan_from_station(
    points: object,
    origin: object,
    name: str = "cloud",
    colour: NDArray[np.float32] | ColourArray | None = None,
) -> RangeImage:
    """Return the points as one scan from `origin`, whose `sensor` says that it was made of points.

    The image is spherical. Where the points lie on a grid of angles about x, y, z or the axis that rows
    or columns of points run about, each has its pixel. Else the pixels are as small as leaves hardly any of
    them empty between others; single empty ones take the nearest point. Each pixel keeps the point nearest to
    its middle exactly as it was measured; others had no return. `sensor` tells how many points were kept,
    `warnings` why not nearly all. Ranges that only say that the scanner's number was full are left out, with
    a warning.

    Parameters
    ----------
    points : (n, 3) float
        World coordinates, metres, z up.
    origin : (3,) float
        Where the scanner stood, metres.
    name : str
        What to call the scan.
    colour : (n, 3) uint8 or float32, optional
        sRGB of each point, 0..255 or in 0..1.

    Raises
    ------
    InputError
        Fewer than 100 points; points that lie behind each other as seen from there, so that no one scan from
        there took them.
    """
    stood, cloud = check_point("origin", origin), check_points("points", points)
    _check_number(len(cloud))
    away = np.linalg.norm(cloud - stood, axis=1)
    start = saturation_start(away[away > 0])
    real = (away > 0) & (away < start)
    _check_number(int(real.sum()))
    swept = swept_poles((cloud[real] - stood) / away[real, None])
    order = np.lexsort(cloud.T)  # so that the file's order does not matter
    order = order[real[order]]
    cloud, ranges = cloud[order], away[order]
    rays = (cloud - stood) / ranges[:, None]
    grid = find_grid(rays, [*np.eye(3)[[2, 0, 1]], *swept])
    bins = _bin_pixels(rays) if grid is None else grid
    _check_single(bins.flat, ranges, stood)
    down = -bins.pole
    pose = Pose.from_parts(np.column_stack([np.cross(down, bins.forward), down, bins.forward]), stood)
    seen = pose.inverse().apply(cloud)
    kept = _nearest(bins, rays)
    sentences = [] if start == np.inf else [saturation_warning(len(away) - int(real.sum()), start, len(away))]
    chosen = np.full(bins.projection.shape, -1)
    chosen[bins.row[kept], bins.column[kept]] = kept
    if grid is None:
        filled = _fill_single(chosen, bins, rays)
        if len(kept) < limits.NEARLY_ALL * len(cloud):
            sentences.append(
                f"{len(kept)} of {len(cloud)} points were kept ({len(kept) / len(cloud):.0%}), one a pixel, "
                f"and {filled} single empty pixels took the nearest: the points lie on no grid of angles "
                "about x, y or z; to keep all take the scan as the scanner wrote it (structured .e57, .ptx)"
            )
    image = np.where((chosen < 0)[..., None], np.nan, seen[chosen])
    painted = None
    if colour is not None:
        members = np.asarray(colour)[order]
        painted = np.where((chosen < 0)[..., None], 0, members[chosen]).astype(colour_type(colour))
    scan = RangeImage.from_points(image, bins.projection, pose, painted, name)
    x, y, z = stood
    sensor = f"{POINTS_SENSOR} from ({x:.10g}, {y:.10g}, {z:.10g}), {len(kept)} of {len(cloud)} kept"
    return scan.with_facts(sensor=sensor).add_warnings(sentences)


def _check_number(n_points: int) -> None:
    if n_points < limits.FEWEST_POINTS:
        raise InputError(
            f"{n_points} points are too few for a scan; at least {limits.FEWEST_POINTS} are needed"
        )


def _angles(bins: AngleGrid, rays: FloatArray) -> FloatArray:
    """Azimuth and elevation (n, 2) of unit rays (n, 3)."""
    right = np.cross(bins.forward, bins.pole)
    return np.column_stack([
        np.arctan2(rays @ right, rays @ bins.forward), np.arcsin(np.clip(rays @ bins.pole, -1.0, 1.0))
    ])  # fmt: skip


def _middles(bins: AngleGrid) -> tuple[FloatArray, FloatArray]:
    return bins.projection.azimuths, bins.projection.elevations


def _nearest(bins: AngleGrid, rays: FloatArray) -> NDArray[np.int64]:
    """The point of each pixel that is nearest to its middle, as numbers."""
    azimuths, elevations = _middles(bins)
    off = _angles(bins, rays) - np.column_stack([azimuths[bins.column], elevations[bins.row]])
    off[:, 0] = (off[:, 0] + np.pi) % (2 * np.pi) - np.pi
    order = np.lexsort((np.hypot(*off.T), bins.flat))
    _, first = np.unique(bins.flat[order], return_index=True)
    return np.asarray(order[first])


def _fill_single(chosen: NDArray[np.int64], bins: AngleGrid, rays: FloatArray) -> int:
    """Write the nearest point into empty pixels (-1) whose neighbours on all sides are filled; count them."""
    inside = np.pad(chosen >= 0, 1)
    around = inside[:-2, 1:-1] & inside[2:, 1:-1] & inside[1:-1, :-2] & inside[1:-1, 2:]
    row, column = np.nonzero(around & (chosen < 0))
    if len(row):
        azimuths, elevations = _middles(bins)
        tree = scipy.spatial.cKDTree(_angles(bins, rays))
        chosen[row, column] = tree.query(np.column_stack([azimuths[column], elevations[row]]))[1]
    return len(row)


def _pole(rays: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Upright, and level towards the points; straight at them where all are on one side."""
    middle, upward = rays.mean(axis=0), np.array([0.0, 0.0, 1.0])
    length = float(np.linalg.norm(middle))
    if not (length > 1e-6 and (rays @ middle).min() > limits.NARROW * length):
        middle = np.array([middle[0], middle[1], 0.0])
        middle = middle if np.linalg.norm(middle) > 1e-6 else np.eye(3)[0]
    turned = Pose.looking_at(np.zeros(3), middle, upward).rotation
    return -turned[:, 1], turned[:, 2]


def _bin_pixels(rays: FloatArray) -> AngleGrid:
    """Pixels wide enough to be filled, starting from the steps between neighbouring points."""
    pole, forward = _pole(rays)
    none = np.zeros(0, np.int64)
    whole = AngleGrid(pole, SphericalProjection(np.zeros(1), np.zeros(1)), forward, none, none)
    angles = _angles(whole, rays)
    step = neighbour_steps(angles)
    sides = np.ptp(angles, axis=0)
    while np.prod(np.maximum(sides / step, 1)) > limits.SPARSE * len(angles) + limits.SPARSE_PIXELS:
        step = step * _WIDER  # most of so many pixels would be empty
    while True:
        bins = _bins(whole, angles, step)
        filled = np.zeros(bins.projection.shape, dtype=np.bool_)
        filled[bins.row, bins.column] = True
        if is_filled(filled, limits.NEARLY_ALL) or min(filled.shape) < 8:
            return bins
        step = step * _WIDER


def _bins(whole: AngleGrid, angles: FloatArray, step: FloatArray) -> AngleGrid:
    low, high = angles.min(axis=0), angles.max(axis=0)
    count = np.maximum(np.ceil((high - low) / step), 1).astype(np.int64)
    check_size(int(count[1]), int(count[0]))
    size = np.maximum((high - low) / count, 1e-12)
    column, row = np.minimum(np.floor((angles - low) / size).astype(np.int64), count - 1).T
    azimuths, elevations = (low[k] + (np.arange(count[k]) + 0.5) * size[k] for k in (0, 1))
    projection = SphericalProjection(azimuths, elevations[::-1])
    return AngleGrid(whole.pole, projection, whole.forward, count[1] - 1 - row, column)


def _check_single(pixel: NDArray[np.int64], ranges: FloatArray, stood: FloatArray) -> None:
    """Raise InputError where too many pixels hold points far behind each other."""
    order = np.argsort(pixel, kind="stable")
    start = np.flatnonzero(np.diff(pixel[order], prepend=-1))
    near = np.minimum.reduceat(ranges[order], start)
    far = np.maximum.reduceat(ranges[order], start)
    share = float(np.mean(far > (1 + limits.RANGES_APART) * near))
    if share > limits.MOST_APART:
        x, y, z = stood
        raise InputError(
            f"{100 * share:.0f} % of the directions from ({x:.10g}, {y:.10g}, {z:.10g}) meet points behind "
            "each other, which no one scan from there measured; was it another place, or are scans merged?"
        )
