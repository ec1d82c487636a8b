# SPDX-License-Identifier: MIT
"""Surfaces of scans: what completion, features, verification and drawings all begin with, made once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from completion.evidence.evidence import Scans
from completion.evidence.reach import Reach, reach_of
from completion.evidence.sight import ScanSight, sight_of
from completion.merging.merged_surface import MergedSurface, number_pixels
from completion.merging.pieces import UnconfirmedRegions
from completion.merging.pipeline import merge
from completion.observe.observation import Observation, find_key_frames, observe
from completion.observe.tolerance import POSE_BOUND, REGISTRATION_M, EvidenceOptions, Tolerance
from completion.registration.correction import Registration
from completion.registration.pipeline import correct_poses
from completion.segmentation.pipeline import segment
from completion.segmentation.regions import Region, SegmentationOptions
from completion.segmentation.relief import typical_relief
from scenes.checks import FloatArray, InputError, Value, check_options
from scenes.run.steps import Steps
from scenes.scan.range_image import RangeImage


@dataclass(frozen=True, kw_only=True, slots=True)
class SurfaceOptions(Value):
    """Options of `find_surfaces`; `CompletionOptions` describes those of the same name.

    Attributes
    ----------
    sigma_m, projector_m : float, optional
        Range noise and place of the projector, metres; when None they are estimated from each scan.
    registration_m : float
        Error of the poses of several scans where the scans do not show it, metres.
    pose_deviations_m : tuple of float
        Standard deviation of the pose of each scan, metres; empty where unknown.
    moves_scans : bool
        Whether scans whose poses contradict what they measured are moved.
    across : bool
        Whether regions are joined across what stood before them.
    segmentation, evidence : options
        Of the stages.

    Raises
    ------
    InputError
        A length or deviation that is negative or not finite.
    """

    sigma_m: float | None = None
    projector_m: float | None = None
    registration_m: float = REGISTRATION_M
    pose_deviations_m: tuple[float, ...] = ()
    moves_scans: bool = True
    across: bool = True
    segmentation: SegmentationOptions = field(default_factory=SegmentationOptions)
    evidence: EvidenceOptions = field(default_factory=EvidenceOptions)

    def __post_init__(self) -> None:
        check_options(self, sigma_m=(0.0, np.inf), registration_m=(0.0, np.inf), projector_m=(-1.0, 1.0))
        for number, deviation_m in enumerate(self.pose_deviations_m, start=1):
            if not 0 <= deviation_m < np.inf:
                raise InputError(
                    f"pose_deviations_m of scan {number} is {deviation_m}: give lengths in metres that are "
                    "finite and not negative"
                )

    def tolerance(self, n_scans: int) -> Tolerance:
        """Return the tolerance along the ray; the pose of a single scan has no error."""
        return self.evidence.tolerance(
            flatness_m=self.segmentation.least_flatness_m,
            registration_m=self.registration_m if n_scans > 1 else 0.0,
        )

    def flatness(self, regions: Sequence[Sequence[Region]]) -> float:
        """Return how uneven surfaces are, metres: as stated, else as the regions of the scans show."""
        stated = (
            self.segmentation.flatness_m if self.evidence.flatness_m is None else self.evidence.flatness_m
        )
        return typical_relief(regions) if stated is None else stated

    def pose_errors(self, left_m: FloatArray) -> FloatArray:
        """Return bounds (n,) of the errors of n poses, metres.

        From what the scans show (n,), NaN where they do not. Where `evidence` states it, that holds for all.

        Raises InputError: another number of `pose_deviations_m` than of scans.
        """
        stated = self.tolerance(len(left_m)).registration_m
        if len(left_m) < 2 or self.evidence.registration_m is not None:
            return np.full(len(left_m), stated)
        least = min(stated, REGISTRATION_M)
        if self.pose_deviations_m:
            if len(self.pose_deviations_m) != len(left_m):
                raise InputError(
                    f"pose_deviations_m holds {len(self.pose_deviations_m)} deviations "
                    f"for {len(left_m)} scans; give one per scan, or none"
                )
            return np.maximum(np.fmax(POSE_BOUND * np.array(self.pose_deviations_m), left_m), least)
        return np.where(np.isfinite(left_m), np.maximum(left_m, least), stated)


@dataclass(frozen=True, slots=True, eq=False)
class ScanSurfaces(Value):
    """The surfaces that scans show, and the scans as they were prepared for it.

    Attributes
    ----------
    observations : tuple of Observation
        The scans in the working frame (the first scan's sensor frame as given), with corrected poses.
    regions : tuple of sequence of Region
        The regions of each scan.
    surfaces : tuple of MergedSurface
        Regions joined across occluders and scans, largest first.
    tolerance : Tolerance
        Along the ray.
    key_frames : tuple of int
        Numbers, from 0, of the scans that show something new; all of up to 64.
    registration : Registration
        What the scans say of each other's poses, and the corrections.
    sights : tuple of Sight
        Each scan as compiled loops read it.
    reach : tuple of Reach
        How far each scan measured, tile by tile.
    """

    observations: tuple[Observation, ...]
    regions: tuple[Sequence[Region], ...]
    surfaces: tuple[MergedSurface, ...]
    tolerance: Tolerance
    key_frames: tuple[int, ...]
    registration: Registration
    sights: tuple[ScanSight, ...]
    reach: tuple[Reach, ...]

    @property
    def unconfirmed(self) -> UnconfirmedRegions:
        """Regions of single frames of a sequence that other frames did not confirm."""
        return UnconfirmedRegions.of(self.regions, self.surfaces)

    def evidence(self, steps: Steps, surfaces: Sequence[MergedSurface] | None = None) -> Scans:
        """Return the scans as evidence, their pixels numbered by `surfaces`, by default its own."""
        chosen = self.surfaces if surfaces is None else surfaces
        owners = (number_pixels(chosen, scan, seen) for scan, seen in enumerate(self.observations))
        return Scans(
            self.observations,
            tuple(map(steps.keep, owners)),
            self.tolerance,
            self.key_frames,
            sights=self.sights,
            reach=self.reach,
        )

    def first(self, options: SurfaceOptions, steps: Steps) -> ScanSurfaces:
        """Return the surfaces that the first scan shows by itself, from its own regions."""
        alone = self.registration.seen_from_first(self.observations[:1])
        registration = _registration(alone, (0,), options, steps)
        observations = registration.apply(alone, options.pose_errors(registration.left_m))
        regions: Sequence[Sequence[Region]] = self.regions[:1]
        if alone[0] is not self.observations[0]:  # moved, and its regions with it
            regions = steps.each("segment", lambda seen: segment(seen, options.segmentation), observations)
        return _join_regions(observations, regions, registration, (0,), options, steps=steps)


def find_surfaces(scans: Sequence[RangeImage], options: SurfaceOptions, steps: Steps) -> ScanSurfaces:
    """Find the planes and cylinders of registered scans, joined across what stood before them.

    Parameters
    ----------
    scans : sequence of RangeImage
        At least one. Several are registered; poses that contradict what was measured are corrected.
    options : SurfaceOptions
        What to do.
    steps : Steps
        Where to run.
    """
    # 1. Observe: points, rays and range noise of each scan, in the sensor frame of the first.
    reference = scans[0].world_from_sensor
    observations = steps.each(
        "noise and normals",
        lambda scan: observe(scan, reference, options.sigma_m, options.projector_m),
        scans,
        remember=False,
    )
    # 2. Register: correct poses that contradict what was measured.
    keys = find_key_frames(observations)
    registration = _registration(observations, keys, options, steps)
    observations = registration.apply(observations, options.pose_errors(registration.left_m))

    # 3. Segment: cut each scan into regions on planes and cylinders.
    regions = steps.each("segment", lambda seen: segment(seen, options.segmentation), observations)

    # 4. Merge: join the regions that are one surface.
    return _join_regions(observations, regions, registration, keys, options, steps=steps)


def _registration(
    observations: Sequence[Observation], keys: Sequence[int], options: SurfaceOptions, steps: Steps
) -> Registration:
    """Pose errors of scans, and the motions that cure them."""
    stated_m = options.tolerance(len(observations)).registration_m
    return steps.one(
        "registration",
        lambda: correct_poses(
            observations, keys, stated_m=stated_m, moves=options.moves_scans, spill=steps.spill
        ),
    )


def _join_regions(
    observations: Sequence[Observation],
    regions: Sequence[Sequence[Region]],
    registration: Registration,
    keys: Sequence[int],
    options: SurfaceOptions,
    steps: Steps,
) -> ScanSurfaces:
    """The surfaces that regions of scans make together."""
    errors = options.pose_errors(registration.left_m)
    tolerance = replace(
        options.tolerance(len(observations)),
        flatness_m=options.flatness(regions),
        registration_m=float(errors.min()),
    )
    sights = tuple(sight_of(seen, tolerance) for seen in observations)
    surfaces = steps.one(
        "merge",
        lambda: merge(
            observations,
            regions,
            tolerance,
            across=options.across,
            keys=keys,
            sights=sights,
            spill=steps.spill,
        ),
    )
    return ScanSurfaces(
        observations=tuple(observations),
        regions=tuple(regions),
        surfaces=tuple(surfaces),
        tolerance=tolerance,
        key_frames=tuple(keys),
        registration=registration,
        sights=sights,
        reach=tuple(steps.keep(reach_of(seen)) for seen in observations),
    )
