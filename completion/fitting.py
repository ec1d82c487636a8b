# SPDX-License-Identifier: MIT
"""Fits: orthogonal-distance least squares of plane and circular cylinder, with covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scenes.checks import BoolArray, FloatArray, check_points
from scenes.surfaces import Cylinder, Plane, Surface, perpendicular

_SUBSAMPLE = 20_000  # points that a cylinder converges on before its last two full steps
_N_STEPS = 30


class FitError(ValueError):
    """Points that determine no surface; the message says why in numbers."""


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceFit:
    """A surface fitted to points.

    Attributes
    ----------
    surface : Plane or Cylinder
        The fit; its normals point to the side the scanner looked from.
    rms : float
        Root mean square orthogonal distance over the degrees of freedom, metres.
    covariance : (k, k) float
        Of the chart's parameters: for a plane the offset along the normal and the slopes along u and v
        (k = 3); for a cylinder the two shifts and two tilts of its axis, and the radius (k = 5).
    n : int
        Number of points.
    """

    surface: Surface
    rms: float
    covariance: FloatArray
    n: int

    def standard_deviation(self, points: FloatArray) -> FloatArray:
        """Predicted standard deviation (n,) of the surface along its normal at `points`, metres."""
        gradient = _gradient(self.surface, points)
        variance = np.einsum("ij,jk,ik->i", gradient, self.covariance, gradient)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)), dtype=np.float64)

    def parameters(self) -> dict[str, object]:
        """The parameters by name, in the order that files use."""
        return surface_parameters(self.surface)

    def parameter_deviations(self) -> dict[str, float]:
        """Standard deviations of offset and direction (radians), or of axis, direction and radius."""
        sd = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        if isinstance(self.surface, Plane):
            return {"offset": float(sd[0]), "normal": float(np.hypot(sd[1], sd[2]))}
        return {
            "point": float(np.hypot(sd[0], sd[1])),
            "direction": float(np.hypot(sd[2], sd[3])),
            "radius": float(sd[4]),
        }


def surface_parameters(surface: Surface) -> dict[str, object]:
    """The parameters of a plane or cylinder by name, in the order that files use."""
    if isinstance(surface, Plane):
        return {"point": surface.point.tolist(), "normal": surface.normal_direction.tolist()}
    if isinstance(surface, Cylinder):
        return {
            "point": surface.point.tolist(),
            "direction": surface.direction.tolist(),
            "radius": surface.radius,
            "concave": surface.concave,
        }
    raise TypeError(f"no parameters are known for a {type(surface).__name__}")


def fit_plane(points: object, towards: FloatArray | None = None) -> SurfaceFit:
    """Fit a plane by principal components, the closed-form orthogonal-distance fit.

    Parameters
    ----------
    points : (n, 3) float
        At least three, not on one line; metres.
    towards : (3,) float, optional
        A point, such as the sensor's position, on the side that the normal shall point to.

    Raises
    ------
    FitError
        Fewer than three points, or points on one line or in one spot.
    """
    cloud = check_points("points", points)
    if len(cloud) < 3:
        raise FitError(f"a plane needs 3 points, got {len(cloud)}")
    centre = cloud.mean(axis=0)
    _, spread, axes = np.linalg.svd(
        np.linalg.qr(cloud - centre, mode="r") if len(cloud) > 3 else cloud - centre
    )
    if spread[1] <= 1e-9 * max(spread[0], 1e-300):
        raise FitError(f"{len(cloud)} points lie on one line: singular values {spread.tolist()}")
    normal = axes[2]
    if towards is not None and (towards - centre) @ normal < 0:
        normal = -normal
    plane = Plane(centre, normal, axes[0])
    uv = plane.to_uv(cloud)
    residual = plane.distance(cloud)
    freedom = max(len(cloud) - 3, 1)
    rms = float(np.sqrt(residual @ residual / freedom))
    gradient = np.column_stack([np.ones(len(uv)), uv])
    covariance = rms**2 * np.linalg.inv(gradient.T @ gradient)
    return SurfaceFit(plane, rms, covariance, len(cloud))


def fit_cylinder(points: object, start: Cylinder) -> SurfaceFit:
    """Fit a circular cylinder by Gauss-Newton on orthogonal distances, in a chart that moves along.

    After each step the frame is turned so that the current axis is z again and the origin is the axis point
    nearest to the centroid: the charts of the least-squares geometric elements library (NPL). Residual
    f = sqrt(x^2 + y^2) - r with gradient (-ux, -uy, -z ux, -z uy, -1), u the unit radial.

    Parameters
    ----------
    points : (n, 3) float
        At least five; metres.
    start : Cylinder
        Where to begin; `concave` is kept.

    Raises
    ------
    FitError
        Too few points, a singular system (a line or a plane), or no convergence.
    """
    cloud = check_points("points", points)
    if len(cloud) < 6:
        raise FitError(f"a cylinder with covariance needs 6 points, got {len(cloud)}")
    stride = max(1, len(cloud) // _SUBSAMPLE)
    point, axis, radius = start.point, start.direction, start.radius
    sample, before = cloud[::stride], np.inf
    for _ in range(_N_STEPS):
        point, axis, radius, moved, _, _ = _cylinder_step(sample, point, axis, radius)
        if moved < 1e-10 or (moved < 1e-6 and moved >= 0.99 * before):
            break
        before = moved
    else:
        raise FitError(f"no convergence after {_N_STEPS} steps: the last moved {moved:.3g} of the radius")
    for _ in range(2 if stride > 1 else 1):
        point, axis, radius, _, rms, inverse = _cylinder_step(cloud, point, axis, radius)
    surface = Cylinder(point, axis, radius, None, start.concave)
    return SurfaceFit(surface, rms, rms**2 * inverse, len(cloud))


def _cylinder_step(
    cloud: FloatArray, point: FloatArray, axis: FloatArray, radius: float
) -> tuple[FloatArray, FloatArray, float, float, float, FloatArray]:
    """One Gauss-Newton step: point, axis, radius, its move / radius, RMS before, inverse normal matrix."""
    origin = point + axis * ((cloud.mean(axis=0) - point) @ axis)
    frame = _axis_frame(axis)
    local = (cloud - origin) @ frame.T
    distance = np.hypot(local[:, 0], local[:, 1])
    if distance.min() < 1e-9 * radius:
        raise FitError(f"{int((distance < 1e-9 * radius).sum())} points lie on the cylinder's axis")
    unit = local[:, :2] / distance[:, None]
    height = local[:, 2:]
    gradient = np.hstack([-unit, -height * unit, -np.ones_like(height)])
    residual = distance - radius
    normal_matrix = gradient.T @ gradient
    scale = np.sqrt(np.diag(normal_matrix))
    scaled = normal_matrix / np.outer(scale, scale)
    condition = float(np.linalg.cond(scaled))
    if not np.isfinite(condition) or condition > 1e12:
        raise FitError(f"{len(cloud)} points determine no cylinder: condition number {condition:.3g}")
    inverse = np.linalg.inv(scaled) / np.outer(scale, scale)
    change = -inverse @ (gradient.T @ residual)
    new_radius = float(radius + change[4])
    if not new_radius > 0:
        raise FitError(
            f"the radius became {new_radius:.3g} m: these points curve the other way or not at all"
        )
    direction = frame.T @ np.array([change[2], change[3], 1.0])
    moved = float(np.abs(change[[0, 1, 4]]).max() / new_radius + np.abs(change[2:4]).max())
    rms = float(np.sqrt(residual @ residual / max(len(cloud) - 5, 1)))
    new_point = origin + frame.T @ np.array([change[0], change[1], 0.0])
    return new_point, direction / np.linalg.norm(direction), new_radius, moved, rms, inverse


def _axis_frame(axis: FloatArray) -> FloatArray:
    """Rows x, y, z of a frame whose z is the axis."""
    x_axis = perpendicular(axis)
    return np.stack([x_axis, np.cross(axis, x_axis), axis])


def inflated(fit: SurfaceFit, points: FloatArray, block: float) -> SurfaceFit:
    """Return the fit with a covariance that allows for residuals that are correlated between neighbours.

    Residuals are averaged over chart blocks of side `block` metres; independent ones would average to
    rms / sqrt(n). The covariance grows by the ratio of the variances, at least one.
    """
    uv = fit.surface.to_uv(points)
    residual = fit.surface.distance(points)
    cell = np.floor((uv - uv.min(axis=0)) / max(block, 1e-12)).astype(np.int64)
    _, which = np.unique(cell[:, 0] * (cell[:, 1].max() + 1) + cell[:, 1], return_inverse=True)
    count = np.bincount(which).astype(np.float64)
    full: BoolArray = count >= 5
    if full.sum() < 8 or fit.rms == 0:
        return fit
    mean = np.bincount(which, residual)[full] / count[full]
    excess = float(np.mean(mean**2 * count[full]) / fit.rms**2)
    return SurfaceFit(fit.surface, fit.rms, fit.covariance * max(excess, 1.0), fit.n)


def _gradient(surface: Surface, points: FloatArray) -> FloatArray:
    """Derivative (n, k) of the signed distance at `points` by the chart's parameters."""
    if isinstance(surface, Plane):
        return np.column_stack([np.ones(len(points)), surface.to_uv(points)])
    if isinstance(surface, Cylinder):
        local = (points - surface.point) @ _axis_frame(surface.direction).T
        unit = local[:, :2] / np.maximum(np.hypot(local[:, 0], local[:, 1]), 1e-12)[:, None]
        return np.column_stack([-unit, -local[:, 2:] * unit, -np.ones(len(points))])
    raise TypeError(f"no gradient is known for a {type(surface).__name__}")
