# SPDX-License-Identifier: MIT
"""Up: which way is up for scans, by their planes and how sensors are held.

Of planes with normals n_i towards the sensor, standard deviations s_i and weights w_i, up u is most probable
where log p(u) + sum_i w_i log f(n_i; u) is greatest. f is a mixture of densities on the sphere: level planes,
upright ones along two horizontal directions at right angles, other upright ones, and any. Level planes and
upright ones along a direction are both densities about a point, so that turning the axes of a room into each
other changes little. Which of them is up is told by planes that face up, and by how sensors are held, p.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from completion.observe.observation import Observation
from completion.room import limits
from completion.room.planes import RoomPlane
from scenes.checks import FloatArray
from scenes.inclination import Up
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import POINTS_SENSOR

_Z = np.array([0.0, 0.0, 1.0])
_ROUNDS = 4  # of refinement
LogPrior = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, slots=True, eq=False)
class PlaneNormals:
    """Planes as they tell up.

    Attributes
    ----------
    normal : (n, 3) float
        Unit normals towards the sensor, world.
    sd : (n,) float
        Standard deviations of their directions, radians, with how far what is built leans.
    weight : (n,) float
        What each counts for: planes that face one way count together as the root of their area, since pieces
        of one wall are not independent.
    """

    normal: FloatArray
    sd: FloatArray
    weight: FloatArray

    @classmethod
    def of(cls, looked_at: Sequence[RoomPlane | None], world_from_reference: Pose) -> PlaneNormals:
        """Look at the planes among surfaces of the working frame."""
        planes = [plane for plane in looked_at if plane is not None]
        area = np.array([plane.area_m2 for plane in planes])
        normal = np.array([plane.normal for plane in planes]).reshape(-1, 3)
        same_way = (normal @ normal.T > np.cos(np.radians(limits.APART_DEG))) @ area
        weight = area / np.sqrt(np.maximum(same_way, 1e-12))
        weight /= max(float(weight.max(initial=0.0)), 1e-12)
        tilt, widest = np.array([plane.tilt_sd for plane in planes]), np.radians(limits.WIDEST_DEG)
        sd = np.minimum(np.hypot(tilt, np.radians(limits.LEAN_DEG)), widest)
        return cls(world_from_reference.rotate(normal), sd, weight)

    def densities(self, up: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """Of the normals (n,) under `up` (3,): as level planes, as upright ones, and as any."""
        cosine = np.clip(self.normal @ up, -1.0, 1.0)
        from_up, from_level = np.arccos(np.abs(cosine)), np.arcsin(np.abs(cosine))
        across = self.normal @ np.linalg.svd(up[None])[2][1:].T
        azimuth = np.arctan2(across[:, 1], across[:, 0])
        upright = self.weight * np.exp(-(from_level**2) / (2 * self.sd**2))
        walls = np.angle((upright * np.exp(4j * azimuth)).sum()) / 4
        beside = np.abs((azimuth - walls + np.pi / 4) % (np.pi / 2) - np.pi / 4)
        facing = np.where(cosine > 0, limits.FACING_UP, 2.0 - limits.FACING_UP)
        level = limits.LEVEL_SHARE * facing / 2 * _about_a_point(from_up, self.sd)
        along = limits.ALONG_SHARE / 4 * _about_a_point(np.hypot(from_level, beside), self.sd)
        ring = limits.UPRIGHT_SHARE * np.exp(-(from_level**2) / (2 * self.sd**2))
        ring /= np.sqrt(2 * np.pi) * self.sd * 2 * np.pi
        other = 1.0 - limits.LEVEL_SHARE - limits.ALONG_SHARE - limits.UPRIGHT_SHARE
        return level, along + ring, other / (4 * np.pi)

    def log_likelihood(self, up: FloatArray) -> float:
        """Of `up` (3,), but for a constant."""
        level, upright, other = self.densities(up)
        return float(self.weight @ np.log(level + upright + other))

    def directions(self) -> FloatArray:
        """Directions (k, 3) that may be up: normals of the largest planes, and at right angles to two."""
        largest = np.argsort(-self.weight, kind="stable")
        able = [self.normal[largest[: limits.N_LARGEST]]]
        for first, second in combinations(largest[: limits.N_CROSSED], 2):
            across = np.cross(self.normal[first], self.normal[second])
            size = float(np.linalg.norm(across))
            if size > limits.LEAST_CROSS:
                able.append(across[None] / size)
        return np.concatenate([part for each in able for part in (each, -each)])

    def refine(self, start: FloatArray) -> tuple[FloatArray, float]:
        """Return the best direction (3,) near a start, and its standard deviation, radians.

        Where planes tell nothing it stays at the start, which is as uncertain as how cameras are held.
        """
        up, held = start, 1.0 / np.radians(limits.PITCH_DEG[1]) ** 2
        for _ in range(_ROUNDS):
            level, upright = self._responsibilities(up)
            matrix = np.einsum("i,ij,ik->jk", upright, self.normal, self.normal)
            matrix += (level.sum() + held) * np.eye(3)
            up = np.linalg.solve(matrix, (level * np.sign(self.normal @ up)) @ self.normal + held * start)
            up = up / np.linalg.norm(up)
        level, upright = self._responsibilities(up)
        across = self.normal @ np.linalg.svd(up[None])[2][1:].T
        information = np.einsum("i,ij,ik->jk", upright, across, across) + (level.sum() + held) * np.eye(2)
        return up, float(np.sqrt(1.0 / np.linalg.eigvalsh(information)[0]))

    def _responsibilities(self, up: FloatArray) -> tuple[FloatArray, FloatArray]:
        """How much each plane (n,) tells as a level one, and as an upright one, 1/rad2."""
        level, upright, other = self.densities(up)
        scale = self.weight / (level + upright + other) / self.sd**2
        return level * scale, upright * scale


def _about_a_point(angle: FloatArray, sd: FloatArray) -> FloatArray:
    """Density on the sphere of a direction at an angle from another; per steradian."""
    return np.asarray(np.exp(-(angle**2) / (2 * sd**2)) / (2 * np.pi * sd**2))


def _normal_density(angle: FloatArray, mean_deg: float, sd_deg: float) -> FloatArray:
    """Of angles in radians; per radian."""
    sd = np.radians(sd_deg)
    off = (angle - np.radians(mean_deg)) / sd
    return np.asarray(np.exp(-(off**2) / 2) / (np.sqrt(2 * np.pi) * sd))


def _near(ups: FloatArray, axis: FloatArray, sd_deg: float) -> FloatArray:
    """Density (n,) of directions (n, 3) about an axis (3,), per steradian."""
    return _about_a_point(np.arccos(np.clip(ups @ axis, -1.0, 1.0)), np.radians(sd_deg))


def _prior(observations: Sequence[Observation], world_from_reference: Pose) -> tuple[LogPrior, FloatArray]:
    """The log prior of up by how sensors are held, and directions (k, 3) that it favours; world."""
    scans = [seen.scan for seen in observations]
    rotations = [world_from_reference.rotation @ scan.world_from_sensor.rotation for scan in scans]
    cameras = [
        (turn[:, 1] * (1.0 if scan.projection.fy < 0 else -1.0), turn[:, 2])
        for scan, turn in zip(scans, rotations, strict=True)
        if isinstance(scan.projection, PinholeProjection)
    ]
    if cameras:
        return _prior_of_cameras(np.array(cameras))
    if all(scan.sensor.startswith(POINTS_SENSOR) for scan in scans):
        share_z, share_y = limits.FILE_AXES
        _, y, z = np.eye(3)

        def of_points(ups: FloatArray) -> FloatArray:
            near_z, near_y = (_near(ups, axis, limits.SCANNER_DEG) for axis in (z, y))
            return np.log(share_z * near_z + share_y * near_y + (1 - share_z - share_y) / (4 * np.pi))

        return of_points, np.eye(3)

    def of_scanners(ups: FloatArray) -> FloatArray:
        near = limits.SCANNER_SHARE * _near(ups, _Z, limits.SCANNER_DEG)
        return np.log(near + (1 - limits.SCANNER_SHARE) / (4 * np.pi))

    return of_scanners, _Z[None]


def _prior_of_cameras(cameras: FloatArray) -> tuple[LogPrior, FloatArray]:
    """The same by cameras (n, 2, 3): where the upper sides of their images are, and where they look."""
    held, forward = cameras.mean(axis=0)
    if np.linalg.norm(held) < limits.LEAST_HELD:  # held every way: nothing is known of up
        return lambda ups: np.full(len(ups), -np.log(4 * np.pi)), _Z[None]
    held = held / np.linalg.norm(held)
    looks_one_way = np.linalg.norm(forward) > limits.LEAST_TURNED
    side = np.cross(forward, held)
    in_file = limits.FILE_SHARE * float(held[2] > limits.LEAST_FACING)
    anyhow = 1.0 - limits.HELD_SHARE - in_file

    def log_prior(ups: FloatArray) -> FloatArray:
        if looks_one_way:
            roll = np.arcsin(np.clip(ups @ side / max(float(np.linalg.norm(side)), 1e-9), -1, 1))
            pitch = np.arctan2(-(ups @ forward) / np.linalg.norm(forward), ups @ held)
            density = _normal_density(roll, 0.0, limits.ROLL_DEG)
            density = density * _normal_density(pitch, *limits.PITCH_DEG)
        else:
            density = _near(ups, held, limits.PITCH_DEG[1])
        density = limits.HELD_SHARE * density + in_file * _near(ups, _Z, limits.FILE_DEG)
        return np.log(density + anyhow / (4 * np.pi))

    return log_prior, np.stack([_Z, held])


def find_up(
    planes: Sequence[RoomPlane | None], observations: Sequence[Observation], world_from_reference: Pose
) -> Up:
    """Find which way is up in the world of scans.

    Of all directions whose posterior is within `limits.MARGIN` of the best, that with the greatest prior is
    taken: walls and floors do not tell which of them is level. Another one of these that is far from it, and
    nearly as probable before, makes it undecided. An axis of the world itself is taken where it lies within
    its deviation, since worlds are mostly made so.

    Parameters
    ----------
    planes : sequence of RoomPlane or None
        The planes among what the scans show, working frame.
    observations : sequence of Observation
        The scans.
    world_from_reference : Pose
        From the working frame to the world.
    """
    normals = PlaneNormals.of(planes, world_from_reference)
    log_prior, favoured = _prior(observations, world_from_reference)
    tried = np.concatenate([favoured, normals.directions()])
    score = log_prior(tried) + [normals.log_likelihood(up) for up in tried]
    start = _spread(tried[np.argsort(-score, kind="stable")])
    refined = [normals.refine(up) for up in start]
    ups, sd = np.array([up for up, _ in refined]), np.array([sd for _, sd in refined])
    prior = log_prior(ups)
    posterior = prior + [normals.log_likelihood(up) for up in ups]
    able = posterior > posterior.max() - np.log(limits.MARGIN)
    best = int(np.argmax(np.where(able, prior, -np.inf)))
    up, sd_deg = ups[best], float(np.degrees(sd[best]))
    apart = ups @ up < np.cos(np.radians(limits.APART_DEG))
    is_decided = not (able & apart & (prior > prior[best] - np.log(limits.PRIOR_MARGIN))).any()
    is_decided &= sd_deg < limits.APART_DEG
    nearest = int(np.argmax(np.abs(up)))
    axis = np.copysign(1.0, up[nearest]) * np.eye(3)[nearest]
    angle_deg = float(np.degrees(np.arccos(np.clip(up @ axis, -1.0, 1.0))))
    if angle_deg <= limits.EXACT_SD * sd_deg:
        up = axis
    return Up(up, sd_deg, bool(is_decided), is_estimated=True)


def _spread(ups: FloatArray) -> list[FloatArray]:
    """The first of directions (n, 3), best first, and those that are far enough from all before them."""
    chosen: list[FloatArray] = []
    for up in ups:
        if all(up @ other < np.cos(np.radians(limits.REFINED_DEG)) for other in chosen):
            chosen.append(up)
        if len(chosen) == limits.N_REFINED:
            break
    return chosen
