# SPDX-License-Identifier: MIT
"""Doubts: in plain words, what a reader should know before trusting a completion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from completion.extension.patch import Patch
from completion.merging.pieces import UnconfirmedRegions
from completion.observe.observation import Observation
from completion.registration.correction import Registration
from completion.registration.registered import pose_doubts
from completion.relations.pipeline import SurfaceRelations
from completion.relations.relation import RelationStatus, kind_text
from completion.room.roles import Room
from scenes.checks import FloatArray
from scenes.inclination import LEVEL_COSINE
from scenes.scan.doubts import merge_warnings
from scenes.scan.projection import SphericalProjection
from scenes.surfaces.plane import Plane

_ROUGH_M = 0.01  # root mean square from which residuals are centimetres
_TIMES = 3.0  # the range noise, beyond which it does not explain them
_NAMED = 5  # surfaces that are named; more are counted
_SURE = 3.0  # standard deviations by which relations move a surface that are worth a warning
_ABOVE = 0.5  # sine of the elevation, 30 deg, from which on beams go over walls nearby
_WALLED = 0.7  # of the four ways along the plan's axes: three of them
_GROUND_M2, _GROUND_SHARE = 1.0, 0.1  # of inferred area that is open ground, worth a warning
_FEW_PX = 1000  # of a surface that are looked at


def doubts_of(
    observations: Sequence[Observation],
    patches: Sequence[Patch],
    registration: Registration,
    unconfirmed: UnconfirmedRegions,
    relations: SurfaceRelations | None,
) -> tuple[str, ...]:
    """Return what was left out of the scans or assumed, with each scan's name, and what came out doubtful.

    Steps between ranges that are wider than their noise; poses that contradict each other by more than they
    were said to be off; what single frames of a sequence took for surfaces; surfaces that their own points do
    not lie on, by centimetres and several times the noise.
    """
    doubts = merge_warnings([(seen.scan.name, _of_scan(seen)) for seen in observations])
    rough = [
        (number, patch, times)
        for number, patch in enumerate(patches, start=1)
        if patch.source.fit.rms >= _ROUGH_M and (times := _times_noise(patch, observations)) >= _TIMES
    ]
    doubts += pose_doubts(registration, way_out="--keep-poses keeps them")
    doubts += _of_relations(relations)
    if unconfirmed.n_regions:
        doubts.append(
            f"{unconfirmed.n_regions} regions of single frames ({unconfirmed.n_pixels} pixels) are of no "
            "surface: five other frames looked there from as near and did not find them; their points are "
            "kept as measured"
        )
    return (*doubts, *([_rough_text(rough)] if rough else []))


def ground_doubts(
    patches: Sequence[Patch], room: Room, observations: Sequence[Observation], up: FloatArray
) -> tuple[str, ...]:
    """Return a sentence where inferred area continues open ground: it is seldom as level as a floor.

    A panorama is outdoors where most of its beams upwards met nothing, or where it has none. There, ground is
    what is inferred on level planes, by the direction `up` (3,), below the scanners where walls end it on
    fewer than three of four sides.
    """
    if "ceiling" in room.roles or not any(_is_open_above(seen, up) for seen in observations):
        return ()
    eye = min(float(seen.scan.origin @ up) for seen in observations)
    inferred = ground = 0.0
    for patch in patches:
        inferred += patch.hypothesised_m2
        surface = patch.source.fit.surface
        if not isinstance(surface, Plane) or abs(surface.normal_direction @ up) < LEVEL_COSINE:
            continue
        places = patch.grid.centres()[patch.hypothesised.ravel()]
        is_open = (places @ up < eye) & (room.closed_at(places) < _WALLED)
        ground += float(is_open.sum()) * patch.grid.cell_area
    if ground < max(_GROUND_M2, _GROUND_SHARE * inferred):
        return ()
    return (
        f"{ground:.0f} of {inferred:.0f} m2 inferred continue a level surface below the scanner that walls "
        "bound on fewer than three sides, with nothing above: outdoors ground is seldom level, nor the same "
        "under cars and plants; leave it out by --only wall, or rely on what was measured",
    )


def _is_open_above(seen: Observation, up: FloatArray) -> bool:
    """Whether a scan is a panorama whose beams upwards, if it has any, met nothing for the most part."""
    projection = seen.scan.projection
    if not isinstance(projection, SphericalProjection) or np.ptp(projection.azimuths) < np.pi:
        return False
    above = projection.directions() @ seen.scan.world_from_sensor.rotation.T @ up > _ABOVE
    return not above.any() or bool(seen.scan.valid[above].mean() < 0.5)


def _of_relations(relations: SurfaceRelations | None) -> list[str]:
    """What a person stated that does not hold, and surfaces that relations would turn too far."""
    if relations is None:
        return []
    doubts = [
        f"the stated relation {kind_text(relation.kind)} of "
        f"{_surface_list(relation.surfaces, relations.numbers)} was rejected: {relation.reason}"
        for relation in relations.graph.relations
        if relation.is_given and relation.status is RelationStatus.REJECTED
    ]
    worst = int(np.argmax(relations.graph.moved_sd)) if relations.graph.moved_sd else 0
    if relations.graph.moved_sd and relations.graph.moved_sd[worst] > _SURE:
        doubts.append(
            f"relations move {_surface_list([worst], relations.numbers)} by "
            f"{relations.graph.moved_sd[worst]:.1f} of its standard deviations: it is less well known than "
            "is stated, or a relation is wrong (--relations off)"
        )
    return doubts


def _surface_list(places: Sequence[int], numbers: Sequence[int]) -> str:
    """Surfaces in words."""
    names = [
        f"surface {numbers[place]}" if numbers[place] else "a surface without number" for place in places
    ]
    return " and ".join(names)


def _of_scan(seen: Observation) -> tuple[str, ...]:
    step = seen.noise.step_m
    if step == 0:
        return seen.scan.warnings
    text = (
        f"its ranges come in steps of {1000 * step:.3g} mm, which hide the noise: surfaces are no more exact "
        "than the steps; if the file was rounded, take the original"
    )
    return (*seen.scan.warnings, text)


def _times_noise(patch: Patch, observations: Sequence[Observation]) -> float:
    """How many times the range noise of its pixels a surface's residuals are."""
    squares = [np.zeros(0)]
    for scan, pixels in patch.source.pixels.held:
        seen = observations[scan]
        sample = pixels.flat[:: max(1, len(pixels.flat) // _FEW_PX)]
        squares.append(np.square(seen.noise.sigma(seen.scan.ranges.ravel()[sample])))
    known = np.concatenate(squares)
    noise = float(np.sqrt(known.mean())) if len(known) else 0.0
    return patch.source.fit.rms / noise if noise > 0 else np.inf


def _rough_text(rough: Sequence[tuple[int, Patch, float]]) -> str:
    largest = sorted(rough, key=lambda entry: -entry[1].observed_m2)[:_NAMED]
    named = ", ".join(_name(*entry) for entry in largest)
    more = f" and {len(rough) - _NAMED} more" if len(rough) > _NAMED else ""
    return (
        "points lie centimetres off their surface, far more than the range noise: surface "
        f"{named}{more}; is it bent or rough, or are the poses of several scans off (--registration-sd)?"
    )


def _name(number: int, patch: Patch, times: float) -> str:
    noise = f", {times:.0f} times the range noise" if times < np.inf else ""
    kind, area = patch.grid.surface.kind, patch.observed_m2
    return f"{number} ({kind}, {area:.2g} m2, rms {1000 * patch.source.fit.rms:.0f} mm{noise})"
