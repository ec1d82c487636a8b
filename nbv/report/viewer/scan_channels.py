# SPDX-License-Identifier: MIT
"""What scans say of faces in the 3-D view: provenance, which scans see them, and at which incidence."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from completion.extension.patch import Provenance
from completion.result.labelled_points import PROVENANCE_NAMES
from nbv.coverage.coverage import VisibilityHistory
from nbv.coverage.measurement import measured_samples
from nbv.report.pictures import picture
from nbv.report.viewer.layers import Category, Numbers, Sightings, count_channel, incidence_channel
from nbv.scans.scan_map import with_known_noise
from nbv.visibility.samples import SurfaceSamples
from scenes.checks import FloatArray
from scenes.run.mapping import trim
from scenes.scan.colour import surface_rgb
from scenes.scan.range_image import RangeImage

MEASURED = Category("measured", picture.MEASURED)
INFERRED = Category("inferred", picture.INFERRED)
_BLOCK = 1 << 16  # faces whose sightings are found together
_PROVENANCE_COLOURS = (0, 1, 14, 5, 3, 13, 6, 10, 9)  # of `Provenance`, numbers in the palette of surfaces


def provenance_categories() -> tuple[Category, ...]:
    """How a place came to be in the model, each with its colour."""
    colours = (picture.MEASURED, *(surface_rgb(k) for k in _PROVENANCE_COLOURS[1:]))
    return tuple(Category(PROVENANCE_NAMES[str(why.value)], colours[int(why)]) for why in Provenance)


def scan_sightings(scans: Sequence[RangeImage], vertices: FloatArray, faces: NDArray[Any]) -> Sightings:
    """Which scans measured the middles of faces (m, 3), and at which incidence.

    Faces of the vertices (n, 3) are asked for a block at a time.
    """
    known = [with_known_noise(scan) for scan in scans]
    blocks = [faces[start : start + _BLOCK] for start in range(0, len(faces), _BLOCK)]
    sightings = [_sightings_of(known, vertices[block]) for block in blocks]
    counts = [np.diff(sightings.start) for sightings in sightings]
    return Sightings(
        np.concatenate([[0], np.cumsum(np.concatenate([np.zeros(0, np.int64), *counts]))]),
        np.concatenate([np.zeros(0, np.int64), *(sightings.view for sightings in sightings)]),
        np.concatenate([np.zeros(0), *(sightings.incidence_deg for sightings in sightings)]),
    )


def _sightings_of(scans: Sequence[RangeImage], corners: FloatArray) -> Sightings:
    """Which scans measured the middles of faces (m, 3, 3)."""
    a, b, c = np.moveaxis(corners, 1, 0)
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1)
    unit = np.divide(normals, length[:, None], out=np.zeros_like(normals), where=length[:, None] > 0)
    zero = np.zeros(len(corners), np.int32)
    samples = SurfaceSamples(corners.mean(axis=1), unit, length / 2, zero, zero)
    numbered = []
    for number, scan in enumerate(scans, start=1):
        numbered.append((number, *measured_samples(scan, samples)))
        trim()
    seen = VisibilityHistory.of(numbered, np.zeros(len(corners), np.int64), ())
    return Sightings(seen.start, seen.view, np.degrees(np.arccos(np.clip(seen.cosine, 0, 1))))


def quality_channels(sightings: Sightings, n_scans: int) -> tuple[Numbers, Numbers]:
    """Best incidence and number of scans of each place."""
    counts = np.diff(sightings.start)
    best = np.full(len(counts), np.inf)
    np.minimum.at(best, np.repeat(np.arange(len(counts)), counts), sightings.incidence_deg)
    angle, many = np.where(counts > 0, best, np.nan), np.where(counts > 0, counts, np.nan)
    absent = "not at the middle of a pixel"
    counted = count_channel("Scans that see it", many, max(n_scans, 2), absent)
    return incidence_channel(angle, absent), counted
