# SPDX-License-Identifier: MIT
"""What scans say of faces in the 3-D view: provenance, which scans see them, and at which incidence."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from completion.extension.patch import Provenance
from completion.result.labelled_points import PROVENANCE_NAMES
from nbv.coverage.measurement import measured_samples
from nbv.report.pictures import picture
from nbv.report.pictures.picture import surface_rgb
from nbv.report.viewer.layers import Category, Numbers, Sightings
from nbv.scans.scan_map import with_known_noise
from nbv.visibility.samples import SurfaceSamples
from scenes.checks import FloatArray
from scenes.scan.range_image import RangeImage

MEASURED = Category("measured", picture.MEASURED)
INFERRED = Category("inferred", picture.INFERRED)
_PROVENANCE_COLOURS = (0, 1, 14, 5, 3, 13, 6)  # of `Provenance`, numbers in the palette of surfaces


def provenance_categories() -> tuple[Category, ...]:
    """How a place came to be in the model, each with its colour."""
    colours = (picture.MEASURED, *(surface_rgb(k) for k in _PROVENANCE_COLOURS[1:]))
    return tuple(Category(PROVENANCE_NAMES[str(why.value)], colours[int(why)]) for why in Provenance)


def scan_sightings(scans: Sequence[RangeImage], corners: FloatArray) -> Sightings:
    """Which scans measured the middles of faces (m, 3, 3), and at which incidence."""
    a, b, c = np.moveaxis(corners, 1, 0)
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1)
    unit = np.divide(normals, length[:, None], out=np.zeros_like(normals), where=length[:, None] > 0)
    zero = np.zeros(len(corners), np.int32)
    samples = SurfaceSamples(corners.mean(axis=1), unit, length / 2, zero, zero)
    found = [measured_samples(with_known_noise(scan), samples) for scan in scans] if len(corners) else []
    index = np.concatenate([np.zeros(0, np.int64), *(index for index, _ in found)])
    scan_of = np.concatenate(
        [np.zeros(0, np.int64), *(np.full(len(i), k) for k, (i, _) in enumerate(found, 1))]
    )
    cosine = np.concatenate([np.zeros(0), *(cosine for _, cosine in found)])
    order = np.argsort(index, kind="stable")
    start = np.concatenate([[0], np.cumsum(np.bincount(index, minlength=len(corners)))])
    return Sightings(start, scan_of[order], np.degrees(np.arccos(np.clip(cosine[order], 0, 1))))


def quality_channels(sightings: Sightings, n_scans: int) -> tuple[Numbers, Numbers]:
    """Best incidence and number of scans of each place."""
    counts = np.diff(sightings.start)
    best = np.full(len(counts), np.inf)
    np.minimum.at(best, np.repeat(np.arange(len(counts)), counts), sightings.incidence_deg)
    angle, many = np.where(counts > 0, best, np.nan), np.where(counts > 0, counts, np.nan)
    absent = "not at the middle of a pixel"
    return (
        Numbers(
            key="quality",
            label="Best incidence",
            unit="\u00b0",
            values=angle,
            low=0,
            high=90,
            digits=1,
            absent=absent,
        ),
        Numbers(
            key="views",
            label="Scans that see it",
            unit="",
            values=many,
            low=1,
            high=max(n_scans, 2),
            digits=0,
            absent=absent,
            small_is_good=False,
        ),
    )
