# SPDX-License-Identifier: MIT
"""Sphere and torus: distance, normal, ray hit, and charts of longitude and latitude or of arc lengths."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from scenes.checks import FloatArray, InputError, Value, check_direction, check_point, frozen_copy
from scenes.pose import Pose
from scenes.surfaces.surface import cross, reference_direction


@dataclass(frozen=True, slots=True, eq=False)
class Sphere(Value):
    """The sphere about `centre`, metres.

    No chart of a sphere is isometric (Gauss). This one is (radius * longitude, radius * latitude) about
    `pole_direction`, longitude counted from `zero_direction`: lengths are true along v everywhere and along
    u on the equator; elsewhere u is stretched by 1 / cos(latitude), and each pole is a whole line. Turn the
    pole away from the data. `concave` is True for a sphere seen from within.

    Examples
    --------
    >>> ball = Sphere(centre=(0, 0, 0), radius=0.5)
    >>> ball.distance(np.array([[0.0, 2.0, 0.0]])).tolist()
    [1.5]
    """

    centre: FloatArray
    radius: float
    pole_direction: FloatArray
    zero_direction: FloatArray
    concave: bool

    kind: ClassVar[str] = "sphere"

    def __init__(
        self,
        centre: object,
        radius: float,
        pole_direction: object = (0.0, 0.0, 1.0),
        zero_direction: object | None = None,
        concave: bool = False,
    ) -> None:
        if not np.isfinite(radius) or radius <= 0:
            raise InputError(f"radius must be a positive number of metres, got {radius}")
        pole = check_direction("pole_direction", pole_direction)
        object.__setattr__(self, "centre", frozen_copy(check_point("centre", centre)))
        object.__setattr__(self, "radius", float(radius))
        object.__setattr__(self, "pole_direction", frozen_copy(pole))
        object.__setattr__(self, "zero_direction", frozen_copy(reference_direction(pole, zero_direction)))
        object.__setattr__(self, "concave", bool(concave))

    @property
    def period(self) -> float:
        """The length of the equator: u returns after 2 pi r."""
        return float(2 * np.pi * self.radius)

    def distance(self, points: FloatArray) -> FloatArray:
        """Signed distance (n,): positive outside, or inside where the sphere is concave."""
        outward: FloatArray = np.linalg.norm(points - self.centre, axis=-1) - self.radius
        return np.negative(outward) if self.concave else outward

    def normal(self, points: FloatArray) -> FloatArray:
        """Unit normals (n, 3): away from the centre, or towards it where the sphere is concave."""
        radial = points - self.centre
        length = np.linalg.norm(radial, axis=-1, keepdims=True)
        outward = np.where(length > 0, radial / np.where(length > 0, length, 1.0), self.zero_direction)
        return -outward if self.concave else outward

    def to_uv(self, points: FloatArray) -> FloatArray:
        """Chart coordinates (n, 2): longitude and latitude of the feet of `points`, times the radius."""
        offset = points - self.centre
        ahead, height = offset @ self.zero_direction, offset @ self.pole_direction
        aside = offset @ cross(self.pole_direction, self.zero_direction)
        longitude, latitude = np.arctan2(aside, ahead), np.arctan2(height, np.hypot(ahead, aside))
        return self.radius * np.stack([longitude, latitude], axis=-1)

    def from_uv(self, uv: FloatArray) -> FloatArray:
        """Points (n, 3) of chart coordinates (n, 2)."""
        longitude, latitude = uv[..., :1] / self.radius, uv[..., 1:] / self.radius
        aside = cross(self.pole_direction, self.zero_direction)
        level = np.cos(longitude) * self.zero_direction + np.sin(longitude) * aside
        outward = np.cos(latitude) * level + np.sin(latitude) * self.pole_direction
        placed: FloatArray = self.centre + self.radius * outward
        return placed

    def ray_ranges(self, origins: FloatArray, directions: FloatArray) -> FloatArray:
        """Range (n,) along unit `directions` to the near side, or the far one where concave; else inf."""
        offset = origins - self.centre
        middle = -np.einsum("...i,...i->...", directions, offset)  # where the ray is nearest the centre
        nearest = offset + middle[..., None] * directions
        depth2 = self.radius**2 - np.einsum("...i,...i->...", nearest, nearest)
        half_chord = np.sqrt(np.maximum(depth2, 0.0))
        ranges = middle + half_chord if self.concave else middle - half_chord
        return np.where((depth2 >= 0) & (ranges >= 0), ranges, np.inf)

    def transform(self, pose: Pose) -> Sphere:
        """Return the sphere moved by `pose`."""
        return Sphere(
            pose.apply(self.centre),
            self.radius,
            pose.rotate(self.pole_direction),
            pose.rotate(self.zero_direction),
            self.concave,
        )

    transformed = transform  # earlier name


_N_POLISH = 3  # Newton steps on the distance along a ray, from the roots of its quartic
_CHUNK = 65_536  # rays at a time


@dataclass(frozen=True, slots=True, eq=False)
class Torus(Value):
    """The ring torus: all that is `tube_radius` away from the circle of `radius` about the axis.

    Its chart is (s, t): arc length s = radius * angle about the axis from `zero_direction`, counted along the
    circle in the tube's middle, and arc length t = tube_radius * angle about the tube, from the outermost
    circle towards `direction`. A torus does not unroll: t is metric, s on the circles of greatest and least
    height alone. `concave` is True where it is seen from within the tube (a fillet).

    Parameters
    ----------
    centre, direction : (3,) float
        Metres, and along the axis; made a unit vector.
    radius : float
        Of the circle in the tube's middle (the major radius), metres.
    tube_radius : float
        Of the tube (the minor radius), metres; less than `radius`.
    zero_direction : (3,) float, optional
        From the centre to where s is 0.
    concave : bool
        Whether it is seen from within the tube.

    Raises
    ------
    InputError
        Numbers that are not finite, a tube that reaches the axis (a spindle), a direction without length.

    Examples
    --------
    >>> ring = Torus(centre=(0, 0, 0), direction=(0, 0, 1), radius=2.0, tube_radius=0.5)
    >>> ring.distance(np.array([[4.0, 0, 0], [0, 0, 0], [0, 2, 1]])).tolist()
    [1.5, 1.5, 0.5]
    """

    centre: FloatArray
    direction: FloatArray
    radius: float
    tube_radius: float
    zero_direction: FloatArray
    concave: bool

    kind: ClassVar[str] = "torus"

    def __init__(
        self,
        centre: object,
        direction: object,
        radius: float,
        tube_radius: float,
        zero_direction: object | None = None,
        concave: bool = False,
    ) -> None:
        for name, length in (("radius", radius), ("tube_radius", tube_radius)):
            if not np.isfinite(length) or length <= 0:
                raise InputError(f"{name} must be a positive number of metres, got {length}")
        if tube_radius >= radius:
            raise InputError(
                f"a tube of radius {tube_radius:.6g} m about a circle of {radius:.6g} m reaches its axis "
                "(a spindle torus)"
            )
        axis = check_direction("direction", direction)
        object.__setattr__(self, "centre", frozen_copy(check_point("centre", centre)))
        object.__setattr__(self, "direction", frozen_copy(axis))
        object.__setattr__(self, "radius", float(radius))
        object.__setattr__(self, "tube_radius", float(tube_radius))
        object.__setattr__(self, "zero_direction", frozen_copy(reference_direction(axis, zero_direction)))
        object.__setattr__(self, "concave", bool(concave))

    @property
    def period(self) -> float:
        """Length of the circle in the tube's middle: s returns after it."""
        return float(2 * np.pi * self.radius)

    @property
    def tube_period(self) -> float:
        """The tube's circumference: t returns after it."""
        return float(2 * np.pi * self.tube_radius)

    def _level(self, offset: FloatArray, height: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Unit vectors away from the axis, and the distance from it."""
        radial = offset - height[..., None] * self.direction
        length = np.linalg.norm(radial, axis=-1)
        safe = np.where(length > 0, length, 1.0)[..., None]
        return np.where(length[..., None] > 0, radial / safe, self.zero_direction), length

    def distance(self, points: FloatArray) -> FloatArray:
        """Signed distance (n,): positive outside the tube, or inside where the torus is concave."""
        offset = points - self.centre
        height = offset @ self.direction
        _, length = self._level(offset, height)
        outward: FloatArray = np.hypot(length - self.radius, height) - self.tube_radius
        return np.negative(outward) if self.concave else outward

    def normal(self, points: FloatArray) -> FloatArray:
        """Unit normals (n, 3): away from the tube's middle, or towards it where the torus is concave."""
        offset = points - self.centre
        height = offset @ self.direction
        level, length = self._level(offset, height)
        away = (length - self.radius)[..., None] * level + height[..., None] * self.direction
        size = np.linalg.norm(away, axis=-1, keepdims=True)
        outward = np.where(size > 0, away / np.where(size > 0, size, 1.0), level)
        return -outward if self.concave else outward

    def to_uv(self, points: FloatArray) -> FloatArray:
        """Chart coordinates (n, 2): arc lengths of the feet of `points` about the axis and the tube."""
        offset = points - self.centre
        height, ahead = offset @ self.direction, offset @ self.zero_direction
        aside = offset @ cross(self.direction, self.zero_direction)
        about, around = np.arctan2(aside, ahead), np.arctan2(height, np.hypot(ahead, aside) - self.radius)
        return np.stack([self.radius * about, self.tube_radius * around], axis=-1)

    def from_uv(self, uv: FloatArray) -> FloatArray:
        """Points (n, 3) of chart coordinates (n, 2)."""
        about, around = uv[..., :1] / self.radius, uv[..., 1:] / self.tube_radius
        aside = cross(self.direction, self.zero_direction)
        level = np.cos(about) * self.zero_direction + np.sin(about) * aside
        reach = self.radius + self.tube_radius * np.cos(around)
        placed: FloatArray = (
            self.centre + reach * level + (self.tube_radius * np.sin(around)) * self.direction
        )
        return placed

    def ray_ranges(self, origins: FloatArray, directions: FloatArray) -> FloatArray:
        """Range (n,) along unit `directions` to the first hit of the seen side; else inf.

        A ray meets a torus in the roots of a quartic: the eigenvalues of its companion matrix, polished by
        Newton steps on the signed distance.
        """
        shape = np.broadcast(origins, directions).shape
        starts = np.broadcast_to(origins, shape).reshape(-1, 3)
        along = np.broadcast_to(directions, shape).reshape(-1, 3)
        ranges = np.full(len(starts), np.inf)
        middle = -np.einsum("ij,ij->i", along, starts - self.centre)  # where the ray is nearest the centre
        nearest = starts + middle[:, None] * along
        reach = self.radius + self.tube_radius
        near = np.flatnonzero(np.linalg.norm(nearest - self.centre, axis=1) <= reach)
        for first in range(0, len(near), _CHUNK):
            sample = near[first : first + _CHUNK]
            ranges[sample] = self._first_hits(nearest[sample], along[sample], -middle[sample])
        return (ranges + np.where(np.isfinite(ranges), middle, 0.0)).reshape(shape[:-1])

    def _first_hits(self, nearest: FloatArray, along: FloatArray, least: FloatArray) -> FloatArray:
        """Reach (n,) along rays from their points nearest to the centre, at `least` (n,); inf for none."""
        roots = self._crossings((nearest - self.centre) / self.radius, along) * self.radius
        for _ in range(_N_POLISH):
            place = nearest[:, None] + roots[..., None] * along[:, None]
            slope = np.einsum("nkj,nj->nk", self.normal(place), along)
            steep = np.where(np.abs(slope) < 1e-6, np.copysign(1e-6, slope), slope)
            step = self.distance(place) / steep
            roots = roots - np.clip(step, -0.1 * self.tube_radius, 0.1 * self.tube_radius)
        place = nearest[:, None] + roots[..., None] * along[:, None]
        facing = np.einsum("nkj,nj->nk", self.normal(place), along) < 0
        on_it = np.abs(self.distance(place)) < 1e-9 * self.radius
        reached = facing & on_it & (roots >= least[:, None])
        best: FloatArray = np.where(reached, roots, np.inf).min(axis=1)
        return best

    def _crossings(self, nearest: FloatArray, along: FloatArray) -> FloatArray:
        """Real parts (n, 4) of the roots of (|p|^2 + 1 - a^2)^2 = 4 (|p|^2 - h^2), in radii."""
        tube2 = (self.tube_radius / self.radius) ** 2
        height, rise = nearest @ self.direction, along @ self.direction
        square = np.einsum("ij,ij->i", nearest, nearest)  # p = nearest + t along, at right angles
        level = square + 1 - tube2
        zero = np.zeros_like(level)
        # t^4 + (2 level - 4 (1 - rise^2)) t^2 + 8 height rise t + level^2 - 4 (square - height^2)
        second = 2 * level - 4 * (1 - rise**2)
        companion = np.zeros((len(level), 4, 4))
        companion[:, 1:, :-1] = np.eye(3)
        companion[:, :, 3] = -np.stack(
            [level**2 - 4 * (square - height**2), 8 * height * rise, second, zero], axis=1
        )
        return np.asarray(np.linalg.eigvals(companion).real, dtype=np.float64)

    def transform(self, pose: Pose) -> Torus:
        """Return the torus moved by `pose`."""
        return Torus(
            centre=pose.apply(self.centre),
            direction=pose.rotate(self.direction),
            radius=self.radius,
            tube_radius=self.tube_radius,
            zero_direction=pose.rotate(self.zero_direction),
            concave=self.concave,
        )

    transformed = transform  # earlier name
