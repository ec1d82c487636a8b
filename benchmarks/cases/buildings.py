# SPDX-License-Identifier: MIT
"""A building whose walls, slabs and ceilings are known as solids, and the rooms to scan it from."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nbv.visibility.site import find_site
from nbv.visibility.site_options import SiteOptions
from scenes import RayCaster
from scenes.checks import BoolArray, FloatArray
from scenes.world.scene import Scene

SHELL = ("IfcWall", "IfcSlab", "IfcCovering")
LEAVES = ("IfcDoor", "IfcWindow")
STEP_M = 0.04  # between the places at which sides are asked about
_OFF_M = 0.03  # before a side, from where rays start
_LEAST_M2 = 1.0  # of what rooms show of a side


@dataclass(frozen=True, slots=True, eq=False)
class Side:
    """A side of a wall."""

    element: int  # its number
    normal: FloatArray  # (3,) float: Outwards, along an axis
    places: FloatArray  # (n, 3) float: On it, all over its rectangle, each for `STEP_M` squared
    is_shown: BoolArray  # (n,) bool: Where the wall is and a room is before it

    @property
    def area_m2(self) -> float:
        """Of what rooms show."""
        return float(self.is_shown.sum()) * STEP_M**2


@dataclass(frozen=True, eq=False)
class TrueBuilding:
    """A building as solids, world coordinates, metres.

    `vertices`, `faces`, `element`: a mesh and each face's element. `shell`, `closed`: of walls, slabs and
    ceilings; of these with doors and windows.
    """

    vertices: FloatArray
    faces: NDArray[np.int64]
    element: NDArray[np.int64]
    classes: tuple[str, ...]  # the IFC class of each element
    shell: RayCaster
    closed: RayCaster
    shell_element: NDArray[np.int64]

    @classmethod
    def read(cls, path: Path) -> TrueBuilding:
        """Return the building of a file as described in the data's README."""
        held = np.load(path)
        classes = tuple(one for one, _ in json.loads(str(held["elements"])))
        return cls.of(held["vertices"].astype(float), held["faces"].astype(int), held["element"], classes)

    @classmethod
    def of(
        cls,
        vertices: FloatArray,
        faces: NDArray[np.int64],
        element: NDArray[np.int64],
        classes: tuple[str, ...],
    ) -> TrueBuilding:
        """Return the building of a mesh whose faces belong to elements of IFC classes."""
        own = np.array([one.startswith(SHELL) for one in classes])[element]
        shut = own | np.array([one.startswith(LEAVES) for one in classes])[element]
        return cls(
            vertices=vertices,
            faces=faces,
            element=element.astype(np.int64),
            classes=classes,
            shell=RayCaster(vertices, faces[own]),
            closed=RayCaster(vertices, faces[shut]),
            shell_element=element[own].astype(np.int64),
        )

    def box(self, number: int) -> FloatArray:
        """Smallest and largest coordinates (2, 3) of an element."""
        places = self.vertices[self.faces[self.element == number]].reshape(-1, 3)
        return np.stack([places.min(axis=0), places.max(axis=0)])

    def class_hit(self, places: FloatArray, way: FloatArray) -> NDArray[np.str_]:
        """The class (n,) of the first element from places (n, 3) on in a direction; "" for none."""
        hits = self.shell.first_hit(places, np.tile(way, (len(places), 1)))
        names = np.array([*self.classes, ""])
        return names[np.where(hits.hit, self.shell_element[hits.face], len(self.classes))]

    def sides(self) -> Iterator[Side]:
        """The sides of walls that rooms show at least a square metre of."""
        for number, name in enumerate(self.classes):
            if name.startswith("IfcWall") and (self.element == number).any():
                axis = int(np.argmin(np.ptp(self.box(number), axis=0)[:2]))
                for sign in (-1.0, 1.0):
                    side = self._side(number, axis, sign)
                    if side.area_m2 >= _LEAST_M2:
                        yield side

    def _side(self, number: int, axis: int, sign: float) -> Side:
        box = self.box(number)
        normal = sign * np.eye(3)[axis]
        across = [k for k in range(3) if k != axis]
        steps = [np.arange(box[0, k] + STEP_M / 2, box[1, k], STEP_M) for k in across]
        places = np.empty((len(steps[0]) * len(steps[1]), 3))
        places[:, across] = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 2)
        places[:, axis] = box[0 if sign < 0 else 1, axis]
        before = places + _OFF_M * normal
        hits = self.shell.first_hit(before, np.tile(-normal, (len(places), 1)))
        is_own = hits.hit & (self.shell_element[hits.face] == number) & (np.abs(hits.ranges - _OFF_M) < 1e-3)
        is_below_ceiling = self.class_hit(before, np.array([0.0, 0.0, 1.0])) == "IfcCovering"
        return Side(number, normal, places, is_own & is_below_ceiling)


_HEIGHT_M = 1.6


def station_places(scene: Scene, n: int) -> FloatArray:
    """Places (n, 3) to stand in the middle of the rooms with most of them, metres."""
    site = find_site(scene, SiteOptions(heights_m=(_HEIGHT_M,)), turns=True)
    largest = [room for room, _ in Counter(site.position_room.tolist()).most_common(n)]
    middles = []
    for room in largest:
        own = site.positions[site.position_room == room]
        middles.append(own[np.argmin(np.linalg.norm(own - np.median(own, axis=0), axis=1))])
    return np.array(middles)
