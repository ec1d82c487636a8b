# SPDX-License-Identifier: MIT
"""Free-form patches on one page: from points, and the surfaces around, to a patch that joins these."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.sparse import csc_array

from completion.fitting import limits
from completion.fitting.patches.joins import (
    Boundaries,
    Boundary,
    ControlEquations,
    JoinKind,
    check_boundaries,
    equations_of,
)
from completion.fitting.patches.parametrisation import parametrise, span_about
from completion.fitting.patches.rounds import (
    ON_ALL,
    STEPS,
    BorderedSystem,
    Freedom,
    State,
    feet_of,
    fit_by_rounds,
    impose_joins,
    information,
    next_round,
    release_surfaces,
    rms_of,
)
from completion.fitting.patches.spline import SideName, SplinePatch, products, side_places
from completion.fitting.result import FitError
from scenes.card import shown
from scenes.checks import FloatArray, InputError, Value, check_points
from scenes.surfaces.catalogue import Cylinder, Plane

N_MEASURED = 400
"""Places along a boundary at which its join is measured."""

_CHUNK = 256  # places whose deviations are solved for at once


@shown
class MeasuredJoin(NamedTuple):
    """How well a patch meets a surface along a boundary."""

    angle: float  # radians, the largest from tangent or orthogonal; NaN where it is connected alone
    gap: float  # the largest distance, in the unit of the points


@dataclass(frozen=True, slots=True, eq=False)
class PatchFit(Value):
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
    equations : ControlEquations
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
    equations: ControlEquations
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
        solver, sums = BorderedSystem(self.information, self.equations), list[FloatArray]()
        for low in range(0, len(places), _CHUNK):
            sample = places[low : low + _CHUNK]
            held = products(self.patch.bases, sample).toarray()
            wide = (held[:, :, None] * self.patch.normals(sample)[:, None]).reshape(len(sample), -1)
            sums.append(np.einsum("ij,ji->i", wide, solver.solve(wide.T)))
        return np.asarray(self.rms * np.sqrt(np.maximum(np.concatenate([np.zeros(0), *sums]), 0.0)))


def measured_join(patch: SplinePatch, side: SideName, boundary: Boundary) -> MeasuredJoin:
    """Return how well a patch meets a surface, by its points and normals, not by the equations."""
    places = side_places(side, np.linspace(0.0, 1.0, N_MEASURED))
    at = patch.at(places)
    gap = float(np.abs(boundary.surface.distance(at)).max())
    if boundary.join is JoinKind.CONNECTED:
        return MeasuredJoin(np.nan, gap)
    patch_normals, other = patch.normals(places), boundary.surface.normal(at)
    sine, cosine = (
        np.linalg.norm(np.cross(patch_normals, other), axis=1),
        np.abs(np.einsum("ij,ij->i", patch_normals, other)),
    )
    off = np.arctan2(sine, cosine) if boundary.join is JoinKind.TANGENT else np.arctan2(cosine, sine)
    return MeasuredJoin(float(off.max()), gap)


_GRID, _EDGE = 81, 0.02  # places along each side at which folds are looked for, a strip apart


def doubts_of(fit: PatchFit, beyond: float) -> tuple[str, ...]:
    """Return what is doubtful of a patch, of whose points a share lies `beyond` its boundaries."""
    doubts = list[str]()
    if beyond > limits.MANY_BEYOND:
        doubts.append(
            f"{100 * beyond:.0f} % of the points lie beyond the boundaries: are the surfaces where they are "
            "said to be?"
        )
    if _is_folded(fit.patch):
        doubts.append("the patch is folded: a surface cuts through the points, or they are no single sheet")
    for side, boundary in fit.boundaries.items():
        angle = fit.joins[side].angle
        if isinstance(boundary.surface, Cylinder) and angle > limits.OFF_CYLINDER:
            doubts.append(
                f"{side} is {angle:.1e} rad off its cylinder: more controls along it follow it closer"
            )
        elif isinstance(boundary.surface, Plane) and angle > limits.OFF_PLANE:
            doubts.append(f"{side} is {angle:.1e} rad off its plane: the patch has no width there")
    if fit.ratio > limits.WORSE_RMS:
        doubts.append(
            f"the points' rms is {fit.ratio:.2f} times that of a patch joined to nothing: they contradict "
            "a join, or a surface is not where it is said to be"
        )
    return tuple(doubts)


def _is_folded(patch: SplinePatch) -> bool:
    """Whether normals turn round between neighbours of a fine grid."""
    places = np.linspace(_EDGE, 1.0 - _EDGE, _GRID)
    uv = np.stack(np.meshgrid(places, places, indexing="ij"), axis=-1).reshape(-1, 2)
    normals = patch.normals(uv).reshape(_GRID, _GRID, 3)
    turned = (
        np.einsum("ijk,ijk->ij", *pair)
        for pair in ((normals[1:], normals[:-1]), (normals[:, 1:], normals[:, :-1]))
    )
    return any(bool((determinant < 0).any()) for determinant in turned)


_MOST_SIDE = 64  # controls
_USUAL, _POINTS_EACH = 10, 4.0  # controls along a side, and points for each, when not given


def fit_patch(
    points: object,
    boundaries: Mapping[SideName, Boundary],
    *,
    controls: tuple[int, int] | None = None,
    free: bool = False,
    smoothing: float = limits.SMOOTHING,
) -> PatchFit:
    """Fit a free-form patch to points, joined along its boundaries to planes exactly, to cylinders nearly so.

    Cubic B-splines, of degree five along cylinders. After Fisher (2004), Applying knowledge to reverse
    engineering problems, figure 2; distances to tangent planes as Pottmann, Leopoldseder & Hofer (2002),
    Approximation with active B-spline curves and surfaces, minimise them.

    Parameters
    ----------
    points : (n, 3) float
        Of the patch alone, in any unit.
    boundaries : mapping
        What it meets along "u0", "u1", "v0", "v1"; sides that are not named end where the points do.
    controls : (int, int), optional
        Control points along u and along v; by default as many as the points bear, at most 10.
    free : bool
        Whether the surfaces may move with what the patch says of them, as little as they are well known.
    smoothing : float
        Weight of the thin plate, a point.

    Raises
    ------
    FitError
        Points that bear no patch, or surfaces that they do not meet; the message says why in numbers.
    InputError
        Arrays of wrong shape, joins that exclude each other, controls too few or too many.

    Examples
    --------
    >>> xy = np.random.default_rng(0).uniform(0, 1, (2000, 2))
    >>> hill = np.column_stack([xy, 0.1 * np.sin(np.pi * xy[:, 0]) ** 2])
    >>> floor = Boundary(Plane((0, 0, 0), (0, 0, 1)), "tangent")
    >>> found = fit_patch(hill, {"u0": floor, "u1": floor})
    >>> found.joins["u0"].angle < 1e-12
    True
    """
    # 1. Check, and take the points to the origin at unit size.
    cloud = _check_points(points)
    check_boundaries(boundaries)
    centre, size = cloud.mean(axis=0), float(np.sqrt(np.mean(np.var(cloud, axis=0)) * 3))
    places, around = (cloud - centre) / size, _scale(boundaries, centre, size)
    degree = _degrees(around)
    shape = _shape(controls, degree, places, around)

    # 2. Parametrise: the four curves where the points end, each named by the surface that it lies on.
    start = parametrise(places, around)
    _check_met(start.off, boundaries, size)

    # 3. Fit: feet of the points, then controls under the joins' equations, less and less smooth.
    state = fit_by_rounds(
        State(SplinePatch(np.zeros((*shape, 3)), degree), start.uv, around), places, smoothing
    )

    # 4. Compare with a patch joined to nothing: what is left of the points there is their error.
    loose = state._replace(around={})
    off, _ = rms_of(state.patch, feet_of(state.patch, places, state.uv, STEPS), around)
    for _ in range(ON_ALL):
        loose = next_round(loose, places, smoothing, rms=off)
    error, _ = rms_of(loose.patch, feet_of(loose.patch, places, loose.uv, STEPS))

    # 5. Free: surfaces move with the controls; then once more with the surfaces where they came to be.
    if free and around:
        state = release_surfaces(state, places, Freedom(around, size), error**2, smoothing)
        state = next_round(state, places, smoothing, rms=error)
    state = state._replace(patch=impose_joins(state.patch, state.around))

    # 6. Measure residuals and joins, in the unit of the points.
    feet = feet_of(state.patch, places, state.uv, STEPS)
    rms, n = rms_of(state.patch, feet, around)
    patch = state.patch.scale_and_shift(size, centre)
    met = _unscale(state.around, boundaries, centre, size) if free else boundaries
    fit = PatchFit(
        patch=patch,
        boundaries=met,
        rms=rms * size,
        unconstrained_rms=error * size,
        n=n,
        joins={side: measured_join(patch, side, boundary) for side, boundary in met.items()},
        information=information(state, places, smoothing),
        equations=equations_of(state.patch, state.around).independent(),
    )
    apart = np.linalg.norm(places - state.patch.at(feet.uv), axis=1)
    return replace(
        fit, warnings=doubts_of(fit, float(np.mean(~feet.is_inside & (apart > limits.BEYOND * rms))))
    )


def _check_points(points: object) -> FloatArray:
    cloud = check_points("points", points)
    least = 4 * 4
    if len(cloud) < least:
        raise FitError(f"{len(cloud)} points bear no patch; at least {least} do")
    spread = np.linalg.svd(cloud - cloud.mean(axis=0), compute_uv=False) / np.sqrt(len(cloud))
    if spread[1] <= 1e-6 * max(spread[0], 1e-300):
        raise FitError(
            f"{len(cloud)} points lie on one line or in one spot: they scatter by {spread.tolist()}"
        )
    return cloud


def _scale(boundaries: Boundaries, centre: FloatArray, size: float) -> Boundaries:
    """The surfaces with their lengths over `size`, from `centre` (3,) on."""
    return {side: replace(boundary, surface=_scale_surface(boundary.surface, -centre / size, 1 / size))
            for side, boundary in boundaries.items()}  # fmt: skip


def _unscale(around: Boundaries, given: Boundaries, centre: FloatArray, size: float) -> Boundaries:
    return {side: replace(given[side], surface=_scale_surface(boundary.surface, centre, size))
            for side, boundary in around.items()}  # fmt: skip


def _scale_surface(surface: Plane | Cylinder, offset: FloatArray, factor: float) -> Plane | Cylinder:
    point = surface.point * factor + offset
    if isinstance(surface, Plane):
        return Plane(point, surface.normal_direction, surface.u_direction)
    radius = surface.radius * factor
    return Cylinder(point, surface.direction, radius, surface.zero_direction, surface.concave)


def _degrees(around: Boundaries) -> tuple[int, int]:
    """Cubic, and of degree five along a cylinder, which a cubic follows too coarsely."""
    bent = {side[0] for side, boundary in around.items() if isinstance(boundary.surface, Cylinder)}
    return (5 if "v" in bent else 3), (5 if "u" in bent else 3)


def _shape(
    controls: tuple[int, int] | None, degree: tuple[int, int], places: FloatArray, around: Boundaries
) -> tuple[int, int]:
    """How many controls along u and along v: as asked for, or as points and cylinders need."""
    if controls is None:
        usual = int(np.clip(np.sqrt(len(places) / _POINTS_EACH), 4, _USUAL))
        needed = {"u": usual, "v": usual}
        for side, boundary in around.items():
            if isinstance(boundary.surface, Cylinder):
                along = "v" if side[0] == "u" else "u"
                spans = int(np.ceil(span_about(places, boundary.surface) / limits.CYLINDER_SPAN))
                needed[along] = min(max(needed[along], 5 + spans), _MOST_SIDE)
        return max(needed["u"], degree[0] + 1), max(needed["v"], degree[1] + 1)
    for n, least, name in zip(controls, degree, "uv", strict=True):
        if not least + 1 <= n <= _MOST_SIDE:
            raise InputError(
                f"{n} controls along {name}: from {least + 1} (degree {least}) to {_MOST_SIDE} are possible"
            )
    return controls


def _check_met(off: Mapping[SideName, float], boundaries: Boundaries, size: float) -> None:
    for side, far in off.items():
        if far > limits.FAR_SIZES:
            kind = boundaries[side].surface.kind
            raise FitError(
                f"{side}: where the points end next to its {kind} they are {far * size:.4g} from it, and "
                f"they scatter by {size:.4g} in all; is it the right surface, in the unit of the points?"
            )
