# SPDX-License-Identifier: MIT
"""Range scans of plates with holes before a wall, and their meshes: what the scanner makes of a pattern."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import Delaunay

from benchmarks.features.hole_plates import SIZE, LostPatches, PlateTruth, centres_of
from completion.templates.engine.measured import Beams, Measured
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensors.sensor import PinholeSensor
from scenes.checks import FloatArray, IntArray
from scenes.pose import Pose
from scenes.world.scene import Scene

_THICK, _BEHIND = 6.0, 150.0  # mm
_STEPS = 96  # corners of a hole
_PIXELS, _FOV_DEG = 360, 40.0
_FAR = (0.26, 0.34)  # m, from the sensor to the plate
_MM = 1e-3


def mesh(flat: FloatArray, radius: float) -> tuple[FloatArray, IntArray]:
    """Corners (n, 3), mm, and triangles (m, 3) of a plate, its upper side at z = 0, with holes (k, 2)."""
    turns = 2 * np.pi * np.arange(_STEPS) / _STEPS
    rings = [centre + radius * np.column_stack([np.cos(turns), np.sin(turns)]) for centre in flat]
    side = np.array([[0, 0], [SIZE[0], 0], SIZE, [0, SIZE[1]]])
    corners = np.concatenate([side, *rings])
    faces = Delaunay(corners).simplices
    middle = corners[faces].mean(axis=1)
    solid = np.ones(len(faces), dtype=np.bool_)
    for centre in flat:
        solid &= np.hypot(*(middle - centre).T) > radius * np.cos(np.pi / _STEPS)
    n, faces = len(corners), faces[solid]
    walls = [np.arange(4)] + [4 + _STEPS * k + np.arange(_STEPS) for k in range(len(flat))]
    strips = []
    for ring in walls:
        on = np.roll(ring, -1)
        strips += [np.column_stack([ring, on, on + n]), np.column_stack([ring, on + n, ring + n])]
    space = np.concatenate([np.column_stack([corners, np.full(n, z)]) for z in (0.0, -_THICK)])
    return space, np.concatenate([faces, faces[:, ::-1] + n, *strips])


def scan(
    rng: np.random.Generator, kind: str, *, sigma: float = 0.1, lost: float = 0.3, wall: bool = True
) -> PlateTruth:
    """A plate seen at a slant by a camera, before a wall or before nothing; patches of pixels are lost."""
    radius = float(rng.uniform(3.0, 6.0))
    flat, pitches = centres_of(rng, kind, radius)
    corners, faces = mesh(flat, radius)
    if wall:
        side = np.array([[-900.0, -900], [1100, -900], [1100, 1000], [-900, 1000]])
        corners = np.concatenate([corners, np.column_stack([side, np.full(4, -_BEHIND)])])
        n = len(corners) - 4
        faces = np.concatenate([faces, [[n, n + 1, n + 2], [n, n + 2, n + 3]]])
    middle = np.array([*np.array(SIZE) / 2, 0.0])
    slant, turn = np.radians(rng.uniform(0, 40)), rng.uniform(0, 2 * np.pi)
    towards = np.array([np.sin(slant) * np.cos(turn), np.sin(slant) * np.sin(turn), np.cos(slant)])
    eye = middle * _MM + rng.uniform(*_FAR) * towards
    sensor = PinholeSensor(fov_deg=_FOV_DEG, width=_PIXELS, height=_PIXELS, min_range_m=0.05)
    scene = Scene.from_mesh((corners * _MM, faces), mode="object")
    seen = scan_scene(
        scene, Pose.looking_at(eye, middle * _MM), sensor, noise=f"gaussian-{sigma:g}mm", rng=rng
    )
    directions = seen.rays().reshape(-1, 3)
    ranges = seen.ranges.ravel() / _MM
    origin = np.asarray(seen.origin) / _MM
    # patches are lost in the image, half of them with their beams
    gone, without_beam = LostPatches(rng, lost), LostPatches(rng, lost / 2)
    pixel = np.stack(np.meshgrid(*(np.arange(_PIXELS) / _PIXELS,) * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    is_lost = gone(pixel * (min(SIZE), min(SIZE)))
    ranges = np.where(is_lost, np.inf, ranges)
    kept = ~(is_lost & without_beam(pixel * (min(SIZE), min(SIZE))))
    beams = Beams(np.tile(origin, (len(ranges), 1)), directions, ranges).chosen(kept)
    back = np.isfinite(beams.ranges)
    points = beams.origins[back] + beams.ranges[back, None] * beams.directions[back]
    measured = Measured(points, sigma, 0.5, beams, np.flatnonzero(back))
    centres = np.column_stack([flat, np.zeros(len(flat))])
    shown = np.array([_shown(points, centre, radius) for centre in centres])
    return PlateTruth(kind, centres, radius, pitches, shown, measured)


def without_beams(truth: PlateTruth) -> PlateTruth:
    """The same of points alone."""
    return replace(truth, measured=replace(truth.measured, beams=None, beam_of_point=None))


def _shown(points: FloatArray, centre: FloatArray, radius: float) -> float:
    """Share of 36 directions in which the plate was measured just outside a hole."""
    offset = points - centre
    far = np.hypot(offset[:, 0], offset[:, 1])
    near = (np.abs(offset[:, 2]) < 1) & (far > radius) & (far < radius + 1.5)
    turn = np.arctan2(offset[near, 1], offset[near, 0])
    return len(np.unique((turn / (2 * np.pi) * 36).astype(int))) / 36
