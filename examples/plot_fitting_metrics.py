# SPDX-License-Identifier: MIT
"""What a metric does to a fitted cylinder: radius of four fits on partial arcs, as a table and a picture.

Run it with `python examples/plot_fitting_metrics.py [--trials N] [--docs FOLDER] [--workers N]`: it writes
`results/fitting-metrics.md` and `pictures/fitting_metrics.png` into FOLDER (default: docs). The cylinder has
radius 60 mm and length 100 mm, 10,000 points spread evenly over an arc, in an oblique pose. Noise is radial,
or along the parallel rays of a far scanner that looks at the middle of the arc. 2,000 trials a row by
default; and robust fits to 100 clouds of which 30 % are outliers.
"""

import argparse
import os
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from completion.fitting.pipeline import fit
from completion.fitting.result import FitError
from scenes import Cylinder
from scenes.surfaces.catalogue import EllipticCylinder

RADIUS, LENGTH, N_POINTS = 60.0, 100.0, 10_000  # mm
ROWS = ((180, 0.5), (90, 0.1), (90, 0.5), (60, 0.1), (60, 0.5), (30, 0.1), (30, 0.5))  # arc deg, sigma mm
NOISES = ("radial", "ray")
N_OUTLIER_TRIALS = 100
METHODS = ("algebraic quadric", "Taubin quadric", "circular algebraic", "Euclidean", "along the ray")
COLOURS = ("#D55E00", "#E69F00", "#0072B2", "#009E73")
POSE = Rotation.from_euler("xyz", [0.4, 0.7, -0.3]).as_matrix()
SHIFT = np.array([210.0, -340.0, 560.0])


@dataclass(frozen=True)
class Row:
    """All trials of one row.

    `radii` (trials, methods) in the order of METHODS, NaN where a fit failed or was not made; `axes`
    (trials, 2, 2) the half axes of the two quadrics; `predicted` (trials, 2) the standard deviations of the
    radius that the last two fits state.
    """

    arc_deg: float
    sigma_mm: float
    noise: str
    radii: NDArray[np.float64]
    axes: NDArray[np.float64]
    predicted: NDArray[np.float64]


def sample(arc_deg: float, sigma: float, noise: str, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return points (n, 3) of one trial, mm."""
    angle = np.radians(rng.uniform(-arc_deg / 2, arc_deg / 2, N_POINTS))
    outward = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(N_POINTS)])
    points = RADIUS * outward
    points[:, 2] = rng.uniform(-LENGTH / 2, LENGTH / 2, N_POINTS)
    along = outward if noise == "radial" else np.array([1.0, 0.0, 0.0])
    points = points + along * rng.normal(0.0, sigma, N_POINTS)[:, None]
    moved: NDArray[np.float64] = points @ POSE.T + SHIFT
    return moved


class Chart:
    """Points seen from a cylinder's axis: parameters are two shifts, two tilts and the radius."""

    def __init__(self, points: NDArray[np.float64], start: Cylinder) -> None:
        self.frame = np.vstack([np.linalg.svd(np.asarray(start.direction)[None])[2][1:], start.direction])
        centre = points.mean(axis=0)
        self.local = (points - centre) @ self.frame.T
        foot = (np.asarray(start.point) - centre) @ self.frame.T
        self.begin = np.array([foot[0], foot[1], 0.0, 0.0, start.radius])

    def across(
        self, p: NDArray[np.float64], vectors: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
        """Parts of `vectors` across the axis (p2, p3, 1), along it, and that axis' length."""
        length = float(np.sqrt(1 + p[2] ** 2 + p[3] ** 2))
        axis = np.array([p[2], p[3], 1.0]) / length
        along = vectors @ axis
        return vectors - along[..., None] * axis, along, length

    def offsets(self, p: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points relative to the axis point (p0, p1, 0)."""
        offset: NDArray[np.float64] = self.local - np.array([p[0], p[1], 0.0])
        return offset

    def gradient(
        self, radial: NDArray[np.float64], height: NDArray[np.float64], length: float, last: float
    ) -> NDArray[np.float64]:
        """Half the derivative of r^2 - R^2 (n, 5) where `radial` are the parts across the axis."""
        x, y, tilt = radial[:, 0], radial[:, 1], height / length
        return np.column_stack([-x, -y, -tilt * x, -tilt * y, np.full(len(x), last)])


SCALE = [1.0, 1.0, 0.02, 0.02, 1.0]


def circular_algebraic(points: NDArray[np.float64], start: Cylinder) -> float:
    """Return the radius where the sum of (r^2 - R^2)^2 over axis and radius is least, starting at `start`."""
    chart = Chart(points, start)

    def residual(p: NDArray[np.float64]) -> NDArray[np.float64]:
        radial, _, _ = chart.across(p, chart.offsets(p))
        value: NDArray[np.float64] = (np.einsum("ij,ij->i", radial, radial) - p[4] ** 2) / (2 * RADIUS)
        return value

    def jacobian(p: NDArray[np.float64]) -> NDArray[np.float64]:
        return chart.gradient(*chart.across(p, chart.offsets(p)), -p[4]) / RADIUS

    found = least_squares(residual, chart.begin, jac=jacobian, method="lm", x_scale=SCALE)
    return float(abs(found.x[4]))


def quadric(points: NDArray[np.float64], metric: str) -> tuple[float, float]:
    """Return the half axes of the elliptic cylinder that a general quadric is read as, NaN if it is none."""
    try:
        surface = fit(points, "elliptic-cylinder", metric=metric).surface  # type: ignore[arg-type]
    except FitError:
        return np.nan, np.nan
    assert isinstance(surface, EllipticCylinder)
    return surface.radii


def trial(
    arc_deg: float, sigma: float, noise: str, seed: Sequence[int]
) -> tuple[list[float], list[tuple[float, float]], list[float]]:
    """Return the radii of all fits to one sample, the quadrics' half axes, and the predicted deviations."""
    points = sample(arc_deg, sigma, noise, np.random.default_rng(seed))
    axes = [quadric(points, metric) for metric in ("algebraic", "taubin")]
    euclidean = fit(points, "cylinder")
    assert isinstance(euclidean.surface, Cylinder)
    radii = [*(float(np.mean(pair)) for pair in axes), circular_algebraic(points, euclidean.surface)]
    fits = [euclidean]
    if noise == "ray":
        fits.append(fit(points, "cylinder", rays=np.broadcast_to(POSE[:, 0], points.shape)))
    for found in fits:
        assert isinstance(found.surface, Cylinder)
        radii.append(found.surface.radius)
    deviations = [float(found.parameter_deviations()["radius"]) for found in fits]
    missing = [np.nan] * (2 - len(fits))
    return radii + missing, axes, deviations + missing


def outlier_trial(seed: Sequence[int]) -> tuple[float, float]:
    """Return |dR| of a robust fit to a quarter turn, sigma 0.1 mm, 30 % outliers, and the predicted u(R).

    Outliers are spread evenly over the box of the points, 10 mm wider on each side.
    """
    rng = np.random.default_rng(seed)
    points = sample(90, 0.1, "radial", rng)[: 7 * N_POINTS // 10]
    low, high = points.min(axis=0) - 10, points.max(axis=0) + 10
    outliers = rng.uniform(low, high, (N_POINTS - len(points), 3))
    found = fit(np.concatenate([points, outliers]), "cylinder", robust=True)
    assert isinstance(found.surface, Cylinder)
    return abs(found.surface.radius - RADIUS), float(found.parameter_deviations()["radius"])


def run_row(index: int, noise: str, trials: int, pool: ProcessPoolExecutor) -> Row:
    """Run all trials of a row; each has its own seed, so that workers do not matter."""
    arc_deg, sigma = ROWS[index]
    seeds = [(0, index, NOISES.index(noise), k) for k in range(trials)]
    chunk = max(1, trials // 32)
    found = list(pool.map(partial(trial, arc_deg, sigma, noise), seeds, chunksize=chunk))
    return Row(
        arc_deg,
        sigma,
        noise,
        np.array([one[0] for one in found]),
        np.array([one[1] for one in found]),
        np.array([one[2] for one in found]),
    )


def cell(row: Row, method: int) -> str:
    """Return mean and deviation of a method's radius in a row, and how often it found no cylinder."""
    radii = row.radii[:, method]
    good = radii[np.isfinite(radii)]
    failed = 1 - len(good) / len(radii)
    if len(good) < 2 or failed > 0.5:
        return f"not elliptic, {100 * failed:.3g} %"
    deviation = good.std(ddof=1)
    digits = int(np.clip(1 - np.floor(np.log10(deviation)), 0, 5))
    text = f"{good.mean():.{digits}f} ± {deviation:.{digits}f}"
    if method == 0 and row.axes.shape[0]:
        greater, smaller = np.nanmean(row.axes[:, 0], axis=0)
        text += f" [{smaller:.1f}/{greater:.1f}]" if greater > 1.05 * smaller else ""
    return text + (f", not elliptic {100 * failed:.2g} %" if failed else "")


def table(rows: Sequence[Row]) -> str:
    """Return the rows of one kind of noise as a Markdown table; checks of the last method stand last."""
    last = 4 if rows[0].noise == "ray" else 3
    heads = ["arc deg / sigma mm", *METHODS[:4]]
    for method in range(3, last + 1):
        heads += [METHODS[4]] if method == 4 else []
        heads += ["predicted u(R)", "bias / sd", "sd / u"]
    lines = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    for row in rows:
        cells = [f"{row.arc_deg} / {row.sigma_mm}", *(cell(row, k) for k in range(4))]
        for method in range(3, last + 1):
            cells += [cell(row, 4)] if method == 4 else []
            radii, u = row.radii[:, method], float(np.sqrt(np.mean(row.predicted[:, method - 3] ** 2)))
            deviation = radii.std(ddof=1)
            cells += [f"{u:.4f}", f"{(radii.mean() - RADIUS) / deviation:+.3f}", f"{deviation / u:.3f}"]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def outlier_line(found: Sequence[tuple[float, float]]) -> str:
    """Return what robust fits among outliers came to."""
    errors, predicted = np.array(found).T
    return (
        f"{len(found)} clouds, 90 deg, sigma 0.1 mm, 30 % outliers: median |dR| {np.median(errors):.4f} mm, "
        f"greatest {errors.max():.4f} mm; root mean square {np.sqrt(np.mean(errors**2)):.4f} mm, "
        f"predicted u(R) {np.sqrt(np.mean(predicted**2)):.4f} mm"
    )


def picture(rows: Sequence[Row], file: Path) -> None:
    """Draw |bias| and spread of the radius against the arc, for radial noise."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, panels = plt.subplots(1, 2, figsize=(11, 4.6), sharex=True, layout="constrained")
    for method, (name, colour) in enumerate(zip(METHODS[:4], COLOURS, strict=True)):
        for sigma, style in ((0.5, "-"), (0.1, "--")):
            chosen = [row for row in rows if row.sigma_mm == sigma and row.noise == "radial"]
            usable = [row for row in chosen if np.isfinite(row.radii[:, method]).mean() > 0.5]
            arcs = [row.arc_deg for row in usable]
            bias = [abs(float(np.nanmean(row.radii[:, method])) - RADIUS) for row in usable]
            spread = [float(np.nanstd(row.radii[:, method], ddof=1)) for row in usable]
            label = f"{name}, sigma {sigma} mm"
            marker, filled = ("o", colour) if sigma == 0.5 else ("s", "white")
            for panel, values in zip(panels, (bias, spread), strict=True):
                panel.plot(arcs, values, style, marker=marker, mfc=filled, color=colour, label=label, lw=1.8)
    radial = [row for row in rows if row.noise == "radial"]
    predicted = [float(np.sqrt(np.mean(row.predicted[:, 0] ** 2))) for row in radial]
    panels[1].plot(
        [row.arc_deg for row in radial],
        predicted,
        "kx",
        markersize=9,
        label="u(R) that the Euclidean fit predicts",
    )
    for panel, title in zip(
        panels, ("|bias| of the radius, mm", "spread (sd) of the radius, mm"), strict=True
    ):
        panel.set(title=title, yscale="log", xlabel="arc that was measured, degrees")
        panel.set_xticks([30, 60, 90, 180])
        panel.invert_xaxis()
        panel.grid(visible=True, which="major", alpha=0.3)
    figure.suptitle(
        f"Cylinder of radius 60 mm, {N_POINTS:,} points; a line ends where no elliptic cylinder is left"
    )
    handles, labels = panels[1].get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside lower center", ncols=3, fontsize=9, handlelength=4.5, frameon=False
    )
    figure.savefig(file, dpi=110, metadata={"Software": None})
    plt.close(figure)


def document(rows: Sequence[Row], outliers: str, trials: int) -> str:
    """Return the page of tables."""
    parts = [
        "<!-- Written by `python examples/plot_fitting_metrics.py"
        + ("" if trials == 2000 else f" --trials {trials}")
        + "`; do not edit. -->\n",
        f"# Radius of a fitted cylinder by metric: {trials:,} trials a row\n",
        f"R = 60 mm, L = 100 mm, {N_POINTS:,} points. Mean ± standard deviation of R in mm; in brackets the "
        "mean half axes of the ellipse where they differ. u(R) is what a fit predicts from one cloud; with "
        "the true model bias / sd is near 0 and sd / u near 1. What it means: [fitting.md](fitting.md).\n",
        "![Bias and spread of the radius against the arc](../pictures/fitting_metrics.png)\n",
    ]
    for noise, title in zip(NOISES, ("Noise along the normal", "Noise along the ray"), strict=True):
        part = table([row for row in rows if row.noise == noise])
        parts.append(f"## {title}\n\n{part}\n")
    parts.append(f"## Outliers\n\n{outliers}.\n")
    return "\n".join(parts)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study and write its table and picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=2000, help="a row; default 2000")
    parser.add_argument("--docs", type=Path, default=Path("docs"), help="folder to write into")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="processes")
    given = parser.parse_args(arguments)
    (given.docs / "pictures").mkdir(parents=True, exist_ok=True)
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ[name] = "1"  # the workers are the parallelism; they inherit this
    begin = time.perf_counter()
    rows = []
    with ProcessPoolExecutor(given.workers, mp_context=get_context("spawn")) as pool:
        for noise in NOISES:
            for index in range(len(ROWS)):
                rows.append(run_row(index, noise, given.trials, pool))
                print(f"{time.perf_counter() - begin:6.0f} s  {noise:6}  {table(rows[-1:]).splitlines()[-1]}")
        seeds = [(0, len(ROWS), k) for k in range(min(given.trials, N_OUTLIER_TRIALS))]
        outliers = outlier_line(list(pool.map(outlier_trial, seeds)))
        print(outliers)
    (given.docs / "results").mkdir(exist_ok=True)
    (given.docs / "results" / "fitting-metrics.md").write_text(
        document(rows, outliers, given.trials), encoding="utf-8"
    )
    picture(rows, given.docs / "pictures" / "fitting_metrics.png")


if __name__ == "__main__":
    main()
