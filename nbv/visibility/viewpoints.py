# SPDX-License-Identifier: MIT
"""Candidate viewpoints: positions, and the directions in which the sensor may look from each."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from trimesh.creation import icosphere

from nbv.scanning.sensor import Sensor
from nbv.visibility.limits import MOST_POSITIONS, SAME_M, SPACING_M
from nbv.visibility.site_options import TRIPOD_HEIGHTS_M
from nbv.visibility.zones import Zones
from scenes.checks import BoolArray, FloatArray, InputError, Value, check_places, frozen_copy
from scenes.io.checks.guard import guard_reading
from scenes.io.clouds.npz import open_arrays
from scenes.pose import Pose, rotations_towards

_OPTIONAL = ("half_angle_deg", "patch_points", "patch_normals")  # entries of a file of candidates


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Candidates(Value):
    """Where a sensor may stand and look.

    Parameters
    ----------
    positions : (p, 3) float
        World coordinates, metres.
    directions : (d, 3) or (p, d, 3) float
        Unit viewing directions: the same for every position, or each position's own.
    patch_points, patch_normals : (n, 3) float, optional
        Surface patches that belong to a fixed planning instance.
    half_angle_deg : float, optional
        A conical aperture that replaces the sensor's.

    Raises
    ------
    InputError
        No candidates, shapes that do not fit, directions without length, patches without normals.
    """

    positions: FloatArray
    directions: FloatArray
    patch_points: FloatArray | None = None
    patch_normals: FloatArray | None = None
    half_angle_deg: float | None = None

    def __repr__(self) -> str:
        return f"Candidates({self.n_positions} positions x {self.n_directions} directions)"

    def __post_init__(self) -> None:
        positions = check_places("positions", self.positions)
        directions = np.asarray(self.directions, dtype=np.float64)
        flag = directions.ndim == 3 and len(directions) == len(positions)
        if directions.shape[-1:] != (3,) or not (directions.ndim == 2 or flag):
            raise InputError(
                f"expected directions (d, 3) or (p, d, 3) for p = {len(positions)}, got {directions.shape}"
            )
        length = np.linalg.norm(directions, axis=-1, keepdims=True)
        if not (np.isfinite(length) & (length > 0)).all():
            raise InputError("candidate directions must be finite and not zero")
        if (self.patch_points is None) != (self.patch_normals is None):
            raise InputError("patch_points and patch_normals belong together; give both or neither")
        if self.half_angle_deg is not None and not 0 < self.half_angle_deg < 90:
            raise InputError(f"half_angle_deg must lie in 0..90 deg, got {self.half_angle_deg}")
        for name in ("patch_points", "patch_normals"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, frozen_copy(check_places(name, getattr(self, name))))
        if self.patch_points is not None and self.patch_normals is not None:
            n_points, n_normals = len(self.patch_points), len(self.patch_normals)
            if n_points != n_normals:
                raise InputError(f"{n_points} patch_points need as many patch_normals, got {n_normals}")
        object.__setattr__(self, "positions", frozen_copy(positions))
        object.__setattr__(self, "directions", frozen_copy(directions / length))

    @property
    def n_positions(self) -> int:
        """How many positions there are."""
        return len(self.positions)

    @property
    def n_directions(self) -> int:
        """How many directions each position has."""
        return int(self.directions.shape[-2])

    @property
    def n_poses(self) -> int:
        """How many poses there are to choose from."""
        return self.n_positions * self.n_directions

    def rotations(self) -> FloatArray:
        """World-from-sensor rotations (d, 3, 3) or (p, d, 3, 3) of the directions."""
        flat = self.directions.reshape(-1, 3)
        return rotations_towards(flat).reshape(*self.directions.shape[:-1], 3, 3)

    def rotations_at(self, position: int) -> FloatArray:
        """Rotations (d, 3, 3) of one position."""
        directions = self.directions if self.directions.ndim == 2 else self.directions[position]
        return rotations_towards(directions)

    def pose(self, number: int) -> Pose:
        """Return pose `number`: position number // d with direction number % d."""
        i, j = divmod(number, self.n_directions)
        direction = self.directions[j] if self.directions.ndim == 2 else self.directions[i, j]
        return Pose.looking_at(self.positions[i], self.positions[i] + direction)

    def at(self, chosen: NDArray[np.int64] | BoolArray) -> Candidates:
        """Return the candidates at the positions chosen by a mask (p,) or numbers (m,)."""
        directions = self.directions if self.directions.ndim == 2 else self.directions[chosen]
        return replace(self, positions=self.positions[chosen], directions=directions)


def allowed_candidates(candidates: Candidates, zones: Zones) -> Candidates:
    """Return the candidates whose positions need not be kept out of.

    Raises
    ------
    InputError
        There are none.
    """
    kept = zones.allow(candidates.positions)
    if not kept.any():
        raise InputError(
            f"all {candidates.n_positions} candidate positions lie in --keep-out boxes; "
            "make the boxes smaller, or give other candidates"
        )
    return candidates if kept.all() else candidates.at(kept)


def at_chosen_heights(
    candidates: Candidates, spots: FloatArray, taken: FloatArray, taken_spots: FloatArray
) -> Candidates:
    """Return the candidates without those at other heights over a spot where a station stands.

    Parameters
    ----------
    candidates : Candidates
        Of p positions.
    spots, taken_spots : (p, 3), (t, 3) float
        Alike for what is over one spot of the floor (`nbv.visibility.site.Site.spots`).
    taken : (t, 3) float
        Where the stations are, metres.
    """
    kept = np.ones(candidates.n_positions, np.bool_)
    for place, spot in zip(taken, taken_spots, strict=True):
        elsewhere = np.abs(candidates.positions - place).max(axis=1) > SAME_M
        kept &= ~((spots == spot).all(axis=1) & elsewhere)
    return candidates if kept.all() else candidates.at(kept)


def load_candidates(path: str | Path) -> Candidates:
    """Return the candidates of an .npz file: `positions`, `directions`, and what else `Candidates` holds.

    Parameters
    ----------
    path : str or path
        World coordinates, metres; entries that `Candidates` does not know are left alone.

    Raises
    ------
    InputError
        No such file, not an .npz, a missing or unusable entry.
    """
    with open_arrays(Path(path)) as arrays:
        wanted = [key for key in _OPTIONAL if key in arrays.files]
        held = {key: arrays[key] for key in ("positions", "directions", *wanted)}
    with guard_reading(Path(path), "candidates"):
        half_angle = float(held["half_angle_deg"]) if "half_angle_deg" in held else None
        patches = held.get("patch_points"), held.get("patch_normals")
        candidates = Candidates(held["positions"], held["directions"], *patches, half_angle)
    if not candidates.n_poses:
        raise InputError(f"{path} holds no candidates")
    return candidates


def sphere_directions(subdivisions: int) -> FloatArray:
    """Unit directions (d, 3) all round: 12, 42, 162 ... for 0, 1, 2 subdivisions of the icosahedron."""
    return np.array(icosphere(subdivisions=subdivisions).vertices, dtype=np.float64)


def sensor_directions(sensor: Sensor, subdivisions: int = 1) -> FloatArray:
    """Unit directions (d, 3) worth trying: all round for a camera, one for a sensor that turns by itself."""
    if sensor.kind == "spherical":
        return np.array([[1.0, 0.0, 0.0]])
    return sphere_directions(subdivisions)


def room_lattice(
    bounds: FloatArray,
    *,
    spacing_m: float | None = None,
    heights_m: tuple[float, ...] = TRIPOD_HEIGHTS_M,
    clearance_m: float = 0.3,
) -> FloatArray:
    """Positions (p, 3) on a lattice over a room's floor, at the heights of a tripod.

    Which of them are free is for the caller to say (`nbv.visibility.standing_room` for a known scene, the
    voxel map for an unknown one). Without `spacing_m` it is 0.5 m, or more where that makes above 600
    positions.

    Parameters
    ----------
    bounds : (2, 3) float
        The room, metres.
    spacing_m, clearance_m : float
        Between positions, and to the bounds, metres.
    heights_m : tuple of float
        Above the lowest bound, metres; those too near to the ceiling are left out.
    """
    low, high = np.asarray(bounds, dtype=np.float64)
    floor = np.maximum(high - low, 1e-9)[:2]
    heights = np.array([h for h in heights_m if clearance_m <= h <= high[2] - low[2] - clearance_m])
    if not len(heights):
        heights = np.array([(high[2] - low[2]) / 2])
    spacing = spacing_m or max(SPACING_M, float(np.sqrt(np.prod(floor) * len(heights) / MOST_POSITIONS)))
    x, y = (line_positions(low[axis], high[axis], spacing, clearance_m) for axis in range(2))
    return np.stack(np.meshgrid(x, y, low[2] + heights, indexing="ij"), axis=-1).reshape(-1, 3)


def line_positions(low: float, high: float, spacing: float, clearance: float) -> FloatArray:
    """Positions (n,) between two bounds, metres; the middle where none fits."""
    first = low + clearance + 0.1  # a little further in than the clearance, so that rounding decides nothing
    n = max(int(np.floor((high - clearance - first) / spacing + 1e-9)) + 1, 0)
    return np.asarray(first + spacing * np.arange(n) if n else [(low + high) / 2], dtype=np.float64)


def viewing_sphere(
    bounds: FloatArray, sensor: Sensor, n_positions: int = 200, *, all_round: bool = True
) -> Candidates:
    """Candidates on a sphere around an object with `bounds` (2, 3), metres, each looking at its centre.

    The sphere is as small as lets the aperture hold the bounding sphere, with 5 % to spare, within the
    sensor's range. Without `all_round` those positions are left out that lie below the lower bound, the
    plane that the object stands on.

    Raises
    ------
    InputError
        The sensor's range gate does not fit around the object.
    """
    low, high = np.asarray(bounds, dtype=np.float64)
    centre, inner = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
    radius = max(1.05 * inner / np.sin(_half_aperture(sensor)), inner + sensor.min_range_m)
    if radius - inner > sensor.max_range_m:
        raise InputError(
            f"an object of {2 * inner:.3g} m does not fit into {sensor.name}: "
            f"it must stand {radius:.3g} m away and reaches {sensor.max_range_m:.3g} m"
        )
    turns = np.arange(n_positions) * (np.pi * (3 - np.sqrt(5)))
    height = 1 - (2 * np.arange(n_positions) + 1) / n_positions
    across = np.sqrt(1 - height**2)
    outward = np.stack([across * np.cos(turns), across * np.sin(turns), height], axis=1)
    positions = centre + radius * outward
    kept = np.ones(n_positions, np.bool_) if all_round else positions[:, 2] > low[2]
    return Candidates(positions[kept], -outward[kept, None])


def _half_aperture(sensor: Sensor) -> float:
    """Half angle in radians of the largest cone about z inside the aperture, at most 45 deg."""
    angles = np.radians(np.arange(0.25, 45.1, 0.25))
    around = np.radians(np.arange(0, 360, 15.0))
    angle, turn = np.meshgrid(angles, around, indexing="ij")
    rim = np.stack([np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), np.cos(angle)], axis=-1)
    held = sensor.sees(rim).all(axis=1)
    return float(angles[max(int(np.argmin(held)) - 1, 0)] if not held.all() else angles[-1])
