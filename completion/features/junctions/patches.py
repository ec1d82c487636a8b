# SPDX-License-Identifier: MIT
"""Patches: where a cloud is one plane or cylinder, grown from the smoothest places."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from completion.features.engine.template import Measured
from completion.features.junctions.descent import Descended, settled, thickness
from completion.features.junctions.models import Unit, at_unit
from completion.features.junctions.weighing import one_arc
from scenes.checks import BoolArray, FloatArray, IntArray

_MOST_POINTS = 16_000
_N_NEIGHBOURS = 16
_BALLS = (120, 48)  # points that a patch begins with, first and where that was too large
_LEAST_POINTS = 30  # of a patch
_N_SEEDS = 90
_N_GROWTHS = 6
_N_FITTED, _N_ROUNDS = 800, 3
_N_DIRECTIONS = 4  # that a patch begins in
_WITHIN, _ANGLE = 3.5, np.cos(np.radians(20.0))  # sigma, and of the normal, that belong to a patch
_FLAT = 0.02  # of its size, that a patch may bend and count as a plane


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """Points thinned, with normals and neighbours.

    Attributes
    ----------
    points, normals : (n, 3) float
        At unit RMS; normals without a side.
    neighbours : (n, k) int
        The nearest of each.
    spacing : float
        Typical distance of the nearest.
    noise : float
        Typical roughness.
    which : (n,) int
        Number of each among all points.
    """

    points: FloatArray
    normals: FloatArray
    neighbours: IntArray
    roughness: FloatArray
    spacing: float
    noise: float
    which: IntArray


class Patch(NamedTuple):
    """Points (m,) of a cloud on one plane or cylinder, by number, and that surface."""

    members: IntArray
    fit: Descended
    is_flat: bool

    @property
    def radius(self) -> float:
        """Of the cylinder; inf of a plane."""
        return np.inf if self.is_flat else float(1 / max(abs(self.fit.model.shape[0]), 1e-12))


def cloud_of(unit: Unit) -> Cloud:
    """Return at most some thousand points of what was measured, with normals and neighbours."""
    points = unit.points
    which = np.arange(len(points))[:: max(1, -(-len(points) // _MOST_POINTS))]
    some = points[which]
    k = min(_N_NEIGHBOURS + 1, len(some))
    tree = cKDTree(some)
    apart, near = tree.query(some, k=k)
    around = some[near] - some[near].mean(axis=1, keepdims=True)
    values, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", around, around) / k)
    rough = np.sqrt(np.maximum(values[:, 0], 0.0))
    spacing = float(np.median(apart[:, 1]))
    noise = max(unit.measured.noise, float(np.quantile(rough, 0.2)), 0.01 * spacing)
    return Cloud(some, vectors[:, :, 0], near[:, 1:], rough, spacing=spacing, noise=noise, which=which)


def find_patches(cloud: Cloud) -> list[Patch]:
    """Return the planes and cylinders of a cloud, the smoothest places first."""
    free = np.ones(len(cloud.points), dtype=np.bool_)
    untried = free.copy()
    order = np.argsort(cloud.roughness, kind="stable")
    found: list[Patch] = []
    for _ in range(_N_SEEDS):
        open_ = order[(untried & free)[order]]
        if len(open_) == 0 or free.sum() < _LEAST_POINTS:
            break
        seed = int(open_[0])
        patch = _grown(cloud, seed, free)
        if patch is None:
            untried[seed] = False
            untried[cloud.neighbours[seed]] = False
            continue
        found.append(patch)
        free[patch.members] = False
        untried[patch.members] = False
    return found


def _grown(cloud: Cloud, seed: int, free: BoolArray) -> Patch | None:
    """A patch about a seed, of free points."""
    for size in _BALLS:
        ball = _ball(cloud, seed, free, size)
        if len(ball) < _LEAST_POINTS:
            return None
        patch = _from_ball(cloud, ball, free)
        if patch is not None:
            return patch
    return None


def _from_ball(cloud: Cloud, ball: IntArray, free: BoolArray) -> Patch | None:
    """A patch from the points (m,) of a ball, if they are one surface."""
    fit = _fitted(cloud, ball)
    if fit.mixture.sigma > 2.5 * cloud.noise + 0.05 * cloud.spacing:
        return None
    members = ball
    for _ in range(_N_GROWTHS):
        section = fit.model.section(cloud.points)
        normal = section.slope @ fit.model.turn
        agrees = np.abs(np.einsum("ij,ij->i", normal, cloud.normals)) > _ANGLE
        band = _WITHIN * max(fit.mixture.sigma, cloud.noise)
        on = free & agrees & (np.abs(section.distance) < band)
        grown = _connected(cloud, on, ball)
        if len(grown) < _LEAST_POINTS:
            return None
        if len(grown) == len(members) and (grown == members).all():
            break
        members = grown
        fit = _refitted(fit, cloud.points[members])
    size = float(np.ptp(fit.model.local(cloud.points[members])[:, 1]))
    sagitta = abs(fit.model.shape[0]) * size**2 / 8
    return Patch(members, fit, is_flat=bool(sagitta < max(_FLAT * size, 2 * cloud.noise)))


def _fitted(cloud: Cloud, members: IntArray) -> Descended:
    """The plane or cylinder of some points (m,), brought to unit RMS for it and back."""
    unit = at_unit(Measured(cloud.points[members], 0.0, cloud.spacing))
    fit = one_arc(unit.points, thickness(unit.points), _N_DIRECTIONS)
    model = replace(fit.model, origin=unit.outside(fit.model.origin), shape=fit.model.shape * unit.factor)
    mixture = replace(
        fit.mixture, sigma=fit.mixture.sigma / unit.factor, reach=fit.mixture.reach / unit.factor
    )
    return fit._replace(model=model, mixture=mixture)


def _refitted(fit: Descended, points: FloatArray) -> Descended:
    """The fit on at most some of the points (n, 3)."""
    return settled(fit, points[:: max(1, len(points) // _N_FITTED)], _N_ROUNDS)


def _ball(cloud: Cloud, seed: int, free: BoolArray, size: int) -> IntArray:
    """About so many free points (m,) that are connected with a seed."""
    inside = np.zeros(len(free), dtype=np.bool_)
    inside[seed] = True
    edge = np.array([seed])
    while len(edge) and inside.sum() < size:
        edge = np.unique(cloud.neighbours[edge])
        edge = edge[free[edge] & ~inside[edge]]
        inside[edge] = True
    return np.flatnonzero(inside)


def _connected(cloud: Cloud, on: BoolArray, ball: IntArray) -> IntArray:
    """The points (m,) among some that are connected with most of a ball."""
    number = np.flatnonzero(on)
    if len(number) == 0:
        return number
    where = np.full(len(on), -1)
    where[number] = np.arange(len(number))
    to = where[cloud.neighbours[number]]
    row, column = np.nonzero(to >= 0)
    graph = coo_array((np.ones(len(row)), (row, to[row, column])), shape=(len(number), len(number)))
    _, label = connected_components(graph, directed=False)
    inside = where[ball]
    inside = inside[inside >= 0]
    if len(inside) == 0:
        return number[:0]
    return np.asarray(number[label == np.bincount(label[inside]).argmax()])
