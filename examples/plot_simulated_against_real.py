# SPDX-License-Identifier: MIT
"""A real scan against simulated ones: the pipe and the floor of pumpA.e57, fitted, and scanned again.

Run it with `python examples/plot_simulated_against_real.py [--data FOLDER] [--docs FOLDER]`; it writes the
picture of docs/results/simulated-against-real.md and prints its table. The data are those of CONTRIBUTING.md.
"""

import argparse
import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
from matplotlib import pyplot as plt

from completion import fit
from nbv import Effects, load_sensor, scan_scene
from nbv.scanning.effects import NO_EFFECTS
from nbv.scanning.noise_models import ConstantNoise
from scenes import (
    Cylinder,
    LabelledMesh,
    Plane,
    Projection,
    RangeImage,
    Scene,
    SphericalProjection,
    read_scan,
)

ROOT = Path(__file__).resolve().parents[1]
ROWS, COLUMNS = slice(721, 1000), slice(216, 244)  # the pipe and what lies beside it
PIPE, FLOOR = 0, 1
FITTED_SD_M = 0.0021
COLOURS = {"real": "black", "phase_terrestrial": "C0", "pulsed_terrestrial": "C1", "constant 2.1 mm": "C3"}


@dataclass(frozen=True)
class SameGrid:
    """A sensor with the pixels of a real scan."""

    projection: Projection
    name: str = "the real scan's grid"
    min_range_m: float = 0.3
    max_range_m: float = 100.0
    effects: Effects = NO_EFFECTS

    kind: ClassVar[str] = "spherical"
    partner: ClassVar[None] = None

    def sees(self, points: np.ndarray) -> np.ndarray:
        """All round."""
        return np.ones(points.shape[:-1], dtype=bool)

    def to_json(self) -> dict[str, Any]:
        """Return nothing: this sensor is no profile."""
        return {}


@dataclass(frozen=True, eq=False)
class Model:
    """The fitted pipe and floor, and which pixels of the real scan measured them."""

    pipe: Cylinder
    floor: Plane
    on_floor: np.ndarray

    def scene(self, heights: tuple[float, float]) -> Scene:
        """Both as a mesh: 1440 facets, which is 0.2 micrometres off the pipe."""
        angle = np.linspace(0, 2 * np.pi, 1441)
        uv = np.stack([np.tile(angle * self.pipe.radius, 2), np.repeat(heights, 1441)], axis=1)
        ring = self.pipe.from_uv(uv)
        k = np.arange(1440)
        sides = np.vstack([np.stack([k, k + 1, k + 1442], 1), np.stack([k, k + 1442, k + 1441], 1)])
        square = self.floor.from_uv(np.array([[-9, -9], [9, -9], [9, 9], [-9, 9.0]]))
        faces = np.vstack([sides, [[2882, 2883, 2884], [2882, 2884, 2885]]])
        labels = np.repeat([PIPE, FLOOR], [len(sides), 2])
        mesh = LabelledMesh(np.vstack([ring, square]), faces, labels)
        return Scene(mesh, (self.pipe, self.floor), ("pipe", "floor"), "pipe and floor", "object")


def fitted(scan: RangeImage) -> Model:
    """Fit pipe and floor to the real scan, robustly."""
    points = scan.points()
    cloud = points[ROWS, 227:240].reshape(-1, 3)
    pipe = fit(cloud[np.isfinite(cloud).all(axis=1)], "cylinder", robust=True).surface
    low = scan.valid & (np.abs(np.nan_to_num(points[..., 2]) + 1.87) < 0.03)
    floor = fit(points[low], "plane", robust=True).surface
    near = np.abs(floor.distance(points.reshape(-1, 3))).reshape(scan.shape) < 0.02
    return Model(pipe, floor, low & near)


def spread(values: np.ndarray) -> float:
    """Standard deviation in mm by the median of absolute deviations, which a few strays do not move."""
    return float(1.4826e3 * np.median(np.abs(values - np.median(values)))) if len(values) > 40 else np.nan


def along_ray_mm(scan: RangeImage, pixels: np.ndarray) -> np.ndarray:
    """Noise of single ranges, mm: second differences down the columns, free of the surface's form."""
    with np.errstate(invalid="ignore"):
        second = (scan.ranges[:-2] - 2 * scan.ranges[1:-1] + scan.ranges[2:]) / np.sqrt(6)
    found = np.full(scan.shape, np.nan)
    whole = pixels[:-2] & pixels[1:-1] & pixels[2:]
    found[1:-1][whole] = second[whole]
    return found


@dataclass(frozen=True, eq=False)
class Found:
    """Spreads of one scan in mm, by bins of incidence (pipe) and of range (floor).

    `radial`, `along`: on the pipe, across its surface and along the ray.
    """

    radial: list[float]
    along: list[float]
    floor: list[float]  # on the floor, along the ray
    form: float  # of the floor about its plane


INCIDENCE = np.array([10, 20, 30, 40, 50, 60, 70, 80])
RANGES = np.array([2.6, 3.0, 3.4, 3.8, 4.2, 4.6])


def examined(scan: RangeImage, model: Model, exact: RangeImage) -> Found:
    """Compare a scan with the model; an exact scan of it says which pixel meets the floor."""
    points = scan.points()
    off, incidence = np.full(scan.shape, np.nan), np.full(scan.shape, np.nan)
    beside = np.zeros(scan.shape, dtype=bool)
    beside[ROWS, COLUMNS] = scan.valid[ROWS, COLUMNS]
    off[beside] = model.pipe.distance(points[beside])
    on_pipe = beside & (np.abs(np.nan_to_num(off, nan=1.0)) < 0.02)
    rays = points[on_pipe] - scan.origin
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    met = scan.origin + rays * model.pipe.ray_ranges(scan.origin[None], rays)[:, None]  # free of noise
    slope = np.abs(np.einsum("ij,ij->i", rays, model.pipe.normal(np.where(np.isfinite(met), met, 0.0))))
    grazing = ~np.isfinite(met).all(axis=1)
    incidence[on_pipe] = np.where(grazing, 90.0, np.degrees(np.arccos(np.clip(slope, 0, 1))))
    second = along_ray_mm(scan, on_pipe)
    bins = [on_pipe & (incidence >= a) & (incidence < a + 10) for a in INCIDENCE]
    on_floor = model.on_floor & scan.valid & (exact.truth.surface == FLOOR)
    flat = along_ray_mm(scan, on_floor)
    far = [on_floor & (scan.ranges >= a) & (scan.ranges < a + 0.4) for a in RANGES]
    return Found(
        [spread(off[pick]) for pick in bins],
        [spread(second[pick & np.isfinite(second)]) for pick in bins],
        [spread(flat[pick & np.isfinite(flat)]) for pick in far],
        spread(model.floor.distance(points[on_floor])),
    )


def beyond_edge_mm(scan: RangeImage, model: Model, points: np.ndarray) -> float:
    """How far beside the pipe a beam may pass and still come back: the 99.5th percentile, mm."""
    points = points[np.isfinite(points).all(axis=-1)]
    points = points[np.abs(model.pipe.distance(points)) < 0.02]
    across = np.cross(points - scan.origin, model.pipe.direction)
    miss = np.abs(across @ (model.pipe.point - scan.origin)) / np.linalg.norm(across, axis=1)
    return float(1e3 * (np.percentile(miss, 99.5) - model.pipe.radius))


def between(scan: RangeImage) -> tuple[int, int]:
    """How many jumps of 0.3 m lie between a pixel's two neighbours in its row, and of how many it is part.

    It is when it lies 5 cm or more from both.
    """
    before, here, after = (np.where(scan.valid, scan.ranges, np.nan)[:, k : k - 2 or None] for k in range(3))
    jumps = np.abs(before - after) > 0.3
    inside = (here > np.fmin(before, after) + 0.05) & (here < np.fmax(before, after) - 0.05)
    return int(jumps.sum()), int((jumps & inside).sum())


def simulated(model: Model, scan: RangeImage) -> tuple[dict[str, RangeImage], dict[str, float]]:
    """Scan the model again: exactly, with two shipped profiles, and with noise fitted to the real scan.

    Returns the scans, and what `beyond_edge_mm` says of each when its columns are eight times finer.
    """
    rows = scan.points()[ROWS, 227:240]
    along = (rows[np.isfinite(rows).all(axis=-1)] - model.pipe.point) @ model.pipe.direction
    scene, grid = model.scene((along.min() - 0.02, along.max() + 0.02)), scan.projection
    sides = grid.azimuths[[COLUMNS.start, COLUMNS.stop]]
    fine = SphericalProjection(np.linspace(*sides, 8 * 28), grid.elevations[ROWS])
    phase, pulsed = (load_sensor(name).effects for name in ("phase_terrestrial", "pulsed_terrestrial"))
    effects = {
        "exact": NO_EFFECTS,
        "phase_terrestrial": phase,
        "pulsed_terrestrial": pulsed,
        "constant 2.1 mm": replace(phase, noise=ConstantNoise(constant_m=FITTED_SD_M)),
    }
    scans, edges = {}, {}
    for name, chosen in effects.items():
        pose = scan.world_from_sensor
        points = replace(
            chosen, footprint=None
        )  # on smooth surfaces a beam measures what its middle ray does
        scans[name] = scan_scene(scene, pose, SameGrid(grid), effects=points, rng=0)
        close = scan_scene(scene, pose, SameGrid(fine), effects=chosen, rng=0)
        edges[name] = beyond_edge_mm(scan, model, close.points())
    return scans, edges


def draw(found: dict[str, Found], path: Path) -> None:
    """Write the picture: spread across the pipe, along the ray, and on the floor."""
    figure, axes = plt.subplots(1, 3, figsize=(12.5, 3.9), layout="constrained")
    for name, one in found.items():
        style = {
            "color": COLOURS[name],
            "marker": "o",
            "ms": 7 if name == "real" else 4,
            "lw": 1.2,
            "label": name,
        }
        axes[0].plot(INCIDENCE + 5, one.radial, **style)
        axes[1].plot(INCIDENCE + 5, one.along, **style)
        axes[2].plot(RANGES + 0.2, one.floor, **style)
    axes[0].set(title="pipe: across its surface", xlabel="incidence, deg", ylabel="standard deviation, mm")
    axes[1].set(title="pipe: along the ray, neighbours compared", xlabel="incidence, deg")
    axes[2].set(title="floor: along the ray, neighbours compared", xlabel="range, m")
    for ax in axes:
        ax.set_ylim(0, 4.2)
    axes[2].legend(loc="center", bbox_to_anchor=(0.5, 0.28))
    figure.savefig(path, dpi=100)
    plt.close(figure)


def main(arguments: list[str] | None = None) -> None:
    """Compare, draw and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    data = Path(os.environ.get("UNSEEN_DATA", ROOT.parent / "shared/data"))
    parser.add_argument("--data", type=Path, default=data)
    parser.add_argument("--docs", type=Path, default=ROOT / "docs")
    asked = parser.parse_args(arguments)
    file = asked.data / "range/e57/pumpA.e57"
    if not file.is_file():
        print(f"skipped: there is no {file}; set UNSEEN_DATA to the folder with the real data")
        return
    scan = read_scan(file)
    model = fitted(scan)
    scans, edges = simulated(model, scan)
    exact = scans.pop("exact")
    found = {name: examined(one, model, exact) for name, one in {"real": scan, **scans}.items()}
    edges["real"] = beyond_edge_mm(scan, model, scan.points()[ROWS, COLUMNS])
    (asked.docs / "pictures").mkdir(parents=True, exist_ok=True)
    draw(found, asked.docs / "pictures/simulated_against_real.png")
    jumps, mixed = between(scan)
    print(f"of {jumps} pixels between jumps in a row, {mixed} ({mixed / jumps:.0%}) lie between the depths")
    print(f"pipe: radius {1e3 * model.pipe.radius:.1f} mm; without beam width: edge {edges['exact']:.1f} mm")
    print(
        "| mm | pipe across, 10-20 deg | 50-60 deg | pipe along the ray | floor along the ray | form | edge |"
    )
    print("|---|---|---|---|---|---|---|")
    for name, one in found.items():
        numbers = one.radial[0], one.radial[4], np.nanmedian(one.along), np.nanmedian(one.floor), one.form
        print(f"| {name} | {' | '.join(f'{number:.2f}' for number in (*numbers, edges[name]))} |")


if __name__ == "__main__":
    main()
