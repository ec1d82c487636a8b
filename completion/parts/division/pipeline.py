# SPDX-License-Identifier: MIT
"""Division of parts on one page: from points, labels or meshes to planes, spheres, cylinders, cones, tori.

A mesh that was made from a model has its corners exactly on the model's surfaces, and is divided where these
are (`tessellation`). A scanned mesh is its vertices: they were measured, and lie close. Where they do not,
the triangles are sampled by area, and the distance of flat triangles from a curved surface counts as noise.

Ripple errs alike over many neighbouring points, which then lie on a cone here and a sphere there. Points
farther apart than its reach err independently. The planes determine that distance: where they are whole, they
predict the points' places best.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from completion.parts.division import limits
from completion.parts.division.faces import fit_labels, groups_of, numbered_faces, settle, spread
from completion.parts.division.growing import GAIN
from completion.parts.division.labelling import (
    best_of_kinds,
    first_labels,
    of_best_kind,
    proposals,
    relabel,
    without_islands,
)
from completion.parts.division.neighbourhoods import look_around
from completion.parts.division.result import (
    MOST_POINTS,
    PartSegmentation,
    checked_cloud,
    no_faces,
    thin_points,
    too_little,
)
from completion.parts.division.tessellation import divide_tessellated
from scenes.checks import FloatArray, InputError, IntArray
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.run.steps import Progress
from scenes.surfaces.catalogue import Plane, Surface


def segment_part(
    points: object,
    normals: object | None = None,
    *,
    noise_m: float | None = None,
    progress: Progress | None = None,
) -> PartSegmentation:
    """Divide the points of a part into faces, and fit a surface to each.

    Nothing is set but by the points themselves: distances count in units of their noise (or a hundredth of
    the sampling distance, where there is hardly any), neighbourhoods are as large as the noise asks for, and
    a surface costs what its parameters are worth (Isack and Boykov 2012).

    Parameters
    ----------
    points : (n, 3) float
        Metres, in any order; copies of a point count once.
    normals : (n, 3) float, optional
        Of any length, with or without a side; where they are not given, they are estimated.
    noise_m : float, optional
        Deviation of the points along the normal, where it is known; else it is estimated. What is less than
        a hundredth of the sampling distance counts as that.
    progress : callable, optional
        Called with stage, done and total.

    Returns
    -------
    PartSegmentation
        With no faces where there are fewer than eight places, or all on a line; a warning says so.

    Raises
    ------
    InputError
        Arrays of wrong shape, points that are not finite, normals without length, a noise below zero.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(0)
    >>> top, side = rng.uniform(0, 1, (2, 800, 2))
    >>> corner = np.vstack([np.insert(top, 2, 0.0, axis=1), np.insert(side, 0, 0.0, axis=1)])
    >>> [fit.surface.kind for fit in segment_part(corner).fits]
    ['plane', 'plane']
    """
    # 1. Thin: distinct places, at most so many; what was left out comes back at the end.
    tell = progress or (lambda _stage, _done, _total: None)
    cloud, turned = checked_cloud(points, normals, noise_m)
    kept = thin_points(cloud, MOST_POINTS)
    if reason := too_little(cloud[kept]):
        return no_faces(len(cloud), reason)

    # 2. Look around: sampling distance, noise, normals, neighbours.
    tell("neighbours", 0, 1)
    about = look_around(cloud[kept], None if turned is None else turned[kept], noise_m)

    # 3. Propose: surfaces grown from where points are smooth, then from what those leave.
    regions = proposals(about, tell)

    # 4. Label: which surface each point is on, the surfaces given that, in turn.
    tell("label", 0, 1)
    labels = first_labels(about, regions)
    surfaces, labels = relabel(about, [region.surface for region in regions], labels)
    labels = without_islands(about, labels)
    surfaces, labels = relabel(about, of_best_kind(about, surfaces, labels), labels)

    # 5. Faces: connected pieces; all points find theirs; a fit for each, with its covariance.
    tell("fit", 0, 1)
    faces, labels = numbered_faces(about, surfaces, labels)
    if len(kept) < len(cloud):
        labels = spread(cloud, about.points, faces, labels, about.tolerance_m)
    fits, labels = fit_labels(cloud, faces, labels, about.noise_m)
    return PartSegmentation(
        labels=labels,
        fits=fits,
        groups=groups_of(cloud, fits, labels, about.tolerance_m),
        noise_m=about.noise_m,
        spacing_m=about.spacing_m,
    )


def fit_labelled(
    points: object, labels: object, normals: object | None = None, *, noise_m: float | None = None
) -> PartSegmentation:
    """Fit a surface to the points of each label: plane, sphere, cylinder, cone or torus, by evidence.

    Labels are taken at their word: all points of one count, and none is moved to another.

    Parameters
    ----------
    points : (n, 3) float
        Metres.
    labels : (n,) int
        0 and less for none.
    normals : (n, 3) float, optional
        As for `segment_part`.
    noise_m : float, optional
        As for `segment_part`.

    Returns
    -------
    PartSegmentation
        `names` are the labels that determine a surface; a warning names each other one.

    Raises
    ------
    InputError
        Arrays of wrong shape, labels that are no whole numbers, points that are not finite.
    """
    cloud, turned = checked_cloud(points, normals, noise_m)
    given = np.asarray(labels)
    if given.shape != (len(cloud),) or given.dtype.kind not in "iu":
        raise InputError(
            f"expected labels with shape ({len(cloud)},) of whole numbers, got {given.shape} {given.dtype}"
        )
    names, number = np.unique(np.maximum(given.astype(np.int64), 0), return_inverse=True)
    number = number.astype(np.int64) + (0 if len(names) and names[0] == 0 else 1)
    names = names[names > 0]
    kept = thin_points(cloud, MOST_POINTS)
    if reason := too_little(cloud[kept]) or ("" if len(names) else "no label is above 0"):
        return no_faces(len(cloud), reason)
    about = look_around(cloud[kept], None if turned is None else turned[kept], noise_m)
    surfaces: list[Surface | None] = [
        best_of_kinds(about, np.flatnonzero(number[kept] == index)) for index in range(1, len(names) + 1)
    ]
    sample = [surface for surface in surfaces if surface is not None]
    place = np.array([0, *np.cumsum([surface is not None for surface in surfaces])])
    is_some = np.array([False, *(surface is not None for surface in surfaces)])
    label_here = np.where(is_some[number], place[number], 0)
    fits, own_fits = fit_labels(cloud, sample, label_here, about.noise_m)
    taken = {int(names[number[own_fits == k][0] - 1]): fit for k, fit in enumerate(fits, start=1)}
    without = [int(name) for name in names if int(name) not in taken]
    return PartSegmentation(
        labels=own_fits,
        fits=fits,
        groups=groups_of(cloud, fits, own_fits, about.tolerance_m),
        noise_m=about.noise_m,
        spacing_m=about.spacing_m,
        names=tuple(taken),
        warnings=tuple(
            f"the {int((given == name).sum())} points with label {name} determine no surface of a known kind"
            for name in without
        ),
    )


_SAMPLES = (4_000, 30_000)  # least and most
_ACROSS = 8  # samples across the narrowest triangle: no face is narrower


def segment_mesh(
    mesh: LabelledMesh, *, noise_m: float | None = None, progress: Progress | None = None
) -> PartSegmentation:
    """Divide the triangles of a mesh into faces, and fit a surface to each; see `segment_part`.

    Parameters
    ----------
    mesh : LabelledMesh
        Metres; which way its triangles turn does not count.
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
    distinct, place = np.unique(mesh.vertices, axis=0, return_inverse=True)
    if len(distinct) < len(mesh.vertices):  # triangles that do not share their corners
        place = place.reshape(-1)
        joined = LabelledMesh(distinct, place[mesh.faces].astype(np.int32))
        part = segment_mesh(joined, noise_m=noise_m, progress=progress)
        return replace(part, labels=part.labels[place])
    areas = mesh.face_areas()
    if not areas.sum() > 0:
        raise InputError(f"none of the {len(areas)} triangles has an area")
    checked_cloud(mesh.vertices, None, noise_m)
    if noise_m is None and (model := _segment_model(mesh, areas)) is not None:
        return model
    used = np.unique(mesh.faces)
    if _is_dense(mesh, float(areas.sum()), len(used)):
        part = segment_part(mesh.vertices[used], noise_m=noise_m, progress=progress)
        labels: IntArray = np.zeros(len(mesh.vertices), dtype=np.int64)
        labels[used] = part.labels
        return replace(part, labels=labels, triangle_labels=_by_corners(mesh, part, labels))
    points, members = _sample_mesh(mesh, areas)
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


def _segment_model(mesh: LabelledMesh, areas: FloatArray) -> PartSegmentation | None:
    """The faces of a model that a mesh was made from; None where it was not."""
    size = float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))
    tolerance_m = limits.MODEL_PRECISION * size
    model = divide_tessellated(mesh, tolerance_m)
    if model is None:
        return None
    triangles, surfaces = model.labels, model.surfaces
    corners, number = _corners(mesh, triangles)
    fits, labels = fit_labels(mesh.vertices[corners], surfaces, number, limits.RESOLUTION * tolerance_m)
    place = np.zeros(len(surfaces) + 1, np.int64)
    place[number] = labels
    triangles = place[triangles]
    free_form = float(areas[triangles == 0].sum()) / float(areas.sum())
    told = f"{free_form:.1%} of the area of this model is on no plane, cylinder, cone, sphere or torus"
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


def _sample_mesh(mesh: LabelledMesh, areas: FloatArray) -> tuple[FloatArray, IntArray]:
    """Points (k, 3) spread evenly over the area, and the triangle (k,) of each."""
    total = np.cumsum(areas)
    n = _n_samples(mesh, areas)
    step = (np.arange(n) + 0.5) / n * total[-1]
    triangle = np.minimum(np.searchsorted(total, step), len(areas) - 1)
    golden = 1.32471795724474602596  # plastic number: a sequence even in two dimensions (Roberts 2018)
    index = np.arange(1, n + 1)[:, None]
    a, b = ((0.5 + index / [golden, golden**2]) % 1.0).T
    over = a + b > 1
    a, b = np.where(over, 1 - a, a), np.where(over, 1 - b, b)
    corners = mesh.vertices[mesh.faces[triangle]]
    points = corners[:, 0] + a[:, None] * (corners[:, 1] - corners[:, 0])
    return points + b[:, None] * (corners[:, 2] - corners[:, 0]), triangle


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


_SPARSER = (16, 64, 256)  # of how many points one is kept
_N_NEAR = 18  # neighbours whose plane tells the roughness


def segment_rippled(
    shape: object,
    labels: object | None = None,
    normals: object | None = None,
    *,
    noise_m: float | None = None,
    progress: Progress | None = None,
) -> PartSegmentation:
    """Divide a part whose planes may bear ripple.

    It is divided as it is, and with one of 16, 64 and 256 of its points. That division stands whose planes
    shorten the description of the points most: by the logarithm of a plane's side over the deviation from it,
    for each point on one. All points then find their surface among those of the sparser division.

    Parameters
    ----------
    shape : (n, 3) float, or LabelledMesh
        Metres.
    labels : (n,) int, optional
        As for `fit_labelled`; what is sought is then the kind of each surface alone.
    normals, noise_m, progress
        As for `segment_part`; they are of the points as they are.

    Returns
    -------
    PartSegmentation
        As `segment_part`, `segment_mesh` and `fit_labelled` do. `noise_m` holds the ripple too; a warning
        says how sparse the points were where that is not all of them.

    Raises
    ------
    InputError
        As these do.
    """
    points = shape.vertices if isinstance(shape, LabelledMesh) else checked_cloud(shape, None, None)[0]
    given = None if labels is None else np.asarray(labels)
    if given is not None:
        best = fit_labelled(points, given, normals, noise_m=noise_m)
    elif isinstance(shape, LabelledMesh):
        best = segment_mesh(shape, noise_m=noise_m, progress=progress)
    else:
        best = segment_part(points, normals, noise_m=noise_m, progress=progress)
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    every, most = min(len(np.unique(points, axis=0)), MOST_POINTS), said_by_planes(best, size)
    for sparser in _SPARSER:
        if every // sparser < limits.LEAST_KEPT:
            break
        sample = points[kept := thin_points(points, every // sparser)]
        rough = max(_roughness(sample), noise_m or 0.0)
        try:
            if given is None:
                coarse = segment_part(sample, noise_m=rough, progress=progress)
            else:
                coarse = fit_labelled(sample, given[kept], noise_m=rough)
        except InputError:
            continue
        value = said_by_planes(coarse, size)
        if value > most + limits.CLEAR_GAIN:
            best, most = _of_all(points, sample, coarse, given), value
    return best


def _roughness(points: FloatArray) -> float:
    """Deviation of points (n, 3) from the plane of their neighbours, at a usual one, metres."""
    near = cKDTree(points).query(points, k=min(_N_NEAR, len(points)))[1]
    about = points[near] - points[near].mean(axis=1, keepdims=True)
    least = np.linalg.eigvalsh(np.einsum("nki,nkj->nij", about, about))[:, 0]
    return float(np.sqrt(max(float(np.median(least)), 0.0) / max(near.shape[1] - 3, 1)))


def said_by_planes(segmentation: PartSegmentation, size_m: float) -> float:
    """Nats a point by which planes shorten its description: their side over the deviation from them.

    A plane's side is that share of the whole size, metres, whose square is its share of the points.
    """
    deviation = max(segmentation.noise_m, limits.RESOLUTION * segmentation.spacing_m, 1e-300)
    number = np.bincount(segmentation.labels, minlength=len(segmentation.fits) + 1)[1:]
    planar = (
        number[[isinstance(fit.surface, Plane) for fit in segmentation.fits]]
        if len(segmentation.fits)
        else number
    )
    gain = np.log(np.maximum(np.sqrt(planar / max(len(segmentation.labels), 1)) * size_m / deviation, 1.0))
    return float(np.sum(planar * gain)) / max(len(segmentation.labels), 1)


def _of_all(
    points: FloatArray, sample: FloatArray, coarse: PartSegmentation, given: IntArray | None
) -> PartSegmentation:
    """The division of all points (n, 3) by that of some of them (m, 3), or by the labels given (n,)."""
    tolerance = max(coarse.noise_m, limits.RESOLUTION * coarse.spacing_m)
    surfaces = [fit.surface for fit in coarse.fits]
    if given is None:
        labels = spread(points, sample, surfaces, coarse.labels.astype(np.int64), tolerance)
        labels = settle(points, surfaces, labels)
    else:
        known = np.array(coarse.names)
        place = np.minimum(np.searchsorted(known, given), len(known) - 1)
        labels = np.where(known[place] == given, place + 1, 0)
    fits, members = fit_labels(points, surfaces, labels, coarse.noise_m)
    names = tuple(coarse.names[labels[members == k][0] - 1] for k in range(1, len(fits) + 1))
    return PartSegmentation(
        labels=members,
        fits=fits,
        groups=groups_of(points, fits, members, tolerance),
        noise_m=coarse.noise_m,
        spacing_m=coarse.spacing_m,
        names=names if given is not None else (),
        warnings=(
            *coarse.warnings,
            f"surfaces were sought among points {1000 * coarse.spacing_m:.3g} mm apart, where ripple is "
            f"noise of {1000 * coarse.noise_m:.3g} mm; nothing smaller than a few of these distances has one",
        ),
    )
