# SPDX-License-Identifier: MIT
"""Audit: re-measure on the finished mesh, by ray casting, how much hypothesis stands in observed free space.

It shares no code with the extension: it knows scans and triangles, neither charts nor labels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from completion.observe.observation import RangeNoise
from completion.observe.tolerance import Tolerance
from scenes.checks import FloatArray
from scenes.mesh.labelled_mesh import triangle_areas
from scenes.rays.raycast import RayCaster
from scenes.scan.range_image import RangeImage


@dataclass(frozen=True, slots=True, eq=False)
class AuditResult:
    """What the beams say of a hypothesised mesh.

    Attributes
    ----------
    violation_m2 : float
        Area of the faces that observed beams went through, square metres.
    faces : (k,) int64
        Those faces.
    n_beams : int
        Beams that were checked.
    """

    violation_m2: float
    faces: NDArray[np.int64]
    n_beams: int


def audit(
    vertices: FloatArray,
    faces: NDArray[np.int32],
    vertex_sd: FloatArray,
    scans: Sequence[RangeImage],
    noises: Sequence[RangeNoise],
    *,
    tolerance: Tolerance,
    n_threads: int | None = None,
) -> AuditResult:
    """Cast every measured beam against the mesh and count the faces that it went through.

    A beam goes through a face when it meets it nearer than what it measured by more than the tolerance
    k sqrt(sigma^2 + (s / cos)^2) + t / cos, with s the face's predicted standard deviation and flatness
    together and t the registration error. Without noise one beam convicts a face; with noise it takes two
    beams on faces that share a vertex.

    Parameters
    ----------
    vertices, faces : (n, 3) float, (m, 3) int
        The hypothesised mesh, same frame as the scans.
    vertex_sd : (n,) float
        Predicted standard deviation at the vertices, metres.
    scans : sequence of RangeImage
        All scans.
    noises : sequence of RangeNoise
        Range noise of each.
    tolerance : Tolerance
        Along the ray; a beam whose tolerance exceeds `max_m` says nothing.
    n_threads : int, optional
        Threads that cast.
    """
    if not len(faces):
        return AuditResult(0.0, np.zeros(0, np.int64), 0)
    caster = RayCaster(vertices, faces, n_threads)
    beams = np.zeros(len(faces), np.int64)
    n_beams, noisy = 0, False
    for scan, noise in zip(scans, noises, strict=True):
        returned = scan.valid
        noisy |= bool(noise.constant_m > 0 or noise.quadratic_per_m > 0)
        hits = caster.first_hit(scan.origin[None], scan.rays()[returned], coherent=True)
        n_beams += int(returned.sum())
        met = np.flatnonzero(hits.hit)
        face = hits.face[met]
        sd = vertex_sd[faces[face]].max(axis=1)
        measured = scan.ranges[returned][met]
        allowed = tolerance.along_ray(noise.deviation(measured), sd, hits.incidence_cosine[met])
        past = measured - hits.ranges[met]
        through = (past > allowed) & (allowed <= tolerance.max_m)
        beams += np.bincount(face[through], minlength=len(faces))
    convicted = beams > 0
    if noisy:
        at_vertex = np.bincount(faces.ravel(), np.repeat(beams, 3), minlength=len(vertices))
        convicted &= at_vertex[faces].max(axis=1) >= 2
    return AuditResult(
        float(triangle_areas(vertices[faces[convicted]]).sum()), np.flatnonzero(convicted), n_beams
    )
