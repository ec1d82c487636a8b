# SPDX-License-Identifier: MIT
"""Walk: points of a moving scanner and its trajectory, as scans of stretches too short to matter.

A scan has one origin; a moving scanner has another for each point. Points are cut, by their times, into
stretches, and each is a scan from the mean origin of its points. Points stay exactly where they were
measured. What changes is the way that a beam took: a beam of length R whose origin moves by d sideways moves
by d (1 - r / R) at the distance r. Evidence tells places across a beam apart by half the angle between
pixels, and along it by the range noise. A stretch is therefore so long that half-way along the median beam
the way moves by no more than the larger of both, which with median range R, pixel angle a and noise s is

    d = max(a R / 2, 2 s),

the origin being at most d from the mean one: a stretch is 2 d long. Beyond the middle of the beam the way
moves less than a pixel's half, near the scanner by at most d.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import scipy  # its parts load when they are first used
from numpy.typing import NDArray

from scenes.checks import ColourArray, FloatArray, InputError
from scenes.io.formats.angle_grid import neighbour_steps
from scenes.io.formats.format import Units
from scenes.io.point_files import PointCloud, read_points
from scenes.io.scan_files import ScanSource
from scenes.io.track import Trajectory, clock_offset, read_trajectory
from scenes.limits import FARTHEST_M, FEWEST_POINTS, LONGEST_GAP_S, MOST_STRETCHES, NEW_SHARE
from scenes.pose import Pose
from scenes.run.mapping import allocate, release
from scenes.scan.projection import SphericalProjection
from scenes.scan.range_image import POINTS_SENSOR, RangeImage

_BLOCK = 1 << 20  # points whose origins are found at a time
_FEWER = 4  # points of a stretch of which one is looked at for what is new
_MASK = (1 << 20) - 1  # cells along an axis that are told apart
_EACH = 64  # points of which one is looked at where stretches are cut
_CONSECUTIVE = 5_000  # points that tell the angles between beams: less than a turn of any scanner
_N_SAMPLES = 8  # of so many points, spread over the walk
_NEIGHBOURS = 12  # to which a plane is fitted, for the noise
_QUARTILE = 0.81  # of the root mean square of planes' residuals: chi square of 9 degrees of freedom


@dataclass(frozen=True, slots=True, eq=False)
class Walk:
    """Points of a moving scanner in the order of their times, and where they are cut.

    Attributes
    ----------
    points : (n, 3) float
        World coordinates, metres.
    times : (n,) float
        Seconds on the trajectory's clock, ascending.
    colour : (n, 3) uint8, optional
        sRGB.
    track : Trajectory
        In metres.
    cuts : (k, 2) int64
        First point and end of each stretch.
    steps : (2,) float
        Angles between beams that are neighbours sideways and upwards, radians.
    reach_m : float
        How far the origin of a point is from the mean one of its stretch, about, at most.
    name : str
        The file's name.
    numbers : (k,) int64, optional
        Of the stretches among all of the walk, from 1.
    """

    points: FloatArray
    times: FloatArray
    colour: ColourArray | None
    track: Trajectory
    cuts: NDArray[np.int64]
    steps: FloatArray
    reach_m: float
    name: str
    numbers: NDArray[np.int64] | None = None

    def scan(self, index: int) -> RangeImage:
        """Return a stretch as a scan from the mean origin of its points.

        The image is spherical about z, its pixels as wide and high as beams are apart. Each keeps the point
        nearest to its middle, where it was measured.
        """
        held = slice(*self.cuts[index].tolist())
        origin = self.track.at(self.times[held]).mean(axis=0)
        rays = self.points[held] - origin
        angles = _angles(rays)
        n_turn = max(round(2 * np.pi / self.steps[0]), 1)
        column, azimuths = _columns(angles[:, 0], n_turn)
        row, elevations = _rows_of(angles[:, 1], self.steps[1])
        off = np.hypot(
            (angles[:, 0] - azimuths[column] + np.pi) % (2 * np.pi) - np.pi, angles[:, 1] - elevations[row]
        )
        shape = len(elevations), len(azimuths)
        flat = row * shape[1] + column
        order = np.lexsort((off, flat))
        kept = order[np.diff(flat[order], prepend=-1) > 0]
        image, painted = np.full((*shape, 3), np.nan), None
        pose = Pose.from_parts(np.column_stack([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]]), origin)
        image.reshape(-1, 3)[flat[kept]] = pose.inverse().apply(self.points[held][kept])
        if self.colour is not None:
            painted = np.zeros((*shape, 3), np.uint8)
            painted.reshape(-1, 3)[flat[kept]] = self.colour[held][kept]
        release(self.points, self.times, self.colour)
        name = f"{self.name}#{index + 1}"
        scan = RangeImage.from_points(image, SphericalProjection(azimuths, elevations), pose, painted, name)
        return scan.with_facts(
            sensor=f"{POINTS_SENSOR} from a walk by {self.track.name}, stretches of {2 * self.reach_m:.3g} m"
        )


def _angles(rays: FloatArray) -> FloatArray:
    """Azimuth and elevation (n, 2) of rays (n, 3)."""
    level = rays[:, :2].T
    return np.column_stack([np.arctan2(*level), np.arctan2(rays[:, 2], np.hypot(*level))])


def _columns(azimuth: FloatArray, n_turn: int) -> tuple[NDArray[np.int64], FloatArray]:
    """Columns (n,) of azimuths, and the azimuth of each: all of a turn but its widest gap."""
    number = np.floor((azimuth + np.pi) / (2 * np.pi) * n_turn).astype(np.int64) % n_turn
    used = np.unique(number)
    gaps = np.diff(used, append=used[0] + n_turn)
    widest = int(np.argmax(gaps))
    first = int(used[(widest + 1) % len(used)])
    n = n_turn - int(gaps[widest]) + 1
    azimuths = (first + np.arange(n) + 0.5) * 2 * np.pi / n_turn - np.pi
    return (number - first) % n_turn, azimuths


def _rows_of(elevation: FloatArray, step: float) -> tuple[NDArray[np.int64], FloatArray]:
    """Rows (n,) of elevations, and the elevation of each, falling; beams lie in the middle of theirs."""
    phase = float(np.angle(np.exp(2j * np.pi / step * elevation).mean())) * step / (2 * np.pi)
    number = np.rint((elevation - phase) / step).astype(np.int64)
    highest = int(number.max())
    return highest - number, phase + step * np.arange(highest, int(number.min()) - 1, -1.0)


def open_walk(
    path: str | os.PathLike[str], trajectory: str | os.PathLike[str], units: Units = "m"
) -> ScanSource:
    """Open a file of points with times as scans of the stretches of a walk; they are read one by one.

    Points outside of the trajectory's time span, or in gaps of more than a second, are left out and counted.

    Raises InputError: unusable files, points without times, clocks that do not fit, hardly any point left.
    """
    base = Path(path)
    cloud = read_points(base, units)
    if cloud.times is None:
        raise InputError(
            f"{base}: its points have no times, which a trajectory needs: export them with GPS time (LAS, "
            "E57) or a column gps_time (text, PLY); points of one station need --origin X,Y,Z instead"
        )
    track = read_trajectory(trajectory)
    track = Trajectory(track.times, track.places * cloud.metres_per_unit, track.name, track.warnings)
    walk, sentences = walk_of(cloud, track)
    readers = tuple(partial(walk.scan, index) for index in range(len(walk.cuts)))
    numbers = () if walk.numbers is None else tuple(walk.numbers.tolist())
    return ScanSource(base, "walk", readers, unit=units, warnings=sentences, numbers=numbers)


def read_walk(
    path: str | os.PathLike[str], trajectory: str | os.PathLike[str], units: Units = "m"
) -> list[RangeImage]:
    """Return the scans of a moving scanner: of each stretch of a walk that shows something new.

    Parameters
    ----------
    path : str or path
        Points with times: `.las .laz .e57`, or text and `.ply` with a column `gps_time` or `time`.
    trajectory : str or path
        Times and places of the scanner: TUM, KITTI with `times.txt`, or text that names its columns.
    units : "mm", "cm", "m", "in", "ft" or "us-ft"
        Unit of the lengths in both files.

    Raises
    ------
    InputError
        Unusable files, points without times, clocks that do not fit, fewer than 100 points left.
    """
    return open_walk(path, trajectory, units).read(units=units)


def walk_of(
    cloud: PointCloud, track: Trajectory, reach_m: float | None = None
) -> tuple[Walk, tuple[str, ...]]:
    """Return points with times and their trajectory, metres, as a walk, with sentences on what was left out.

    `reach_m` states how far an origin may be from the mean one of its stretch; None chooses it.

    Raises InputError: clocks that do not fit; fewer than 100 points left; too many stretches.
    """
    order, times, sentences = _in_time(cloud, track)
    points = allocate((len(order), 3), np.float64)
    for start in range(0, len(order), _BLOCK):
        points[start : start + _BLOCK] = cloud.points[order[start : start + _BLOCK]]
        release(points)
    sensor = _sensor_of(points, times, track)
    if sensor.median_m > FARTHEST_M:
        raise InputError(
            f"{cloud.name}: half of its points are {sensor.median_m:.3g} m or more from {track.name}: give "
            "both in one coordinate system and unit"
        )
    reach = sensor.reach_m if reach_m is None else reach_m
    cuts = _cuts(times, track, reach)
    if not len(cuts):
        raise InputError(f"{cloud.name}: no stretch of {2 * reach:.3g} m holds {FEWEST_POINTS} points")
    if len(cuts) > MOST_STRETCHES:
        raise InputError(
            f"{cloud.name}: a walk of {len(cuts):,} stretches of {2 * reach:.3g} m; at most "
            f"{MOST_STRETCHES:,} are read together: cut the file by time"
        )
    colour = None if cloud.colour is None else cloud.colour[order]
    walk = Walk(
        points=points,
        times=times,
        colour=colour,
        track=track,
        cuts=cuts,
        steps=sensor.steps,
        reach_m=reach,
        name=cloud.name,
    )
    numbers = np.array(list(_numbers_of_new(walk, sensor.cell_m)), np.int64)
    across, up = np.degrees(sensor.steps).tolist()
    sentences.append(
        f"{np.diff(cuts).sum()} points were cut into {len(cuts)} stretches of {2 * reach:.3g} m of "
        f"{track.name} (beams {across:.2g} x {up:.2g} deg apart, median range {sensor.median_m:.3g} m, noise "
        f"{1000 * sensor.sigma_m:.2g} mm); {len(numbers)} show something new and are scans, each from its "
        "mean place, the others were left out"
    )
    chosen = replace(walk, cuts=cuts[numbers], numbers=numbers + 1)
    return chosen, (*cloud.warnings, *track.warnings, *sentences)


def _in_time(cloud: PointCloud, track: Trajectory) -> tuple[NDArray[np.int64], FloatArray, list[str]]:
    """The points that have a place of the trajectory, in order, their times, and what was left out."""
    stamps = np.asarray(cloud.times)
    offset, sentence = clock_offset(stamps, track)
    times = stamps + offset
    known = np.isfinite(times)
    inside, in_gap = track.covers(times)
    kept = inside & ~in_gap
    lost = (
        (~known, "have no finite time"),
        (known & ~inside, f"lie outside of the time span of {track.name}"),
        (in_gap, f"lie in gaps of {track.name} of more than {LONGEST_GAP_S:g} s"),
    )
    sentences = [sentence] if sentence else []
    sentences += [
        f"{which.sum()} of {len(times)} points {why} and were left out" for which, why in lost if which.any()
    ]
    if kept.sum() < FEWEST_POINTS:
        raise InputError(f"{cloud.name}: {kept.sum()} points are left for scans: {'; '.join(sentences)}")
    order = np.flatnonzero(kept)
    order = order[np.argsort(times[order], kind="stable")]
    return order, times[order], sentences


@dataclass(frozen=True, slots=True, eq=False)
class _Sensor:
    """What samples of consecutive points tell of a moving scanner."""

    steps: FloatArray  # (2,) angles between neighbours sideways and upwards, radians
    median_m: float  # range
    sigma_m: float  # noise of a range

    @property
    def cell_m(self) -> float:
        """How far beams are apart at the median range, at most."""
        return float(self.steps.max()) * self.median_m

    @property
    def reach_m(self) -> float:
        """How far an origin may be from the mean one; see the head of this file."""
        return max(self.cell_m / 2, 2 * self.sigma_m)


def _sensor_of(points: FloatArray, times: FloatArray, track: Trajectory) -> _Sensor:
    """The angles between beams, median range and noise, as medians over samples of the walk."""
    n = min(_CONSECUTIVE, len(points))
    found = []
    for start in np.linspace(0, len(points) - n, _N_SAMPLES).astype(np.int64).tolist():
        rays = points[start : start + n] - track.at(times[start : start + n])
        rays = rays[np.any(rays != 0, axis=1)]
        angles, away = _angles(rays), np.linalg.norm(rays, axis=1)
        finest = float(neighbour_steps(angles).min())
        steps = np.array([_step(angles, finest), _step(angles[:, ::-1], finest)])
        found.append([*steps, np.median(away), _noise(away, angles / steps)])
    wide, high, middle, sigma = np.median(found, axis=0).tolist()
    return _Sensor(np.array([wide, high]), middle, sigma)


def _step(angles: FloatArray, finest: float) -> float:
    """Typical angle between neighbours along the first of two angles (n, 2), within lines of the other.

    Lines are as wide as the `finest` angle between neighbours, radians; beams of a spinning scanner are ten
    times as far apart across its lines as along them.
    """
    line = np.floor(angles[:, 1] / finest)
    order = np.lexsort((angles[:, 0], line))
    way = np.diff(angles[order, 0])[np.diff(line[order]) == 0]
    way = way[way > finest / 2]
    return float(np.median(way)) if len(way) else finest


def _noise(ranges: FloatArray, places: FloatArray) -> float:
    """Standard deviation of ranges (n,) about planes through neighbours, by places (n, 2) in steps; metres.

    On a plane the inverse of the range is linear in small angles. The lower quartile counts: of flat places.
    """
    near = scipy.spatial.cKDTree(places).query(places[::10], k=min(_NEIGHBOURS, len(places)))[1]
    basis = np.concatenate([np.ones((*near.shape, 1)), places[near] - places[near[:, :1]]], axis=2)
    inverse = 1.0 / ranges[near]
    terms = np.einsum("nik,nk->ni", np.linalg.pinv(basis), inverse)
    errors = (inverse - np.einsum("nki,ni->nk", basis, terms)) * np.square(ranges[near])
    rms = np.sqrt(np.square(errors).sum(axis=1) / max(near.shape[1] - 3, 1))
    return float(np.quantile(rms, 0.25)) / _QUARTILE


def _cuts(times: FloatArray, track: Trajectory, reach_m: float) -> NDArray[np.int64]:
    """First point and end (k, 2) of each stretch of at least 100 points.

    A stretch ends where the origin leaves a ball about its first place, of twice the reach.
    """
    places = track.at(times[::_EACH])
    starts, block = [0], 256
    here = 1
    while here < len(places):
        away = np.linalg.norm(places[here : here + block] - places[starts[-1]], axis=1)
        out = np.flatnonzero(away > 2 * reach_m)
        if len(out):
            starts.append(here + int(out[0]))
        here += int(out[0]) + 1 if len(out) else block
    first = np.array(starts) * _EACH
    cuts = np.column_stack([first, np.append(first[1:], len(times))])
    return np.asarray(cuts[cuts[:, 1] - cuts[:, 0] >= FEWEST_POINTS])


def _numbers_of_new(walk: Walk, cell_m: float) -> Iterator[int]:
    """Numbers, from 0, of the stretches that show something new, in their order.

    Space is cut into cells as wide as beams are apart. A stretch shows something new if more than a fifth of
    the cells that it measured are such that no chosen stretch before it measured them from the same of six
    sides: where a person comes by again nothing is new, and a place between two beams is.
    """
    known = np.zeros(0, np.int64)
    for number, (start, end) in enumerate(walk.cuts.tolist()):
        points = walk.points[start:end:_FEWER]
        rays = points - walk.track.at(walk.times[start:end:_FEWER])
        axis = np.argmax(np.abs(rays), axis=1)
        side = 2 * axis + (rays[np.arange(len(rays)), axis] > 0)
        place = np.floor((points - walk.points[0]) / cell_m).astype(np.int64) & _MASK
        cells = np.unique(((place[:, 0] << 40) | (place[:, 1] << 20) | place[:, 2]) * 6 + side)
        at = np.minimum(np.searchsorted(known, cells), max(len(known) - 1, 0))
        is_new = known[at] != cells if len(known) else np.ones(len(cells), np.bool_)
        if is_new.sum() > NEW_SHARE * len(cells):
            known = np.union1d(known, cells)
            yield number
        release(walk.points, walk.times)
