# SPDX-License-Identifier: MIT
"""Extension: the hidden cells that a surface is inferred to cover, each with the reason why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import ndimage

from completion.boundary.boundary_pixels import BoundaryKind, BoundaryPixels
from completion.boundary.continuation import ContinuedEdge, continue_edges
from completion.boundary.edges import BoundaryEdge, edge_along, find_edges, meeting_line
from completion.boundary.hidden_regions import HiddenRegions, divide_hidden, label_regions
from completion.boundary.meshing import Trim, trimmed_to_frames
from completion.edits.application import EditedSurface
from completion.edits.edit import SurfaceEdits
from completion.evidence.chart_grid import ChartGrid
from completion.evidence.evidence import Evidence, Label, Scans
from completion.evidence.sight import ball_around
from completion.evidence.weighing import weigh
from completion.extension.confidence import as_far_as_probable, estimate, silent_cells, trust
from completion.extension.extent import ExtensionRules, Extent, with_ends, with_joints
from completion.extension.features import lay_openings
from completion.extension.grid import lay_grid
from completion.extension.limits import LEAST_CONFIDENCE, LEAST_OF_ROOM, SPECK_CELLS
from completion.extension.patch import Patch, Provenance, in_hull, in_hulls, provenance_of
from completion.fitting.result import SurfaceFit
from completion.room import limits
from completion.room.roles import NO_ROOM, Room
from scenes.checks import BoolArray
from scenes.surfaces.catalogue import Cylinder


def extend(
    boundary: BoundaryPixels,
    extent: Extent,
    edited: EditedSurface,
    stated: SurfaceFit,
    *,
    scans: Scans,
    room: Room = NO_ROOM,
    number: int,
    rules: ExtensionRules,
) -> Patch:
    """Continue a surface into the cells that are hidden, within its extent.

    A cell is filled where some scan says OCCLUDED and none says FREE, where the surface is known well enough,
    and where it is probable enough for the mode. Beside such cells the edge of the view cuts others, of which
    the part in view is filled. A person may accept improbable cells, but cannot overrule a beam.

    Parameters
    ----------
    boundary : BoundaryPixels
        Of the surface's regions, in the chart of its fit.
    extent : Extent
        How far it may go, by what was measured.
    edited : EditedSurface
        The surface, working frame, and what a person says of it.
    stated : SurfaceFit
        Its fit with the covariance of all errors.
    scans : Scans
        All scans.
    room : Room
        What they show of the room.
    number : int
        This surface's number in `scans.owners`, from 1.
    rules : ExtensionRules
        What may be used, and how sure the result must be.
    """
    # 1. Weigh: what the scans say of each cell of the chart.
    surface, edits, mode = edited.surface, edited.edits, rules.wishes.mode
    least = (LEAST_OF_ROOM if extent.role else LEAST_CONFIDENCE)[mode]
    is_said = edits.ends or edits.wishes
    if edits.joints:
        extent = with_joints(extent, [joint.plane for joint in edits.joints])
    if is_said:
        extent = with_ends(extent, edits.ends)
    elif extent.role:
        extent = replace(
            extent, reach=np.stack([extent.own_low - limits.FARTHEST_M, extent.own_high + limits.FARTHEST_M])
        )
    else:
        extent = as_far_as_probable(extent, least)
    grid = lay_grid(surface, extent, scans, max_cells=rules.max_cells, cell_m=rules.cell_m)
    predicted_sd = surface.fit.standard_deviation(grid.centres())
    evidence = weigh(grid, predicted_sd, scans, number)
    predicted_sd = predicted_sd.reshape(grid.shape)

    # 2. Hidden cells: where the surface may be, unseen; and those of them that a person accepts.
    within = _within(grid, extent, evidence, room)
    possible = _possible(grid, evidence, edits) & within & (predicted_sd <= rules.wishes.max_sd_m)
    accepted = possible & edits.accepted_cells(grid, grid.within(*extent.known_window()))
    hidden = possible & grid.within(*extent.window())
    if rules.wishes.mode == "conservative":
        hidden = in_hull(evidence.observed, hidden)
    if extent.is_inset:
        hidden = in_hulls(evidence.observed, hidden)

    # 3. Divide: continue the surface's own edges through the hidden cells, which fall into regions.
    edges = _boundary_edges(extent, boundary.in_chart(surface.fit.surface, extent.chart))
    continued = continue_edges(edges, grid, hidden, rules.cues)
    measured = _across_limb(evidence, grid)
    regions = divide_hidden(grid, hidden, measured, evidence.open, continued)

    # 4. Label: the cheapest boundary says which regions are surface, and how probable each cell is.
    labelling = label_regions(regions)
    confidence = estimate(grid, regions, labelling, extent, evidence, room=room)

    # 5. Fill: what is probable or accepted, and hangs together with what was measured.
    probable = hidden & (confidence >= least) & ~edits.rejected_cells(grid)
    filled = _connected_cells(probable | accepted, measured, grid) | (accepted & edits.outlined_cells(grid))

    # 6. Openings: lay those that were fitted whole into what is filled, to their exact sides.
    filled, confidence, edits = lay_openings(
        grid, hidden, filled, confidence, open_=evidence.open, edits=edits, least=least
    )
    occluded = filled & (evidence.labels == Label.OCCLUDED)

    # 7. Silence: where nothing came back, how probably that is surface, by what is around. Walls have panes;
    #    a floor is dark or polished there, and goes on as it does behind things.
    silent = silent_cells(evidence, hidden)
    if extent.role != "floor":
        is_wall = extent.encloses
        confidence = confidence * trust(grid, evidence, hidden, occluded, within=within, is_wall=is_wall)
    filled = occluded | (filled & silent & (confidence >= least))
    if extent.role:
        filled = _without_specks(filled)

    # 8. Trim: cut cells along the continued edges, declared openings and the edges of the view.
    filled, trims = _add_trimmed_cells(grid, evidence, filled, regions, continued)
    filled, trims = _without_openings(grid, evidence, filled & ~edits.rejected_cells(grid), edits, trims)
    looking = np.flatnonzero(scans.views.may_see(ball_around(grid.bounds(), grid.cell)))
    frames = [scans.observations[scan] for scan in looking.tolist()]
    filled, confidence, cut = trimmed_to_frames(grid, evidence, filled, confidence, frames)
    trims = (*trims, *cut)

    # 9. Provenance: why each cell is in the model.
    provenance = provenance_of(grid, extent, evidence.observed, filled)
    provenance[filled & silent] = Provenance.NO_RETURN
    provenance[filled & _beyond(grid, extent, extent.by_feature)] = Provenance.FEATURE
    by_edit = accepted & ~_connected_cells(probable, measured, grid) | _beyond(grid, extent, extent.by_edit)
    by_edit |= edits.is_joined & (provenance == Provenance.BETWEEN)
    provenance[filled & by_edit] = Provenance.USER
    return Patch(
        source=surface,
        stated=stated,
        limits=extent,
        grid=grid,
        evidence=evidence,
        hypothesised=filled,
        provenance=provenance,
        confidence=confidence,
        spread=predicted_sd,
        is_within=within,
        edges=tuple(edges),
        stretches=tuple(continued),
        shadows=regions,
        labelling=labelling,
        trims=trims,
        verdict=edits,
    )


def _possible(grid: ChartGrid, evidence: Evidence, edits: SurfaceEdits) -> BoolArray:
    """Cells that are neither measured nor passed by beams, nor in an opening that a person declared.

    At its limb a cylinder is too oblique to tell: its back may go on to there, but no beam was lost.
    """
    silent = np.isin(evidence.labels, (Label.UNLIT, Label.NO_RETURN)) & ~evidence.through
    hidden = (silent | (evidence.labels == Label.OCCLUDED)) & ~evidence.open
    hidden &= ~evidence.observed & ~edits.declared_cells(grid)
    if isinstance(grid.surface, Cylinder):
        hidden &= ~evidence.rings_passed()[:, None]
    return np.asarray(hidden)


def _across_limb(evidence: Evidence, grid: ChartGrid) -> BoolArray:
    """Measured cells, and those of a cylinder's limb beside them."""
    if not isinstance(grid.surface, Cylinder):
        return evidence.observed
    limb = evidence.limb & ~evidence.rings_passed()[:, None]
    return _connected_part(limb | evidence.observed, evidence.observed, grid.wraps)


def _without_specks(filled: BoolArray) -> BoolArray:
    """Inferred cells (rows, columns) without parts of a few: the view's edge is ragged in cells."""
    part, _ = ndimage.label(filled, np.ones((3, 3)))
    is_speck = np.bincount(part.ravel()) < SPECK_CELLS
    return np.asarray(filled & ~is_speck[part], dtype=np.bool_)


def _connected_cells(cells: BoolArray, measured: BoolArray, grid: ChartGrid) -> BoolArray:
    """Those of the cells that hang together with measured ones."""
    return cells & _connected_part(cells | measured, measured, grid.wraps)


def _without_openings(
    grid: ChartGrid, evidence: Evidence, filled: BoolArray, edits: SurfaceEdits, trims: tuple[Trim, ...]
) -> tuple[BoolArray, tuple[Trim, ...]]:
    """Take declared openings out: whole cells, and by cuts through those that their sides cross."""
    declared = edits.open_cells(grid)
    around = ndimage.binary_dilation(filled & ~declared, np.ones((3, 3)))
    sides = [side for side in edits.trims(grid) if (side.cells & around).any()]
    if not sides:
        return filled & ~declared, trims
    crossed = np.logical_or.reduce([side.cells for side in sides])
    parted = crossed & declared & around & (evidence.labels == Label.OCCLUDED) & ~evidence.observed
    return filled & ~declared | parted, (*trims, *sides)


def _beyond(grid: ChartGrid, extent: Extent, sides: BoolArray) -> BoolArray:
    """Cells beyond what was measured on some sides (2, 2): those where a person or a joint set the end."""
    u, v = grid.axes()
    across, up = (
        (sides[0, axis] & (centre < extent.own_low[axis]))
        | (sides[1, axis] & (centre > extent.own_high[axis]))
        for axis, centre in enumerate((u, v))
    )
    return np.asarray(up[:, None] | across, dtype=np.bool_)


def _boundary_edges(extent: Extent, boundary: BoundaryPixels) -> list[BoundaryEdge]:
    """Creases with the neighbours of a surface, and its own edges where it has no neighbour."""
    creases, free = [], boundary.kind == BoundaryKind.OWN_EDGE
    seen = np.isin(boundary.kind, (BoundaryKind.CONTIGUOUS, BoundaryKind.OWN_EDGE))
    for neighbour in extent.neighbours:
        line = meeting_line(extent.chart, neighbour)
        if line is not None:
            edge, members = edge_along(line, boundary.only(seen))
            free[np.flatnonzero(seen)[members]] = False
            creases.append(edge)
    return [edge for edge in creases if len(edge.runs)] + find_edges(boundary.only(free))


def _add_trimmed_cells(
    grid: ChartGrid,
    evidence: Evidence,
    hypothesised: BoolArray,
    regions: HiddenRegions,
    continued: Sequence[ContinuedEdge],
) -> tuple[BoolArray, tuple[Trim, ...]]:
    """Add the hidden cells that a continued edge cuts in two, and say where to cut them."""
    filled, occluded = hypothesised.ravel(), (evidence.labels == Label.OCCLUDED).ravel()
    result, trims = filled.copy(), []
    borders = regions.borders
    for number, edge in enumerate(continued):
        at = borders.edge == number
        pairs = np.stack([borders.first[at], borders.second[at]])
        pairs = pairs[:, filled[pairs[0]] != filled[pairs[1]]]
        if not pairs.size:
            continue
        inner = pairs.T[filled[pairs].T]
        uv = grid.centres_uv().reshape(-1, 2)[inner]
        sign = 1.0 if np.mean(edge.curve.across(uv) >= 0) > 0.5 else -1.0
        outer = pairs.T[~filled[pairs].T]
        result[outer[occluded[outer]]] = True
        touched = np.zeros(len(filled), dtype=np.bool_)
        touched[pairs.ravel()] = True
        near = ndimage.binary_dilation(touched.reshape(grid.shape), np.ones((3, 3)))
        trims.append(Trim(edge.curve, sign, near))
    return result.reshape(grid.shape), tuple(trims)


def _within(grid: ChartGrid, extent: Extent, evidence: Evidence, room: Room) -> BoolArray:
    """Cells on the right side of every cut that are not hidden behind what bounds the room.

    What is in a room in which a scanner stands is behind nothing.
    """
    inside, centres = np.ones(grid.shape, dtype=np.bool_), grid.centres()
    for cut in extent.cuts:
        inside &= (cut.distance(centres) > -float(np.hypot(*grid.cell) / 2)).reshape(grid.shape)
    unseen = np.isin(evidence.labels, (Label.OCCLUDED, Label.NO_RETURN))
    at = np.flatnonzero(unseen & inside)
    at = at[~room.holds(centres[at] + limits.ASIDE_M * grid.surface.normal(centres[at]))]
    behind = room.hides(centres[at], extent.index) if room.walls else np.zeros(len(at), dtype=np.bool_)
    occluder, is_occluded = evidence.occluder.ravel()[at], evidence.labels.ravel()[at] == Label.OCCLUDED
    for number, plane in extent.enclosures:
        behind |= is_occluded & (occluder == number) & (plane.distance(centres[at]) < 0)
    inside.ravel()[at[behind]] = False
    return inside


def _connected_part(passable: BoolArray, start: BoolArray, wraps: bool) -> BoolArray:
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
