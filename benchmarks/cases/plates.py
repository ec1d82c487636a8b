# SPDX-License-Identifier: MIT
"""Plates with patterns of holes, or blank ones, as points and as range scans; parts lost, outliers added."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.spatial import Delaunay
from scipy.spatial.transform import Rotation

from completion.features.engine.template import Measurements, PixelBeams
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor
from scenes.checks import BoolArray, FloatArray, IntArray
from scenes.pose import Pose
from scenes.world.scene import Scene

SIZE = (140.0, 90.0)  # mm, of a plate
_HIGH = 10.0  # mm: how far from the plate outliers reach
_MARGIN = 4.0  # mm between a hole and the plate's side
_PATCHES = ("disc", "ellipse", "strip", "star", "cloud", "rectangle")


@dataclass(frozen=True, slots=True, eq=False)
class PlateTruth:
    """A plate: what holes it has, in the frame of the points; `shown` tells the share of each rim left."""

    kind: str
    centres: FloatArray  # (n, 3)
    radius: float
    pitches: tuple[float, ...]
    shown: FloatArray  # (n,)
    measured: Measurements


def plate(
    rng: np.random.Generator,
    kind: str,
    *,
    sigma: float = 0.1,
    lost: float = 0.3,
    outliers: float = 0.1,
    counts: tuple[int, int] = (4, 8),
    half_lost: bool = False,
) -> PlateTruth:
    """A plate of one point a square millimetre with "hole-row", "hole-grid", "bolt-circle" or "blank".

    Rows have the least to the most holes of `counts`; where half of them are lost, these show less than a
    third of their rims each, whatever else is lost.
    """
    radius = float(rng.uniform(3.0, 6.0))
    flat, pitches = centres_of(rng, kind, radius, counts)
    points = rng.uniform(0, 1, (rng.poisson(SIZE[0] * SIZE[1]), 2)) * SIZE
    kept = np.ones(len(points), dtype=np.bool_)
    for centre in flat:
        kept &= np.hypot(*(points - centre).T) > radius
    points = points[kept]
    gone = LostPatches()
    for centre in rng.permutation(flat)[: len(flat) // 2] if half_lost else ():
        while _shown(centre, radius, gone) >= 1 / 3:
            gone.cover(rng, centre + rng.uniform(-1, 1, 2) * radius)
    points = points[~gone.grow(rng, lost)(points)]
    shown = np.array([_shown(centre, radius, gone) for centre in flat])
    space = np.column_stack([points, np.zeros(len(points))]) + sigma * rng.normal(size=(len(points), 3))
    n_out = round(outliers * len(points) / (1 - outliers))
    stray = rng.uniform(0, 1, (n_out, 3)) * (*SIZE, 2 * _HIGH) - (0, 0, _HIGH)
    space = rng.permutation(np.concatenate([space, stray]))
    turn, moved = Rotation.random(random_state=rng), rng.uniform(-500, 500, 3)
    centres = turn.apply(np.column_stack([flat, np.zeros(len(flat))])) + moved
    measured = Measurements(turn.apply(space) + moved, noise=sigma, spacing=0.5)
    return PlateTruth(kind, centres, radius, pitches, shown, measured)


def centres_of(
    rng: np.random.Generator, kind: str, radius: float, counts: tuple[int, int] = (4, 8)
) -> tuple[FloatArray, tuple[float, ...]]:
    """Centres (n, 2) within the plate, and the pitches, or the radius of the circle."""
    while kind != "blank":
        angle = rng.uniform(0, 2 * np.pi)
        along = np.array([np.cos(angle), np.sin(angle)])
        across = np.array([-along[1], along[0]])
        pitches = tuple(rng.uniform(2.5, 5.0, 2) * radius)
        if kind == "hole-row":
            n = int(rng.integers(counts[0], counts[1] + 1))
            flat, pitches = np.arange(n)[:, None] * pitches[0] * along, pitches[:1]
        elif kind == "hole-grid":
            shape = rng.integers(2, 5, 2)
            if shape.max() < 3:
                continue
            i, j = (g.ravel()[:, None] for g in np.indices(tuple(shape.tolist())))
            flat = i * pitches[0] * along + j * pitches[1] * across
        else:
            n = int(rng.integers(4, 11))
            circle = float(rng.uniform(1.3, 2.5) * radius / np.sin(np.pi / n))
            turns = angle + 2 * np.pi * np.arange(n) / n
            flat, pitches = circle * np.column_stack([np.cos(turns), np.sin(turns)]), (circle,)
        flat = flat - flat.min(axis=0) + radius + _MARGIN
        room = np.array(SIZE) - flat.max(axis=0) - radius - _MARGIN
        if (room > 0).all():
            return flat + rng.uniform(0, 1, 2) * room, pitches
    return np.zeros((0, 2)), ()


def _shown(centre: FloatArray, radius: float, gone: LostPatches) -> float:
    """Share of directions in which the plate is there just outside a hole."""
    turns = np.linspace(0, 2 * np.pi, 72, endpoint=False)
    ring = np.column_stack([np.cos(turns), np.sin(turns)])
    there = [~gone(centre + (radius + out) * ring) for out in (0.2, 1.0)]
    return float((there[0] & there[1]).mean())


class LostPatches:
    """Patches of many shapes, as much of the plate as told."""

    _CELL = 0.1  # mm

    def __init__(self) -> None:
        self._lost: BoolArray = np.zeros(tuple(int(side / self._CELL) for side in SIZE), dtype=np.bool_)

    def grow(self, rng: np.random.Generator, share: float) -> LostPatches:
        """Lose patches anywhere until they are a share of the plate."""
        while self._lost.mean() < share:
            self.cover(rng)
        return self

    def cover(self, rng: np.random.Generator, centre: FloatArray | None = None) -> None:
        """Lose a patch of any shape about a place, or anywhere."""
        name = _PATCHES[int(rng.integers(len(_PATCHES)))]
        centre = rng.uniform(0, 1, 2) * SIZE if centre is None else centre
        size = float(rng.uniform(3.0, 9.0))
        low = np.maximum(((centre - 3 * size) / self._CELL).astype(int), 0)
        high = np.minimum(((centre + 3 * size) / self._CELL).astype(int), self._lost.shape)
        x, y = np.meshgrid(*(np.arange(a, b) for a, b in zip(low, high, strict=True)), indexing="ij")
        place = (np.stack([x, y], axis=-1) + 0.5) * self._CELL - centre
        window = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
        self._lost[window] |= _patch(rng, name, place, size, self._CELL)

    def __call__(self, places: FloatArray) -> BoolArray:
        """Tell which places (n, 2) are lost."""
        cell = (places / self._CELL).astype(int)
        inside = ((cell >= 0) & (cell < self._lost.shape)).all(axis=1)
        lost = np.asarray(~inside)
        lost[inside] = self._lost[tuple(cell[inside].T)]
        return lost


def _patch(rng: np.random.Generator, name: str, place: FloatArray, size: float, cell: float) -> BoolArray:
    """Which of the places (k, l, 2) about a patch's centre belong to it."""
    angle = rng.uniform(0, np.pi)
    x = place @ [np.cos(angle), np.sin(angle)]
    y = place @ [-np.sin(angle), np.cos(angle)]
    stretch = rng.uniform(1.2, 2.5)
    if name == "disc":
        return np.asarray(np.hypot(x, y) < size)
    if name == "ellipse":
        return np.asarray(np.hypot(x / stretch, y) * np.sqrt(stretch) < size)
    if name == "rectangle":
        high = 0.9 * size / np.sqrt(stretch)
        return np.asarray((np.abs(x) < 0.9 * size * np.sqrt(stretch)) & (np.abs(y) < high))
    if name == "strip":
        return np.asarray((np.abs(x) < 2 * size) & (np.abs(y) < 0.3 * size))
    if name == "star":
        turn, edge = np.arctan2(y, x), np.ones_like(x)
        for k in range(2, 7):
            edge += rng.normal(0, 0.25 / np.sqrt(k)) * np.cos(k * turn + rng.uniform(0, 2 * np.pi))
        return np.asarray(np.hypot(x, y) < size * np.maximum(edge, 0.1))
    rough = ndimage.gaussian_filter(rng.normal(size=x.shape), 0.25 * size / cell)
    return np.asarray((np.hypot(x, y) < 1.5 * size) & (rough > 0))


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
    gone, without_beam = LostPatches().grow(rng, lost), LostPatches().grow(rng, lost / 2)
    pixel = np.stack(np.meshgrid(*(np.arange(_PIXELS) / _PIXELS,) * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    is_lost = gone(pixel * (min(SIZE), min(SIZE)))
    ranges = np.where(is_lost, np.inf, ranges)
    kept = ~(is_lost & without_beam(pixel * (min(SIZE), min(SIZE))))
    beams = PixelBeams(np.tile(origin, (len(ranges), 1)), directions, ranges).select(kept)
    back = np.isfinite(beams.ranges)
    points = beams.origins[back] + beams.ranges[back, None] * beams.directions[back]
    measured = Measurements(points, sigma, 0.5, beams, np.flatnonzero(back))
    centres = np.column_stack([flat, np.zeros(len(flat))])
    shown = np.array([_shown_of_hole_scans(points, centre, radius) for centre in centres])
    return PlateTruth(kind, centres, radius, pitches, shown, measured)


def _shown_of_hole_scans(points: FloatArray, centre: FloatArray, radius: float) -> float:
    """Share of 36 directions in which the plate was measured just outside a hole."""
    offset = points - centre
    far = np.hypot(offset[:, 0], offset[:, 1])
    near = (np.abs(offset[:, 2]) < 1) & (far > radius) & (far < radius + 1.5)
    turn = np.arctan2(offset[near, 1], offset[near, 0])
    return len(np.unique((turn / (2 * np.pi) * 36).astype(int))) / 36
