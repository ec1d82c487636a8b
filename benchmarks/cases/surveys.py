# SPDX-License-Identifier: MIT
"""Surveys: scans of planted states that carry wrong poses, and what their beams truly met."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.cases.asbuilt import PlantedState, pixel_areas
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor, Sensor, SphericalSensor
from scenes.checks import FloatArray
from scenes.pose import Pose
from scenes.rays.raycast import RayCaster
from scenes.scan.range_image import RangeImage

_OFFSET_M = 0.001  # of all ranges of a scanner
_LEAST_BEAMS, _LEAST_M2 = 50, 0.05  # on main faces from one station, where an element counts as measured
_BEHIND_M = 0.03  # beyond the exit from an element's body, where a beam went through


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """A sensor and errors of poses.

    Standard deviations an axis of a station's position (metres) and turn (radians), and of the motion of all
    scans together.
    """

    is_camera: bool = False
    station: tuple[float, float] = (0.002, 0.0001)
    together: tuple[float, float] = (0.004, 0.0003)


SETTINGS = {
    "2mm": Setting(),
    "0mm": Setting(station=(0.0, 0.0)),
    "5mm": Setting(station=(0.005, 0.0003)),
    "3cm": Setting(together=(0.03, 0.002)),
    "camera": Setting(is_camera=True, station=(0.005, 0.0003)),
}


@dataclass(frozen=True, slots=True, eq=False)
class Survey:
    """Scans as a user has them (wrong poses, no truth), and the same as they were taken."""

    given: tuple[RangeImage, ...]
    true: tuple[RangeImage, ...]

    @property
    def n_pixels(self) -> int:
        """Of all scans."""
        return sum(scan.ranges.size for scan in self.given)


def survey(state: PlantedState, setting: str, seed: int, megapixels: float = 2.4) -> Survey:
    """Scan what was built from all stations; panoramas, or four frames of a depth camera from each."""
    how, rng = SETTINGS[setting], np.random.default_rng([20281, seed])
    sensor = _sensor(how, megapixels * 1e6 / len(state.stations))
    everywhere = _random_motion(rng, np.zeros(3), how.together)
    given, true = [], []
    for number, eye in enumerate(state.stations):
        turns = (90.0 * np.arange(4) if how.is_camera else np.zeros(1)) + rng.uniform(0, 360)
        for turn in np.radians(turns):
            pose = Pose.looking_at(eye, eye + [np.cos(turn), np.sin(turn), -0.1 * how.is_camera])
            scan = scan_scene(
                state.built, pose, sensor, noise="nguyen2012" if how.is_camera else "gaussian-2mm",
                rng=rng, name=f"s{number + 1}",
            )  # fmt: skip
            if not how.is_camera:
                scan = replace(scan, ranges=scan.ranges + _OFFSET_M)
            true.append(scan)
            wrong = everywhere @ _random_motion(rng, eye, how.station) @ pose
            given.append(replace(scan, world_from_sensor=wrong, truth=None))
    return Survey(tuple(given), tuple(true))


def _sensor(how: Setting, n_pixels: float) -> Sensor:
    if how.is_camera:
        width = int(np.sqrt(n_pixels / 4 * 4 / 3))
        return PinholeSensor(
            fov_deg=75.0, width=width, height=width * 3 // 4, max_range_m=6.0, name="depth camera"
        )
    width = int(np.sqrt(n_pixels * 360 / 145))
    return SphericalSensor(
        azimuth_span_deg=360.0, elevation_min_deg=-60.0, elevation_max_deg=85.0, width=width,
        height=int(width * 145 / 360), max_range_m=40.0, name="scanner",
    )  # fmt: skip


def _random_motion(rng: np.random.Generator, place: FloatArray, sd: tuple[float, float]) -> Pose:
    """A motion by a normal shift and a normal turn about a place."""
    turn = Rotation.from_rotvec(sd[1] * rng.normal(size=3)).as_matrix()
    return Pose.from_parts(turn, place - turn @ place + sd[0] * rng.normal(size=3))


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """What beams truly met of each element, (n,) each.

    `measured`: one station has at least 50 beams and 0.05 m2 on main faces. `worst_m`: 95 % of the beams on
    them are off the design by less, metres. `through_m2`: beams went through the whole body of what was
    removed. `extra` (m, 3): what was met of no element's place, at true poses.
    """

    measured: NDArray[np.bool_]
    worst_m: FloatArray
    through_m2: FloatArray
    extra: FloatArray


def sighting(state: PlantedState, scans: tuple[RangeImage, ...]) -> Sighting:
    """Return what the beams of scans with their truth met."""
    n, mesh = len(state.design.elements), state.design.mesh
    is_main = np.zeros(len(mesh.faces) + 1, np.bool_)
    is_main[np.concatenate([face.faces for face in state.main_faces])] = True
    normals, start = mesh.face_normals(), mesh.corners[:, 0]
    beams, area = np.zeros((2, n, len(scans)))
    off: list[tuple[NDArray[np.int32], FloatArray]] = []
    extra = []
    through = np.zeros(n)
    for number, scan in enumerate(scans):
        assert scan.truth is not None
        met = (scan.truth.face >= 0) & scan.valid
        source = state.source_face[scan.truth.face[met]]
        points, areas = scan.true_points()[met], pixel_areas(scan)[met]
        own = (source >= 0) & is_main[source]
        element = mesh.face_surface[source[own]]
        beams[:, number] = np.bincount(element, minlength=n)
        area[:, number] = np.bincount(element, areas[own], n)
        away = np.einsum("ij,ij->i", points[own] - start[source[own]], normals[source[own]])
        off.append((element, np.abs(away)))
        extra.append(points[source < 0][::4])
        for gone in (k for k, change in state.changes.items() if change.is_gone):
            through[gone] += _through(mesh.corners[mesh.face_surface == gone], scan)
    element, away = (np.concatenate(one) for one in zip(*off, strict=True))
    worst = np.zeros(n)
    for k in state.changes:
        own = element == k
        worst[k] = np.quantile(away[own], 0.95) if own.any() else 0.0
    measured = np.asarray(((beams >= _LEAST_BEAMS) & (area >= _LEAST_M2)).any(axis=1))
    return Sighting(measured, worst, through, np.concatenate(extra))


def _through(corners: FloatArray, scan: RangeImage) -> float:
    """Area, square metres, of a body that is not there across beams that ended beyond it."""
    assert scan.truth is not None
    caster = RayCaster(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
    rays = scan.rays()[scan.valid]
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    reach = max(
        float(np.linalg.norm(np.array(one) - scan.origin)) for one in product(*zip(low, high, strict=True))
    )
    back = caster.first_hit(scan.origin + (reach + 1.0) * rays, -rays)
    leaves = reach + 1.0 - np.where(back.hit, back.ranges, np.inf)
    ends = scan.truth.ranges[scan.valid]
    passed = (leaves > 0) & (ends > leaves + _BEHIND_M) & np.isfinite(ends)
    solid = scan.projection.pixel_angle**2
    return float((leaves[passed] ** 2).sum() * solid)
