# SPDX-License-Identifier: MIT
"""Regions of a segmentation against the true faces of a range image (Hoover et al. 1996)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scenes.checks import FloatArray, InputError, check_number

_ROUNDING = 1e-12  # of sums of shares, whatever their order


@dataclass(frozen=True, slots=True, eq=False)
class HooverScore:
    """Classes of true faces and found regions (Hoover et al. 1996, section 4)."""

    correct: tuple[tuple[int, int], ...]  # true face and found region of each pair that covers enough of both
    over: tuple[tuple[int, tuple[int, ...]], ...]  # true faces that several regions share
    under: tuple[tuple[tuple[int, ...], int], ...]  # regions that cover several true faces
    missed: tuple[int, ...]  # true faces in none of these
    noise: tuple[int, ...]  # found regions in none of these


def score_regions(
    truth: NDArray[np.integer],
    found: NDArray[np.integer],
    *,
    overlap: float = 0.8,
    min_pixels: int = 1,
) -> HooverScore:
    """Classify true faces and found regions.

    A face is correct where one region covers at least the share `overlap` of it and it covers that share of
    the region; over-segmented where several regions that each lie on it by that share cover it together;
    under-segmented the other way round.
    `truth`, `found` (rows, columns) int: face and region of each pixel; negative where there is none. Pixels
    of no true face are left out. `overlap`: the share, above one half, so that no face is correct twice.
    `min_pixels`: true faces with fewer pixels are not scored; a region that lies mostly on them is no noise
    either. Raises InputError: images of different shapes, or a share outside 0.5..1.

    Examples
    --------
    >>> truth = np.array([[0, 0, 0, 0, 1, 1, 1]])
    >>> score_regions(truth, np.array([[5, 5, 5, 5, 5, 7, 8]])).correct
    ((0, 5),)
    """
    check_number("overlap", overlap, 0.5, 1.0)
    if truth.shape != found.shape:
        raise InputError(f"true faces have shape {truth.shape}, found regions {found.shape}")
    faces, regions, common = _overlaps(truth, found)
    size, large = common.sum(axis=1), common.sum(axis=1) >= min_pixels
    of_face = common[:, 1:] / np.maximum(size, 1)[:, None]  # the first column is of no region
    of_region = common[:, 1:] / np.maximum(common[:, 1:].sum(axis=0), 1)
    ignored = of_region[~large].sum(axis=0) >= 0.5
    of_face, of_region, faces = of_face[large], of_region[large], faces[large]

    pair = (of_face >= overlap) & (of_region >= overlap)
    over = _shared(of_region >= overlap, of_face, overlap)
    under = _shared((of_face >= overlap).T, of_region.T, overlap)
    known = pair.any(axis=1)
    known[list(over)] = True
    known[[face for members in under.values() for face in members]] = True
    named = pair.any(axis=0) | ignored
    named[list(under)] = True
    named[[region for members in over.values() for region in members]] = True
    return HooverScore(
        tuple((int(faces[i]), int(regions[j])) for i, j in np.argwhere(pair)),
        tuple((int(faces[i]), tuple(int(regions[j]) for j in js)) for i, js in over.items()),
        tuple((tuple(int(faces[i]) for i in members), int(regions[j])) for j, members in under.items()),
        tuple(int(face) for face in faces[~known]),
        tuple(int(region) for region in regions[~named]),
    )


def _overlaps(
    truth: NDArray[np.integer], found: NDArray[np.integer]
) -> tuple[NDArray[np.integer], NDArray[np.integer], FloatArray]:
    """Face numbers, region numbers, and common pixels (faces, 1 + regions), the first column of no region."""
    inside = truth >= 0
    faces, face = np.unique(truth[inside], return_inverse=True)
    regions, region = np.unique(np.where(found[inside] < 0, -1, found[inside]), return_inverse=True)
    if not len(regions) or regions[0] >= 0:
        regions, region = np.append(-1, regions), region + 1
    count = np.bincount(face * len(regions) + region, minlength=len(faces) * len(regions))
    return faces, regions[1:], count.reshape(len(faces), len(regions)).astype(np.float64)


def _shared(lies_on: NDArray[np.bool_], share: FloatArray, overlap: float) -> dict[int, tuple[int, ...]]:
    """Rows that two or more columns lie on and together cover: the columns of each."""
    result = {}
    for row in range(len(lies_on)):
        members = np.flatnonzero(lies_on[row])
        if len(members) >= 2 and share[row, members].sum() >= overlap - _ROUNDING:
            result[row] = tuple(int(column) for column in members)
    return result
