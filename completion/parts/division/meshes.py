# SPDX-License-Identifier: MIT
"""Division of meshes: of tessellated models at their faces, of scanned ones by their vertices or samples.

A mesh that was made from a model has its corners exactly on the model's surfaces, and is divided where these
are (`tessellation`). A scanned mesh is its vertices: they were measured, and lie close. Where they do not,
the triangles are sampled by area, and the distance of flat triangles from a curved surface counts as noise.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from completion.parts.division import limits
from completion.parts.division.faces import fit_labels, groups_of
from completion.parts.division.growing import GAIN
from completion.parts.division.pipeline import segment_part
from completion.parts.division.result import (
    PartSegmentation,
    checked_cloud,
)
from completion.parts.division.tessellation import divide_tessellated
from scenes.checks import FloatArray, InputError, IntArray
from scenes.mesh.labelled_mesh import LabelledMesh, spread_points
from scenes.mesh.merging import merge_vertices
from scenes.run.steps import Progress

_SAMPLES = (4_000, 30_000)  # least and most
_ACROSS = 8  # samples across the narrowest triangle: no face is narrower


def segment_mesh(
    mesh: LabelledMesh, *, noise_m: float | None = None, step_m: float = 0.0, progress: Progress | None = None
) -> PartSegmentation:
    """Divide the triangles of a mesh into faces, and fit a surface to each; see `segment_part`.

    Parameters
    ----------
    mesh : LabelledMesh
        Metres; which way its triangles turn does not count.
    step_m : float
        Step between coordinates of the file, metres.
    noise_m, progress
        As for `segment_part`.

    Returns
    -------
    PartSegmentation
        `labels` are those of the vertices, `triangle_labels` those of the triangles. Fits are to the
        vertices of a face where these are enough, else to samples of its triangles.

    Raises
    ------
    InputError
        A mesh without area, or a noise below zero.
    """
    size = float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))
    distinct, place = merge_vertices(mesh.vertices, limits.ROUNDED_OFF * size)
    if len(distinct) < len(mesh.vertices):  # triangles that do not share their corners
        joined = LabelledMesh(distinct, place[mesh.faces].astype(np.int32))
        part = segment_mesh(joined, noise_m=noise_m, step_m=step_m, progress=progress)
        return replace(part, labels=part.labels[place])
    areas = mesh.face_areas()
    if not areas.sum() > 0:
        raise InputError(f"none of the {len(areas)} triangles has an area")
    checked_cloud(mesh.vertices, None, noise_m)
    if noise_m is None and (model := _segment_model(mesh, areas, step_m)) is not None:
        return model
    used = np.unique(mesh.faces)
    if _is_dense(mesh, float(areas.sum()), len(used)):
        part = segment_part(mesh.vertices[used], noise_m=noise_m, progress=progress)
        labels: IntArray = np.zeros(len(mesh.vertices), dtype=np.int64)
        labels[used] = part.labels
        return replace(part, labels=labels, triangle_labels=_by_corners(mesh, part, labels))
    points, members = spread_points(mesh.corners, _n_samples(mesh, areas))
    sag = _sag(mesh)
    turned, noise = mesh.face_normals()[members], max(sag, noise_m or 0.0)
    part = segment_part(points, turned, noise_m=noise, progress=progress)
    triangles = _of_triangles(mesh, points, members, part.labels.astype(np.int64), len(part.fits))
    corners, number = _corners(mesh, triangles)
    surfaces = [fit.surface for fit in part.fits]
    fits, _ = fit_labels(mesh.vertices[corners], surfaces, number, noise_m or 0.0)
    if len(fits) < len(surfaces):  # too few vertices somewhere
        fits = part.fits
    labels = _of_vertices(mesh, triangles, areas, len(surfaces))
    groups = groups_of(points, fits, part.labels.astype(np.int64), max(sag, 1e-2 * part.spacing_m))
    return replace(part, labels=labels, fits=fits, groups=groups, triangle_labels=triangles)


def _segment_model(mesh: LabelledMesh, areas: FloatArray, step_m: float) -> PartSegmentation | None:
    """The faces of a model that a mesh was made from; None where it was not."""
    size = float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))
    model = divide_tessellated(mesh, [max(share * size, step_m) for share in limits.MODEL_PRECISIONS])
    if model is None:
        return None
    triangles, surfaces, tolerance_m = model.labels, model.surfaces, model.tolerance_m
    corners, number = _corners(mesh, triangles)
    fits, labels = fit_labels(mesh.vertices[corners], surfaces, number, tolerance_m)
    place = np.zeros(len(surfaces) + 1, np.int64)
    place[number] = labels
    triangles = place[triangles]
    free_form = float(areas[triangles == 0].sum()) / float(areas.sum())
    told = f"{100 * free_form:.1f} % of the model's area is on no plane, cylinder, cone, sphere or torus"
    return PartSegmentation(
        labels=_of_vertices(mesh, triangles, areas, len(fits)),
        fits=fits,
        groups=groups_of(mesh.vertices[corners], fits, labels, tolerance_m),
        noise_m=float(np.sqrt(np.mean([fit.rms**2 for fit in fits]))) if fits else 0.0,
        spacing_m=float(np.sqrt(areas.sum() / _n_samples(mesh, areas))),
        triangle_labels=triangles,
        is_model=True,
        warnings=(told,) if free_form > limits.FREE_FORM else (),
    )


def _by_corners(mesh: LabelledMesh, segmentation: PartSegmentation, labels: IntArray) -> IntArray:
    """The face (m,) of each triangle: of those at its corners and beside, the one that it lies on best.

    Corners on an edge belong to one of two faces; which the triangle is on, its other corners and its slope
    tell.
    """
    n, tolerance = len(mesh.faces), max(segmentation.noise_m, 1e-2 * segmentation.spacing_m)
    normals, middle = mesh.face_normals(), mesh.corners.mean(axis=1)
    corners = labels[mesh.faces]
    is_majority = (corners == corners[:, [1]]).sum(axis=1) >= 2
    best = np.where(is_majority, corners[:, 1], corners[:, 0]).astype(np.int64)
    least = np.full(n, np.inf)
    for number, fit in enumerate(segmentation.fits, start=1):
        touched = np.zeros(len(mesh.vertices), dtype=np.bool_)
        touched[mesh.faces[(corners == number).any(axis=1)].ravel()] = True
        near = np.flatnonzero(touched[mesh.faces].any(axis=1))
        off = np.abs(fit.surface.distance(mesh.corners[near].reshape(-1, 3))).reshape(-1, 3) / tolerance
        slope = np.einsum("ij,ij->i", fit.surface.normal(middle[near]), normals[near])
        turn = np.arccos(np.clip(np.abs(slope), 0, 1)) / limits.LEAST_ANGLE
        cost = np.minimum(off**2, 2 * GAIN).sum(axis=1) + turn**2
        better = (cost < least[near]) & (off.max(axis=1) <= limits.CUT)
        least[near[better]], best[near[better]] = cost[better], number
    return best


def _is_dense(mesh: LabelledMesh, area: float, n_used: int) -> bool:
    """Whether the vertices stand for most of the area: each for a hexagon of the usual edge."""
    edges = mesh.vertices[mesh.faces] - mesh.vertices[np.roll(mesh.faces, 1, axis=1)]
    usual = float(np.median(np.linalg.norm(edges, axis=2)))
    return (
        n_used >= limits.LEAST_VERTICES and n_used * usual**2 * np.sqrt(3) / 2 >= limits.VERTICES_COVER * area
    )


def _n_samples(mesh: LabelledMesh, areas: FloatArray) -> int:
    """How many samples lie closely enough for the narrowest triangle that has an area."""
    longest = np.linalg.norm(mesh.corners - np.roll(mesh.corners, 1, axis=1), axis=2).max(axis=1)
    narrowest = float(np.min(2 * areas[areas > 0] / longest[areas > 0]))
    least, most = _SAMPLES
    return int(np.clip(areas.sum() * (_ACROSS / narrowest) ** 2, least, most))


def _sag(mesh: LabelledMesh) -> float:
    """How far flat triangles are off the surface that they stand for: a chord's width times its turn / 8."""
    edges = np.sort(mesh.faces[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
    triangle = np.repeat(np.arange(len(mesh.faces)), 3)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    edges, triangle = edges[order], triangle[order]
    twice = np.flatnonzero((edges[1:] == edges[:-1]).all(axis=1))
    first, two, ends = triangle[twice], triangle[twice + 1], mesh.vertices[edges[twice]]
    normals, areas = mesh.face_normals(), mesh.face_areas()
    turn = np.arccos(np.clip(np.abs(np.einsum("ij,ij->i", normals[first], normals[two])), 0, 1))
    bent = (turn > limits.FLAT_ANGLE) & (turn < limits.CREASE)
    if not bent.any():
        return 0.0
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)[bent]
    width = (areas[first] + areas[two])[bent] / np.maximum(length, 1e-300)
    return float(np.quantile(width * turn[bent] / 8, limits.SAGGING))


def _of_triangles(
    mesh: LabelledMesh, points: FloatArray, members: IntArray, labels: IntArray, n_faces: int
) -> IntArray:
    """The face (m,) that most samples of a triangle are on; of one without samples, that of the nearest."""
    votes = np.zeros((len(mesh.faces), n_faces + 1), dtype=np.int32)
    np.add.at(votes, (members, labels), 1)
    votes[:, 0] = 0
    best = votes.argmax(axis=1)
    unasked = np.flatnonzero(votes.sum(axis=1) == 0)
    known = np.flatnonzero(labels > 0)
    if len(unasked) and len(known):
        centres = mesh.vertices[mesh.faces[unasked]].mean(axis=1)
        best[unasked] = labels[known[cKDTree(points[known]).query(centres)[1]]]
    return np.asarray(best, dtype=np.int64)


def _corners(mesh: LabelledMesh, triangles: IntArray) -> tuple[IntArray, IntArray]:
    """Vertices (k,) of each face's triangles, once a face, and the face (k,) of each."""
    pairs = np.column_stack([np.repeat(triangles, 3), mesh.faces.ravel()])
    pairs = np.unique(pairs[pairs[:, 0] > 0], axis=0)
    return np.asarray(pairs[:, 1]), np.asarray(pairs[:, 0])


def _of_vertices(mesh: LabelledMesh, triangles: IntArray, areas: FloatArray, n_faces: int) -> IntArray:
    """The largest face (n,) that has a triangle at a vertex; 0 for none."""
    size = np.bincount(triangles, areas, minlength=n_faces + 1)
    size[0] = -1.0
    labels = np.zeros(len(mesh.vertices), dtype=np.int64)
    for number in np.argsort(size, kind="stable"):
        labels[mesh.faces[triangles == number].ravel()] = number
    return labels
