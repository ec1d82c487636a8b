# SPDX-License-Identifier: MIT
"""What a fit gives: the surface, its residual, and the covariance of every parameter."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from completion.fitting.kinds import chart_of, chart_origin, kind_of
from scenes.card import Card
from scenes.checks import ArrayValue, BoolArray, FloatArray, InputError
from scenes.inclination import Inclination
from scenes.surfaces.catalogue import Cone, Cylinder, Plane, Surface


class FitError(InputError):
    """Points that determine no surface; the message says why in numbers."""


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceFit(ArrayValue):
    """A surface fitted to points.

    Attributes
    ----------
    surface : Surface
        The fit; a plane's normal points to the side the scanner looked from, where that was given.
    rms : float
        Root mean square orthogonal distance over the degrees of freedom, metres.
    covariance : (k, k) float
        Of the chart's parameters: for a plane the offset along the normal and the slopes along u and v
        (k = 3); for a sphere its centre and radius (4); else the two shifts and two tilts of the axis and
        the radius (cylinder, 5), the radius and half angle (cone, 6), the mean radius, half the difference
        of the radii and the turn times it (elliptic cylinder, 7), or the shift along the axis, the radius and
        the tube's (torus, 7). NaN where the points leave no degree of
        freedom, and for the algebraic metrics, which predict none.
    n : int
        Number of points that took part.
    inflation : float
        By how much `covariance` exceeds that of independent residuals, at least one; see `inflated`.
    converged : bool
        False where the last steps still moved the surface by more than rounding explains.
    inliers : (m,) bool or None
        Robust fits and fits along rays: which of all the points given took part.
    metric : str
        "euclidean", "taubin" or "algebraic".
    held : tuple of str
        Parameters that were given and held exactly: "direction" ("normal" of a plane), "radius". Their
        variances and covariances are zero.
    """

    surface: Surface
    rms: float
    covariance: FloatArray
    n: int
    inflation: float = 1.0
    converged: bool = True
    inliers: BoolArray | None = None
    metric: str = "euclidean"
    held: tuple[str, ...] = ()

    @property
    def degrees_of_freedom(self) -> int:
        """Points less parameters that were sought."""
        n_held = sum(1 if name == "radius" else 2 for name in self.held)
        return self.n - len(self.covariance) + n_held

    @property
    def covariance_independent(self) -> FloatArray:
        """The covariance for independent residuals (k, k), whatever `covariance` was inflated by."""
        return np.asarray(self.covariance / self.inflation, dtype=np.float64)

    def standard_deviation(self, points: FloatArray) -> FloatArray:
        """Predicted standard deviation (n,) of the surface along its normal at `points`, metres."""
        gradient, covariance = self.gradient(points), np.ascontiguousarray(self.covariance)
        variance = np.einsum("ij,jk,ik->i", gradient, covariance, gradient)  # rounded as they lie in memory
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)), dtype=np.float64)

    def gradient(self, points: FloatArray) -> FloatArray:
        """Derivative (n, k) of the signed distance at `points` by the chart's parameters."""
        origin = chart_origin(self.surface)
        chart = chart_of(self.surface, origin, 1.0)
        return np.ascontiguousarray(chart.linearise(chart.frame @ (points - origin).T)[1].T)

    def parameters(self) -> dict[str, object]:
        """The parameters by name, in the order that files use."""
        return surface_parameters(self.surface)

    def parameter_covariances(self) -> dict[str, FloatArray]:
        """Covariance of each natural parameter: (3, 3) of points and directions, (1, 1) of numbers.

        In metres and radians; a cone's apex, which is derived, included.
        """
        return {
            name: np.atleast_2d(jacobian @ self.covariance @ jacobian.T)
            for name, jacobian in kind_of(self.surface).geometry.jacobians(self.surface).items()
        }

    def parameter_deviations(self) -> dict[str, float]:
        """Standard deviations of the parameters in `parameters()`; vectors by their total, angles in radians.

        Points move across the axis or along the normal only. Names ending in `_deg` are in degrees.
        """
        total = {
            name: float(np.sqrt(max(np.trace(covariance), 0.0)))
            for name, covariance in self.parameter_covariances().items()
        }
        if isinstance(self.surface, Plane):
            return {"offset": total["point"], "normal": total["normal"]}
        if isinstance(self.surface, Cone):
            apex, half_angle = total.pop("apex"), total.pop("half_angle")
            return total | {"half_angle_deg": float(np.degrees(half_angle)), "apex": apex}
        return total

    def inclination(self, up: FloatArray, up_sd_deg: float = 0.0) -> Inclination:
        """Return the angle of a plane or of a cylinder's axis with the horizontal; NaN of other surfaces.

        `up` (3,) is a unit vector in the frame of the surface, `up_sd_deg` its standard deviation, degrees.
        """
        if isinstance(self.surface, Plane):
            normal, covariance = self.surface.normal_direction, self.parameter_covariances()["normal"]
            return Inclination.of_plane(normal, up, covariance, up_sd_deg)
        if isinstance(self.surface, Cylinder):
            axis, covariance = self.surface.direction, self.parameter_covariances()["direction"]
            return Inclination.of_axis(axis, up, covariance, up_sd_deg)
        return Inclination(np.nan)

    def _facts(self) -> list[tuple[str, str]]:
        """The kind of surface, its parameters and how well they are known."""
        figures = [("kind", f"{type(self.surface).__name__.lower()}, {self.metric}")]
        figures += [
            (name, f"{_digits(value)} {_unit(name)}".rstrip()) for name, value in self.parameters().items()
        ]
        figures += [
            (f"sd of {name}", f"{_digits(value)} {_deviation_unit(name)}")
            for name, value in self.parameter_deviations().items()
        ]
        return [*figures, ("residual rms", f"{1000 * self.rms:.3g} mm"), ("points", str(self.n))]

    def _repr_html_(self) -> str:
        """What a notebook shows: the parameters and how well they are known."""
        (_, title), *figures = self._facts()
        note = "" if self.converged else "The last steps still moved the surface: take it with care."
        return Card("Surface fit", title, figures, note=note).to_html()


def _unit(name: str) -> str:
    """Unit of a parameter by its name; directions and truth values have none."""
    if name in ("point", "centre", "apex") or name.endswith("radius"):
        return "m"
    return "deg" if name.endswith("_deg") else ""


def _deviation_unit(name: str) -> str:
    """Unit of a parameter's deviation: directions deviate by angles in radians."""
    if name.endswith("_deg"):
        return "deg"
    return "rad" if name in ("normal", "direction", "zero_direction") else "m"


def _digits(value: object) -> str:
    """A number or a vector with six digits."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return ", ".join(f"{number:.6g}" for number in np.atleast_1d(np.asarray(value, dtype=np.float64)))


def surface_parameters(surface: Surface) -> dict[str, object]:
    """The parameters of a surface by name, in the order that files use."""
    return kind_of(surface).geometry.parameters(surface)


def inflated(fit: SurfaceFit, points: FloatArray, block: float | None = None) -> SurfaceFit:
    """Return the fit with a covariance that allows for residuals that are alike between neighbours.

    Residuals are averaged over chart blocks of side `block`; independent ones would average to rms / sqrt(n).
    The covariance grows by the ratio of the variances, at least one; `inflation` keeps it.

    Parameters
    ----------
    fit : SurfaceFit
        Of these points, or robustly of some of them.
    points : (n, 3) float
        All that were given to the fit, metres.
    block : float, optional
        Metres; by default so large that about sqrt(n) points lie in a block.
    """
    used = points if fit.inliers is None else points[fit.inliers]
    uv = fit.surface.to_uv(used)
    residual = fit.surface.distance(used)
    if block is None:
        block = float(np.sqrt(np.prod(np.ptp(uv, axis=0)) / np.sqrt(len(used))))
    cell = np.floor((uv - uv.min(axis=0)) / max(block, 1e-12)).astype(np.int64)
    _, which = np.unique(cell[:, 0] * (cell[:, 1].max() + 1) + cell[:, 1], return_inverse=True)
    count = np.bincount(which).astype(np.float64)
    full: BoolArray = count >= 5
    if full.sum() < 8 or fit.rms == 0 or block <= 0:
        return fit
    mean = np.bincount(which, residual)[full] / count[full]
    excess = max(float(np.mean(mean**2 * count[full]) / fit.rms**2), 1.0)
    return replace(fit, covariance=fit.covariance * excess, inflation=fit.inflation * excess)


def allow_for_warp(fit: SurfaceFit, points: FloatArray, relief_m: float) -> SurfaceFit:
    """Return the fit with a covariance that allows for a warp as long as its `points` (n, 3).

    Such a warp is one sample of the surface, not many: it adds s^2 (mean g g')^-1, with s the relief in
    metres and g the gradient of the surface's height by its parameters.
    """
    gradient = fit.gradient(points)
    moment = gradient.T @ gradient / len(points)
    warp = relief_m**2 * np.linalg.pinv(moment, rcond=1e-12, hermitian=True)
    return replace(fit, covariance=fit.covariance + warp)
