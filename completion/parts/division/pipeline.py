# SPDX-License-Identifier: MIT
"""Division of parts on one page: from points or labels to planes, spheres, cylinders, cones, tori."""

from __future__ import annotations

import numpy as np

from completion.parts.division.borders import fits_inside
from completion.parts.division.faces import fit_labels, groups_of, numbered_faces, spread
from completion.parts.division.labelling import (
    best_of_kinds,
    first_labels,
    of_best_kind,
    relabel,
    without_islands,
)
from completion.parts.division.limits import MANY_FACES
from completion.parts.division.neighbourhoods import look_around
from completion.parts.division.proposals import is_free_form, proposals
from completion.parts.division.result import (
    MOST_POINTS,
    PartSegmentation,
    checked_cloud,
    no_faces,
    thin_points,
    too_little,
)
from scenes.checks import InputError, IntArray
from scenes.run.steps import Progress
from scenes.surfaces.catalogue import Surface


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
    labels, surfaces = first_labels(about, regions), [region.surface for region in regions]
    is_free = is_free_form(len(regions), labels == 0)
    if not is_free:
        surfaces, labels = relabel(about, surfaces, labels)
        labels = without_islands(about, labels)
        surfaces, labels = relabel(about, of_best_kind(about, surfaces, labels), labels)

    # 5. Faces: connected pieces; all points find theirs; a fit for each, with its covariance.
    tell("fit", 0, 1)
    faces, labels = numbered_faces(about, surfaces, labels)
    if len(kept) < len(cloud):
        labels = spread(cloud, about.points, faces, labels, about.tolerance_m)
    fits, labels = fit_labels(cloud, faces, labels, about.noise_m)
    fits = fits_inside(about, cloud, fits, labels, kept)
    return PartSegmentation(
        labels=labels,
        fits=fits,
        groups=groups_of(cloud, fits, labels, about.tolerance_m),
        noise_m=about.noise_m,
        spacing_m=about.spacing_m,
        warnings=_doubts(labels, len(fits), is_free),
    )


def _doubts(labels: IntArray, n_faces: int, is_free: bool) -> tuple[str, ...]:
    """What is told of a cloud with labels (n,) that has more faces than parts have; a sentence, or none."""
    share = float((labels > 0).mean())
    if is_free:
        return (
            "most of this surface is on no plane, cylinder, cone, sphere or torus: the "
            f"{n_faces} largest faces have {share:.0%} of the points, and no more were sought; use "
            "`unseen complete` for rooms and free forms",
        )
    if n_faces < MANY_FACES:
        return ()
    return (
        f"{n_faces} faces have {share:.0%} of the points, more than most parts have; use `unseen complete` "
        "if this is a scan of a room or a plant",
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
