# SPDX-License-Identifier: MIT
"""Verification: what was inferred from some scans, confirmed or refuted by others that see it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from completion.evidence.evidence import Label, Scans
from completion.evidence.reach import Reach
from completion.evidence.weighing import weigh
from completion.extension.patch import Patch
from completion.observe.observation import Observation, observe
from completion.observe.tolerance import REGISTRATION_M, EvidenceOptions, Tolerance
from completion.result.completed_model import CompletedModel, anchor_of
from scenes.checks import FloatArray, InputError, Value
from scenes.pose import Pose
from scenes.run.mapping import trim
from scenes.scan.range_image import RangeImage


class Finding(IntEnum):
    """What the other scans say of an inferred place."""

    NONE = -1  # nothing was inferred there
    HIDDEN = 0  # they do not see it either
    CONFIRMED = 1  # they measured surface there
    REFUTED = 2  # their beams went through: nothing is there


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceVerification(Value):
    """What the other scans say of one surface.

    Attributes
    ----------
    patch : Patch
        The surface as it was inferred.
    anchor : (3,) float
        A measured point on it, world coordinates.
    finding : (rows, columns) int8
        A `Finding` for each cell of its chart.
    """

    patch: Patch
    anchor: FloatArray
    finding: NDArray[np.int8]

    def area_m2(self, finding: Finding) -> float:
        """Inferred area of which the others say so, square metres, cells counted whole."""
        return float((self.finding == finding).sum()) * self.patch.grid.cell_area


@dataclass(frozen=True, slots=True, eq=False)
class Verification(Value):
    """What other scans say of a completion.

    Attributes
    ----------
    surfaces : tuple of SurfaceVerification
        Surface by surface, in the completion's order.
    """

    surfaces: tuple[SurfaceVerification, ...]

    def _facts(self) -> list[tuple[str, str]]:
        """Area of what was inferred, by what the other scans say of it."""
        areas = [(found.name.lower(), self.area_m2(found)) for found in Finding if found is not Finding.NONE]
        return [("surfaces", str(len(self.surfaces))), *((name, f"{m2:.2f} m\u00b2") for name, m2 in areas)]

    def area_m2(self, finding: Finding) -> float:
        """Inferred area of which the others say so, square metres."""
        total = 0.0
        for surface in self.surfaces:
            total += surface.area_m2(finding)
            trim()
        return total


def verify(
    completion: CompletedModel,
    others: Sequence[RangeImage],
    options: EvidenceOptions | None = None,
    *,
    registration_m: float | FloatArray = REGISTRATION_M,
    sigma_m: float | None = None,
) -> Verification:
    """Hold what was inferred against scans that it was not inferred from.

    Places are confirmed where another scan measured the surface within the tolerance along the ray, and
    refuted by the rule of the veto: one beam of a noise-free scan that went through, two neighbouring ones
    of a noisy scan. A place with both is refuted, as in the completion of all scans together.

    Parameters
    ----------
    completion : CompletedModel
        Made without `others`.
    others : sequence of RangeImage
        Registered scans, world coordinates.
    options : EvidenceOptions, optional
        Tolerances.
    registration_m : float or (n,) float
        Error of the poses, or of that of each of the others, where `options` leave it open, metres.
    sigma_m : float, optional
        Range noise of the others in metres; when None it is read off each.

    Raises
    ------
    InputError
        No other scan.
    """
    if not others:
        raise InputError("nothing to verify with: give at least one other scan")
    errors = np.broadcast_to(np.asarray(registration_m, dtype=np.float64), len(others)).tolist()
    tolerance = (options or EvidenceOptions()).tolerance(registration_m=min(errors))
    if (options or EvidenceOptions()).registration_m is not None:
        errors = [0.0] * len(others)
    observations = tuple(
        replace(observe(scan, completion.world_from_reference, sigma_m), pose_error_m=error)
        for scan, error in zip(others, errors, strict=True)
    )
    others_ready = unowned_scans(observations, tolerance)
    return compare_patches(
        completion.patches, completion.observations, others_ready, completion.world_from_reference
    )


def unowned_scans(
    observations: Sequence[Observation], tolerance: Tolerance, reach: tuple[Reach, ...] = ()
) -> Scans:
    """Return scans as evidence whose pixels are of no surface; `reach` is that of each, where it is known."""
    nobody = tuple(np.zeros(seen.scan.shape, np.int32) for seen in observations)
    return Scans(tuple(observations), nobody, tolerance, reach=reach)


def compare_patches(
    patches: Sequence[Patch],
    observations: Sequence[Observation],
    others: Scans,
    world_from_reference: Pose,
) -> Verification:
    """Compare the inferred area of surfaces with other scans, in the working frame of the surfaces.

    `observations` are the scans that the surfaces were inferred from.
    """
    return Verification(
        tuple(
            SurfaceVerification(
                patch,
                world_from_reference.apply(anchor_of(patch.source, observations)),
                _findings(patch, others),
            )
            for patch in patches
        )
    )


def counterpart(surface: SurfaceVerification, completion: CompletedModel) -> int:
    """Number, from 1, of the surface in `completion`, of more scans, with most of its pixels; 0 for none."""
    numbers = surface.patch.source.pixels[0].pick(completion.owners[0])
    return int(np.argmax(np.bincount(numbers))) if len(numbers) else 0


def _findings(patch: Patch, scans: Scans) -> NDArray[np.int8]:
    evidence = weigh(patch.grid, patch.spread.ravel(), scans, owner=1)
    finding = np.select(
        [evidence.labels == Label.FREE, evidence.labels == Label.VISIBLE],
        [Finding.REFUTED, Finding.CONFIRMED],
        Finding.HIDDEN,
    )
    return np.where(patch.hypothesised, finding, Finding.NONE).astype(np.int8)
