# SPDX-License-Identifier: MIT
"""Surfaces of scans: their relations inferred, and each surface moved to where these hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import accumulate

import numpy as np

from completion.edits.application import EditedSurface, surface_at
from completion.edits.edit import Anchor
from completion.fitting.result import SurfaceFit
from completion.merging.merged_surface import MergedSurface
from completion.observe.observation import Observation
from completion.observe.sensor_modes import range_displacements
from completion.observe.tolerance import POSE_BOUND
from completion.relations.engine.estimate import Doubt, Estimate
from completion.relations.engine.wald import with_only
from completion.relations.graph import RelationGraph, is_settled
from completion.relations.options import RelationOptions
from completion.relations.pipeline import infer
from completion.relations.stated import StatedRelation
from completion.uncertainty.joint_errors import UNRELATED, JointErrors, RelatedErrors
from completion.uncertainty.pipeline import StatedFits, shift_by_sensors
from scenes.checks import FloatArray
from scenes.pose import Pose
from scenes.scan.range_image import MESH_SENSOR

MOST_LEAST, LEAST_LEAST, LEAST_SHARE = 1_200, 200, 0.004
"""Pixels of a surface that relations are inferred of: that share of a scan's, between the other two."""
_SHARE_OFF = 0.95
_MOST_OFF = 0.5  # of the scatter of its points about it, by which a surface may be moved off them
_N_SAMPLE = 1_000  # pixels that tell how far a surface was moved off what was measured


@dataclass(frozen=True, slots=True, eq=False)
class FoundRelations:
    """What was found of surfaces' relations.

    Attributes
    ----------
    graph : RelationGraph
        Surfaces where their relations hold, working frame.
    before : tuple of SurfaceFit
        The same n surfaces without, with the covariances of all errors.
    numbers : tuple of int
        Their numbers (n,) in files, from 1; 0 for one that has none.
    off_m : tuple of float
        How far each (n,) would stand off its measured points, metres: 95 % are nearer.
    is_moved : tuple of bool
        Which (n,) are where their relations hold; the others stayed where they were measured.
    """

    graph: RelationGraph
    before: tuple[SurfaceFit, ...]
    numbers: tuple[int, ...]
    off_m: tuple[float, ...]
    is_moved: tuple[bool, ...]

    def numbered(self, chosen: Sequence[bool]) -> FoundRelations:
        """Return it with numbers counted anew, of surfaces (m,) that are `chosen` alone."""
        anew = np.where(chosen, np.cumsum(chosen), 0)
        return replace(self, numbers=tuple(int(anew[number - 1]) for number in self.numbers))


@dataclass(frozen=True, slots=True, eq=False)
class RelatedSurfaces:
    """Surfaces where their relations hold.

    Attributes
    ----------
    surfaces : tuple of EditedSurface
        All n, in their order.
    stated : tuple of SurfaceFit
        Their fits (n,) with the covariances of all errors, given the relations.
    errors : JointErrors
        The same, jointly.
    found : FoundRelations, optional
        Which relations there are; None where nobody asked for them, or there is nothing to relate.
    """

    surfaces: tuple[EditedSurface, ...]
    stated: tuple[SurfaceFit, ...]
    errors: JointErrors
    found: FoundRelations | None = None


def relate_surfaces(
    edited: Sequence[EditedSurface],
    stated: StatedFits,
    observations: Sequence[Observation],
    options: RelationOptions | None,
    given: Sequence[StatedRelation[Anchor]] = (),
    *,
    world_from_reference: Pose,
) -> RelatedSurfaces:
    """Infer what the surfaces of scans are to each other, and move them to where that holds.

    Relations are inferred of surfaces of at least 1,200 pixels (fewer in small scans), and of all that a
    person names. A surface is
    moved where its measured points hardly show it: by less than half of their scatter about it. One that a
    sensor bent stays where it was measured, so that what is inferred of it joins what was measured.

    Parameters
    ----------
    edited : sequence of EditedSurface
        The surfaces (n,), working frame.
    stated : StatedFits
        How well they are known.
    observations : sequence of Observation
        The scans.
    options : RelationOptions, optional
        How exactly things are built, and what is looked for; None leaves the surfaces as they are.
    given : sequence of StatedRelation
        What a person states, world coordinates.
    world_from_reference : Pose
        From the working frame to the world.

    Raises
    ------
    InputError
        A person names a place where nothing was measured, or a relation that the surfaces there cannot have.
    """
    told = [stated.total(k) for k in range(len(edited))]
    if options is None:
        return RelatedSurfaces(tuple(edited), tuple(told), _errors(edited, told, stated, observations))
    named = [[surface_at(edited, anchor, one.source, observations, world_from_reference)
              for anchor in one.surfaces] for one in given]  # fmt: skip
    largest = max((seen.scan.ranges.size for seen in observations), default=0)
    least = float(np.clip(LEAST_SHARE * largest, LEAST_LEAST, MOST_LEAST))
    large = {
        k
        for k, (one, own) in enumerate(zip(edited, told, strict=True))
        if one.surface.n_pixels >= least and is_settled(own)
    }
    numbers = sorted(large.union(*named))
    if not numbers:
        return RelatedSurfaces(tuple(edited), tuple(told), _errors(edited, told, stated, observations))
    place = {number: k for k, number in enumerate(numbers)}
    relations = [one.of([place[number] for number in some]) for one, some in zip(given, named, strict=True)]
    doubt = Doubt([stated.freedom[number] for number in numbers], stated.smooth.covariance_of(numbers))
    graph = infer([stated.fits[number] for number in numbers], relations, options, doubt=doubt)
    short = _short_covariances([edited[number].surface.fit for number in numbers], graph)
    off = [_off(edited[k].surface, fit, observations) for k, fit in zip(numbers, graph.fits, strict=True)]
    is_moved = [far <= _MOST_OFF * edited[k].surface.fit.rms for k, far in zip(numbers, off, strict=True)]
    before, surfaces = tuple(told[k] for k in numbers), list(edited)
    for number, fit, covariance, moves in zip(numbers, graph.fits, short, is_moved, strict=True):
        if moves:
            surface = edited[number].surface
            moved = replace(surface.fit, surface=fit.surface, covariance=covariance)
            surfaces[number] = replace(edited[number], surface=replace(surface, fit=moved))
            told[number] = replace(moved, covariance=fit.covariance)
    places = tuple(number + 1 for number in numbers)
    found = FoundRelations(graph, before, places, off_m=tuple(off), is_moved=tuple(is_moved))
    first = tuple(accumulate((len(one.covariance) for one in graph.fits), initial=0))
    related = RelatedErrors(tuple(numbers), first, graph.covariance, tuple(is_moved))
    return RelatedSurfaces(
        tuple(surfaces), tuple(told), _errors(surfaces, told, stated, observations, related), found
    )


def _errors(
    edited: Sequence[EditedSurface],
    told: Sequence[SurfaceFit],
    stated: StatedFits,
    observations: Sequence[Observation],
    related: RelatedErrors = UNRELATED,
) -> JointErrors:
    """All errors of the surfaces, jointly, those of the scans' places included."""
    shares = np.zeros((len(edited), len(observations)))
    for number, one in enumerate(edited):
        for scan, held in one.surface.pixels.held:
            shares[number, scan] = len(held) / one.surface.n_pixels
    return JointErrors(
        own=tuple(one.covariance for one in told),
        shared=stated.smooth,
        related=related,
        ranges=tuple(shift_by_sensors(one.surface, observations, range_displacements) for one in edited),
        freedom=stated.freedom,
        shares=shares,
        pose_sd=np.array([seen.pose_error_m for seen in observations]) / POSE_BOUND,
        is_known=not any(seen.scan.sensor == MESH_SENSOR and not seen.is_noisy for seen in observations),
    )


def _short_covariances(fits: Sequence[SurfaceFit], graph: RelationGraph) -> list[FloatArray]:
    """The covariances (k, k) of errors as long as blocks of pixels, given the relations that hold.

    These tell how far a surface may stray from where it was measured nearby, which is what its continuation
    goes by; errors of the whole image move both alike.
    """
    placed = [replace(fit, surface=own.surface) for fit, own in zip(fits, graph.fits, strict=True)]
    estimate = with_only(graph.accepted, Estimate(placed, graph.options.up, graph.options.built_sd))
    return [estimate.covariance_of(number) for number in range(len(fits))]


def _off(before: MergedSurface, after: SurfaceFit, observations: Sequence[Observation]) -> float:
    points = before.points(observations, _N_SAMPLE)
    apart = after.surface.distance(points) - before.fit.surface.distance(points)
    return float(np.quantile(np.abs(apart), _SHARE_OFF)) if len(points) else 0.0
