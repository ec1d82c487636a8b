# SPDX-License-Identifier: MIT
"""Measurement of coverage: by views of a known scene, and by scans that were really taken."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from nbv.coverage.coverage import MET, NEVER, REACHABLE, UNREACHABLE, Coverage, VisibilityHistory
from nbv.scanning.sensor import Sensor, View
from nbv.scanning.sensor_profile import load_sensor
from nbv.visibility.candidates import find_standing, restrict_to_rooms, samples_that_count
from nbv.visibility.limits import (
    FOREIGN,
    GRAZING_COSINE,
    MOSTLY_SAME,
    ROUNDING_M,
    SAME_SCENE,
    SAME_SCENE_M,
    STEEPEST_SLOPE,
)
from nbv.visibility.requirement import Requirement, SightLimits
from nbv.visibility.samples import SurfaceSamples, sample_surface
from nbv.visibility.viewpoints import Candidates
from nbv.visibility.visibility import Progress, Reachability, find_reachable, visible_from_view
from scenes.checks import BoolArray, FloatArray, InputError
from scenes.inclination import LEVEL_COSINE
from scenes.limits import NEARLY_ALL
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.rays.raycast import RayCaster
from scenes.scan.range_image import RangeImage
from scenes.world.scene import Scene

_CAST = 20_000  # beams of a scan that tell whether it is of a scene


@dataclass(slots=True, eq=False)
class CoverageTally:
    """Coverage so far of n samples, while views are added one by one.

    What each view sees is cast once and kept: `history` tells it. `best_cosine` (n,) is the best cosine of
    incidence, `n_views` and `n_met` (n,) how many views see each sample, and measure it as required, and
    `first_met` (n,) the view after which it meets the requirement, `NEVER` so far.
    """

    caster: RayCaster
    samples: SurfaceSamples
    requirement: Requirement
    best_cosine: FloatArray
    n_views: NDArray[np.int32]
    n_met: NDArray[np.int32]
    first_met: NDArray[np.int64]
    _seen: list[tuple[int, NDArray[np.int64], FloatArray]] = field(default_factory=list)
    _shares: list[float] = field(default_factory=lambda: [0.0])
    _held: list[tuple[int, NDArray[np.int64]]] = field(default_factory=list)

    @classmethod
    def start(cls, caster: RayCaster, samples: SurfaceSamples, requirement: Requirement) -> CoverageTally:
        """Return the tally before the first view."""
        n = len(samples)
        counts = np.zeros(n, np.int32), np.zeros(n, np.int32), np.full(n, NEVER, np.int64)
        return cls(caster, samples, requirement, np.zeros(n), *counts)

    def add(self, view: View) -> float:
        """Add a view; return the area in square metres that is newly met."""
        before = self.met
        seen = visible_from_view(self.caster, view, self.samples, self.requirement.visibility(view.sensor))
        self._shares.append(0.0)
        self._add_seen(*seen, view.world_from_sensor.translation, self.requirement.limits(view.sensor))
        return float(self.samples.areas[self.met & ~before].sum())

    def add_scan(self, scan: RangeImage, *, is_given: bool = False) -> int:
        """Add what a scan has measured; return how many samples that is, at any incidence.

        Of the requirement's range limits only its own holds for scans. One that `is_given` was taken before
        the first view, and counts as number 0.
        """
        limits = self.requirement.limits_of_scan(scan)
        index, cosine = measured_samples(scan, self.samples, limits.max_range_m)
        if not is_given:
            self._shares.append(0.0)
        self._add_seen(index, cosine, scan.origin, limits)
        return len(index)

    def add_all(self, stations: Sequence[View | RangeImage], progress: Progress | None = None) -> None:
        """Add views, whose sight is cast, or scans, which have measured what they have."""
        for done, station in enumerate(stations, start=1):
            if isinstance(station, RangeImage):
                self.add_scan(station)
            else:
                self.add(station)
            if progress is not None:
                progress("coverage", done, len(stations))

    def _add_seen(
        self, index: NDArray[np.int64], cosine: FloatArray, origin: FloatArray, limits: SightLimits
    ) -> None:
        """Add the samples that one more view has seen from `origin`, each once, with its cosines."""
        self.best_cosine[index] = np.maximum(self.best_cosine[index], cosine)
        self.n_views[index] += 1
        distance = np.linalg.norm(self.samples.points[index] - origin, axis=1)
        held = index[limits.hold(distance, cosine)]
        self.n_met[held] += 1
        number, met = len(self._shares) - 1, self.met
        self._seen.append((number, index, cosine))
        self._held.append((number, held))
        self.first_met[met & (self.first_met == NEVER)] = number
        self._shares[number] = self.met_m2() / self.samples.total_m2

    @property
    def met(self) -> BoolArray:
        """Samples that meet the requirement, (n,)."""
        return np.asarray(self.n_met >= self.requirement.k)

    def met_m2(self) -> float:
        """Area in square metres that meets the requirement."""
        return float(self.samples.areas[self.met].sum())

    def lost_without(self) -> tuple[float, ...]:
        """Share of the area that would not meet the requirement without each view, the others as they are."""
        just = np.where(self.n_met == self.requirement.k, self.samples.areas, 0.0) / self.samples.total_m2
        return tuple(float(just[held].sum()) for number, held in self._held if number)

    def history(self) -> VisibilityHistory:
        """Return what each view saw, by sample."""
        return VisibilityHistory.of(self._seen, self.first_met, self._shares)

    def reachable(
        self, candidates: Candidates, sensor: Sensor, n_threads: int | None, progress: Progress | None
    ) -> Reachability:
        """Return what `sensor` could measure from the candidates."""
        return find_reachable(
            self.caster, self.samples, candidates, sensor, self.requirement, n_threads=n_threads,
            progress=progress,
        )  # fmt: skip

    def coverage(self, scene: Scene, reachability: Reachability) -> Coverage:
        """Return the coverage so far."""
        possible = reachability.include(self.met)
        state = np.where(self.met, MET, np.where(possible.reachable, REACHABLE, UNREACHABLE)).astype(np.int8)
        names, n_faces = scene.surface_names, len(scene.mesh.faces)
        parts = (self.best_cosine, self.n_views, state, possible.reason)
        return Coverage(self.samples, self.requirement, *parts, names, n_faces, history=self.history())


def measure_coverage(
    scene: Scene,
    views: Sequence[View],
    requirement: Requirement | None = None,
    *,
    max_incidence_deg: float | None = None,
    samples: SurfaceSamples | None = None,
    candidates: Candidates | None = None,
    sensor: Sensor | None = None,
    caster: RayCaster | None = None,
    n_threads: int | None = None,
    progress: Progress | None = None,
) -> Coverage:
    """Measure the coverage of a scene by views.

    A sample is met when some view sees it, in its aperture and range, unobstructed and at no larger
    incidence than required. Faces are two-sided (`nbv.visibility.visibility`).

    Parameters
    ----------
    scene : Scene
        The true scene.
    views : sequence of View
        Stations; none is allowed.
    requirement : Requirement, optional
        What counts; default 60 deg incidence, or `max_incidence_deg`.
    max_incidence_deg : float, optional
        Short for a requirement of this incidence in degrees.
    samples : SurfaceSamples, optional
        Where to measure; the scene's own default samples when not given.
    candidates : Candidates, optional
        What "reachable" refers to; the scene's own (`find_standing`) when not given.
    sensor : Sensor, optional
        The sensor that would stand at the candidates; the first view's when not given.
    caster : RayCaster, optional
        The scene prepared for ray casting.
    n_threads : int, optional
        Threads that cast; coverage does not depend on it.
    progress : callable, optional
        Called with (stage, done, total).

    Raises
    ------
    InputError
        Both kinds of requirement, neither view nor sensor, a scene without surface.
    """
    requirement = _one_requirement(requirement, max_incidence_deg)
    standing = sensor or (views[0].sensor if views else None)
    if standing is None:
        raise InputError("without views, coverage needs a sensor to compute the reachable area")
    caster = caster or scene.ray_caster(n_threads)
    samples, candidates, apart = _resolve_samples(scene, samples, candidates, standing, caster)
    tally = CoverageTally.start(caster, samples, requirement)
    tally.add_all(views, progress)
    coverage = tally.coverage(scene, tally.reachable(candidates, standing, n_threads, progress))
    return replace(coverage, apart_m2=apart)


def measure_scan_coverage(
    scene: Scene,
    scans: Sequence[RangeImage],
    requirement: Requirement | None = None,
    *,
    max_incidence_deg: float | None = None,
    samples: SurfaceSamples | None = None,
    candidates: Candidates | None = None,
    sensor: Sensor | None = None,
    caster: RayCaster | None = None,
    n_threads: int | None = None,
    progress: Progress | None = None,
) -> Coverage:
    """Measure the coverage of a known scene by scans, real or simulated.

    A sample is seen when the pixel that looks at it measured its range: within 1 mm, three standard
    deviations of the scan's known noise, and what the surface's slope makes of three quarters of a pixel.

    Parameters
    ----------
    scene : Scene
        The scene, in the world coordinates of the scans' poses.
    scans : sequence of RangeImage
        The scans; none is allowed.
    sensor : Sensor, optional
        What would stand at the candidates to say what is reachable; "generic60" when not given.
    requirement, max_incidence_deg, samples, candidates, caster, n_threads, progress
        As for `measure_coverage`; of the range limits only the requirement's own holds for scans.

    Raises
    ------
    InputError
        Both kinds of requirement, a scene without surface.
    """
    requirement = _one_requirement(requirement, max_incidence_deg)
    standing = sensor or load_sensor("generic60")
    caster = caster or scene.ray_caster(n_threads)
    samples, candidates, apart = _resolve_samples(scene, samples, candidates, standing, caster)
    tally = CoverageTally.start(caster, samples, requirement)
    tally.add_all(scans, progress)
    coverage = tally.coverage(scene, tally.reachable(candidates, standing, n_threads, progress))
    return replace(coverage, apart_m2=apart)


def _resolve_samples(
    scene: Scene,
    samples: SurfaceSamples | None,
    candidates: Candidates | None,
    sensor: Sensor,
    caster: RayCaster,
) -> tuple[SurfaceSamples, Candidates, Mapping[str, float]]:
    """Samples and candidates, the scene's own where none are given, and the area that is set apart then."""
    if candidates is not None:
        return samples or sample_surface(scene.mesh), candidates, {}
    standing = find_standing(scene, sensor)
    if samples is None:
        samples, apart = samples_that_count(scene, standing, caster)
    else:
        samples, apart = restrict_to_rooms(samples, standing, caster)
    return samples, standing.candidates, apart


def visibility_history(
    caster: RayCaster,
    samples: SurfaceSamples,
    requirement: Requirement,
    stations: Sequence[View | RangeImage],
    given: Sequence[RangeImage] = (),
) -> VisibilityHistory:
    """Walk through views or scans and note what each sees.

    Parameters
    ----------
    caster : RayCaster
        The scene.
    samples : SurfaceSamples
        Of its surface.
    requirement : Requirement
        What counts as met.
    stations : sequence of View or RangeImage
        Views, whose sight is cast, or scans, which have measured what they have.
    given : sequence of RangeImage
        Scans that were taken before; together they are number 0.
    """
    tally = CoverageTally.start(caster, samples, requirement)
    for scan in given:
        tally.add_scan(scan, is_given=True)
    tally.add_all(stations)
    return tally.history()


def measured_samples(
    scan: RangeImage, samples: SurfaceSamples, max_range_m: float = np.inf
) -> tuple[NDArray[np.int64], FloatArray]:
    """Return which samples (m,) one scan has measured, and their cosines (m,) of incidence.

    A sample counts as measured where the scan's range at its pixel agrees with its distance, metres.
    """
    pixels = scan.pixels(samples.points)
    index = np.flatnonzero(np.isfinite(pixels).all(axis=1))
    limit = np.array(scan.shape) - 1
    row, column = np.clip(np.rint(pixels[index]).astype(np.int64), 0, limit).T
    towards = scan.origin - samples.points[index]
    distance = np.linalg.norm(towards, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        cosine = np.abs(np.einsum("ij,ij->i", towards, samples.normals[index])) / distance
        tangent = np.minimum(np.sqrt(1 - np.minimum(cosine, 1) ** 2) / cosine, STEEPEST_SLOPE)
    slope = 0.75 * scan.projection.pixel_angle * distance * tangent
    tolerance = ROUNDING_M + 3 * (scan.sigma_m or 0.0) + slope
    with np.errstate(invalid="ignore"):
        agrees = np.abs(scan.ranges[row, column] - distance) <= tolerance
    agrees &= (cosine >= GRAZING_COSINE) & (distance <= max_range_m)
    return index[agrees], cosine[agrees]


def check_scans(mesh: LabelledMesh, caster: RayCaster, scans: Sequence[RangeImage]) -> tuple[str, ...]:
    """Return a sentence on each scan of whose beams most do not end at the surface that they meet first.

    Up to 20,000 beams that came back are cast; they agree within 5 cm, or 1 % of the range. Floors and
    ceilings tell nothing where there is more, since other buildings have theirs at the same height.

    Raises
    ------
    InputError
        Fewer than 2 % agree: the scan is of another place, in other coordinates or in another unit.
    """
    doubts, normals = [], mesh.face_normals()
    for scan in scans:
        valid = np.flatnonzero(scan.valid)
        few = valid[:: -(-len(valid) // _CAST) or 1]
        rays, ranges = scan.rays().reshape(-1, 3)[few], scan.ranges.ravel()[few]
        hits = caster.first_hit(np.broadcast_to(scan.origin, rays.shape), rays)
        agrees = np.abs(hits.ranges - ranges) <= np.maximum(SAME_SCENE_M, SAME_SCENE * ranges)
        is_level = hits.hit & (np.abs(normals[hits.face, 2]) > LEVEL_COSINE)
        what = "beams" if is_level.mean() > NEARLY_ALL else "beams beside floors and ceilings"
        telling = agrees if is_level.mean() > NEARLY_ALL else agrees[~is_level]
        n_same, n_all = int(np.count_nonzero(telling)), len(telling)
        text = f"{scan.name}: {n_same:,} of {n_all:,} {what} meet the scene within 5 cm or 1 % of the range"
        if n_same < FOREIGN * n_all:
            raise InputError(
                f"{text}: the scan is of another place: poses "
                "must be in the scene's coordinates; check --poses, --units and --up"
            )
        if n_same < MOSTLY_SAME * n_all:
            doubts.append(f"{text}; is the scan of this scene, and are --poses, --units and --up right?")
    return tuple(doubts)


def _one_requirement(requirement: Requirement | None, max_incidence_deg: float | None) -> Requirement:
    if requirement is not None and max_incidence_deg is not None:
        raise InputError("give requirement or max_incidence_deg, not both")
    if requirement is None:
        return (
            Requirement() if max_incidence_deg is None else Requirement(max_incidence_deg=max_incidence_deg)
        )
    return requirement
