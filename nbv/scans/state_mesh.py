# SPDX-License-Identifier: MIT
"""State mesh: what scans have measured, what was inferred, and where the unknown begins, as one mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from nbv.online.limits import MOST_SCAN_PIXELS, REACH_PX
from nbv.scans.measured_area import PixelQuality
from nbv.scans.scan_coverage import ScanCoverage
from nbv.scans.scan_mesh import scan_faces
from nbv.visibility.requirement import Requirement
from scenes.checks import BoolArray, FloatArray
from scenes.mesh.labelled_mesh import LabelledMesh, join_meshes
from scenes.scan.colour import colour_bytes
from scenes.scan.range_image import RangeImage

MEASURED, SEEN_WORSE, INFERRED, SHADOW, FRONTIER = range(5)
STATES = ("measured as required", "measured worse than required", "inferred", "edge of a shadow", "frontier")
_DRAWN_PIXELS, _LEAST_PIXELS = 300_000, 30_000  # of all scans together, and of each at least
_GREY = 160


@dataclass(frozen=True, slots=True, eq=False)
class StateMesh:
    """Triangles of surface and of boundary in world coordinates, n vertices in metres and m faces.

    Each face's `face_surface` is its state, an index into `STATES`; `front` (m, 3) is to which side it looks.
    Vertices have a `state` (n,), a `cosine` (n,) of incidence where they were measured and it is known, else
    0, and a natural `colour` (n, 3), sRGB; mid grey where none is known.
    """

    mesh: LabelledMesh
    state: NDArray[np.uint8]
    cosine: NDArray[np.float32]
    front: FloatArray
    colour: NDArray[np.uint8]

    @classmethod
    def of(cls, coverage: ScanCoverage) -> StateMesh:
        """Return the mesh of a coverage."""
        voxel_m, scans = coverage.scan_map.voxels.grid.voxel_m, coverage.scan_map.scans
        n_most = min(MOST_SCAN_PIXELS, max(_DRAWN_PIXELS // len(scans), _LEAST_PIXELS))
        parts = [_measured_points(scan, coverage.requirement, voxel_m / 2, n_most) for scan in scans]
        if coverage.completion is not None:
            inferred = coverage.completion.hypothesised
            vertices = coverage.completion.world_from_reference.apply(inferred.vertices)
            parts.append(_plain(vertices, inferred.faces, INFERRED, colour=inferred.colour))
        unseen = coverage.unseen
        for state, here in ((SHADOW, unseen.occluded), (FRONTIER, ~unseen.occluded)):
            chosen = here & ~unseen.explained
            front = np.repeat(unseen.faces.outward[chosen], 2, axis=0)
            parts.append(_plain(*unseen.triangles(chosen, voxel_m), state, front))
        return cls(
            join_meshes([part.mesh for part in parts]),
            np.concatenate([part.state for part in parts]),
            np.concatenate([part.cosine for part in parts]),
            np.concatenate([part.front for part in parts]),
            np.concatenate([part.colour for part in parts]),
        )


def _measured_points(scan: RangeImage, requirement: Requirement, baseline_m: float, n_most: int) -> StateMesh:
    """Return what a scan has measured, by about `n_most` pixels; the requirement asks all of them."""
    few = scan.thin(n_most)
    pixels = PixelQuality.of(few, requirement, baseline_m, limits=requirement.limits_of_scan(scan))
    state, cosine = np.full(few.ranges.size, SEEN_WORSE, np.uint8), np.zeros(few.ranges.size, np.float32)
    state[pixels.pixel[pixels.met]] = MEASURED
    cosine[pixels.pixel] = pixels.cosine
    state = _fill_states(state.reshape(few.shape), cosine.reshape(few.shape) > 0).ravel()
    vertices, faces, used = scan_faces(few)
    state, cosine = state[used], cosine[used]
    worst = state[faces].max(axis=1, initial=MEASURED)
    mesh = LabelledMesh(vertices, faces, worst.astype(np.int32))
    colour = np.full((len(used), 3), _GREY, np.uint8)
    if few.colour is not None:
        colour = colour_bytes(few.colour.reshape(-1, 3)[used])
    return StateMesh(mesh, state, cosine, mesh.face_normals(), colour)


def _fill_states(state: NDArray[np.uint8], known: BoolArray) -> NDArray[np.uint8]:
    """Return the states, in pixels without a normal those of the nearest pixel with one, if it is near."""
    if not known.any():
        return state
    distance, (row, column) = distance_transform_edt(~known, return_indices=True)
    return np.where(distance <= REACH_PX, state[row, column], state)


def _plain(
    vertices: FloatArray,
    faces: NDArray[np.int32],
    state: int,
    front: FloatArray | None = None,
    colour: NDArray[np.uint8] | None = None,
) -> StateMesh:
    """Return a mesh of one state."""
    mesh = LabelledMesh(vertices, faces, np.full(len(faces), state, np.int32))
    n = len(vertices)
    front = mesh.face_normals() if front is None else front
    colour = np.full((n, 3), _GREY, np.uint8) if colour is None else colour
    return StateMesh(mesh, np.full(n, state, np.uint8), np.zeros(n, np.float32), front, colour)
