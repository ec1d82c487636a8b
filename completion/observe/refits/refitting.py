# SPDX-License-Identifier: MIT
"""Refitting: surfaces from all their pixels at once, errors along the rays, each weighted by its variance."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from completion.fitting.chart import axis_frame
from completion.fitting.result import SurfaceFit
from completion.observe.observation import Beams, Observation
from completion.observe.pixel_set import ScanPixels
from completion.observe.refits.alike_residuals import block_sums, residual_correlation
from completion.observe.refits.normal_equations import NormalEquations, add_up
from scenes.checks import FloatArray
from scenes.run.mapping import trim
from scenes.surfaces.catalogue import Cylinder, Plane, Surface

_THINNING = 3  # of the pixels that covariances are read from
_FEW = 2_000  # pixels of a surface that are not thinned
_LARGEST = 1e4  # a cylinder whose radius exceeds its points' extent by this has run away


def refit(
    surfaces: Sequence[Surface],
    observations: Sequence[Observation],
    labels: Sequence[NDArray[np.int32]],
    flatness_m: float,
    n_rounds: int = 1,
) -> list[SurfaceFit | None]:
    """Fit planes and cylinders to their pixels by Gauss-Newton on the errors along the rays.

    Orthogonal distances pull a cylinder's radius in, since the foot of a noisy point moves sideways; along
    the known ray the place that was meant stays put. Pixels are weighted by the inverse variance of the
    range and of the surface's own flatness, seen along the ray.

    Parameters
    ----------
    surfaces : sequence of Plane or Cylinder
        Where to begin, working frame.
    observations : sequence of Observation
        The scans.
    labels : sequence of (rows, columns) int32
        For each, the surface of each pixel, from 1; 0 for none.
    flatness_m : float
        How far surfaces stray from their ideal form, metres.
    n_rounds : int
        Steps before the one whose covariance is returned.

    Returns
    -------
    list of SurfaceFit or None
        Covariances inflated by how much the residuals' means over blocks of pixels exceed independent ones;
        None where the pixels determine no such surface.
    """
    beams = [Beams.of(observation, label) for observation, label in zip(observations, labels, strict=True)]
    return _with_inflation(*_placed(surfaces, beams, flatness_m, n_rounds))


def refit_each(
    surfaces: Sequence[Surface],
    observations: Sequence[Observation],
    pixels: Sequence[ScanPixels],
    flatness_m: float,
    n_rounds: int = 1,
) -> list[SurfaceFit | None]:
    """`refit` from the pixels of each surface in each of the n scans, (n,), one surface after another.

    A pixel may belong to several surfaces. No memory of the size of an image is taken, nor of the pixels that
    a surface has in all scans.
    """
    placed: list[Surface | None] = []
    sums: list[NormalEquations] = []
    blocks = np.zeros((len(surfaces), 4))
    for k, (surface, own) in enumerate(zip(surfaces, pixels, strict=True)):
        beams = _BeamsOfOne(observations, own)
        (one,), (equations,), blocks[k : k + 1] = _placed([surface], beams, flatness_m, n_rounds)
        placed.append(one)
        sums.append(equations)
    return _with_inflation(placed, sums, blocks)


@dataclass(frozen=True, slots=True, eq=False)
class _BeamsOfOne:
    """The beams that met one surface, made scan by scan each time that they are gone through."""

    observations: Sequence[Observation]
    pixels: ScanPixels

    def __iter__(self) -> Iterator[Beams]:
        """Return the beams of each scan that has any."""
        for scan, some in self.pixels.held:
            trim()
            yield Beams.at(self.observations[scan], some.flat)


def _placed(
    surfaces: Sequence[Surface], beams: Iterable[Beams], flatness_m: float, n_rounds: int
) -> tuple[list[Surface | None], list[NormalEquations], FloatArray]:
    """The surfaces after some steps, their normal equations there, and their `block_sums` (n, 4)."""
    placed = improve(surfaces, beams, flatness_m, n_rounds)
    return placed, _thinned_sums(placed, beams, flatness_m), block_sums(placed, beams, flatness_m)


def _with_inflation(
    placed: Sequence[Surface | None], sums: Sequence[NormalEquations], blocks: FloatArray
) -> list[SurfaceFit | None]:
    """The fits, their covariances inflated by what the means over blocks (n, 4) say."""
    return [
        None if surface is None or found.step() is None else _fit(surface, found, growth)
        for surface, found, growth in zip(placed, sums, residual_correlation(blocks), strict=True)
    ]


def improve(
    surfaces: Sequence[Surface], beams: Iterable[Beams], flatness_m: float, n_rounds: int = 1
) -> list[Surface | None]:
    """The surfaces after some Gauss-Newton steps, None where a step loses one.

    Each step goes through the beams again.
    """
    placed: list[Surface | None] = list(surfaces)
    for _ in range(n_rounds):
        sums = add_up(placed, beams, flatness_m)
        placed = [_moved(surface, found) for surface, found in zip(placed, sums, strict=True)]
    return placed


def _thinned_sums(
    surfaces: Sequence[Surface | None], beams: Iterable[Beams], flatness_m: float
) -> list[NormalEquations]:
    """Normal equations from a share of the pixels, from all of them for small surfaces.

    Those that a grid's stride leaves of a narrow surface may stand in one line.
    """
    some = map(_thinned, beams)
    sums = [found.repeated(_THINNING) for found in add_up(surfaces, some, flatness_m)]
    small = np.array([number for number, found in enumerate(sums) if found.n < _FEW], dtype=np.int64)
    if len(small):
        every = add_up(surfaces, (beam.of_surfaces(small + 1) for beam in beams), flatness_m)
        sums = [every[k] if sums[k].n < _FEW else sums[k] for k in range(len(sums))]
    return sums


def _thinned(beams: Beams) -> Beams:
    """The beams of every third pixel of the scan, whichever of its pixels there are."""
    kept = beams.pixel % _THINNING == 0
    return replace(beams, pixel=beams.pixel[kept], label=beams.label[kept])


def _fit(surface: Surface, sums: NormalEquations, inflation: float) -> SurfaceFit:
    """The fit, its covariance by the weighted residuals themselves."""
    freedom = sums.n - len(sums.vector)
    covariance = np.asarray(sums.cost / freedom * np.linalg.inv(sums.matrix) * inflation, dtype=np.float64)
    rms = float(np.sqrt(sums.square / freedom))
    return SurfaceFit(surface, rms, covariance, sums.n, inflation=float(inflation))


def _moved(surface: Surface | None, sums: NormalEquations) -> Surface | None:
    """The surface after a step, None where it is lost."""
    if surface is None:
        return None
    if not isinstance(surface, Plane | Cylinder):
        raise TypeError(f"cannot refit a {type(surface).__name__}")
    step = sums.step()
    if step is None:
        return None
    if isinstance(surface, Plane):
        offset, by_u, by_v = step
        normal = surface.normal_direction - by_u * surface.u_direction - by_v * surface.v_direction
        return Plane(surface.point + offset * surface.normal_direction, normal, surface.u_direction)
    radius = surface.radius + step[4]
    if not 0 < radius < _LARGEST * surface.radius:
        return None
    x, y, z = axis_frame(surface.direction)
    point = surface.point + step[0] * x + step[1] * y
    return Cylinder(point, z + step[2] * x + step[3] * y, radius, None, surface.concave)
