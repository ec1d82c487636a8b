# SPDX-License-Identifier: MIT
"""Site options: what a surveyor says of where stations may stand."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial import cKDTree

from nbv.visibility.samples import sample_surface
from nbv.visibility.viewpoints import TRIPOD_HEIGHTS_M
from scenes.checks import BoolArray, FloatArray, InputError
from scenes.mesh.labelled_mesh import LabelledMesh

CLEARANCE_M = 0.3
_FINENESS = 5.0  # samples along the clearance: distances are right to a hundredth of it
_MOST_SAMPLES = 2e6


@dataclass(frozen=True, slots=True, eq=False)
class Clearance:
    """Dense samples of a mesh, among which places are to keep `clearance_m` metres."""

    clearance_m: float
    surface: cKDTree

    @classmethod
    def of(cls, mesh: LabelledMesh, clearance_m: float = CLEARANCE_M) -> Clearance:
        """Sample a mesh; its samples are at most two million, and then further apart."""
        spacing = max(clearance_m / _FINENESS, float(np.sqrt(mesh.face_areas().sum() / _MOST_SAMPLES)))
        samples = sample_surface(mesh, spacing)
        tree = cKDTree(
            samples.points, balanced_tree=False, compact_nodes=False
        )  # built in a third of the time
        return cls(clearance_m, tree)

    @classmethod
    def of_points(cls, points: FloatArray, clearance_m: float = CLEARANCE_M) -> Clearance:
        """Return the clearance from points (n, 3) that lie densely on what is to be kept clear of, metres."""
        cells = np.floor(points / (clearance_m / _FINENESS)).astype(np.int64)
        low, high = cells.min(axis=0), cells.max(axis=0)
        numbers = np.ravel_multi_index((cells - low).T, (high - low + 1).tolist())
        return cls(clearance_m, cKDTree(points[np.unique(numbers, return_index=True)[1]]))

    def holds(self, positions: FloatArray) -> BoolArray:
        """Tell at which positions (p, 3) no surface is nearer than the clearance."""
        distance, _ = self.surface.query(positions, workers=1)
        return np.asarray(distance >= self.clearance_m - 1e-9)


@dataclass(frozen=True, slots=True, kw_only=True)
class SiteOptions:
    """Which rooms to stand in, and where in them.

    Attributes
    ----------
    rooms : "all", "connected" or tuple of int
        All of the scene; those to which one walks from the largest; or these numbers.
    outdoors : bool
        Whether a station may stand outside.
    all_round : bool
        Whether an object may be looked at from below the plane that it stands on.
    heights_m : tuple of float, optional
        Of the sensor above the floor, metres; 0.4, 1.0, 1.6 and 2.2 when not given.
    spacing_m : float, optional
        Between places, metres; 0.5 when not given, 1 from 60 m2 of floor on.
    clearance_m : float
        From the sensor to every surface, metres.
    start : (2,) or (3,) tuple of float, optional
        Where the first station stands: x, y and, if it matters, z of the sensor, metres.
    several_heights : bool
        Whether a plan may put stations at several heights over one spot of the floor.

    Raises
    ------
    InputError
        A height, spacing or clearance that is not positive; rooms that are no numbers from 1; a start that
        is not two or three finite numbers.
    """

    rooms: Literal["all", "connected"] | tuple[int, ...] = "all"
    outdoors: bool = False
    all_round: bool = False
    heights_m: tuple[float, ...] | None = None
    spacing_m: float | None = None
    clearance_m: float = CLEARANCE_M
    start: tuple[float, ...] | None = None
    several_heights: bool = False

    def __post_init__(self) -> None:
        lengths = {"clearance_m": (self.clearance_m,), "heights_m": self.heights_m or (), "spacing_m": ()}
        if self.heights_m is not None and not self.heights_m:
            raise InputError("heights_m holds no height; give at least one, or leave it out")
        if self.spacing_m is not None:
            lengths["spacing_m"] = (self.spacing_m,)
        for name, values in lengths.items():
            if wrong := [value for value in values if not (np.isfinite(value) and value > 0)]:
                raise InputError(f"{name} must be positive, metres, got {wrong[0]}")
        if self.start is not None and not (len(self.start) in (2, 3) and np.isfinite(self.start).all()):
            raise InputError(f"start is X,Y or X,Y,Z, finite numbers of metres, got {self.start}")
        named = self.rooms if isinstance(self.rooms, tuple) else ()
        if wrong_rooms := [room for room in named if room < 1]:
            raise InputError(f"rooms are numbered from 1, got {wrong_rooms[0]}")
        if isinstance(self.rooms, str) and self.rooms not in ("all", "connected"):
            raise InputError(f"rooms must be all, connected, or their numbers, got {self.rooms!r}")

    @property
    def heights_above_floor_m(self) -> tuple[float, ...]:
        """Heights at which the sensor may be above the floor, metres."""
        return self.heights_m or TRIPOD_HEIGHTS_M

    def heights_in_words(self) -> str:
        """Return the heights of the sensor for people."""
        return ",".join(f"{height:g}" for height in self.heights_above_floor_m) + " m"
