# SPDX-License-Identifier: MIT
"""Known faces: what scans say of the faces of features, and what of them is inferred."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from completion.boundary.hidden_regions import divide_hidden, label_regions
from completion.edits.edit import SurfaceEdits
from completion.edits.fitted import KnownFace
from completion.evidence.chart_grid import ChartGrid
from completion.evidence.evidence import Label, Scans
from completion.evidence.weighing import weigh
from completion.extension.extent import Extent
from completion.extension.patch import Patch, Provenance, in_hull
from completion.extension.pipeline import LEAST_CONFIDENCE, ExtensionRules
from completion.observe.observation import Observation
from scenes.checks import FloatArray
from scenes.run.mapping import trim

Owners = NDArray[np.int32]

GOES_ON = 0.95
"""Probability that a reveal whose side and depth are known is there."""

_FEWEST_CELLS = 3  # across a face


def with_faces(
    scans: Scans, faces: Sequence[KnownFace], n_surfaces: int, keep: Callable[[Owners], Owners]
) -> Scans:
    """Return the scans with the pixels of faces numbered on from those of `n_surfaces` surfaces.

    `keep` puts the numbers (rows, columns) of a scan where arrays of its size are kept.
    """
    owners = list(scans.owners)
    for scan, before in enumerate(scans.owners):
        measured = [
            (number, face.surface.pixels[scan].flat)
            for number, face in enumerate(faces, start=n_surfaces + 1)
            if len(face.surface.pixels[scan])
        ]
        if not measured:
            continue
        owner = before.copy()
        for number, flat in measured:
            owner.ravel()[flat] = number
        owners[scan] = keep(owner)
        trim()
    return scans.numbered(owners)


def extend_face(face: KnownFace, scans: Scans, number: int, rules: ExtensionRules) -> Patch:
    """Infer a face of a feature where it is hidden, within its outline.

    Its place and its outline come from the feature. A cell is filled where some scan says OCCLUDED and none
    says FREE, and nowhere else: where nothing came back, and where nobody looked, it stays unknown.

    Parameters
    ----------
    face : KnownFace
        The face, working frame.
    scans : Scans
        All scans, their pixels numbered with those of the face.
    number : int
        Its number in `scans.owners`, from 1.
    rules : ExtensionRules
        How sure the result must be, and how fine.
    """
    surface, fit = face.surface, face.surface.fit
    low, high = -face.size / 2, face.size / 2
    cell = _footprint(face, scans.observations) if rules.cell_m is None else rules.cell_m
    grid = _grid(face, max(cell, float(np.sqrt(np.prod(face.size) / rules.max_cells))))
    spread = fit.standard_deviation(grid.centres())
    evidence = weigh(grid, spread, scans, number)
    hidden = (evidence.labels == Label.OCCLUDED) & ~evidence.open & ~evidence.observed
    hidden &= (spread.reshape(grid.shape) <= rules.max_sd_m) & (LEAST_CONFIDENCE[rules.mode] <= GOES_ON)
    if rules.mode == "conservative":
        hidden = in_hull(evidence.observed, hidden)
    regions = divide_hidden(grid, hidden, evidence.observed, evidence.open, ())
    provenance = np.where(hidden, np.int8(Provenance.FEATURE), np.int8(-1))
    provenance[evidence.observed] = Provenance.MEASURED
    return Patch(
        source=surface,
        stated=fit,
        limits=Extent(
            chart=fit.surface,
            enclosures=(),
            cuts=(),
            neighbours=(),
            own_low=low,
            own_high=high,
            ends=np.stack([low, high]),
            end_probability=np.ones((2, 2)),
            ended=np.ones((2, 2), dtype=np.bool_),
            full_turn=False,
            encloses=False,
        ),
        grid=grid,
        evidence=evidence,
        hypothesised=hidden,
        provenance=provenance,
        confidence=np.where(evidence.observed, 1.0, GOES_ON * hidden),
        spread=spread.reshape(grid.shape),
        is_within=np.ones(grid.shape, dtype=np.bool_),
        edges=(),
        stretches=(),
        shadows=regions,
        labelling=label_regions(regions),
        trims=(),
        verdict=SurfaceEdits(),
        feature=face.feature,
    )


def _footprint(face: KnownFace, observations: Sequence[Observation]) -> float:
    """How wide the pixels of the nearest scan are on a face that they look at, metres."""
    plane = face.surface.fit.surface
    middle: FloatArray = plane.from_uv(np.zeros((1, 2)))[0]
    return min(
        float(np.linalg.norm(middle - seen.scan.origin)) * seen.scan.projection.pixel_angle
        for seen in observations
    )


def _grid(face: KnownFace, cell_m: float) -> ChartGrid:
    """Cells of about one size that fill the outline exactly."""
    count = np.maximum(np.ceil(face.size / cell_m - 1e-6).astype(np.int64), _FEWEST_CELLS)
    chart = face.surface.fit.surface
    return ChartGrid(chart, -face.size / 2, face.size / count, (int(count[1]), int(count[0])), wraps=False)
