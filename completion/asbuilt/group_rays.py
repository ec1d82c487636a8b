# SPDX-License-Identifier: MIT
"""Group rays: what scans that are registered among themselves bring to a design: facets, and some beams."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from completion.observe.observation import observe
from completion.registration.facets import facets_of
from completion.room.up import PlaneNormals
from scenes.checks import FloatArray, InputError, IntArray
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage

GATE_M = 0.03
"""Between a beam's end and a surface of the design, along its normal, beside 3 sd of the range noise."""
_N_BEAMS = 3000  # of a scan, so that shares have a sampling error of 1 %
_AZIMUTHS, _HEIGHTS = 12, 4  # sectors of a scan, of equal solid angle
_FACET_SD, _ROUNDS = np.radians(1.5), 3  # of what single facets face, by which up is found


@dataclass(frozen=True, slots=True, eq=False)
class GroupRays:
    """What scans of one group measured, in the group's frame turned so that z is up.

    Attributes
    ----------
    turn : (3, 3) float
        Out of the group's frame.
    centre, normal, eye : (n, 3) float
        Middles of flat tiles, their unit normals towards the sensor, and where that stood.
    area : (n,) float
        What each stands for, square metres.
    origin, direction : (b, 3) float
        Some beams.
    range_m, gate_m : (b,) float
        Where they ended, and by how much they may miss a surface, along its normal.
    scan, block : (b,) int
        Whose they are, counted within the group, and of which sector of which scan.
    """

    turn: FloatArray
    centre: FloatArray
    normal: FloatArray
    eye: FloatArray
    area: FloatArray
    origin: FloatArray
    direction: FloatArray
    range_m: FloatArray
    gate_m: FloatArray
    scan: IntArray
    block: IntArray

    @classmethod
    def of(cls, scans: Sequence[RangeImage], poses: Sequence[Pose], up: FloatArray) -> GroupRays:
        """Return what scans measured, by their poses in the group; `up` (n, 3) is that of their own worlds.

        They know it to some degrees. What their facets face tells it to tenths.
        Raises InputError: no facet in any of them.
        """
        parts, said = [], np.zeros(3)
        for number, (scan, pose) in enumerate(zip(scans, poses, strict=True)):
            said += pose.rotate(up[number] @ scan.world_from_sensor.rotation)
            parts.append(_part(number, scan, pose))
        if not sum(len(part[0]) for part in parts):
            names = ", ".join(scan.name for scan in scans)
            raise InputError(f"{names}: no flat surface to place on a design; leave it out, or scan walls")
        joined = [np.concatenate(each) for each in zip(*parts, strict=True)]
        together = cls(np.eye(3), *joined)
        largest = float(together.area.max(initial=1e-12))
        weight = np.minimum(together.area / largest, 1.0)
        told = PlaneNormals(together.normal, np.full(len(weight), _FACET_SD), weight)
        direction = said / np.linalg.norm(said)
        for _ in range(_ROUNDS):
            direction, _ = told.refine(direction)
        return together._turned(_upright(direction))

    def _turned(self, turn: FloatArray) -> GroupRays:
        vectors = {
            name: getattr(self, name) @ turn.T for name in ("centre", "normal", "eye", "origin", "direction")
        }
        return replace(self, turn=turn, **vectors)

    def thin(self, step: int) -> GroupRays:
        """Return the same with every so many-th beam alone."""
        some = {each.name: getattr(self, each.name)[::step] for each in fields(self)[5:]}
        return replace(self, **some)


def _part(number: int, scan: RangeImage, pose: Pose) -> tuple[FloatArray | IntArray, ...]:
    """All that `GroupRays` has of a scan but the turn."""
    seen = observe(scan.with_facts(world_from_sensor=pose), Pose.identity())
    facets = facets_of(seen, curved=True)
    eye = np.tile(seen.scan.origin, (len(facets.area), 1))
    pixels = np.flatnonzero(seen.valid)
    step = np.sqrt(max(1.0, len(pixels) / _N_BEAMS))
    rows, columns = (np.arange(step / 2, n, step).astype(np.int64) for n in scan.ranges.shape)
    pixels = (rows[:, None] * scan.ranges.shape[1] + columns).ravel()
    pixels = pixels[seen.valid.ravel()[pixels]]
    ways = seen.points_at(pixels) - seen.scan.origin
    ranges = np.linalg.norm(ways, axis=1)
    ways = ways / ranges[:, None]
    in_sensor = pose.inverse().rotate(ways)
    azimuth = (np.arctan2(in_sensor[:, 0], in_sensor[:, 2]) / (2 * np.pi) + 0.5) * _AZIMUTHS
    height = (in_sensor[:, 1] + 1) / 2 * _HEIGHTS
    sector = [
        np.clip(each.astype(np.int64), 0, n - 1) for each, n in ((azimuth, _AZIMUTHS), (height, _HEIGHTS))
    ]
    block = (number * _AZIMUTHS + sector[0]) * _HEIGHTS + sector[1]
    origin = np.tile(seen.scan.origin, (len(ways), 1))
    gate = GATE_M + 3 * seen.noise.deviation(ranges)
    scans = np.full(len(ways), number)
    return facets.centre, -facets.normal, eye, facets.area, origin, ways, ranges, gate, scans, block


def _upright(up: FloatArray) -> FloatArray:
    """The rotation (3, 3) that turns `up` (3,) to z by the least angle."""
    axis = np.cross(up, [0.0, 0.0, 1.0])
    cosine = float(up[2])
    if cosine < -0.999:
        return np.diag([1.0, -1.0, -1.0])
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.asarray(np.eye(3) + cross + cross @ cross / (1 + cosine))
