# SPDX-License-Identifier: MIT
"""Speed and accuracy of fits side by side in one run: `make bench`, or `pytest benchmarks --benchmark-only`.

Each fit gets the same points: a cylinder (R = 60 mm, L = 100 mm, a quarter turn, sigma 0.1 mm), and an
elliptic cylinder and a cone of the same size. The table at the end puts time and error of the radius beside
each other. "polish" begins at a surface that is a little off; "cold" is given points alone.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import cache
from importlib import metadata
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares

from completion.fitting.pipeline import fit
from completion.fitting.quadrics import fit_quadric, moments, read_surface
from scenes.surfaces.catalogue import Cone, Cylinder, EllipticCylinder

RADIUS, LENGTH, SIGMA = 60.0, 100.0, 0.1
RADII = (66.0, 54.0)
HALF_ANGLE = np.radians(20.0)
SIZES = {"1e4": 10_000, "1e6": 1_000_000}
START = Cylinder((0.4, -0.3, 0.0), (0.004, -0.003, 1.0), RADIUS + 0.5)
ELLIPTIC_START = EllipticCylinder((0.4, -0.3, 0.0), (0.004, -0.003, 1.0), (66.5, 53.6), (1.0, 0.01, 0.0))
CONE_START = Cone((0.4, -0.3, 0.0), (0.004, -0.003, 1.0), RADIUS + 0.5, HALF_ANGLE + 0.004)


@dataclass
class Table:
    """What was measured: a row a fit and size, in the order they ran."""

    rows: list[tuple[str, str, float, float]] = field(default_factory=list)

    def seconds(self, name: str, size: str) -> float:
        """Return the best time of a fit, NaN where it did not run."""
        return next((row[2] for row in self.rows if row[:2] == (name, size)), float("nan"))

    def lines(self) -> Iterator[str]:
        """Yield the table, and the ratios that the project holds itself to."""
        yield f"{'fit':<44}{'points':>8}{'ms':>12}{'|dR| mm':>12}"
        for name, size, seconds, error in self.rows:
            yield f"{name:<44}{size:>8}{1e3 * seconds:>12.2f}{error:>12.4f}"
        for size in SIZES:
            taubin = self.seconds("Taubin, moments and eigenproblem", size)
            ratios = [
                f"{what} {self.seconds(f'{what}, Euclidean polish', size) / taubin:.1f}"
                for what in ("cylinder", "elliptic cylinder", "cone")
            ]
            yield f"Euclidean polish / Taubin at {size}: {', '.join(ratios)}"


@pytest.fixture(scope="module")
def table(final_tables: list[Callable[[], Iterable[str]]]) -> Table:
    """Return the table of this run; it is printed at the end."""
    found = Table()
    final_tables.append(found.lines)
    return found


@cache
def cloud(shape: str, n: int) -> NDArray[np.float64]:
    """Points (n, 3) on a quarter turn, mm, with noise along the normal; the same in every run."""
    rng = np.random.default_rng(5)
    angle = rng.uniform(-np.pi / 4, np.pi / 4, n)
    height = rng.uniform(-LENGTH / 2, LENGTH / 2, n)
    noise = rng.normal(0, SIGMA, n)
    if shape == "elliptic-cylinder":
        angle = rng.uniform(-np.pi / 2, np.pi / 2, n)  # a quarter turn says too little of two axes
        normal = np.column_stack([RADII[1] * np.cos(angle), RADII[0] * np.sin(angle)])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        section = np.column_stack([RADII[0] * np.cos(angle), RADII[1] * np.sin(angle)])
        return np.column_stack([section + noise[:, None] * normal, height])
    slope = np.tan(HALF_ANGLE) if shape == "cone" else 0.0
    tilt = np.arctan(slope)
    radius = RADIUS + slope * height + noise * np.cos(tilt)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), height - noise * np.sin(tilt)])


def measure(
    benchmark: Any, table: Table, name: str, size: str, run: Callable[[], float], rounds: int | None = None
) -> float:
    """Time `run`, which returns the radius; note time and error, and return the best seconds."""
    rounds = rounds or (15 if size == "1e4" else 5)
    radius = benchmark.pedantic(run, rounds=rounds, iterations=1, warmup_rounds=int(rounds > 1))
    seconds = float(benchmark.stats.stats.min)
    table.rows.append((name, size, seconds, abs(radius - RADIUS)))
    return seconds


def radius_of(surface: Any) -> float:
    """Return the radius; of an elliptic cylinder half the sum of its half axes, of a cone at height 0."""
    if isinstance(surface, EllipticCylinder):
        return float(np.mean(surface.radii))
    if isinstance(surface, Cone):
        return float(surface.radius - surface.point[2] / surface.direction[2] * np.tan(surface.half_angle))
    return float(surface.radius)


@pytest.mark.parametrize("size", SIZES)
def test_taubin_quadric_without_residuals(benchmark: Any, table: Table, size: str) -> None:
    points = cloud("cylinder", SIZES[size])

    def run() -> float:
        return radius_of(read_surface(fit_quadric(moments(points), "taubin"), "elliptic-cylinder"))

    measure(benchmark, table, "Taubin, moments and eigenproblem", size, run)


@pytest.mark.parametrize("size", SIZES)
def test_taubin_quadric(benchmark: Any, table: Table, size: str) -> None:
    points = cloud("cylinder", SIZES[size])

    def run() -> float:
        return radius_of(fit(points, "elliptic-cylinder", metric="taubin").surface)

    measure(benchmark, table, "Taubin, with residuals and RMS", size, run)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("is_cold", [False, True], ids=["polish", "cold"])
def test_euclidean_cylinder(benchmark: Any, table: Table, size: str, is_cold: bool) -> None:
    points = cloud("cylinder", SIZES[size])

    def run() -> float:
        return radius_of(fit(points, "cylinder", start=None if is_cold else START).surface)

    measure(benchmark, table, f"cylinder, Euclidean {'cold' if is_cold else 'polish'}", size, run)
    # 10,000 points on a quarter turn determine R to 0.0103 mm
    assert table.rows[-1][3] < 4 * 0.0103


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("shape", ["elliptic-cylinder", "cone"])
@pytest.mark.parametrize("is_cold", [False, True], ids=["polish", "cold"])
def test_euclidean_of_other_shapes(
    benchmark: Any, table: Table, size: str, shape: Any, is_cold: bool
) -> None:
    points = cloud(shape, SIZES[size])
    start = CONE_START if shape == "cone" else ELLIPTIC_START

    def run() -> float:
        return radius_of(fit(points, shape, start=None if is_cold else start).surface)

    name = f"{shape.replace('-', ' ')}, Euclidean {'cold' if is_cold else 'polish'}"
    measure(benchmark, table, name, size, run, rounds=5)


@pytest.mark.parametrize("size", SIZES)
def test_robust_cylinder(benchmark: Any, table: Table, size: str) -> None:
    points = cloud("cylinder", SIZES[size])

    def run() -> float:
        return radius_of(fit(points, "cylinder", robust=True).surface)

    measure(benchmark, table, "cylinder, robust", size, run, rounds=3)


@pytest.mark.parametrize("size", SIZES)
def test_scipy_levenberg_marquardt(benchmark: Any, table: Table, size: str) -> None:
    points = cloud("cylinder", SIZES[size])

    def residual(p: NDArray[np.float64]) -> NDArray[np.float64]:
        axis = np.array([p[2], p[3], 1.0])
        axis /= np.linalg.norm(axis)
        value: NDArray[np.float64] = np.linalg.norm(np.cross(points - [p[0], p[1], 0], axis), axis=1) - p[4]
        return value

    def run() -> float:
        begin = [*START.point[:2], *(START.direction[:2] / START.direction[2]), START.radius]
        return float(least_squares(residual, begin, method="lm").x[4])

    measure(benchmark, table, "scipy least_squares LM, same start", size, run, rounds=3)


@pytest.mark.filterwarnings("default")  # a peer's warnings are its own
@pytest.mark.parametrize("size", SIZES)
def test_cylfit(benchmark: Any, table: Table, size: str) -> None:
    cylfit = peer("cylfit")
    points = cloud("cylinder", SIZES[size])

    def run() -> float:
        return float(cylfit.fit_cylinder(points, random_state=0).radius)

    name = f"cylfit {metadata.version('cylfit')}, cold"
    measure(benchmark, table, name, size, run, rounds=3 if size == "1e4" else 1)


@pytest.mark.filterwarnings("default")
def test_pyransac3d(benchmark: Any, table: Table) -> None:
    pyransac3d = peer("pyransac3d")
    points = cloud("cylinder", SIZES["1e4"])

    def run() -> float:
        import random

        random.seed(0)  # it draws from the global generator
        found = pyransac3d.Cylinder().fit(points, thresh=3 * SIGMA, maxIteration=1000)
        return float(found[2])

    name = f"pyransac3d {metadata.version('pyransac3d')}, cold"
    measure(benchmark, table, name, "1e4", run, rounds=1)


def peer(name: str) -> ModuleType:
    """Return a peer's module, or skip with the reason."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        pytest.skip(f'{name} is not installed ({error}); pip install "unseen[bench]"')
