# SPDX-License-Identifier: MIT
"""Division beneath ripple: planes sought among points so far apart that ripple is noise of each of them.

Ripple errs alike over many neighbouring points, which then lie on a cone here and a sphere there. Points that
are farther apart than it reaches err each by itself. At which distance that is, planes themselves tell: where
they are whole, they say most about where points are.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from completion.parts.division.faces import fitted, groups_of, spread
from completion.parts.division.meshes import segment_mesh
from completion.parts.division.pipeline import segment_part
from completion.parts.division.result import PartSegmentation
from completion.parts.division.thinning import MOST_POINTS, checked_cloud, thinned
from scenes.checks import FloatArray, InputError
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.run.steps import Progress
from scenes.surfaces.catalogue import Plane

_SPARSER = (16, 64, 256)  # of how many points one is kept
_LEAST_KEPT = 100
_RESOLUTION = 0.01  # of the sampling distance: no difference of surfaces shows below it


def segment_rippled(
    shape: object,
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
    normals, noise_m, progress
        As for `segment_part`; they are of the points as they are.

    Returns
    -------
    PartSegmentation
        As `segment_part` and `segment_mesh` do. `noise_m` holds the ripple too; a warning says how sparse
        the points were where that is not all of them.

    Raises
    ------
    InputError
        As `segment_part` and `segment_mesh` do.
    """
    if isinstance(shape, LabelledMesh):
        found, points = segment_mesh(shape, noise_m=noise_m, progress=progress), shape.vertices
    else:
        found = segment_part(shape, normals, noise_m=noise_m, progress=progress)
        points = checked_cloud(shape, None, None)[0]
    every = min(len(np.unique(points, axis=0)), MOST_POINTS)
    best, most = found, said_by_planes(found)
    for sparser in _SPARSER:
        if every // sparser < _LEAST_KEPT:
            break
        kept = thinned(points, every // sparser)
        try:
            coarse = segment_part(points[kept], progress=progress)
        except InputError:
            continue
        said = said_by_planes(coarse)
        if said > most:
            best, most = _of_all(points, points[kept], coarse), said
    return best


def said_by_planes(found: PartSegmentation) -> float:
    """Nats a point by which planes shorten its description: their side over the deviation from them."""
    deviation = max(found.noise_m, _RESOLUTION * found.spacing_m, 1e-300)
    size = np.bincount(found.labels, minlength=len(found.fits) + 1)[1:]
    own = size[[isinstance(fit.surface, Plane) for fit in found.fits]] if len(found.fits) else size
    gain = np.log(np.maximum(np.sqrt(own) * found.spacing_m / deviation, 1.0))
    return float(np.sum(own * gain)) / max(len(found.labels), 1)


def _of_all(points: FloatArray, some: FloatArray, coarse: PartSegmentation) -> PartSegmentation:
    """The division of all points (n, 3) by that of some of them (m, 3)."""
    tolerance = max(coarse.noise_m, _RESOLUTION * coarse.spacing_m)
    surfaces = [fit.surface for fit in coarse.fits]
    labels = spread(points, some, surfaces, coarse.labels.astype(np.int64), tolerance)
    fits, labels = fitted(points, surfaces, labels, coarse.noise_m)
    return replace(
        coarse,
        labels=labels,
        fits=fits,
        groups=groups_of(points, fits, labels, tolerance),
        triangle_labels=None,
        names=(),
        warnings=(
            f"surfaces were sought among points {1000 * coarse.spacing_m:.3g} mm apart, where ripple is "
            f"noise of {1000 * coarse.noise_m:.3g} mm; nothing smaller than a few of these distances has one",
        ),
    )
