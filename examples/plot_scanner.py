# SPDX-License-Identifier: MIT
"""The pictures of docs/guides/scanner.md: what each parameter of the scanner does, one picture for each.

Run it with `python examples/plot_scanner.py [--docs FOLDER] [--scale 1.0]`; a small scale is quick.
"""

import argparse
import io
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
from PIL import Image

mpl.use("Agg")
from matplotlib import pyplot as plt

from nbv import Dropout, Effects, Footprint, Intensity, LineSensor, PinholeSensor, Quantisation, scan_scene
from nbv.scanning.effects import PointingNoise, named_effects
from nbv.scanning.noise_models import TerrestrialNoise, range_sigma_m
from nbv.scanning.triangulation import TriangulationSensor
from scenes import LabelledMesh, Pose, Scene, builtin_scene

EAST = Pose.looking_at((0, 0, 0), (1, 0, 0))
SCALE = 1.0
BLUE, RED, GREY = "#1f5fa8", "#c8332b", "#9a9a9a"


def pixels(n: int) -> int:
    """Return a number of pixels at the scale that was asked for."""
    return max(int(n * SCALE), 24)


def walls(*extents: tuple[float, float, float, float]) -> Scene:
    """Upright walls 4 m high, each from (x, y) to (x, y) in metres."""
    vertices = [point for a, b, c, d in extents for point in ((a, b, -2), (c, d, -2), (c, d, 2), (a, b, 2))]
    faces = [
        f for k in range(len(extents)) for f in ([4 * k, 4 * k + 1, 4 * k + 2], [4 * k, 4 * k + 2, 4 * k + 3])
    ]
    mesh = LabelledMesh(np.array(vertices, float), np.array(faces), np.repeat(np.arange(len(extents)), 2))
    return Scene(mesh, (None,) * len(extents), ("wall",) * len(extents), "walls", "object")


def profile(scene: Scene, effects: Effects, fan_deg: float = 24.0, n: int = 1400) -> np.ndarray:
    """Measured points (n, 2) of one horizontal row of pixels, top view: x ahead, y to the left."""
    row = scan_scene(scene, EAST, LineSensor(fan_deg=fan_deg, width=pixels(n)), effects=effects, rng=1)
    return row.points()[row.valid][:, :2]


def save(figure: plt.Figure, folder: Path, name: str) -> None:
    """Write a picture and say so."""
    drawn = io.BytesIO()
    figure.savefig(drawn, dpi=110)
    plt.close(figure)
    with Image.open(drawn) as picture:
        picture.convert("RGB").quantize(256).save(folder / f"scanner_{name}.png", optimize=True)
    print(f"scanner_{name}.png")


def row_of(n: int, height: float = 3.4, width: float = 11.0) -> tuple[plt.Figure, list[plt.Axes]]:
    """Return a figure with `n` panels side by side."""
    figure, axes = plt.subplots(1, n, figsize=(width, height), layout="constrained", squeeze=False)
    return figure, list(axes[0])


def noise(folder: Path) -> None:
    """Formula and measured spread of each model, against range and against incidence."""
    names = ["gaussian-2mm", "constant-ppm", "khoshelham2012", "nguyen2012", "stereo-0.08px-447px-50mm"]
    figure, (left, right) = row_of(2, 4.2)
    axis = np.linspace(0.5, 6, 100)
    for k, name in enumerate([*names, "terrestrial-0.3mm-0.02mm"]):
        model = named_effects(name).noise
        left.plot(
            axis, 1e3 * np.broadcast_to(range_sigma_m(model, axis, 0 * axis), axis.shape), f"C{k}", label=name
        )
        for depth in (1, 2, 3, 4, 5):
            left.plot(depth, 1e3 * measured_sd(model, depth, 0.0, 1.0), f"C{k}o", ms=5)
    left.set(xlabel="range of a wall that faces the sensor, m", ylabel="standard deviation, mm", yscale="log")
    left.legend(fontsize=8)
    angles = np.linspace(0, 86, 200)
    for k, name in [(3, "nguyen2012"), (5, "terrestrial-0.3mm-0.02mm")]:
        model = named_effects(name).noise
        sigma = range_sigma_m(model, np.full(200, 4.0), np.radians(angles), 1.0, 0.5)
        right.plot(angles, 1e3 * sigma, f"C{k}", label=f"{name}, at 4 m, reflectivity 0.5")
        for angle in (0, 30, 55, 65, 75, 82):
            right.plot(angle, 1e3 * measured_sd(model, 4.0, angle, 0.5), f"C{k}o", ms=5)
    right.set(xlabel="incidence, deg", ylabel="standard deviation, mm", yscale="log")
    right.legend(fontsize=8)
    figure.suptitle("Noise models: lines are the formulas, dots the spread of simulated scans", fontsize=11)
    save(figure, folder, "noise")


def measured_sd(model: object, distance: float, incidence_deg: float, white: float) -> float:
    """Standard deviation of simulated ranges of a wall at one distance and incidence, metres."""
    turn = np.radians(incidence_deg)
    along = 30 * np.array([np.sin(turn), np.cos(turn)])
    scene = walls((distance - along[0], -along[1], distance + along[0], along[1]))
    sensor = PinholeSensor(fov_deg=0.5, width=pixels(120), height=pixels(120), max_range_m=100)
    effects = Effects(noise=model, intensity=Intensity(reflectivity=white))
    scan = scan_scene(scene, EAST, sensor, effects=effects, rng=2)
    return float(np.std(scan.range_error()[scan.valid]))


def divergence(folder: Path) -> None:
    """Mixed pixels at the edge of a panel before a wall, top view, by beam width and by return."""
    scene = walls((5.0, -2, 5.0, 0.0), (5.6, -3, 5.6, 3))
    options = [
        ("no footprint", None),
        (
            "0.3 mrad, mean: a phase scanner",
            Footprint(divergence_rad=3e-4, exit_diameter_m=2e-3, returns="mean"),
        ),
        ("3 mrad, mean", Footprint(divergence_rad=3e-3, exit_diameter_m=5e-3, returns="mean")),
        (
            "3 mrad, first of 0.3 m pulse",
            Footprint(divergence_rad=3e-3, exit_diameter_m=5e-3, returns="first"),
        ),
        ("3 mrad, last of 0.3 m pulse", Footprint(divergence_rad=3e-3, exit_diameter_m=5e-3, returns="last")),
    ]
    figure, axes = row_of(len(options), 3.6, 13)
    for ax, (title, footprint) in zip(axes, options, strict=True):
        points = profile(scene, Effects(footprint=footprint), 1.2, 260)
        mixed = (np.abs(points[:, 0] - 5) > 0.005) & (np.abs(points[:, 0] - 5.6) > 0.005)
        ax.axvline(0, color=GREY, lw=0.8, ls=":")
        ax.plot(1e3 * points[~mixed, 1], points[~mixed, 0], ".", ms=4, color=BLUE)
        ax.plot(1e3 * points[mixed, 1], points[mixed, 0], ".", ms=5, color=RED)
        ax.set(title=title, xlabel="sideways, mm", xlim=(-32, 32), ylim=(4.9, 5.75))
    axes[0].set_ylabel("range, m (seen from above)")
    for ax in axes:
        ax.title.set_fontsize(9)
    save(figure, folder, "divergence")


def incidence(folder: Path) -> None:
    """A floor that recedes: residuals of a terrestrial scanner grow with range and incidence."""
    scene = walls((-1.0, 1.0, 40.0, 1.0))
    figure, axes = row_of(2, 3.4)
    for ax, white in zip(axes, (0.8, 0.1), strict=True):
        effects = Effects(
            noise=TerrestrialNoise(constant_m=5e-4, signal_per_m=4e-6),
            intensity=Intensity(reflectivity=white),
        )
        row = scan_scene(
            scene, EAST, LineSensor(fan_deg=180, width=pixels(6000), max_range_m=30), effects=effects, rng=0
        )
        angle = np.degrees(row.truth.incidence[0])
        ax.plot(angle, 1e3 * row.range_error()[0], ".", ms=2, color=BLUE, alpha=0.5)
        grid = np.linspace(1, 86, 200)
        sigma = effects.noise.sigma_m(1 / np.cos(np.radians(grid)), np.radians(grid), white)
        for sign in (-2, 2):
            ax.plot(grid, sign * 1e3 * sigma, color=RED, lw=1)
        ax.set(xlabel="incidence on a wall 1 m beside the scanner, deg", ylim=(-14, 14), xlim=(0, 87))
        ax.set_title(f"reflectivity {white}: error along the ray, red: two standard deviations", fontsize=9)
    axes[0].set_ylabel("range error, mm")
    save(figure, folder, "incidence")


def two_paths(folder: Path) -> None:
    """Depth images of a chair with growing baseline: what the second device does not see has no depth."""
    scene, view = builtin_scene("chair_before_wall"), Pose.looking_at((0.4, -1.7, 1.2), (0.0, 0.8, 0.7))
    figure, axes = row_of(4, 3.0, 13)
    cases = [
        ("one path", None),
        ("75 mm to the right", 0.075),
        ("250 mm to the right", 0.25),
        ("250 mm to the left", -0.25),
    ]
    for ax, (title, baseline) in zip(axes, cases, strict=True):
        size = {"fov_deg": 40, "width": pixels(480), "height": pixels(360), "max_range_m": 6.0}
        sensor = (
            PinholeSensor(**size)
            if baseline is None
            else TriangulationSensor(**size, baseline_m=baseline, partner_fov_deg=100)
        )
        scan = scan_scene(scene, view, sensor)
        ax.imshow(np.where(scan.valid, scan.ranges, np.nan), cmap="viridis_r", vmin=1.2, vmax=3.6)
        lost = ~scan.valid & np.isfinite(scan.truth.ranges)
        ax.imshow(np.where(lost[..., None], [0.85, 0.12, 0.1, 1.0], [0, 0, 0, 0]))
        ax.set(xticks=[], yticks=[])
        ax.set_title(f"{title}: {lost.mean():.1%} in shadow", fontsize=9)
    save(figure, folder, "two_paths")


def quantisation(folder: Path) -> None:
    """A slightly slanted wall in the steps of a Kinect, with and without its noise, and in steps of range."""
    near, far = np.array([2.95, 1.1]), np.array([3.25, -1.1])
    options = [
        (
            "steps even in disparity: 2.85e-3 z² m",
            Effects(quantisation=Quantisation(inverse_depth_step_per_m=2.85e-3)),
        ),
        ("the same with Khoshelham's noise", named_effects("khoshelham2012")),
        ("steps of 2 cm in range", Effects(quantisation=Quantisation(range_step_m=0.02))),
    ]
    figure, axes = row_of(3, 3.6, 12)
    for ax, (title, effects) in zip(axes, options, strict=True):
        camera = PinholeSensor(fov_deg=36, width=pixels(600), height=1)
        scan = scan_scene(walls((*near, *far)), EAST, camera, effects=effects, rng=0)
        points = scan.points()[scan.valid]
        ax.plot([near[1], far[1]], [near[0], far[0]], color=RED, lw=1)
        ax.plot(points[:, 1], points[:, 0], ".", ms=2.5, color=BLUE)
        ax.set(xlabel="sideways, m", xlim=(1, -1), ylim=(2.93, 3.27))
        ax.set_title(title, fontsize=9)
    axes[0].set_ylabel("depth, m (red: the wall)")
    save(figure, folder, "quantisation")


def dropout(folder: Path) -> None:
    """Intensity of a room, and what three kinds of drop-out take away."""
    scene, view = builtin_scene("two_occluders"), Pose.looking_at((0.4, 0.4, 1.7), (4.0, 3.0, 0.8))
    sensor = PinholeSensor(fov_deg=80, width=pixels(420), height=pixels(330))
    light = Intensity(reference_range_m=3.0)
    whole = scan_scene(scene, view, sensor, effects=Effects(intensity=light))
    figure, axes = row_of(4, 3.0, 13)
    axes[0].imshow(np.log10(whole.intensity), cmap="gray", vmin=-2.2, vmax=0.3)
    axes[0].set_title("intensity, logarithmic", fontsize=9)
    cases = [
        ("weaker than 0.05", Dropout(min_intensity=0.05)),
        ("beyond 70 deg of incidence", Dropout(max_incidence_deg=70)),
        ("specular loss 0.8, exponent 2", Dropout(specular_loss=0.8, specular_exponent=2)),
    ]
    for ax, (title, lost) in zip(axes[1:], cases, strict=True):
        scan = scan_scene(scene, view, sensor, effects=Effects(intensity=light, dropout=lost), rng=0)
        ax.imshow(np.where(scan.valid[..., None], whole.colour, [0.85, 0.12, 0.1]))
        ax.set_title(f"{title}: {1 - scan.valid.mean():.0%} lost (red)", fontsize=9)
    for ax in axes:
        ax.set(xticks=[], yticks=[])
    save(figure, folder, "dropout")


def pointing(folder: Path) -> None:
    """Points on two walls and the edge between them, pushed sideways by angular noise."""
    scene = walls((8.0, -3, 8.0, 0.0), (9.0, -4, 9.0, 4))
    figure, axes = row_of(3, 3.4, 12)
    for ax, sd_deg in zip(axes, (0.0, 0.01, 0.05), strict=True):
        options = Effects(pointing=PointingNoise(sd_deg=sd_deg))
        sensor = PinholeSensor(fov_deg=1.0, width=pixels(160), height=pixels(110))
        scan = scan_scene(scene, EAST, sensor, effects=options, rng=0)
        points, near = scan.points(), scan.truth.surface == 0
        for where, colour in ((~near, GREY), (near, BLUE)):
            ax.plot(-1e3 * points[where][:, 1], 1e3 * points[where][:, 2], ".", ms=2, color=colour)
        ax.axvline(0, color=RED, lw=0.8)
        ax.set(xlabel="sideways, mm", xlim=(-30, 30), ylim=(-22, 22), aspect="equal")
        ax.set_title(f"{sd_deg} deg: {1e3 * 8 * np.radians(sd_deg):.1f} mm at 8 m", fontsize=9)
    axes[0].set_ylabel("up, mm (as the scanner sees it)")
    save(figure, folder, "pointing")


def hedge_before_wall(n_leaves: int = 2500) -> Scene:
    """Leaves, triangles of 3 cm, within half a metre about 5 m away, and a wall a metre behind them."""
    rng = np.random.default_rng(2)
    middle = rng.uniform((4.8, -1.0, -0.04), (5.6, 0.55, 0.04), (n_leaves, 3))
    leaves = (middle[:, None] + 0.02 * rng.standard_normal((n_leaves, 3, 3))).reshape(-1, 3)
    wall = walls((6.6, -3, 6.6, 3)).mesh
    faces = np.concatenate([np.arange(3 * n_leaves).reshape(-1, 3), wall.faces + len(leaves)])
    surface = np.repeat([0, 1], [n_leaves, len(wall.faces)])
    mesh = LabelledMesh(np.concatenate([leaves, wall.vertices]), faces, surface)
    return Scene(mesh, (None, None), ("leaves", "wall"), "hedge", "object")


def echoes(folder: Path) -> None:
    """All returns of one row of beams through a hedge, top view, and the share of a beam beside an edge."""
    beam = Footprint(divergence_rad=6e-3, exit_diameter_m=5e-3, returns="all", range_resolution_m=0.1)
    figure, (left, right) = row_of(2, 4.2)
    row = LineSensor(fan_deg=24.0, width=pixels(320))
    scan = scan_scene(hedge_before_wall(), EAST, row, effects=Effects(footprint=beam), rng=1)
    points, number = scan.points()[scan.valid], np.ones(int(scan.valid.sum()), int)
    if scan.echoes is not None:
        points, number = np.concatenate([points, scan.echo_points()]), np.append(number, scan.echoes.number)
    for k, colour in ((1, BLUE), (2, "#e08a1e"), (3, RED)):
        shown = number == k if k < 3 else number >= k
        label = f"{('first', 'second', 'third or later')[k - 1]}: {np.count_nonzero(shown)}"
        left.plot(points[shown, 1], points[shown, 0], ".", ms=4, color=colour, label=label)
    left.set(xlabel="sideways, m", ylabel="range, m (seen from above)", ylim=(4.6, 6.8))
    left.set_title(f"returns of {row.width} beams, 6 mrad, resolution 0.1 m", fontsize=9)
    left.legend(fontsize=8, loc="lower right")
    offsets = np.linspace(-1, 1, 201)
    share = 1 - (np.arccos(offsets) - offsets * np.sqrt(1 - offsets**2)) / np.pi
    right.plot(offsets, share, color=GREY, label="segment of a circle")
    radius, axis = float(beam.diameter_m(np.array(5.0))) / 2, PinholeSensor(fov_deg=1e-5, width=8, height=8)
    for n_rays, colour in ((16, BLUE), (196, RED)):
        effects = Effects(footprint=replace(beam, n_rays=n_rays))
        for offset in np.linspace(-0.95, 0.95, 20):
            edge = walls((5.0, -2, 5.0, offset * radius), (6.0, -3, 6.0, 3))
            taken = scan_scene(edge, EAST, axis, effects=effects, rng=3)
            near = np.where(taken.ranges < 5.5, taken.truth.n_rays, 0) / n_rays  # type: ignore[union-attr]
            right.errorbar(offset, near.mean(), near.std(), color=colour, fmt=".", ms=5, lw=1)
        right.plot([], [], ".", color=colour, label=f"{n_rays} rays, mean and deviation of 64 beams")
    right.set(xlabel="offset of the edge, radii of the beam", ylabel="share of the near return")
    right.set_title("a beam at the edge of a plate", fontsize=9)
    right.legend(fontsize=8, loc="upper left")
    save(figure, folder, "echoes")


PICTURES = (noise, divergence, echoes, incidence, two_paths, quantisation, dropout, pointing)


def main(arguments: list[str] | None = None) -> None:
    """Write the pictures."""
    global SCALE
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--docs", type=Path, default=Path(__file__).resolve().parents[1] / "docs")
    parser.add_argument("--scale", type=float, default=1.0)
    asked = parser.parse_args(arguments)
    SCALE = asked.scale
    folder = asked.docs / "pictures"
    folder.mkdir(parents=True, exist_ok=True)
    for picture in PICTURES:
        picture(folder)


if __name__ == "__main__":
    main()
