# SPDX-License-Identifier: MIT
"""Strips: how far off a wall is metres beyond what was seen of it, with and without relations."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from benchmarks.completion.relations.calibration import doubt_of
from benchmarks.completion.relations.sensors import SENSORS, SensorErrors
from completion.fitting.result import SurfaceFit
from completion.merging.merged_surface import MergedSurface
from completion.observe.observation import Observation, observe
from completion.observe.pixel_set import PixelSet, ScanPixels
from completion.observe.refits.refitting import refit_each
from completion.relations.options import BUILT
from completion.relations.pipeline import infer
from completion.uncertainty.pipeline import state_fits
from scenes.checks import FloatArray
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Plane

BEYOND_M = (1.0, 2.0, 3.0)
CAMERA = PinholeProjection.from_fov(640, 480, 62.7)
STRIP = 3  # which of `ROOM` shows as a strip
ROOM = (
    Plane((0.0, 2.0, 0.0), (0, 0, 1.0)),
    Plane((-1.9, 2.0, 1.3), (1.0, 0, 0)),
    Plane((0.0, 4.2, 1.3), (0, -1.0, 0)),
    Plane((1.9, 2.0, 1.3), (-1.0, 0, 0)),
)
"""Floor, left wall, far wall and right wall of a room 3.8 m wide; the last shows beside the far one."""


def seen_room(
    sensor: SensorErrors, seed: int, strip_m: float | None, turn_deg: float = 0.0
) -> tuple[list[MergedSurface], Observation, list[Plane]]:
    """Return the planes of the room, each fitted to its own pixels, before a sensor, and the true ones.

    Of the right wall, which is turned about the vertical by `turn_deg`, only `strip_m` metres beside the
    corner with the far wall show; all of it when None.
    """
    rng = np.random.default_rng([20269, seed])
    eye = np.array([rng.uniform(-0.4, 0.4), rng.uniform(-0.4, 0.0), rng.uniform(1.3, 1.6)])
    pose = Pose.looking_at(eye, (rng.uniform(0.2, 0.6), 4.0, rng.uniform(0.8, 1.1)))
    turn = np.radians(turn_deg)
    true = [*ROOM[:3], Plane(ROOM[3].point, (-np.cos(turn), np.sin(turn), 0))]
    rays = CAMERA.directions().reshape(-1, 3) @ pose.rotation.T
    every = np.stack([one.ray_ranges(eye, rays) for one in true])
    every = np.where(np.isfinite(every) & (every > 0), every, np.inf)
    which, ranges = np.argmin(every, axis=0), every.min(axis=0)
    if strip_m is not None:
        corner = true[2].point[1]
        hidden = (which == STRIP) & ((eye + ranges[:, None] * rays)[:, 1] < corner - strip_m)
        which = np.where(hidden, -1, which)
    scan = RangeImage(ranges.reshape(CAMERA.shape), CAMERA, pose)
    seen = observe(sensor.applied(scan, seed), pose)
    pixels = [ScanPixels.of([PixelSet.of((which == k).reshape(CAMERA.shape))]) for k in range(len(true))]
    local = [one.transformed(pose.inverse()) for one in true]
    fits = refit_each(local, [seen], pixels, 0.0, n_rounds=2)
    surfaces = [MergedSurface(fit, own, 1) for fit, own in zip(fits, pixels, strict=True) if fit is not None]
    return surfaces, seen, local


def strip_errors(
    sensor: SensorErrors, seed: int, strip_m: float | None
) -> tuple[FloatArray, FloatArray] | None:
    """How far off the right wall is 1, 2 and 3 m beyond the strip, metres: without relations, and with."""
    surfaces, seen, true = seen_room(sensor, seed, strip_m)
    if len(surfaces) < len(true):
        return None
    stated = state_fits(surfaces, [seen], 0.0)
    graph = infer(stated.fits, (), BUILT, doubt=doubt_of(stated))
    level = np.cross(true[STRIP].normal_direction, true[0].normal_direction)
    points = surfaces[STRIP].points([seen], 4_000)
    along = points @ level
    toward = 1.0 if level @ (points.mean(axis=0)) < 0 else -1.0  # back to where the sensor stands
    edge = points[np.argmax(toward * along)]
    beyond = edge + toward * np.outer(BEYOND_M, level)
    beyond -= true[STRIP].distance(beyond)[:, None] * true[STRIP].normal_direction
    alone, related = (_off(fit, beyond) for fit in (stated.fits[STRIP], graph.fits[STRIP]))
    return alone, related


def _off(fit: SurfaceFit, points: FloatArray) -> FloatArray:
    return np.abs(fit.surface.distance(points))


def strip_table(seeds: Sequence[int], sensors: Sequence[SensorErrors] = SENSORS) -> Iterator[str]:
    """Yield the lines of a table: root mean square errors beyond what was seen, millimetres."""
    yield "| right wall | sensor | rooms | alone, 1 / 2 / 3 m beyond, mm | with relations |"
    yield "|---|---|---|---|---|"
    for strip_m, name in ((0.15, "15 cm"), (0.5, "50 cm"), (None, "whole")):
        for sensor in sensors:
            found = [both for seed in seeds if (both := strip_errors(sensor, seed, strip_m)) is not None]
            alone, related = (np.sqrt(np.mean(np.square(some), axis=0)) for some in zip(*found, strict=True))
            yield f"| {name} | {sensor.name} | {len(found)} | {_cells(alone)} | {_cells(related)} |"


def _cells(errors: FloatArray) -> str:
    return " / ".join(f"{1000 * one:.1f}" if one < 0.0195 else f"{1000 * one:.0f}" for one in errors)


def off_square_table(seeds: Sequence[int], sensors: Sequence[SensorErrors] = SENSORS) -> Iterator[str]:
    """Yield the lines of a table: of a wall that is off square, how often it is imposed, and at what harm."""
    yield "| sensor | off, deg | imposed | angle off alone, deg | related | 2 m beyond alone, mm | related |"
    yield "|---|---|---|---|---|---|---|"
    for sensor in sensors:
        for off_deg in (0.3, 1.0, 3.0):
            found = [off_square(sensor, seed, off_deg) for seed in seeds]
            imposed = np.mean([one[0] for one in found])
            rows = np.sqrt(np.mean(np.square([one[1:] for one in found]), axis=0))
            yield (
                f"| {sensor.name} | {off_deg:g} | {imposed:.2f} | {rows[0]:.2f} | {rows[1]:.2f} "
                f"| {rows[2]:.1f} | {rows[3]:.1f} |"
            )


def off_square(sensor: SensorErrors, seed: int, off_deg: float) -> tuple[float, float, float, float, float]:
    """Whether a relation is imposed on a wall that is off, its angle's error without and with, and 2 m on."""
    surfaces, seen, true = seen_room(sensor, seed, None, off_deg * (1 if seed % 2 else -1))
    stated = state_fits(surfaces, [seen], 0.0)
    graph = infer(stated.fits, (), BUILT, doubt=doubt_of(stated))
    on_wall = [one for one in graph.accepted if STRIP in one.surfaces]
    wrong = any(one.kind == "parallel" or 0 not in one.surfaces for one in on_wall)  # the floor is square
    points = surfaces[STRIP].points([seen], 2_000)
    level = np.cross(true[STRIP].normal_direction, true[0].normal_direction)
    there = points[np.argmax(points @ level)] + 2.0 * level
    there -= float(true[STRIP].distance(there[None])[0]) * true[STRIP].normal_direction
    out = []
    for fit in (stated.fits[STRIP], graph.fits[STRIP]):
        cosine = abs(float(fit.surface.normal(there[None])[0] @ true[STRIP].normal_direction))
        out.append((float(np.degrees(np.arccos(min(cosine, 1.0)))), 1000 * float(_off(fit, there[None])[0])))
    return float(wrong), out[0][0], out[1][0], out[0][1], out[1][1]
