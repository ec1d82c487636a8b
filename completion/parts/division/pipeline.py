# SPDX-License-Identifier: MIT
"""Parts on one page: from points without any order to faces on planes, spheres, cylinders, cones and tori."""

from __future__ import annotations

from completion.parts.division.faces import fitted, groups_of, numbered_faces, spread
from completion.parts.division.labelling import (
    first_labels,
    of_best_kind,
    proposals,
    relabelled,
    without_islands,
)
from completion.parts.division.neighbourhoods import look_around
from completion.parts.division.result import (
    MOST_POINTS,
    PartSegmentation,
    checked_cloud,
    no_faces,
    thinned,
    too_little,
)
from scenes.run.steps import Progress


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
    kept = thinned(cloud, MOST_POINTS)
    if reason := too_little(cloud[kept]):
        return no_faces(len(cloud), reason)

    # 2. Look around: sampling distance, noise, normals, neighbours.
    tell("neighbours", 0, 1)
    about = look_around(cloud[kept], None if turned is None else turned[kept], noise_m)

    # 3. Propose: surfaces grown from where points are smooth, then from what those leave.
    found = proposals(about, tell)

    # 4. Label: which surface each point is on, the surfaces given that, in turn.
    tell("label", 0, 1)
    labels = first_labels(about, found)
    surfaces, labels = relabelled(about, [one.surface for one in found], labels)
    labels = without_islands(about, labels)
    surfaces, labels = relabelled(about, of_best_kind(about, surfaces, labels), labels)

    # 5. Faces: connected pieces; all points find theirs; a fit for each, with its covariance.
    tell("fit", 0, 1)
    faces, labels = numbered_faces(about, surfaces, labels)
    if len(kept) < len(cloud):
        labels = spread(cloud, about.points, faces, labels, about.tolerance_m)
    fits, labels = fitted(cloud, faces, labels, about.noise_m)
    return PartSegmentation(
        labels=labels,
        fits=fits,
        groups=groups_of(cloud, fits, labels, about.tolerance_m),
        noise_m=about.noise_m,
        spacing_m=about.spacing_m,
    )
