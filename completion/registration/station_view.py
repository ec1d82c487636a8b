# SPDX-License-Identifier: MIT
"""Station view: what registration compares of a scan, in the scan's own frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from completion.evidence.sight import ScanSight, sight_of
from completion.observe.observation import Observation, observe
from completion.observe.tolerance import FLATNESS_M, EvidenceOptions
from completion.registration import limits
from completion.registration.facets import ScanFacets, facets_of
from completion.segmentation.pipeline import segment
from completion.segmentation.regions import Region, SegmentationOptions
from scenes.checks import FloatArray, IntArray, Value
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Plane


@dataclass(frozen=True, slots=True, eq=False)
class PlaneSums(Value):
    """The planes of a scan, in its frame.

    Attributes
    ----------
    normals : (k, 3) float
        Unit normals towards the sensor.
    heights : (k,) float
        n . x of each, below zero.
    areas : (k,) float
        What is seen of each, square metres.
    scatter : (k, 4, 4) float
        Sums of (x, 1) (x, 1)' over the pixels x, each over the variance of a facet's error there.
    n_pixels : int
        That brought something back in all.
    """

    normals: FloatArray
    heights: FloatArray
    areas: FloatArray
    scatter: FloatArray
    n_pixels: int

    @classmethod
    def of(cls, regions: Sequence[Region], seen: Observation, side: int) -> PlaneSums:
        """Return the planes among the regions of a scan, whose facets have `side` pixels, in their order."""
        planes = [
            (region.fit.surface, region.pixels) for region in regions if isinstance(region.fit.surface, Plane)
        ]
        n, angle = len(planes), seen.scan.projection.pixel_angle
        normals, heights, areas, scatter = np.zeros((n, 3)), np.zeros(n), np.zeros(n), np.zeros((n, 4, 4))
        for k, (plane, pixels) in enumerate(planes):
            normal = plane.normal_direction
            height = float(normal @ plane.point)
            normals[k], heights[k] = (normal, height) if height <= 0 else (-normal, -height)
            points = seen.points_at(pixels.flat)
            distance = np.linalg.norm(points, axis=1)
            cosine = np.abs(points @ normal) / distance
            areas[k] = float((np.square(distance * angle) / np.maximum(cosine, limits.LEAST_COSINE)).sum())
            along = np.square(seen.noise.sigma(distance) / side) + np.square(seen.noise.bias(distance))
            weight = 1.0 / (along * np.square(cosine) + FLATNESS_M**2)
            whole = np.concatenate([points, np.ones((len(points), 1))], axis=1)
            scatter[k] = whole.T @ (weight[:, None] * whole)
        return cls(normals, heights, areas, scatter, int(seen.valid.sum()))


@dataclass(frozen=True, slots=True, eq=False)
class Directions(Value):
    """What the planes of a scan face, largest area first.

    Attributes
    ----------
    normals : (k, 3) float
        Unit normals towards the sensor, in its frame.
    heights : tuple of (m,) float
        For each direction, n . x of its planes, metres: below zero.
    areas : tuple of (m,) float
        Of these planes, square metres.
    """

    normals: FloatArray
    heights: tuple[FloatArray, ...]
    areas: tuple[FloatArray, ...]


@dataclass(frozen=True, slots=True, eq=False)
class StationView(Value):
    """A scan as registration sees it, in its own frame: the sensor is the origin.

    Attributes
    ----------
    seen : Observation
        The scan.
    facets : ScanFacets
        Its flat tiles.
    sight : Sight
        How it sees a place.
    sample : (k,) int
        Numbers of some facets, half of them evenly over what they face, half over the image.
    planes : PlaneSums
        Its planes.
    directions : Directions
        What they face.
    radius_m : float
        Distance from the sensor within which nine tenths of the facets lie, metres.
    middle : (3,) float
        The middle of the facets.
    spread_m : float
        Root mean square of their distances to it, metres.
    up : (3,) float or None
        What is up, where the scanner was level or said how it stood.
    """

    seen: Observation
    facets: ScanFacets
    sight: ScanSight
    sample: IntArray
    planes: PlaneSums
    directions: Directions
    radius_m: float
    middle: FloatArray
    spread_m: float
    up: FloatArray | None = None

    @classmethod
    def of(cls, scan: RangeImage, *, up: FloatArray | None = None, unit_m: float = 1.0) -> StationView:
        """Return the view of a scan, whatever its pose says; of that what is `up` (3,), world, where given.

        Lengths are then in units of `unit_m`.
        """
        alone = scan.with_facts(world_from_sensor=Pose.identity())
        if unit_m != 1.0:
            sigma = None if scan.sigma_m is None else scan.sigma_m / unit_m
            alone = replace(alone, ranges=scan.ranges / unit_m, sigma_m=sigma)
        seen = observe(alone, Pose.identity())
        facets = facets_of(seen, curved=True)
        planes = PlaneSums.of(segment(seen, SegmentationOptions()), seen, facets.side)
        distance = np.linalg.norm(facets.centre, axis=1)
        radius = float(np.quantile(distance, 0.9)) if len(distance) else 1.0
        apart = np.flatnonzero(distance > limits.STAND * radius)
        return cls(
            seen=seen,
            facets=facets,
            sight=sight_of(seen, EvidenceOptions().tolerance()),
            sample=apart[sample_of(facets.normal[apart])],
            planes=planes,
            directions=_directions(planes),
            radius_m=radius,
            middle=facets.centre.mean(axis=0) if len(distance) else np.zeros(3),
            spread_m=float(np.sqrt(facets.centre.var(axis=0).sum())) if len(distance) else 1.0,
            up=None if up is None else up @ scan.world_from_sensor.rotation,
        )


def unit_of(scans: Sequence[RangeImage]) -> float:
    """Return the unit in which what the scans saw is as large as a desk at least: 1 m, or less for objects.

    Gates and cells of registration are lengths in rooms. What is smaller is taken for larger than it is.
    """
    spreads = []
    for scan in scans:
        points = scan.points()[scan.valid]
        points = points[:: max(1, len(points) // limits.N_POINTS)]
        if len(points):
            spreads.append(float(np.sqrt(points.var(axis=0).sum())))
    return min(1.0, float(np.median(spreads)) / limits.LEAST_SPREAD_M) if spreads else 1.0


def sample_of(normals: FloatArray) -> IntArray:
    """Return numbers (k,) of facets by normals (m, 3), half evenly over the image, half over what they face.

    The first see what most of the scan is, the second let furniture have its say against walls.
    """
    half = limits.N_SAMPLES // 2
    over_image = np.linspace(0, len(normals) - 1, min(half, len(normals))).astype(np.int64)
    return np.concatenate([_even_sample(normals, half), over_image])


def _even_sample(normals: FloatArray, n: int) -> IntArray:
    """Numbers (k,) of at most n of the normals (m, 3), evenly over their directions."""
    axis = np.abs(normals).argmax(axis=1)
    rows = np.arange(len(normals))
    most = normals[rows, axis]
    across = [np.floor((normals[rows, (axis + k) % 3] / np.abs(most) + 1) / 2 * limits.CELLS) for k in (1, 2)]
    cell = ((axis + 3 * (most < 0)) * (limits.CELLS + 1) + across[0]) * (limits.CELLS + 1) + across[1]
    _, cell, count = np.unique(cell, return_inverse=True, return_counts=True)
    # as many of each cell as fit: the least cap that lets n through
    cap = 1
    while np.minimum(count, cap + 1).sum() <= n and cap < count.max(initial=1):
        cap += 1
    chosen = []
    for k in range(len(count)):
        members = np.flatnonzero(cell == k)
        step = max(1.0, len(members) / cap)
        chosen.append(members[(np.arange(min(cap, len(members))) * step).astype(np.int64)])
    return np.sort(np.concatenate(chosen)) if chosen else np.zeros(0, np.int64)


def _directions(planes: PlaneSums) -> Directions:
    """What the planes of a scan face; parallel ones are one direction."""
    normals, heights, areas = planes.normals, planes.heights, planes.areas
    directions: list[tuple[FloatArray, FloatArray, FloatArray]] = []
    left = np.argsort(-areas, kind="stable")
    while len(left):
        is_parallel = normals[left] @ normals[left[0]] > limits.PARALLEL
        members = left[is_parallel]
        mean = (normals[members] * areas[members, None]).sum(axis=0)
        directions.append((mean / np.linalg.norm(mean), heights[members], areas[members]))
        left = left[~is_parallel]
    directions.sort(key=lambda families: -float(families[2].sum()))
    directions = directions[: limits.N_DIRECTIONS]
    return Directions(
        np.array([family[0] for family in directions]).reshape(-1, 3),
        tuple(family[1] for family in directions),
        tuple(family[2] for family in directions),
    )
