# SPDX-License-Identifier: MIT
"""Division of parts whose planes bear ripple.

Ripple errs alike over many neighbouring points, which then lie on a cone here and a sphere there. Points
farther apart than its reach err independently. The planes determine that distance: where they are whole, they
predict the points' places best.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress

import numpy as np
from scipy.spatial import cKDTree

from completion.parts.division import limits
from completion.parts.division.faces import fit_labels, groups_of, settle, spread
from completion.parts.division.growing import GAIN, GrownRegion
from completion.parts.division.meshes import segment_mesh
from completion.parts.division.neighbourhoods import look_around
from completion.parts.division.pipeline import fit_labelled, segment_part
from completion.parts.division.proposals import from_smooth
from completion.parts.division.result import (
    MOST_POINTS,
    PartSegmentation,
    checked_cloud,
    thin_points,
)
from scenes.checks import BoolArray, FloatArray, InputError, IntArray
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.run.steps import Progress
from scenes.surfaces.catalogue import Plane

_SPARSER = (16, 64, 256)  # of how many points one is kept
_N_NEAR = 18  # neighbours whose plane tells the roughness


def segment_rippled(
    shape: object,
    labels: object | None = None,
    normals: object | None = None,
    *,
    noise_m: float | None = None,
    progress: Progress | None = None,
    found: PartSegmentation | None = None,
) -> PartSegmentation:
    """Divide a part whose planes may bear ripple.

    It is divided with one of 16, 64 and 256 of its points, and as it is, unless planes could say no more
    then. That division stands whose planes shorten the description of the points most: by the logarithm of a
    plane's side over the deviation from it, for each point on one. All points then find their surface among
    those of the sparser division.

    Parameters
    ----------
    shape : (n, 3) float, or LabelledMesh
        Metres.
    labels : (n,) int, optional
        As for `fit_labelled`; what is sought is then the kind of each surface alone.
    normals, noise_m, progress
        As for `segment_part`; they are of the points as they are.
    found : PartSegmentation, optional
        The division as it is, where that is known already.

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
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    every = min(len(np.unique(points, axis=0)), MOST_POINTS)

    def whole() -> PartSegmentation:
        if found is not None:
            return found
        if given is not None:
            return fit_labelled(points, given, normals, noise_m=noise_m)
        if isinstance(shape, LabelledMesh):
            return segment_mesh(shape, noise_m=noise_m, progress=progress)
        return segment_part(points, normals, noise_m=noise_m, progress=progress)

    # 1. Sparse points first, since all of them take long where ripple is taken for surfaces.
    sparser = [
        (kept, coarse, said_by_planes(coarse, size))
        for n in _SPARSER
        if every // n >= limits.LEAST_KEPT
        for kept, coarse in _coarse(points, every // n, given, noise_m, progress)
    ]

    # 2. All points, unless their planes could not say as much.
    enough = max((value for *_, value in sparser), default=-np.inf) - limits.CLEAR_GAIN
    asks = given is None and found is None and len(points) >= limits.LEAST_VERTICES and enough > 0
    most = _most_said(points, noise_m, size, enough) if asks else np.inf
    best = None if most < enough else whole()
    most = most if best is None else said_by_planes(best, size)

    # 3. The division that says clearly more.
    chosen: tuple[IntArray, PartSegmentation] | None = None
    for kept, coarse, value in sparser:
        if value > most + limits.CLEAR_GAIN:
            chosen, most = (kept, coarse), value
    if chosen is not None:
        return _of_all(points, points[chosen[0]], chosen[1], given)
    return whole() if best is None else best


def _coarse(
    points: FloatArray, n: int, given: IntArray | None, noise_m: float | None, progress: Progress | None
) -> Iterator[tuple[IntArray, PartSegmentation]]:
    """About n of the points (m, 3), and their division, if there is one."""
    sample = points[kept := thin_points(points, n)]
    rough = max(_roughness(sample), noise_m or 0.0)
    with suppress(InputError):
        if given is None:
            yield kept, segment_part(sample, noise_m=rough, progress=progress)
        else:
            yield kept, fit_labelled(sample, given[kept], noise_m=rough)


def _most_said(points: FloatArray, noise_m: float | None, size_m: float, enough: float) -> float:
    """Nats a point that planes of a division of points (n, 3) may say at most, as `said_by_planes` counts.

    Surfaces are grown until no more than `enough` can be said; what is free yet counts as one plane.
    """
    about = look_around(points[thin_points(points, MOST_POINTS)], None, noise_m)
    n, said = len(about.points), np.inf

    def ends(regions: list[GrownRegion], free: BoolArray) -> bool:
        nonlocal said
        planes = [len(region.members) for region in regions if isinstance(region.surface, Plane)]
        share = np.array([*planes, np.count_nonzero(free)]) / n
        gain = np.log(np.maximum(np.sqrt(share) * size_m / about.tolerance_m, 1.0))
        said = float(share @ gain)
        return said < enough

    from_smooth(about, np.full(n, GAIN), cKDTree(about.points), lambda *_: None, ends)
    return said


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
