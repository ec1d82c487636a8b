# SPDX-License-Identifier: MIT
"""Beam: its footprint at jump edges, and how much of its light comes back.

Footprint: a beam has width, so at a jump edge it meets two depths; which of them the instrument reports.
A beam is 16 rays, each for the same area of its cross section: 4 in the inner quarter, 12 around them. What
they meet within one range resolution is one return, with the mean range of its rays weighted by the light
that each brings back. A pulsed scanner reports the first, strongest or last return, or all of them; a phase
scanner the mean of all light, which puts mixed pixels between the two depths.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from scenes.checks import BoolArray, FloatArray, InputError, Value, check_options, read_only_view
from texture.engine.compiled import compiled

Returns = Literal["first", "strongest", "last", "mean", "all"]
N_RAYS = 16
_COUNTS = tuple(4 * k**2 for k in range(1, 8))  # rays in k rings of equal width; a byte counts them


@dataclass(frozen=True, slots=True, kw_only=True)
class Footprint(Value):
    """Width of the beam, and which return is reported.

    Parameters
    ----------
    divergence_rad : float
        Full angle of the beam, radians.
    exit_diameter_m : float
        Diameter of the beam where it leaves the instrument, metres.
    returns : "first", "strongest", "last", "mean" or "all"
        What is reported of a beam that meets several depths. Of all, the first is in the image, the others
        are its `echoes`, and all have an intensity.
    range_resolution_m : float
        Returns nearer to each other than this are one, metres: half the pulse's length, 0.3 m for 2 ns.
        The mean is of all light and asks for none.
    n_rays : int, optional
        How many rays a beam is: 4, 16, 36, 64, 100, 144 or 196; 16 when not given. The share of a beam on
        one side of a straight edge has a standard deviation of .033 with 16, .012 with 64, .005 with 196.

    Raises
    ------
    InputError
        Negative lengths or angles, a beam without width, another name for the returns, pulses without a
        range resolution (a slanted wall would fall apart into returns), another number of rays.
    """

    divergence_rad: float
    exit_diameter_m: float = 0.0
    returns: Returns = "strongest"
    range_resolution_m: float = 0.3
    n_rays: int | None = None

    def __post_init__(self) -> None:
        check_options(self, divergence_rad=(0.0, 0.5), exit_diameter_m=(0.0, 1.0))
        check_options(self, range_resolution_m=(0.0, np.inf))
        if self.returns not in get_args(Returns):
            raise InputError(f"returns must be one of {', '.join(get_args(Returns))}, got {self.returns!r}")
        if self.returns != "mean" and self.range_resolution_m == 0:
            raise InputError(
                f"{self.returns} returns need a range_resolution_m above 0, half a pulse's length"
            )
        if self.divergence_rad == 0 and self.exit_diameter_m == 0:
            raise InputError("a footprint needs a divergence or an exit diameter")
        if self.n_rays not in (None, *_COUNTS):
            raise InputError(f"n_rays must be one of {', '.join(map(str, _COUNTS))}, got {self.n_rays}")

    @property
    def n_rays_cast(self) -> int:
        """How many rays a beam is."""
        return self.n_rays or N_RAYS

    def diameter_m(self, ranges: FloatArray) -> FloatArray:
        """Diameter (...,) of the beam at `ranges` (...,), metres."""
        return np.asarray(self.exit_diameter_m + 2 * np.tan(self.divergence_rad / 2) * ranges)


@cache
def beam_pattern(n_rays: int = N_RAYS) -> FloatArray:
    """Positions (n, 2), read-only, of the rays in a beam of radius 1, each for the same part of its area.

    They stand in rings of equal width, 4 in the innermost and 8 more in each next one, every second ring
    turned by half a step.
    """
    n_rings = round(np.sqrt(n_rays / 4))
    radii, angles = [], []
    for k in range(n_rings):
        count = 4 * (2 * k + 1)
        radii += [np.sqrt((k**2 + (k + 1) ** 2) / (2 * n_rings**2))] * count
        angles.append((np.arange(count) + (0.5 if k % 2 == 0 else 0.0)) * 2 * np.pi / count)
    angle = np.concatenate(angles)
    pattern: FloatArray = np.array(radii)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    pattern.setflags(write=False)
    return pattern


def sub_rays(
    directions: FloatArray, footprint: Footprint, turns: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Starts about the origin and directions, both (k n, 3), of the k rays of beams along `directions`.

    The pattern of each beam is turned by `turns` (n,), radians, so that straight edges make no steps.
    """
    pattern = beam_pattern(footprint.n_rays_cast)
    starts, along = np.empty((2, len(directions), len(pattern), 3))
    turned = np.empty((len(turns), 2))
    np.cos(turns, out=turned[:, 0])
    np.sin(turns, out=turned[:, 1])
    spread = footprint.exit_diameter_m / 2, np.tan(footprint.divergence_rad / 2)
    _fill_rays(read_only_view(directions), read_only_view(turned), pattern, spread, starts, along)
    return starts.reshape(-1, 3), along.reshape(-1, 3)


@compiled
def _fill_rays(
    directions: FloatArray,
    turned: FloatArray,
    pattern: FloatArray,
    spread: tuple[float, float],
    starts: FloatArray,
    along: FloatArray,
) -> None:
    """Write starts and directions (n, k, 3); `turned` (n, 2) is the cosine and sine of each beam's turn.

    Two vectors across each direction as by Duff et al., "Building an orthonormal basis", 2017.
    """
    across, down = np.empty(3), np.empty(3)
    for n in range(len(directions)):
        x, y, z = directions[n]
        cosine, sine = turned[n]
        sign = np.copysign(1.0, z)
        a = -1.0 / (sign + z)
        b = x * y * a
        first = (1 + sign * x * x * a, sign * b, -sign * x)
        second = (b, sign + y * y * a, -y)
        for axis in range(3):
            across[axis] = cosine * first[axis] + sine * second[axis]
            down[axis] = cosine * second[axis] - sine * first[axis]
        for k in range(len(pattern)):
            for axis in range(3):
                offset = pattern[k, 0] * across[axis] + pattern[k, 1] * down[axis]
                starts[n, k, axis] = spread[0] * offset
                along[n, k, axis] = directions[n, axis] + spread[1] * offset


_LUMINANCE = (0.2126, 0.7152, 0.0722)  # of linear sRGB, ITU-R BT.709
_STEPS = 8192  # of sRGB values, between which straight lines are right to 4e-8


@dataclass(frozen=True, slots=True, kw_only=True)
class Intensity(Value):
    """Lambert's law and the inverse square of the range: rho cos(theta) (reference / r)^2.

    The value is 1 for a white surface that faces the beam at the reference range.

    Parameters
    ----------
    reflectivity : float, optional
        rho of every surface, 0..1; from the colour at the hit when not given.
    reference_range_m : float
        Metres.

    Raises
    ------
    InputError
        A reflectivity outside 0..1, a reference range that is not positive.
    """

    reflectivity: float | None = None
    reference_range_m: float = 10.0

    def __post_init__(self) -> None:
        check_options(self, reflectivity=(0.0, 1.0), reference_range_m=(1e-6, np.inf))

    def reflectivity_of(self, colour: NDArray[np.float32]) -> FloatArray | float:
        """Reflectivity, the given one or that of `colour` (..., 3), sRGB in 0..1."""
        return reflectivity_of_colour(colour) if self.reflectivity is None else self.reflectivity

    def of(
        self, ranges: FloatArray, cosine: FloatArray, reflectivity: FloatArray | float
    ) -> NDArray[np.float32]:
        """Return the intensity (...,) of echoes; 0 where nothing was met.

        Parameters
        ----------
        ranges, cosine : (...,) float
            Metres, inf where nothing was met, and the absolute cosine of incidence.
        reflectivity : float or (...,) float
            0..1.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            light = reflectivity * cosine * (self.reference_range_m / ranges) ** 2
        return np.asarray(np.where(np.isfinite(ranges) & (ranges > 0), light, 0.0), dtype=np.float32)


def reflectivity_of_colour(colour: NDArray[np.float32]) -> FloatArray:
    """Luminance of sRGB colours (..., 3) in 0..1, to 4e-8: the light that a matt surface scatters."""
    colours = np.ascontiguousarray(colour, np.float32)
    luminance = np.empty(colours.shape[:-1])
    _luminances(read_only_view(colours.reshape(-1, 3)), _linear_values(), _LUMINANCE, luminance.reshape(-1))
    return luminance


@cache
def _linear_values() -> FloatArray:
    """Linear values of sRGB values from 0 to 1 in equal steps, one more than steps: powers take long."""
    encoded = np.linspace(0.0, 1.0, _STEPS + 1)
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    return read_only_view(linear)


@compiled
def _luminances(
    colour: NDArray[np.float32], linear: FloatArray, weights: tuple[float, ...], luminance: FloatArray
) -> None:
    """Write the luminance (n,) of colours (n, 3) by straight lines between the linear values."""
    steps = len(linear) - 1
    for n in range(len(colour)):
        if n > 0:  # neighbours often have the same colour
            same = colour[n, 0] == colour[n - 1, 0]
            same &= colour[n, 1] == colour[n - 1, 1]
            if same & (colour[n, 2] == colour[n - 1, 2]):
                luminance[n] = luminance[n - 1]
                continue
        total = 0.0
        for channel in range(3):
            value = colour[n, channel]
            place = (value if value < 1 else 1.0) * steps if value > 0 else 0.0
            below = min(int(place), steps - 1)
            step = linear[below + 1] - linear[below]
            total += weights[channel] * (linear[below] + (place - below) * step)
        luminance[n] = total


@dataclass(frozen=True, slots=True, kw_only=True)
class Dropout(Value):
    """Which echoes are lost.

    A glossy surface sends a beam that meets it at incidence theta into the direction 2 theta off the way
    back. With probability `specular_loss` (1 - max(0, cos 2 theta)^`specular_exponent`) nothing comes back:
    never when the surface faces the sensor, with `specular_loss` when it is turned by 45 deg or more. The
    exponent is that of Phong's lobe.

    Parameters
    ----------
    min_intensity : float
        Weaker echoes are lost; see `nbv.scanning.beam` for the scale.
    max_incidence_deg : float
        Echoes at larger incidence are lost, degrees.
    specular_loss : float
        Share of echoes that glossiness may cost, 0..1.
    specular_exponent : float
        How narrow the mirror's lobe is.

    Raises
    ------
    InputError
        Values outside these bounds.
    """

    min_intensity: float = 0.0
    max_incidence_deg: float = 90.0
    specular_loss: float = 0.0
    specular_exponent: float = 20.0

    def __post_init__(self) -> None:
        check_options(self, min_intensity=(0.0, np.inf), max_incidence_deg=(0.0, 90.0))
        check_options(self, specular_loss=(0.0, 1.0), specular_exponent=(0.0, np.inf))

    def draw_kept(
        self, intensity: NDArray[np.float32], incidence: FloatArray, rng: np.random.Generator
    ) -> BoolArray:
        """Tell which echoes (...,) are kept; one uniform number is drawn for every pixel.

        Parameters
        ----------
        intensity, incidence : (...,) float
            On the scale of `Intensity`, and in radians.
        rng : Generator
            Drawn from where glossiness costs echoes.
        """
        with np.errstate(invalid="ignore"):
            kept = (intensity >= self.min_intensity) & ~(incidence > np.radians(self.max_incidence_deg))
            if self.specular_loss > 0:
                lobe = np.maximum(np.cos(2 * incidence), 0.0) ** self.specular_exponent
                kept &= ~(rng.random(incidence.shape) < self.specular_loss * (1 - lobe))
        return np.asarray(kept, dtype=np.bool_)

    kept = draw_kept  # earlier name
