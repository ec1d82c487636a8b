# SPDX-License-Identifier: MIT
"""Extension: the hidden cells that a surface is inferred to cover, each with the reason why."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from completion.boundary.boundary_pixels import Rim, RimPoints
from completion.boundary.continuation import Stretch, continue_edges
from completion.boundary.creases import meeting_line
from completion.boundary.cues import ALL_CUES, Cue
from completion.boundary.edges import Edge, edge_along, find_edges
from completion.boundary.hidden_regions import Shadows, divide
from completion.boundary.labelling import Labelling, label_pieces
from completion.boundary.meshing import Trim
from completion.boundary.rings import rings_passed
from completion.edits.surface_edits import Verdict
from completion.evidence.chart_grid import ChartGrid
from completion.evidence.evidence import Evidence, Label, weigh
from completion.extension.confidence import estimate
from completion.extension.extent import Limits, Mode
from completion.extension.layout import in_box, lay_grid
from completion.extension.provenance import Provenance, hull_of, provenance_of
from completion.merging.pipeline import MergedSurface
from completion.observe.observation import Observation
from completion.observe.tolerance import EvidenceOptions
from scenes.checks import BoolArray, FloatArray
from scenes.surfaces.catalogue import Cylinder

LEAST_CONFIDENCE: dict[Mode, float] = {"conservative": 0.8, "standard": 0.5, "bold": 0.2}
"""Probability below which a place is left unknown."""


@dataclass(frozen=True, slots=True, eq=False)
class Patch:
    """One completed surface in its chart.

    Attributes
    ----------
    source : MergedSurface
        The fit and the pixels behind it.
    limits : Limits
        What bounded the continuation.
    grid : ChartGrid
        The cells.
    evidence : Evidence
        What the scans say of them.
    hypothesised : (rows, columns) bool
        Cells that the surface is inferred to cover.
    provenance : (rows, columns) int8
        A `Provenance` for each observed or hypothesised cell, -1 elsewhere.
    confidence : (rows, columns) float
        Probability that the surface is there; 1 where it was measured, 0 where it cannot be.
    spread : (rows, columns) float
        Predicted standard deviation along the normal, metres.
    is_within : (rows, columns) bool
        Cells that are not beyond what the surface ends at, seen or not.
    edges : tuple of Edge
        Its creases and own edges.
    stretches : tuple of Stretch
        Its edges, continued where they are hidden.
    shadows : Shadows
        The hidden cells in the pieces that those edges part them into.
    labelling : Labelling
        Which pieces are surface.
    trims : tuple of Trim
        Where the mesh of hypothesised cells is cut along continued edges and declared openings.
    verdict : Verdict
        What a person says of it.
    """

    source: MergedSurface
    limits: Limits
    grid: ChartGrid
    evidence: Evidence
    hypothesised: BoolArray
    provenance: NDArray[np.int8]
    confidence: FloatArray
    spread: FloatArray
    is_within: BoolArray
    edges: tuple[Edge, ...]
    stretches: tuple[Stretch, ...]
    shadows: Shadows
    labelling: Labelling
    trims: tuple[Trim, ...]
    verdict: Verdict

    @property
    def observed(self) -> BoolArray:
        """Cells where the surface was measured."""
        return self.evidence.observed

    @property
    def observed_m2(self) -> float:
        """Measured area in square metres."""
        return float(self.observed.sum()) * self.grid.cell_area

    @property
    def hypothesised_m2(self) -> float:
        """Inferred area in square metres, cells cut by a limit counted whole."""
        return float(self.hypothesised.sum()) * self.grid.cell_area


def extend(
    surface: MergedSurface,
    rim: RimPoints,
    limits: Limits,
    observations: Sequence[Observation],
    owners: Sequence[NDArray[np.int32]],
    owner: int,
    options: EvidenceOptions,
    mode: Mode,
    max_sd_m: float,
    verdict: Verdict,
    cues: Collection[Cue] = ALL_CUES,
) -> Patch:
    """Continue a surface into the cells that are hidden, within its limits.

    Its own edges are followed into the hidden zone and part it into pieces; the cheapest boundary says which
    pieces are surface and how clearly. A cell is filled only where some scan says OCCLUDED and none says
    FREE, where the surface is known to `max_sd_m`, and where it is probable enough for the mode; or where a
    person accepts it, who may not overrule the beams.
    """
    grid = lay_grid(surface, limits, observations, options.max_cells)
    spread = surface.fit.standard_deviation(grid.centres())
    evidence = weigh(grid, spread, observations=observations, owners=owners, owner=owner, options=options)
    edges = _boundaries(limits, rim.recharted(surface.fit.surface, limits.chart))

    within = _within(grid, limits, evidence)
    possible = _possible(grid, limits, evidence, verdict) & within & (spread <= max_sd_m).reshape(grid.shape)
    accepted = possible & verdict.accepted(grid, in_box(grid, limits, *limits.known_window()))
    hidden = possible & in_box(grid, limits, *limits.window())
    if mode == "conservative":
        hidden &= hull_of(grid, evidence.observed)
    stretches = continue_edges(edges, grid, hidden, cues)
    seen = _across_limb(evidence, grid)
    shadows = divide(grid, hidden, seen, evidence.open, stretches)
    labelling = label_pieces(shadows)

    confidence = estimate(
        grid, shadows, labelling=labelling, limits=limits, observed=evidence.observed, open_=evidence.open
    )
    probable = hidden & (confidence >= LEAST_CONFIDENCE[mode]) & ~verdict.rejected(grid)
    filled = _reached(probable | accepted, seen, grid) | (accepted & verdict.drawn(grid))
    hypothesised, trims = _trimmed(
        grid, evidence, filled & (evidence.labels == Label.OCCLUDED), shadows, stretches
    )
    hypothesised, trims = _without(verdict, grid, hypothesised & ~verdict.rejected(grid), evidence, trims)
    provenance = provenance_of(grid, limits, evidence.observed, hypothesised)
    said = accepted & ~_reached(probable, seen, grid) | _to_said_end(grid, limits)
    said |= verdict.is_joined & (provenance == Provenance.BETWEEN)
    provenance[hypothesised & said] = Provenance.USER
    return Patch(
        source=surface,
        limits=limits,
        grid=grid,
        evidence=evidence,
        hypothesised=hypothesised,
        provenance=provenance,
        confidence=confidence,
        spread=spread.reshape(grid.shape),
        is_within=within,
        edges=tuple(edges),
        stretches=tuple(stretches),
        shadows=shadows,
        labelling=labelling,
        trims=trims,
        verdict=verdict,
    )


def _possible(grid: ChartGrid, limits: Limits, evidence: Evidence, verdict: Verdict) -> BoolArray:
    """Cells that are neither measured nor passed by beams, nor in an opening that a person declared."""
    hidden = np.isin(evidence.labels, (Label.OCCLUDED, Label.NO_RETURN)) & ~evidence.open
    hidden &= ~evidence.observed & ~verdict.open_cells(grid)
    if isinstance(limits.chart, Cylinder):
        hidden &= ~rings_passed(evidence)[:, None]
    return hidden


def _across_limb(evidence: Evidence, grid: ChartGrid) -> BoolArray:
    """Measured cells, and those of a cylinder's limb beside them."""
    if not isinstance(grid.surface, Cylinder):
        return evidence.observed
    limb = evidence.limb & ~rings_passed(evidence)[:, None]
    return _connected(limb | evidence.observed, evidence.observed, grid.wraps)


def _reached(cells: BoolArray, seen: BoolArray, grid: ChartGrid) -> BoolArray:
    """Those of the cells that hang together with measured ones."""
    return cells & _connected(cells | seen, seen, grid.wraps)


def _without(
    verdict: Verdict, grid: ChartGrid, hypothesised: BoolArray, evidence: Evidence, trims: tuple[Trim, ...]
) -> tuple[BoolArray, tuple[Trim, ...]]:
    """Take declared openings out: whole cells, and by cuts through those that their sides cross."""
    sides = verdict.trims(grid)
    if not sides:
        return hypothesised, trims
    declared = verdict.open_cells(grid)
    crossed = np.logical_or.reduce([side.cells for side in sides])
    around = ndimage.binary_dilation(hypothesised & ~declared, np.ones((3, 3)))
    parted = crossed & declared & around & (evidence.labels == Label.OCCLUDED) & ~evidence.observed
    return hypothesised & ~declared | parted, (*trims, *sides)


def _to_said_end(grid: ChartGrid, limits: Limits) -> BoolArray:
    """Cells beyond what was measured on the sides where a person set the end."""
    uv = grid.centres_uv()
    beyond = np.stack([uv < limits.own_low, uv > limits.own_high])  # side, row, column, axis
    return np.asarray((beyond & limits.said[:, None, None, :]).any(axis=(0, 3)), dtype=np.bool_)


def _boundaries(limits: Limits, rim: RimPoints) -> list[Edge]:
    """Creases with the surfaces that it meets, and its own edges elsewhere."""
    creases, free = [], rim.kind == Rim.OWN_EDGE
    seen = np.isin(rim.kind, (Rim.CONTIGUOUS, Rim.OWN_EDGE))
    for neighbour in limits.neighbours:
        line = meeting_line(limits.chart, neighbour)
        if line is not None:
            edge, members = edge_along(line, rim.only(seen))
            free[np.flatnonzero(seen)[members]] = False
            creases.append(edge)
    return [edge for edge in creases if len(edge.runs)] + find_edges(rim.only(free))


def _trimmed(
    grid: ChartGrid,
    evidence: Evidence,
    hypothesised: BoolArray,
    shadows: Shadows,
    stretches: Sequence[Stretch],
) -> tuple[BoolArray, tuple[Trim, ...]]:
    """Add the hidden cells that a continued edge cuts in two, and say where to cut them."""
    filled, occluded = hypothesised.ravel(), (evidence.labels == Label.OCCLUDED).ravel()
    result, trims = filled.copy(), []
    borders = shadows.borders
    for number, stretch in enumerate(stretches):
        at = borders.stretch == number
        pairs = np.stack([borders.first[at], borders.second[at]])
        pairs = pairs[:, filled[pairs[0]] != filled[pairs[1]]]
        if not pairs.size:
            continue
        inner = pairs.T[filled[pairs].T]
        uv = grid.centres_uv().reshape(-1, 2)[inner]
        sign = 1.0 if np.mean(stretch.curve.across(uv) >= 0) > 0.5 else -1.0
        outer = pairs.T[~filled[pairs].T]
        result[outer[occluded[outer]]] = True
        touched = np.zeros(len(filled), dtype=np.bool_)
        touched[pairs.ravel()] = True
        near = ndimage.binary_dilation(touched.reshape(grid.shape), np.ones((3, 3)))
        trims.append(Trim(stretch.curve, sign, near))
    return result.reshape(grid.shape), tuple(trims)


def _within(grid: ChartGrid, limits: Limits, evidence: Evidence) -> BoolArray:
    """Cells on the right side of every cut that are not hidden behind what encloses the room."""
    centres = grid.centres()
    inside = np.ones(grid.shape, dtype=np.bool_)
    for cut in limits.cuts:
        inside &= (cut.distance(centres) > -float(np.hypot(*grid.cell) / 2)).reshape(grid.shape)
    for number, plane in limits.enclosures:
        behind = (plane.distance(centres) < 0).reshape(grid.shape)
        inside &= ~(behind & (evidence.occluder == number) & (evidence.labels == Label.OCCLUDED))
    return inside


def _connected(passable: BoolArray, start: BoolArray, wraps: bool) -> BoolArray:
    """The part of `passable` connected with `start`, across the seam where the grid wraps."""
    part, n_parts = ndimage.label(passable)
    reached = np.zeros(n_parts + 1, dtype=np.bool_)
    reached[np.unique(part[start & passable])] = True
    reached[0] = False
    for _ in range(2 if wraps else 0):
        both = (part[:, 0] > 0) & (part[:, -1] > 0)
        joined = both & (reached[part[:, 0]] | reached[part[:, -1]])
        reached[part[joined, 0]] = reached[part[joined, -1]] = True
    return np.asarray(reached[part], dtype=np.bool_)
