# SPDX-License-Identifier: MIT
"""Rays of placed scans in a design: how probable what beams measured is, and refinement of poses.

A beam ends on the first surface of the design along it (within `group_rays.GATE_M`), before it, at whatever
stands in a building but not in its design, or behind it, which right poses hardly ever show: a mixture of
three uniform densities. Doors and windows are as likely open as shut.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from completion.asbuilt.group_rays import GroupRays
from completion.asbuilt.limits import SEE_THROUGH
from completion.registration.limits import RIDGE
from completion.registration.motions import perturb
from scenes.checks import BoolArray, FloatArray
from scenes.mesh.design import ElementMesh
from scenes.rays.raycast import Hits, RayCaster

_ON, _BEFORE, _BEYOND = 0.6, 0.03, 0.004
"""Of a beam that ends on the design its probability, else its density, 1/m: before it and behind it."""
_LEAST_COSINE = 0.1
_SAME = 0.8  # cosine between a facet and the face that it lies on: 37 deg
_LEAF_WORDS = "door", "window", "curtain", "glass", "glazing"
_COARSE_GATES_M = 0.4, 0.3, 0.2, 0.15, 0.1, 0.1
_FINE_GATES_M = (0.1, 0.1, 0.08, 0.08) + (0.06,) * 36
_STILL_M, _LEAST_MET = 1e-10, 12  # when steps end; facets that a step needs
_N_COARSE = 400  # facets of a first refinement


@dataclass(frozen=True, slots=True, eq=False)
class BeamVotes:
    """What b beams say of a pose.

    `log_density`: of what each measured; `agrees`, `passes`: whether it ends on the design, or behind its
    first surface; `is_near`: within twice the gate of it; `end_m`: where that surface is.
    """

    log_density: FloatArray
    agrees: BoolArray
    passes: BoolArray
    is_near: BoolArray
    end_m: FloatArray


class DesignRays:
    """A design prepared for beams; its vertices (n, 3) are about its own middle."""

    def __init__(self, design: ElementMesh, middle: FloatArray, n_threads: int | None) -> None:
        self.mesh = design.mesh.at(design.mesh.vertices - middle)
        self.normals = self.mesh.face_normals()
        leaf = np.array(
            [_is_leaf(f"{each.ifc_class} {each.name} {each.type_name}") for each in design.elements]
        )
        self.is_leaf = leaf[self.mesh.face_surface]
        look = self.mesh.appearance
        if look is not None and look.opacity is not None:
            self.is_leaf = self.is_leaf | (look.opacity < SEE_THROUGH)
        self._shut = RayCaster(self.mesh.vertices, self.mesh.faces, n_threads)
        solid = self.mesh.faces[~self.is_leaf]
        self._open = (
            RayCaster(self.mesh.vertices, solid, n_threads) if 0 < len(solid) < len(self.is_leaf) else None
        )

    def votes(self, rays: GroupRays, pose: FloatArray) -> BeamVotes:
        """Return what beams of a group say of its pose (3, 4)."""
        origins, ways = rays.origin @ pose[:, :3].T + pose[:, 3], rays.direction @ pose[:, :3].T
        each = [_beam_votes(self._shut.first_hit(origins, ways), rays)]
        if self._open is not None:
            each.append(_beam_votes(self._open.first_hit(origins, ways), rays))
        density = np.mean([np.exp(one.log_density) for one in each], axis=0)
        return BeamVotes(
            np.log(density),
            np.any([one.agrees for one in each], axis=0),
            np.all([one.passes for one in each], axis=0),
            np.any([one.is_near for one in each], axis=0),
            each[0].end_m,
        )

    def refine(self, rays: GroupRays, pose: FloatArray, *, coarse: bool = False) -> tuple[FloatArray, float]:
        """Return the pose (3, 4) that brings a group's facets to the design's planes, and its stiffness.

        Each facet is compared with what the beam to its middle would meet first; least squares of distances
        along normals, with Tukey's weights in a gate that closes. The stiffness is the smallest eigenvalue of
        the mean of n n': 1/3 where normals face all ways alike, 0 where the pose slides.
        """
        step = max(1, len(rays.centre) // _N_COARSE) if coarse else 1
        facets = rays.centre[::step], rays.normal[::step], rays.eye[::step]
        weight, stiffness = np.sqrt(rays.area[::step]), 0.0
        gates = _COARSE_GATES_M if coarse else _FINE_GATES_M
        for gate in gates:
            place, normal, off = self._meet(facets, pose)
            near = np.abs(off) < gate
            if near.sum() < _LEAST_MET:
                return pose, 0.0
            pull = weight[near] * (1 - np.square(off[near] / gate)) ** 2
            pose, change, stiffness = _step(place[near], normal[near], off[near], pull, pose)
            if gate == gates[-1] and change < _STILL_M:
                break
        return pose, stiffness

    def _meet(
        self, facets: tuple[FloatArray, FloatArray, FloatArray], pose: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Where facets lie (n, 3), the normals that they meet (n, 3), and how far along these (n,)."""
        centre, normal, eye = facets
        place, origin = (array @ pose[:, :3].T + pose[:, 3] for array in (centre, eye))
        way = place - origin
        hits = self._shut.first_hit(origin, way)
        facing = self.normals[hits.face]
        with np.errstate(invalid="ignore"):
            off = (facing * way).sum(axis=1) * (1 - hits.ranges / np.linalg.norm(way, axis=1))
        is_same = hits.hit & ((facing * (normal @ pose[:, :3].T)).sum(axis=1) > _SAME)
        return place, facing, np.where(is_same, off, np.inf)


def _step(
    place: FloatArray, normal: FloatArray, off: FloatArray, pull: FloatArray, pose: FloatArray
) -> tuple[FloatArray, float, float]:
    """A pose after a step of least squares, how large that was, metres, and the stiffness."""
    middle = np.average(place, axis=0, weights=pull)
    spread = float(np.sqrt(((place - middle) ** 2).sum(axis=1).mean()))
    rows = np.concatenate([np.cross(place - middle, normal) / spread, normal], axis=1)
    matrix = rows.T @ (pull[:, None] * rows)
    ridge = RIDGE * np.trace(matrix) / 6 * np.eye(6)
    change = -np.linalg.solve(matrix + ridge, rows.T @ (pull * off))
    stiffness = float(np.linalg.eigvalsh(matrix[3:, 3:] / pull.sum())[0])
    size = float(np.abs(change).max())
    return perturb(pose, change / np.repeat([spread, 1.0], 3), middle), size, stiffness


def _is_leaf(text: str) -> bool:
    return any(word in text.lower() for word in _LEAF_WORDS)


def _beam_votes(hits: Hits, rays: GroupRays) -> BeamVotes:
    """What beams say whose first hits are these."""
    cosine = np.maximum(hits.incidence_cosine, _LEAST_COSINE)
    gate = rays.gate_m / cosine
    off = np.where(hits.hit, rays.range_m - hits.ranges, -np.inf)
    agrees, passes = np.abs(off) <= gate, off > gate
    density = np.where(agrees, _ON / (2 * gate), np.where(passes, _BEYOND, _BEFORE))
    return BeamVotes(np.log(density), agrees, passes, np.abs(off) <= 2 * gate, hits.ranges)
