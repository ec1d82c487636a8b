# SPDX-License-Identifier: MIT
"""Merging: regions that are one surface, cut apart by an occluder, by noise or by different scans."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from completion.evidence import EvidenceOptions, Label, label_points
from completion.fitting.euclidean import fit_cylinder, fit_plane
from completion.fitting.result import FitError, SurfaceFit, inflated
from completion.growing import Region
from completion.observation import Observation
from scenes.checks import BoolArray, FloatArray
from scenes.surfaces import Cylinder, Surface

_N_SAMPLE = 400  # points of a region that take part in the pair tests
_N_BRIDGES = 24
_N_STEPS = 24


@dataclass(frozen=True, slots=True, eq=False)
class MergedSurface:
    """One surface with all its pixels in all scans.

    Attributes
    ----------
    fit : SurfaceFit
        Fit to all its points, covariance inflated for correlated residuals; working frame.
    masks : tuple of (rows, columns) bool
        Its pixels in each scan.
    n_parts : int
        How many regions were joined.
    """

    fit: SurfaceFit
    masks: tuple[BoolArray, ...]
    n_parts: int

    @property
    def n_pixels(self) -> int:
        """Pixels in all scans together."""
        return int(sum(mask.sum() for mask in self.masks))

    def points(self, observations: Sequence[Observation]) -> FloatArray:
        """Its measured points (n, 3) in the working frame."""
        return np.concatenate([o.points[mask] for o, mask in zip(observations, self.masks, strict=True)])


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """A region with what the pair tests need."""

    scan: int
    region: Region
    sample: FloatArray
    scale: float  # standard deviation that its pixels may show
    curved: bool


def merge(
    observations: Sequence[Observation],
    regions: Sequence[Sequence[Region]],
    scales: Sequence[FloatArray],
    options: EvidenceOptions,
) -> list[MergedSurface]:
    """Join regions that one surface explains and that nothing observed keeps apart.

    Two regions join when one surface fitted to both leaves each of them within its own noise, and when
    they touch or no beam went through the gap between them. All pairs are tried, large ones first.

    Parameters
    ----------
    observations : sequence of Observation
        The scans.
    regions : sequence of sequence of Region
        The regions of each scan.
    scales : sequence of (rows, columns) float
        For each scan, the standard deviation that a surface's pixels may show, flatness included, metres.
    options : EvidenceOptions
        Tolerances of the gap test.
    """
    parts = [
        _part(index, region, observation, scale)
        for index, (observation, found, scale) in enumerate(zip(observations, regions, scales, strict=True))
        for region in found
    ]
    parts.sort(key=lambda part: -part.region.n_pixels)
    groups: list[list[_Part]] = []
    fits: list[SurfaceFit] = []
    for part in parts:
        for index, group in enumerate(groups):
            joined = _joined_fit(fits[index], group, part)
            if joined is not None and _gap_is_closed(joined.surface, group, part, observations, options):
                group.append(part)
                fits[index] = joined
                break
        else:
            groups.append([part])
            fits.append(part.region.fit)
    merged = [_merged(fit, group, observations) for fit, group in zip(fits, groups, strict=True)]
    return sorted(merged, key=lambda surface: -surface.n_pixels)


def _part(scan: int, region: Region, observation: Observation, scale: FloatArray) -> _Part:
    points = observation.points[region.mask]
    sample = points[np.linspace(0, len(points) - 1, min(_N_SAMPLE, len(points))).astype(np.int64)]
    curved = isinstance(region.fit.surface, Cylinder)
    return _Part(scan, region, sample, float(np.median(scale[region.mask])), curved)


def _joined_fit(fit: SurfaceFit, group: list[_Part], part: _Part) -> SurfaceFit | None:
    """The surface through all of `group` and `part`, None where it leaves one of them outside its noise."""
    if _is_speck(fit, group, part):
        return fit
    if part.curved != group[0].curved or not _may_agree(fit, part):
        return None
    members = [*group, part]
    weight = [max(1, round(8 * m.region.n_pixels / max(p.region.n_pixels for p in members))) for m in members]
    points = np.concatenate([m.sample for m, w in zip(members, weight, strict=True) for _ in range(w)])
    try:
        if isinstance(fit.surface, Cylinder):
            joined = fit_cylinder(points, fit.surface)
        else:
            joined = _plane_facing_as(fit, points)
    except FitError:
        return None
    for member in (max(group, key=lambda m: m.region.n_pixels), part):
        residual = joined.surface.distance(member.sample)
        if abs(float(np.mean(residual))) > 1.5 * member.scale or float(np.std(residual)) > 2.0 * member.scale:
            return None
    return joined


def _is_speck(fit: SurfaceFit, group: list[_Part], part: _Part) -> bool:
    """Tell whether a part is too small to have a say and lies within the surface's noise."""
    if part.region.n_pixels > 0.05 * max(member.region.n_pixels for member in group):
        return False
    return float(np.quantile(np.abs(fit.surface.distance(part.sample)), 0.9)) <= 3.0 * part.scale


def _may_agree(fit: SurfaceFit, part: _Part) -> bool:
    """Quick look: the part's points within reach of the surface, as far as that is known there."""
    distance = np.abs(fit.surface.distance(part.sample))
    normal = np.einsum(
        "ij,ij->i", fit.surface.normal(part.sample[:1]), part.region.fit.surface.normal(part.sample[:1])
    )
    reach = 4.0 * np.hypot(part.scale, fit.standard_deviation(part.sample)) + 3.0 * part.scale
    return bool(np.median(distance - reach) <= 0) and float(normal[0]) > 0.8


def _plane_facing_as(fit: SurfaceFit, points: FloatArray) -> SurfaceFit:
    """The plane through `points` whose normal points to the side that the plane of `fit` faces."""
    middle = points.mean(axis=0)
    return fit_plane(points, middle + fit.surface.normal(middle[None])[0])


def _gap_is_closed(
    surface: Surface,
    group: list[_Part],
    part: _Part,
    observations: Sequence[Observation],
    options: EvidenceOptions,
) -> bool:
    """Tell whether the shortest bridges between the parts cross nothing that a beam went through."""
    there = np.concatenate([member.sample for member in group])
    distance, nearest = cKDTree(there).query(part.sample)
    order = np.argsort(distance, kind="stable")[:_N_BRIDGES]
    start, end = surface.to_uv(part.sample[order]), surface.to_uv(there[nearest[order]])
    if np.isfinite(surface.period):
        end[:, 0] += np.rint((start[:, 0] - end[:, 0]) / surface.period) * surface.period
    along = (np.arange(_N_STEPS) + 0.5) / _N_STEPS
    bridges = start[:, None, :] + along[None, :, None] * (end - start)[:, None, :]
    points = surface.from_uv(bridges.reshape(-1, 2))
    crossed = np.zeros(len(points), dtype=np.bool_)
    seen = np.zeros(len(points), dtype=np.bool_)
    spread = np.full(len(points), part.scale)
    for observation in observations:
        said, pixel, _, _ = label_points(surface, points, spread, observation, options)
        seen |= said >= Label.OCCLUDED
        measured = observation.scan.ranges.ravel()[pixel]
        beyond = measured - np.linalg.norm(points - observation.scan.origin, axis=1)
        crossed |= (pixel >= 0) & np.isfinite(measured) & (beyond > 0) & (said == Label.NO_RETURN)
    return float(crossed.mean()) < 0.1 and float(seen.mean()) > 0.5


def _merged(fit: SurfaceFit, group: list[_Part], observations: Sequence[Observation]) -> MergedSurface:
    masks = []
    for index, observation in enumerate(observations):
        mask = np.zeros(observation.valid.shape, dtype=np.bool_)
        for part in group:
            if part.scan == index:
                mask |= part.region.mask
        masks.append(mask)
    points = np.concatenate([o.points[mask] for o, mask in zip(observations, masks, strict=True)])
    thinned = points[:: max(1, len(points) // 200_000)]
    if len(group) > 1:
        if isinstance(fit.surface, Cylinder):
            fit = fit_cylinder(thinned, fit.surface)
        else:
            fit = _plane_facing_as(fit, thinned)
    footprint = float(np.median([np.median(o.scan.ranges[m]) * o.scan.projection.pixel_angle
                                 for o, m in zip(observations, masks, strict=True) if m.any()]))  # fmt: skip
    return MergedSurface(inflated(fit, thinned, 10 * footprint), tuple(masks), len(group))
