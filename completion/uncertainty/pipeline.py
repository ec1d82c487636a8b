# SPDX-License-Identifier: MIT
"""Uncertainty on one page: from fits to covariances that hold, what surfaces share included.

Residual modes: a fit takes on the smoothest part of an error that is alike over a surface, its offset and
tilt, and no residual shows it. The next smooth shapes, of second and third order over the surface, show how
large such errors are. Let Q be the fit's columns and then those shapes, whitened and orthonormal over the n
pixels. The components z = Q'r of the residuals beyond the fit have the variance s2 where errors are
independent.

Image field: a smooth error over a scan's image, as large and as long as the residuals of surfaces show it.
Errors of the disparity, of a lens, of an interpolated table change slowly from pixel to pixel. They are taken
as a Gaussian random field over the image, in deviations of the range: a sum of bumps on a grid, with
correlation exp(-d2 / 2 l2). The components of residuals beyond the fits give its size and length, as it
explains their variance. Both are not known well from one scan: they are averaged over, by their probability.

Systematics: how far a sensor's own errors, alike over its whole image, shift and tilt what is fitted.
What bends or tilts a surface as a whole leaves no residual: it is in the fit, and no fit can tell. How a
sensor bends its image is known by its kind (`completion.observe.sensor_modes`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from completion.fitting.chart import axis_frame
from completion.fitting.result import SurfaceFit
from completion.merging.merged_surface import MergedSurface
from completion.observe.observation import Observation
from completion.observe.sensor_modes import displacements, rounding_displacements
from completion.uncertainty.joint_errors import SharedErrors
from completion.uncertainty.limits import FEWEST_PIXELS, LEAST_COSINE, LEAST_WEIGHT, STUDENT_FREEDOM
from scenes.checks import FloatArray, IntArray
from scenes.run.mapping import trim
from scenes.surfaces.catalogue import Cylinder, Plane, Surface

N_SHAPES = 7  # of second and third order over a surface
_CHUNK = 1 << 17  # pixels at a time
_N_FRAME = 4_000  # pixels that tell where a surface was measured
_N_SAMPLE = 400  # pixels over which smooth fields are integrated
_SINGULAR = 1e-10  # of a column's own mean square


@dataclass(frozen=True, slots=True, eq=False)
class ResidualModes:
    """What the residuals of a surface in one scan say, and a sample of its pixels.

    Attributes
    ----------
    beyond : (7,) float
        Components of the whitened residuals along the smooth shapes beyond the fit.
    square : float
        Mean square of the whitened residuals, s2.
    n : int
        How many pixels.
    factor : (k, k) float
        R with R R' the information of the fit's parameters, errors taken as independent.
    shapes : (m, k + 7) float
        Q at a sample of m pixels.
    places : (m, 2) float
        Those pixels in the image, x to the right and y down from its middle, in half longer sides.
    gain : (m,) float
        What an error along the ray of the range's own deviation makes of the whitened residual there.
    """

    beyond: FloatArray
    square: float
    n: int
    factor: FloatArray
    shapes: FloatArray
    places: FloatArray
    gain: FloatArray

    @property
    def information(self) -> FloatArray:
        """Of the fit's parameters (k, k), by these pixels as if their errors were independent."""
        return np.asarray(self.factor @ self.factor.T)

    def taken_on(self, fields: FloatArray) -> FloatArray:
        """Components (k + 7, f) along Q of errors along the rays, (m, f), in deviations of the range."""
        return np.asarray(self.shapes.T @ (fields * self.gain[:, None]) * (self.n / len(self.gain)))


def find_modes(
    fit: SurfaceFit, seen: Observation, pixels: IntArray, flatness_m: float
) -> ResidualModes | None:
    """Return the residual modes of a plane or cylinder in one scan, from all its flat pixels (n,) there.

    A sample of them would not do: what is left of the noise in a component falls with their number. None
    where the pixels do not tell the shapes apart.
    """
    size = len(fit.covariance)
    sample = seen.points_at(pixels[:: max(1, len(pixels) // _N_FRAME)])
    frame = _WhitenedColumns(fit, seen, flatness_m, *_frame_of(_places(fit.surface, sample)))
    moments, n = np.zeros((size + N_SHAPES + 1,) * 2), 0
    for first in range(0, len(pixels), _CHUNK):
        columns, _, _ = frame.columns(pixels[first : first + _CHUNK])
        moments += columns.T @ columns
        n += len(columns)
        trim()
    diagonal = np.diag(moments)
    freedom = n - size - N_SHAPES
    if freedom < 1 or not (diagonal[:-1] > 0).all():
        return None
    scale = np.sqrt(diagonal[:-1])
    unit = moments[:-1, :-1] / np.outer(scale, scale)
    if np.linalg.eigvalsh(unit)[0] < _SINGULAR:
        return None
    lower = cholesky(unit, lower=True)
    along = solve_triangular(lower, moments[:-1, -1] / scale, lower=True)
    pixels_used, kept, gain = frame.columns(pixels[:: max(1, len(pixels) // _N_SAMPLE)])
    return ResidualModes(
        beyond=np.asarray(along[size:]),
        square=max(float(diagonal[-1] - along @ along), 0.0) / freedom,
        n=n,
        factor=(lower * scale[:, None])[:size, :size],
        shapes=np.asarray(solve_triangular(lower, (pixels_used[:, :-1] / scale).T, lower=True).T),
        places=_in_image(kept, seen.scan.shape),
        gain=gain,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _WhitenedColumns:
    """The columns of a surface's fit, of the shapes beyond, and its residuals, in deviations."""

    fit: SurfaceFit
    seen: Observation
    flatness_m: float
    centre: FloatArray
    width: FloatArray

    def columns(self, pixels: IntArray) -> tuple[FloatArray, IntArray, FloatArray]:
        """The columns (n, k + 8) at flat pixels, without those that graze; which are left, and their gain."""
        surface, points = self.fit.surface, self.seen.points_at(pixels)
        cosine = np.abs(np.einsum("ij,ij->i", surface.normal(points), self.seen.rays_at(pixels)))
        kept = cosine > LEAST_COSINE
        pixels, points = pixels[kept], points[kept]
        along = self.seen.sigma_at(pixels) * cosine[kept]
        sigma = np.sqrt(np.square(along) + self.flatness_m**2 + 1e-30)
        shapes = _shapes(surface, points, self.centre, self.width)
        columns = np.column_stack([self.fit.gradient(points), shapes, surface.distance(points)])
        return columns / sigma[:, None], pixels, along / sigma


def _frame_of(places: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The middle (d,) of places (n, d), and how wide they are spread."""
    return places.mean(axis=0), np.maximum(places.std(axis=0), 1e-9)


def _shapes(surface: Surface, points: FloatArray, centre: FloatArray, width: FloatArray) -> FloatArray:
    """Shapes of second and third order (n, 7): of a plane's u, v, or of a cylinder's angle and height."""
    places = (_places(surface, points) - centre) / width
    if isinstance(surface, Plane):
        u, v = np.ascontiguousarray(places.T)
        uu, uv, vv = u * u, u * v, v * v  # a power takes five times as long
        return np.column_stack([uu, uv, vv, uu * u, uu * v, u * vv, vv * v])
    if not isinstance(surface, Cylinder):
        raise _without_shapes(surface)
    x, y = axis_frame(surface.direction)[:2] @ (points - surface.point).T
    turn, h = np.arctan2(y, x), places[:, 0]
    two, three = (np.stack([np.cos(n * turn), np.sin(n * turn)]) for n in (2, 3))
    return np.column_stack([*two, h * h, *three, *(h * two)])


def _places(surface: Surface, points: FloatArray) -> FloatArray:
    """Where points are on a plane (n, 2), or along an axis (n, 1), metres."""
    if isinstance(surface, Plane):
        across = np.stack([surface.u_direction, surface.v_direction])
        return np.asarray((points - surface.point) @ across.T)
    if isinstance(surface, Cylinder):
        return np.asarray(((points - surface.point) @ surface.direction)[:, None])
    raise _without_shapes(surface)


def _without_shapes(surface: Surface) -> TypeError:
    return TypeError(f"no smooth shapes are known over a {type(surface).__name__}")


def _in_image(pixels: IntArray, shape: tuple[int, int]) -> FloatArray:
    """Places (n, 2) of flat pixels, from the middle of the image, in half longer sides."""
    row, column = np.divmod(pixels, shape[1])
    return np.column_stack([column - shape[1] / 2, row - shape[0] / 2]) / (max(shape) / 2)


LENGTHS = (0.2, 0.35, 0.6, 1.0, 2.0)
"""Correlation lengths, in half longer sides of the image; shorter ones show in blocks of pixels."""

_SQUARES = np.geomspace(1e-6, 100.0, 73)  # mean squares that are tried, in squared deviations of the range


@dataclass(frozen=True, slots=True, eq=False)
class ImageField:
    """Smooth errors of a scan.

    Attributes
    ----------
    squares : dict of float to float
        By correlation length, the mean square of the field, in squared deviations of the range.
    freedom : float
        From how many independent components it was estimated.
    """

    squares: dict[float, float]
    freedom: float

    def shifts(self, modes: ResidualModes) -> FloatArray:
        """What the field does to a surface's fit: J'W f (k, b), for one deviation of each of b bumps."""
        size = len(modes.factor)
        taken = [np.zeros((size, 0))] + [
            np.sqrt(square) * modes.taken_on(bumps(modes.places, length))[:size]
            for length, square in self.squares.items()
        ]
        return np.asarray(modes.factor @ np.concatenate(taken, axis=1))


NO_FIELD = ImageField({}, np.inf)


def bumps(places: FloatArray, length: float) -> FloatArray:
    """Return Gaussian bumps (n, b) at places (n, 2) of an image, whose squares add up to 1 everywhere."""
    width = length / np.sqrt(2.0)  # their correlation is as long as two of them
    n = int(np.ceil(2.0 / length)) + 3
    centre = (np.arange(n) - (n - 1) / 2) * length
    x, y = (np.exp(-0.5 * np.square((coordinates[:, None] - centre) / width)) for coordinates in places.T)
    both = (x[:, :, None] * y[:, None, :]).reshape(len(places), -1)
    return np.asarray(both / (np.sqrt(np.pi) * width / length))


def fit_field(modes: Sequence[ResidualModes]) -> ImageField:
    """Return the smooth errors of a scan by the residual modes of its surfaces; none of no surface.

    A scan whose ranges are stated to be exact has no deviations in which errors could be told.
    The squares are weighted by their probability: Student's likelihood of the components of each surface,
    before it any size up to the noise's own is as probable, and larger ones less.
    """
    modes = [mode for mode in modes if mode.gain.any()]
    if not modes:
        return NO_FIELD
    square = np.repeat([mode.square for mode in modes], [len(mode.beyond) for mode in modes])
    tried = {length: _LengthTrial.of(modes, length, square) for length in LENGTHS}
    top = max(float(trial.log_posterior.max()) for trial in tried.values())
    weights = {length: np.exp(trial.log_posterior - top) for length, trial in tried.items()}
    total = sum(float(weight.sum()) for weight in weights.values())
    share = {length: float(weight.sum()) / total for length, weight in weights.items()}
    squares = {
        length: float(weight @ _SQUARES) / total
        for length, weight in weights.items()
        if share[length] >= LEAST_WEIGHT
    }
    freedom = sum(share[length] * trial.freedom for length, trial in tried.items())
    return ImageField(squares, max(freedom, 1.0))


def mean_field(fields: Sequence[ImageField]) -> ImageField:
    """Return what holds of scans like these whose own field is not known."""
    if not fields:
        return NO_FIELD
    squares = {
        length: float(np.mean([field.squares.get(length, 0.0) for field in fields]))
        for length in LENGTHS
        if any(length in field.squares for field in fields)
    }
    return ImageField(squares, float(np.mean([field.freedom for field in fields])))


@dataclass(frozen=True, slots=True, eq=False)
class _LengthTrial:
    """How probable each mean square (k,) of a field of one length is, and from how many components."""

    log_posterior: FloatArray
    freedom: float

    @classmethod
    def of(cls, modes: Sequence[ResidualModes], length: float, square: FloatArray) -> _LengthTrial:
        """Try a length on surfaces, whose residuals' mean squares are repeated for each component (c,)."""
        taken = [mode.taken_on(bumps(mode.places, length))[len(mode.factor) :] for mode in modes]
        every = np.concatenate(taken)
        explained = np.square(every).sum(axis=1)
        log_likelihood = np.zeros(len(_SQUARES))
        first = 0
        for mode in modes:
            stretch = slice(first, first + len(mode.beyond))
            variance = square[stretch, None] + explained[stretch, None] * _SQUARES
            fit = (np.square(mode.beyond)[:, None] / variance).sum(axis=0)
            log_likelihood -= 0.5 * np.log(variance).sum(axis=0)
            log_likelihood -= (STUDENT_FREEDOM + len(mode.beyond)) / 2 * np.log1p(fit / STUDENT_FREEDOM)
            first = stretch.stop
        log_posterior = log_likelihood - np.log1p(_SQUARES)
        best = _SQUARES[int(np.argmax(log_posterior))]
        weight = 1.0 / np.sqrt(square + best * explained)
        weighted = (every @ every.T) * np.outer(weight, weight)
        return cls(log_posterior, float(np.trace(weighted) ** 2 / np.square(weighted).sum()))


Modes = Callable[[Observation, FloatArray], FloatArray]
"""How far each of m errors moves points (n, 3) that a scan measured: (m, n, 3), metres."""

_N_BEAMS = 2000  # of a surface that tell what its fit takes on


def shift_by_sensors(
    merged: MergedSurface, observations: Sequence[Observation], modes: Modes = displacements
) -> FloatArray:
    """Return what systematic errors do to a surface's fit: (k, m), its parameters' change by each mode.

    Each error is a mode: a displacement of all measured points, as far as one standard deviation takes it.
    What the fit makes of it is by least squares over the surface's own beams, the same mode in all scans.
    """
    size = len(merged.fit.covariance)
    moment, pull = np.zeros((size, size)), np.zeros((size, len(modes(observations[0], np.zeros((0, 3))))))
    for seen, pixels in merged.sampled_by(observations, _N_BEAMS):
        points = seen.points_at(pixels)
        gradient = merged.fit.gradient(points)
        weight = 1.0 / np.maximum(np.square(seen.sigma_at(pixels)), 1e-12)
        along = np.einsum("mij,ij->im", modes(seen, points), merged.fit.surface.normal(points))
        both = gradient.T * weight
        moment += both @ gradient
        pull += both @ along
        trim()
    return np.asarray(np.linalg.pinv(moment, rcond=1e-12, hermitian=True) @ pull)


_MOST_SCANS = 8  # of a surface, those that measured most of it, which tell what smooth errors do to it
_MOST_FIELDS = 32  # scans whose own smooth errors are estimated: those that measured most


@dataclass(frozen=True, slots=True, eq=False)
class StatedFits:
    """How well n surfaces are known, jointly.

    Attributes
    ----------
    fits : tuple of SurfaceFit
        Their covariances hold the noise, and what errors alike in blocks of pixels add.
    smooth : SharedErrors
        Smooth and systematic errors of the scans, which surfaces share.
    freedom : tuple of float
        Degrees of freedom (n,) that the scale of each covariance is known with; inf where errors are
        independent.
    """

    fits: tuple[SurfaceFit, ...]
    smooth: SharedErrors
    freedom: tuple[float, ...]

    def total(self, number: int) -> SurfaceFit:
        """Return a surface's fit with the covariance of all errors."""
        fit = self.fits[number]
        return replace(fit, covariance=fit.covariance + self.smooth.covariance_of([number]))


def state_fits(
    surfaces: Sequence[MergedSurface], observations: Sequence[Observation], flatness_m: float
) -> StatedFits:
    """Return how well surfaces are known, where neighbouring pixels err alike.

    To the variance of each fit, which knows errors as long as blocks of pixels, those are added that are as
    long as the surface or longer. They come of a smooth random field over each scan's image, as large and as
    long as residuals beyond the fits show it, and of the sensors' systematic errors, which leave no residual.
    Both move neighbouring surfaces alike. The share of a variance that was estimated gives its degrees of
    freedom (Satterthwaite 1946).

    Parameters
    ----------
    surfaces : sequence of MergedSurface
        Planes and cylinders, working frame.
    observations : sequence of Observation
        The scans.
    flatness_m : float
        How far surfaces stray from their ideal form, metres.
    """
    # 1. Modes: what each surface's residuals say of smooth errors, in the scans that saw most of it.
    modes = [_modes_of(surface, observations, flatness_m) for surface in surfaces]

    # 2. Fields: the smooth errors of each scan, by all its surfaces.
    fields = _fields_of(modes)
    typical = mean_field(list(fields.values()))

    # 3. Spread: what these do to each surface, scan by scan, so that surfaces of a scan share them.
    sizes = tuple(len(surface.fit.covariance) for surface in surfaces)
    shifts = []
    for scan in sorted({scan for mode in modes for scan in mode}):
        field = fields.get(scan, typical)
        shifts.append({k: _shift(mode, scan, field) for k, mode in enumerate(modes) if scan in mode})
    estimated = SharedErrors(sizes, tuple(shifts))

    # 4. Systematic errors of the sensors, which leave no residual.
    by_sensors = {k: shift_by_sensors(surface, observations) for k, surface in enumerate(surfaces)}

    # 5. Rounding of coordinates in the files, of each surface by itself.
    rounding = [
        {k: shift_by_sensors(surface, observations, rounding_displacements)}
        for k, surface in enumerate(surfaces)
        if any(seen.noise.common_m for seen in observations)
    ]

    freedom = [
        _freedom(surface.fit, estimated.covariance_of([k]), [fields.get(scan, typical) for scan in modes[k]])
        for k, surface in enumerate(surfaces)
    ]
    smooth = SharedErrors(sizes, (*shifts, by_sensors, *rounding))
    return StatedFits(tuple(surface.fit for surface in surfaces), smooth, tuple(freedom))


def _modes_of(
    surface: MergedSurface, observations: Sequence[Observation], flatness_m: float
) -> dict[int, ResidualModes]:
    """By scan, those of a surface in the scans that measured most of it."""
    largest = sorted(surface.pixels.held, key=lambda pair: (-len(pair[1]), pair[0]))[:_MOST_SCANS]
    modes = {
        scan: find_modes(surface.fit, observations[scan], held.flat, flatness_m) for scan, held in largest
    }
    return {scan: modes for scan, modes in sorted(modes.items()) if modes is not None}


def _fields_of(modes: Sequence[dict[int, ResidualModes]]) -> dict[int, ImageField]:
    """The field of each scan, by its surfaces that are large enough to tell; of those that measured most."""
    telling: dict[int, list[ResidualModes]] = {}
    for mode in modes:
        for scan, residual_modes in mode.items():
            if residual_modes.n >= FEWEST_PIXELS:
                telling.setdefault(scan, []).append(residual_modes)
    size = {scan: sum(modes.n for modes in modes) for scan, modes in telling.items()}
    chosen = sorted(telling, key=lambda scan: (-size[scan], scan))[:_MOST_FIELDS]
    return {scan: fit_field(telling[scan]) for scan in sorted(chosen)}


def _shift(modes: dict[int, ResidualModes], scan: int, field: ImageField) -> FloatArray:
    """What the field of a scan does to a surface's parameters (k, b), which other scans hold as well."""
    information = np.sum([mode.information for mode in modes.values()], axis=0)
    return np.asarray(np.linalg.pinv(information, rcond=1e-14, hermitian=True) @ field.shifts(modes[scan]))


def _freedom(fit: SurfaceFit, smooth: FloatArray, fields: Sequence[ImageField]) -> float:
    """Degrees of freedom of a covariance, of which the `smooth` part was estimated."""
    share = np.linalg.lstsq(fit.covariance + smooth, smooth, rcond=None)[0]
    part = float(np.trace(share)) / len(share)
    if not fields or part <= 0:
        return np.inf
    return float(min(field.freedom for field in fields)) / part**2
