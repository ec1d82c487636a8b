# SPDX-License-Identifier: MIT
"""Faces: a region's surface within its loops, kept where it holds the region's points and little else."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from completion.exchange.step.brep import EdgeMaker, area_of, is_valid, tipped_face, trimmed_face
from completion.exchange.step.curves.kernel import kernel_errors
from completion.exchange.step.curves.winding import winding
from completion.exchange.step.loops import RegionLoops, Side, loop_points
from completion.exchange.step.measured import shares_of
from completion.exchange.step.nesting import nested
from completion.exchange.step.regions import PartRegions
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Cone, Sphere, Surface, Torus

HELD = 0.5  # share of a region's points that its face must hold
LEAST = 0.5  # share of a face that must have been measured
MEASURED = 0.95  # share of a face from which on it counts as measured
_ROUND = 4.0  # sampling distances, from which radius on points tell a whole surface


class RegionFaces(NamedTuple):
    """The faces of a region, the share of them that was measured, and why there are none."""

    faces: list[Any]
    measured: float = 0.0
    reason: str = ""


class FaceMaker:
    """Makes the faces of regions; lengths of surfaces, shapes and points in millimetres."""

    def __init__(self, parts: PartRegions, make: EdgeMaker, spacing: float) -> None:
        self.parts, self.make, self.spacing = parts, make, spacing

    def faces(self, surface: Surface, shape: Any, loops: RegionLoops, points: FloatArray) -> RegionFaces:
        """The faces of a region of points (n, 3), or why there are none."""
        if loops.rest:
            return RegionFaces([], reason=self._open(loops.rest))
        try:
            made = self._made(surface, shape, loops, points)
            return made if made.reason else self._checked(made, points, is_bounded=bool(loops.closed))
        except kernel_errors():
            return RegionFaces([], reason="the kernel could not trim it")

    def _open(self, chains: Sequence[Sequence[Side]]) -> str:
        """Between which surfaces a boundary is open."""
        ends = [side for chain in chains for side in (chain[0], chain[-1])]
        curves, pieces = self.make.curves, self.make.pieces
        places = {place for side in ends for place in curves[pieces[side.piece].curve].pair}
        numbers = ", ".join(str(one) for one in sorted(self.parts.regions[place].number for place in places))
        return f"its boundary is open where surfaces {numbers} should meet"

    def _made(self, surface: Surface, shape: Any, loops: RegionLoops, points: FloatArray) -> RegionFaces:
        make = self.make
        if not loops.closed:
            size = getattr(surface, "tube_radius", getattr(surface, "radius", 0.0))
            if not isinstance(surface, Sphere | Torus) or size < _ROUND * self.spacing:
                return RegionFaces([], reason="no fold with a neighbour bounds it")
            return RegionFaces([trimmed_face(shape, [], make).face])
        if isinstance(surface, Cone) and len(loops.closed) == 1:
            rim = self._rim(surface, loops.closed[0])
            if rim is not None:
                return RegionFaces([tipped_face(surface, shape, rim)])
        groups = nested(surface, loops.closed, make.pieces, make.curves, points)
        faces = [trimmed_face(shape, group, make) for group in groups]
        failed = [one.reason for one in faces if one.face is None]
        if failed or not faces:
            return RegionFaces([], reason=failed[0] if failed else "its loops enclose none of its points")
        return RegionFaces([one.face for one in faces])

    def _rim(self, cone: Cone, loop: Sequence[Side]) -> FloatArray | None:
        """A point (3,) of a loop round a cone's axis that all lies at one height; None of others."""
        points = loop_points(loop, self.make.pieces, self.make.curves)
        height = (points - cone.point) @ cone.direction
        if np.ptp(height) > 1e-6 or not winding(cone.point, cone.direction, points):
            return None
        first: FloatArray = points[0]
        return first

    def _checked(self, made: RegionFaces, points: FloatArray, *, is_bounded: bool) -> RegionFaces:
        """The faces, if they hold their points, and were measured."""
        if not all(is_valid(face) for face in made.faces):
            return RegionFaces([], reason="the kernel finds its trimmed face invalid")
        shares = [shares_of(face, points, self.spacing) for face in made.faces]
        held = sum(share.held for share in shares)
        if held < HELD:
            return RegionFaces([], reason=f"its loops enclose only {100 * held:.0f} % of its points")
        areas = [area_of(face) for face in made.faces]
        measured = float(np.average([share.measured for share in shares], weights=areas))
        if measured < (LEAST if is_bounded else MEASURED):
            where = "within its loops" if is_bounded else "of it, which no neighbour bounds,"
            return RegionFaces([], reason=f"only {100 * measured:.0f} % {where} was measured")
        return RegionFaces(made.faces, measured)
