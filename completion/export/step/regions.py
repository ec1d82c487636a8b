# SPDX-License-Identifier: MIT
"""Fitted regions: surfaces, the points that measured each, and where two of them touch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from completion.export.step.limits import CONTACT_REACH, EXACT_VOLUME, LEAST_POINTS
from scenes.checks import FloatArray, InputError, IntArray, frozen_copy
from scenes.surfaces.catalogue import Cone, Cylinder, Plane, Sphere, Surface, Torus

KINDS = (Plane, Cylinder, Cone, Sphere, Torus)
MM = 1000.0  # in a metre: CAD works in millimetres
_N_LINKED = 10  # neighbours among which a point finds those of other regions


@dataclass(frozen=True, slots=True, eq=False)
class FittedRegion:
    """A region and the surface that was fitted to it.

    Attributes
    ----------
    number : int
        What the surface is called in the files.
    surface : Surface
        Plane, cylinder, cone, sphere or torus, metres.
    sd_m : float
        Standard deviation of the surface along its normal over the region, metres.
    group : int
        Regions with equal numbers lie on one surface.
    inferred : str
        What of it was not measured and why it is there, in words; empty where there is none.
    measured_share : float
        Share of its points that was measured.
    """

    number: int
    surface: Surface
    sd_m: float = 0.0
    group: int = -1
    inferred: str = ""
    measured_share: float = 1.0


def place_text(point: FloatArray) -> str:
    """A place (3,), millimetres, as people read it."""
    return f"({', '.join(f'{value + 0.0:.4g}' for value in point)}) mm"


class RegionMesh(NamedTuple):
    """Triangles (m, 3) of vertices (n, 3), and the place (m,) of each among the regions; -1 for none."""

    vertices: FloatArray
    faces: IntArray
    region: IntArray


@dataclass(frozen=True, slots=True, eq=False)
class PartRegions:
    """What a part's boundary is made of.

    Attributes
    ----------
    regions : tuple of FittedRegion
        The k surfaces.
    points : (n, 3) float
        What was measured, metres.
    region : (n,) int
        Place of each point among the regions; -1 for none.
    contacts : (m, 3) float
        Where two regions touch, metres: between neighbours of different regions.
    between : (m, 2) int
        Places of these regions, the lesser first.
    spacing_m, noise_m : float
        Sampling distance, and the deviation of the points along the normal.
    mesh : RegionMesh, optional
        The triangles of a model, whose edges are where regions meet; metres.
    """

    regions: tuple[FittedRegion, ...]
    points: FloatArray
    region: IntArray
    contacts: FloatArray
    between: IntArray
    spacing_m: float
    noise_m: float
    mesh: RegionMesh | None = None

    def __post_init__(self) -> None:
        for name in ("points", "contacts"):
            object.__setattr__(self, name, frozen_copy(getattr(self, name), np.float64))
        for name in ("region", "between"):
            object.__setattr__(self, name, frozen_copy(getattr(self, name), np.int64))


def part_regions(
    regions: Sequence[FittedRegion],
    points: object,
    region: object,
    *,
    spacing_m: float,
    noise_m: float = 0.0,
    mesh: RegionMesh | None = None,
) -> PartRegions:
    """Return the regions of points (n, 3), with their contacts: pairs of near points of two regions.

    Parameters
    ----------
    regions : sequence of FittedRegion
        The surfaces.
    points, region : (n, 3) float, (n,) int
        Metres, and the place of each point among the regions; -1 for none. Of a mesh, some on its triangles.
    spacing_m, noise_m : float
        Sampling distance and noise, metres.
    mesh : RegionMesh, optional
        The triangles of a model, metres: regions touch where they share an edge.

    Raises
    ------
    InputError
        No surface, one of another kind, numbers that are not finite, arrays of other shapes.
    """
    if not regions:
        raise InputError("there is no surface to export as STEP: nothing was fitted to the part")
    for fitted_region in regions:
        if not isinstance(fitted_region.surface, KINDS):
            raise InputError(
                f"surface {fitted_region.number} is of kind {fitted_region.surface.kind}, "
                "which STEP export has not"
            )
    place = np.asarray(points, dtype=np.float64)
    members = np.asarray(region, dtype=np.int64)
    if place.ndim != 2 or place.shape[1] != 3 or members.shape != (len(place),):
        raise InputError(f"expected points (n, 3) and regions (n,), got {place.shape} and {members.shape}")
    used = members >= 0
    bad = int((~np.isfinite(place[used])).any(axis=1).sum())
    if bad:
        raise InputError(f"{bad} of {int(used.sum())} points on surfaces are not finite; drop them first")
    if not (np.isfinite(spacing_m) and spacing_m > 0):
        raise InputError(f"the sampling distance must be a positive number of metres, got {spacing_m}")
    if int(members.max(initial=-1)) >= len(regions):
        raise InputError(f"a point is of region {int(members.max())}, but there are {len(regions)}")
    place, members = place[used], members[used]
    contacts, between = _contacts(place, members, spacing_m) if mesh is None else _shared_edges(mesh)
    return PartRegions(
        tuple(regions), place, members, contacts, between=between, spacing_m=spacing_m, noise_m=noise_m,
        mesh=mesh,
    )  # fmt: skip


def _shared_edges(mesh: RegionMesh) -> tuple[FloatArray, IntArray]:
    """Middles (m, 3) of edges of triangles of two regions, once for each of both ways, and these regions."""
    start, end = mesh.faces.ravel(), np.roll(mesh.faces, -1, axis=1).ravel()
    ends = np.sort(np.column_stack([start, end]), axis=1)
    order = np.lexsort((ends[:, 1], ends[:, 0]))
    ends, region = ends[order], np.repeat(mesh.region, 3)[order]
    is_shared = (ends[1:] == ends[:-1]).all(axis=1) & (region[1:] != region[:-1])
    kept = np.flatnonzero(is_shared & (np.minimum(region[1:], region[:-1]) >= 0))
    between = np.sort(np.column_stack([region[kept], region[kept + 1]]), axis=1)
    middle = mesh.vertices[ends[kept]].mean(axis=1)
    return np.concatenate([middle, middle]), np.concatenate([between, between])


def _contacts(points: FloatArray, members: IntArray, spacing_m: float) -> tuple[FloatArray, IntArray]:
    """Middles (m, 3) of near points of two regions, and these regions (m, 2)."""
    if len(points) < LEAST_POINTS:
        return np.zeros((0, 3)), np.zeros((0, 2), dtype=np.int64)
    tree = cKDTree(points)
    apart, near = tree.query(points, k=min(_N_LINKED + 1, len(points)))
    point_index = np.repeat(np.arange(len(points)), near.shape[1])
    two, length = near.ravel(), apart.ravel()
    kept = (members[point_index] != members[two]) & (length <= CONTACT_REACH * spacing_m)
    point_index, two = point_index[kept], two[kept]
    pairs = np.unique(np.sort(np.column_stack([point_index, two]), axis=1), axis=0)
    between = members[pairs]
    middle = points[pairs].mean(axis=1)
    nearest = members[tree.query(middle)[1]]  # of a third region where that lies between
    kept = (between == nearest[:, None]).any(axis=1)
    between, middle = between[kept], middle[kept]
    order = np.argsort(between, axis=1)
    return middle, np.take_along_axis(between, order, axis=1)


def join_regions(parts: PartRegions) -> PartRegions:
    """Return regions with those made one that touch and lie on one surface.

    A region without an edge of its own to a neighbour is a piece of that: no curve parts them.
    """
    n = len(parts.regions)
    head = list(range(n))

    def root(index: int) -> int:
        while head[index] != index:
            index = head[index]
        return index

    size = np.bincount(parts.region, minlength=n)
    tolerance = max(3 * parts.noise_m, (1e-2 if parts.mesh is None else 1e-4) * parts.spacing_m)
    pairs, count = np.unique(parts.between, axis=0, return_counts=True)
    for (first, two), n_contacts in zip(pairs.tolist(), count.tolist(), strict=True):
        a, b = root(first), root(two)
        if a == b or n_contacts < 2:
            continue
        large, small = (a, b) if size[a] >= size[b] else (b, a)
        if _is_one(parts, large, small, tolerance):
            head[small] = large
            size[large] += size[small]
    heads = [root(number) for number in range(n)]
    kept = [number for number in range(n) if heads[number] == number]
    number = np.full(n, -1)
    number[kept] = np.arange(len(kept))
    new = number[heads]
    between = np.sort(new[parts.between], axis=1)
    differ = between[:, 0] != between[:, 1]
    return PartRegions(
        regions=tuple(_joined(parts, [one for one, to in enumerate(heads) if to == k], k) for k in kept),
        points=parts.points,
        region=new[parts.region],
        contacts=parts.contacts[differ],
        between=between[differ],
        spacing_m=parts.spacing_m,
        noise_m=parts.noise_m,
        mesh=None
        if parts.mesh is None
        else parts.mesh._replace(region=np.append(new, -1)[parts.mesh.region]),
    )


def _joined(parts: PartRegions, members: Sequence[int], head: int) -> FittedRegion:
    """The region of a place with others that are pieces of it."""
    some = [parts.regions[k] for k in members]
    n = np.array([(parts.region == k).sum() for k in members])
    return replace(
        parts.regions[head],
        inferred=", ".join(dict.fromkeys(one.inferred for one in some if one.inferred)),
        measured_share=float(n @ [one.measured_share for one in some] / max(int(n.sum()), 1)),
    )


def drop_regions(parts: PartRegions, numbers: Sequence[int]) -> PartRegions:
    """Return regions without some, given by their places: their neighbours touch across them."""
    kept = [k for k in range(len(parts.regions)) if k not in numbers]
    place = np.full(len(parts.regions), -1)
    place[kept] = np.arange(len(kept))
    regions = [parts.regions[k] for k in kept]
    region = place[parts.region]
    return part_regions(regions, parts.points, region, spacing_m=parts.spacing_m, noise_m=parts.noise_m)


def false_volume(parts: PartRegions, volume_m3: float) -> str:
    """Why a solid is not that of a model: its volume differs by more than chords do; else empty."""
    mesh = parts.mesh
    if mesh is None:
        return ""
    corners = mesh.vertices[mesh.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas, own = (
        np.linalg.norm(across, axis=1) / 2,
        abs(float(np.einsum("ij,ij->", corners[:, 0], across)) / 6),
    )
    middles = np.stack(
        [corners.mean(axis=1), *((corners + np.roll(corners, 1, axis=1)) / 2).transpose(1, 0, 2)]
    )
    most = 0.0
    for k, region in enumerate(parts.regions):
        some = mesh.region == k
        sag = np.abs(region.surface.distance(middles[:, some].reshape(-1, 3))).max(initial=0.0)
        most += float(sag * areas[some].sum())
    if abs(volume_m3 - own) <= most + EXACT_VOLUME * own:
        return ""
    return f"its solid has {1e6 * volume_m3:.4g} cm3, but its triangles enclose {1e6 * own:.4g} cm3"


def _is_one(parts: PartRegions, large: int, small: int, tolerance: float) -> bool:
    """Whether the smaller region lies on the larger one's surface."""
    first, second = parts.regions[large].surface, parts.regions[small].surface
    if first.kind != second.kind:
        return False
    if parts.regions[large].group == parts.regions[small].group >= 0:
        return True
    members = parts.points[parts.region == small]
    off = np.abs(first.distance(members))
    turn = np.abs(np.einsum("ij,ij->i", first.normal(members), second.normal(members)))
    return bool(np.quantile(off, 0.9) <= tolerance and np.median(turn) > np.cos(np.radians(2.0)))


def in_millimetres(surface: Surface) -> Surface:
    """The same surface with lengths in millimetres."""
    if isinstance(surface, Plane):
        return Plane(surface.point * MM, surface.normal_direction, surface.u_direction)
    if isinstance(surface, Sphere):
        return Sphere(surface.centre * MM, surface.radius * MM, concave=surface.concave)
    if isinstance(surface, Cylinder):
        return Cylinder(surface.point * MM, surface.direction, surface.radius * MM, concave=surface.concave)
    if isinstance(surface, Cone):
        return Cone(
            surface.point * MM, surface.direction, surface.radius * MM, surface.half_angle,
            concave=surface.concave,
        )  # fmt: skip
    if isinstance(surface, Torus):
        return Torus(
            surface.centre * MM, surface.direction, surface.radius * MM, surface.tube_radius * MM,
            concave=surface.concave,
        )  # fmt: skip
    raise InputError(f"STEP export has no {surface.kind}")
