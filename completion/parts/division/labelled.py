# SPDX-License-Identifier: MIT
"""Labelled points: divided already, so that only the kind of each surface is sought."""

from __future__ import annotations

import numpy as np

from completion.parts.division.faces import fitted, groups_of
from completion.parts.division.labelling import best_of_kinds
from completion.parts.division.neighbourhoods import look_around
from completion.parts.division.result import (
    MOST_POINTS,
    PartSegmentation,
    checked_cloud,
    no_faces,
    thinned,
    too_little,
)
from scenes.checks import InputError
from scenes.surfaces.catalogue import Surface


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
    kept = thinned(cloud, MOST_POINTS)
    if reason := too_little(cloud[kept]) or ("" if len(names) else "no label is above 0"):
        return no_faces(len(cloud), reason)
    about = look_around(cloud[kept], None if turned is None else turned[kept], noise_m)
    surfaces: list[Surface | None] = [
        best_of_kinds(about, np.flatnonzero(number[kept] == one)) for one in range(1, len(names) + 1)
    ]
    some = [surface for surface in surfaces if surface is not None]
    place = np.array([0, *np.cumsum([surface is not None for surface in surfaces])])
    is_some = np.array([False, *(surface is not None for surface in surfaces)])
    own = np.where(is_some[number], place[number], 0)
    fits, own_fits = fitted(cloud, some, own, about.noise_m)
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
