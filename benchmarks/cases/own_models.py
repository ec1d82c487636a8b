# SPDX-License-Identifier: MIT
"""Real scans with the model that completion makes of them as their design, and changes planted in it."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from completion import CompletionOptions, complete
from completion.result.completed_model import CompletedModel
from nbv.scans.registering import register_request
from scenes.checks import FloatArray
from scenes.io.scan_request import ScanRequest, read_request
from scenes.mesh.design import Element, ElementMesh
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.scan.range_image import RangeImage

FOLDER = Path(os.environ.get("UNSEEN_DATA", "../shared/data")) / "range"
_LEAST_M2 = 0.3  # measured, of a surface that is changed
_BOX_M = 0.4, 0.4, 0.1
_CLEAR_M = 0.15  # around a thing that is not there
_LEAST_THROUGH = 400  # beams through its middle half
_TRIES = 4000


@dataclass(frozen=True, slots=True)
class RealSet:
    """Files of real scans, the tolerance that their instrument can tell, metres, and whether to register."""

    files: tuple[str, ...]
    tolerance_m: float
    origins: tuple[tuple[float, ...], ...] = ()
    is_registered: bool = True


SETS = {
    "tdtk": RealSet(("tdtk",), 0.04, is_registered=False),
    "pumpA": RealSet(("e57/pumpA.e57",), 0.01),
    "office1": RealSet(("pcl/office1.pcd",), 0.03),
    "pcl_room": RealSet(
        ("pcl_room/room_scan1.pcd", "pcl_room/room_scan2.pcd"), 0.04, ((0.0, 0.0, 0.0),) * 2,
        is_registered=False,
    ),
}  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class OwnModel:
    """Scans, the completed model of them as a design, and the measured area (E,) of its elements."""

    scans: tuple[RangeImage, ...]
    design: ElementMesh
    measured_m2: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Planted:
    """A design with three changes: surface ids of what was moved, added and removed.

    `moved_m` (3,) is the shift of the moved one; `removed` (m, 3, 3) are corners of what was removed.
    """

    design: ElementMesh
    moved: int
    added: int
    removed: int
    moved_m: FloatArray
    removed_corners: FloatArray


def own_model(name: str) -> OwnModel:
    """Complete the scans of a set, registered where they come without poses."""
    one = SETS[name]
    request = ScanRequest(tuple(str(FOLDER / file) for file in one.files), origins=one.origins)
    given = read_request(request) if one.is_registered else register_request(request).given
    model = complete(given.scans, CompletionOptions(texture=False), rng=0)
    scans = tuple(scan.with_facts(name=f"{name} {k}") for k, scan in enumerate(model.scans, start=1))
    return OwnModel(scans, as_design(model, name), np.array([
        *(surface.patch.observed_m2 for surface in model.surfaces), 0.0
    ]))  # fmt: skip


def as_design(model: CompletedModel, name: str) -> ElementMesh:
    """Return the light model of a completion: an element for each surface, and one for the rest."""
    vertices, faces, surface, start = [], [], [], 0
    rest = model.light_remainder
    parts: list[tuple[int, FloatArray, NDArray[np.integer]]] = [
        *((one.number - 1, one.part.vertices, one.part.faces) for one in model.textured),
        (len(model.surfaces), rest.vertices, rest.faces),
    ]
    for number, points, triangles in parts:
        vertices.append(model.world_from_reference.apply(np.asarray(points, float)))
        faces.append(np.asarray(triangles, np.int32) + start)
        surface.append(np.full(len(triangles), number, np.int32))
        start += len(points)
    elements = [
        Element(f"surface {k + 1} {patch.grid.surface.kind}") for k, patch in enumerate(model.patches)
    ]
    mesh = LabelledMesh(np.concatenate(vertices), np.concatenate(faces), np.concatenate(surface))
    return ElementMesh(mesh, (*elements, Element("remainder")), name)


def planted(own: OwnModel, shift_m: float, seed: int) -> Planted:
    """Move one plane along its normal, leave out another, and put a box into space that beams passed."""
    rng = np.random.default_rng([48, seed])
    mesh = own.design.mesh
    flat = [k for k, one in enumerate(own.design.elements) if one.name.endswith("plane")]
    usable = [k for k in flat if own.measured_m2[k] >= _LEAST_M2]
    moved, removed = (int(k) for k in rng.choice(usable, 2, replace=False))
    areas, normals = mesh.face_areas(), mesh.face_normals()
    of_moved = mesh.face_surface == moved
    normal = normals[of_moved][np.argmax(areas[of_moved])]
    shift = shift_m * rng.choice([-1.0, 1.0]) * normal
    corners = mesh.corners.copy()
    corners[of_moved] += shift
    kept = mesh.face_surface != removed
    box = _box(_free_place(own.scans, rng), rng)
    every = np.concatenate([corners[kept], box])
    surface = np.concatenate([
        mesh.face_surface[kept], np.full(len(box), len(own.design.elements), np.int32)
    ]).astype(np.int32)  # fmt: skip
    changed = LabelledMesh(
        every.reshape(-1, 3), np.arange(3 * len(every), dtype=np.int32).reshape(-1, 3), surface
    )
    elements = (*own.design.elements, Element("box that is not there"))
    design = ElementMesh(changed, elements, own.design.name)
    return Planted(design, moved, len(own.design.elements), removed, shift, corners[~kept])


def _free_place(scans: tuple[RangeImage, ...], rng: np.random.Generator) -> FloatArray:
    """A place that many beams passed, far from all that was measured."""
    points = np.concatenate([scan.points()[scan.valid] for scan in scans])
    tree = cKDTree(points)
    best, most = np.zeros(3), -1
    for _ in range(_TRIES // 100):
        scan = scans[rng.integers(len(scans))]
        ends = scan.points()[scan.valid]
        place = scan.origin + rng.uniform(0.3, 0.8, (100, 1)) * (
            ends[rng.integers(len(ends), size=100)] - scan.origin
        )
        away = tree.query(place)[0]
        for k in np.flatnonzero(away > np.linalg.norm(_BOX_M) / 2 + _CLEAR_M):
            ways = ends - scan.origin
            length = np.linalg.norm(ways, axis=1)
            along = (place[k] - scan.origin) @ (ways / length[:, None]).T
            off = np.linalg.norm(place[k] - scan.origin - along[:, None] * ways / length[:, None], axis=1)
            passed = int(((off < _BOX_M[0] / 4) & (length > along + _BOX_M[0])).sum())
            if passed > most:
                best, most = place[k], passed
        if most > _LEAST_THROUGH:
            break
    return best


def _box(place: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Triangles (12, 3, 3) of a box, its outside outside."""
    import trimesh

    box = trimesh.creation.box(_BOX_M)
    turn = trimesh.transformations.random_rotation_matrix(rng.random(3))[:3, :3]
    return np.asarray(box.vertices[box.faces] @ turn.T + place)
