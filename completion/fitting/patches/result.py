# SPDX-License-Identifier: MIT
"""What a patch fit gives: the surface, its residuals, how well it meets its neighbours, how sure it is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.sparse import csc_array

from completion.fitting.patches.boundary import Boundaries, Boundary, Join
from completion.fitting.patches.constraints import Equations
from completion.fitting.patches.least_squares import Bordered
from completion.fitting.patches.patch import SideName, SplinePatch, products, side_places
from scenes.checks import FloatArray, InputError

N_MEASURED = 400
"""Places along a boundary at which its join is measured."""

_CHUNK = 256  # places whose deviations are solved for at once


class MeasuredJoin(NamedTuple):
    """How well a patch meets a surface along a boundary."""

    angle: float  # radians, the largest from tangent or orthogonal; NaN where it is connected alone
    gap: float  # the largest distance, in the unit of the points


@dataclass(frozen=True, slots=True, eq=False)
class PatchFit:
    """A free-form patch fitted to points between surfaces.

    Attributes
    ----------
    patch : SplinePatch
        The surface, in the unit of the points.
    boundaries : mapping
        By side, what it is joined to; surfaces that were free as they came out.
    rms : float
        Root mean square of the points' distances across the patch, over the degrees of freedom.
    unconstrained_rms : float
        The same of a patch of as many controls that is joined to nothing.
    n : int
        Points that took part.
    joins : mapping
        By side, the largest angle and gap at `N_MEASURED` places.
    information : (k, k) sparse
        Of the controls' coordinates, for points of unit variance, the smoothing included.
    equations : Equations
        Those that hold them.
    warnings : tuple of str
        What is doubtful.
    """

    patch: SplinePatch
    boundaries: Boundaries
    rms: float
    unconstrained_rms: float
    n: int
    joins: Mapping[SideName, MeasuredJoin]
    information: csc_array
    equations: Equations
    warnings: tuple[str, ...] = ()

    @property
    def ratio(self) -> float:
        """The rms over that of a patch joined to nothing."""
        return self.rms / self.unconstrained_rms if self.unconstrained_rms > 0 else 1.0

    def deviation(self, uv: FloatArray) -> FloatArray:
        """Return the standard deviation (k,) of the patch along its normal at parameters (k, 2).

        For points whose errors are independent and as large as `rms`, between surfaces that are exact.

        Raises
        ------
        InputError
            Parameters of another shape, or outside of [0, 1].
        """
        places = np.asarray(uv, dtype=np.float64)
        if places.ndim != 2 or places.shape[1] != 2 or not ((places >= 0) & (places <= 1)).all():
            raise InputError(f"expected parameters with shape (k, 2) in [0, 1], got {places.shape}")
        solver, found = Bordered(self.information, self.equations), list[FloatArray]()
        for low in range(0, len(places), _CHUNK):
            some = places[low : low + _CHUNK]
            held = products(self.patch.bases, some).toarray()
            wide = (held[:, :, None] * self.patch.normals(some)[:, None]).reshape(len(some), -1)
            found.append(np.einsum("ij,ji->i", wide, solver.solve(wide.T)))
        return np.asarray(self.rms * np.sqrt(np.maximum(np.concatenate([np.zeros(0), *found]), 0.0)))


def measured_join(patch: SplinePatch, side: SideName, boundary: Boundary) -> MeasuredJoin:
    """Return how well a patch meets a surface, by its points and normals, not by the equations."""
    places = side_places(side, np.linspace(0.0, 1.0, N_MEASURED))
    at = patch.at(places)
    gap = float(np.abs(boundary.surface.distance(at)).max())
    if boundary.join is Join.CONNECTED:
        return MeasuredJoin(np.nan, gap)
    own, other = patch.normals(places), boundary.surface.normal(at)
    sine, cosine = np.linalg.norm(np.cross(own, other), axis=1), np.abs(np.einsum("ij,ij->i", own, other))
    off = np.arctan2(sine, cosine) if boundary.join is Join.TANGENT else np.arctan2(cosine, sine)
    return MeasuredJoin(float(off.max()), gap)
