# SPDX-License-Identifier: MIT
"""Walls before and after flattening, as heights and as shaded relief; planes of a range image likewise.

Run it with `python examples/plot_flattening.py [SCAN] [--docs FOLDER] [-o FOLDER]`: it draws generated
walls that the method was not tuned on into FOLDER/pictures (default: docs), the pictures of
docs/how-it-works/flattening.md. With SCAN, an organised scan or `FOLDER#k` for a frame of an RGB-D folder, it
flattens the planes found in its mesh instead, prints a line a plane and what became of the mesh, and draws
it into `-o` (default: out/flattening). Pictures of others' data stay out of the docs.
"""

import argparse
import time
from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
from matplotlib import pyplot as plt

from benchmarks.cases.relief import make_wall
from benchmarks.suites.flattening import score
from completion.boundary.range_mesh import mesh_range_image
from completion.flattening.flat import RegionKind
from completion.flattening.mesh_movement import new_crossings
from completion.flattening.pipeline import flatten_heights, flatten_mesh
from completion.observe.observation import observe
from completion.segmentation.pipeline import segment
from completion.segmentation.regions import SegmentationOptions
from scenes import read_scan
from scenes.scan.range_image import RangeImage

ROOT = Path(__file__).resolve().parents[1]
SEEDS = (0, 3, 5, 6)
LEAST = 3000  # pixels of a plane that is flattened
REACH = 4.0  # footprints and sd of noise that a face may span


def shaded(heights: np.ndarray, cell: float) -> np.ndarray:
    """Light from the upper left on heights, 4 times exaggerated."""
    down, right = np.gradient(4 * heights, cell)
    normal = np.stack([-right, -down, np.ones_like(right)])
    light = np.array([-0.5, -0.5, 0.7])
    shade: np.ndarray = np.tensordot(light, normal / np.linalg.norm(normal, axis=0), 1)
    return shade


def draw_walls(seeds: tuple[int, ...], path: Path) -> None:
    """Draw the walls of some seeds as measured, as they are, and flattened."""
    figure, axes = plt.subplots(len(seeds), 5, figsize=(15, 2.6 * len(seeds)), squeeze=False)
    for row, seed in zip(axes, seeds, strict=True):
        wall = make_wall(seed, held_out=True)
        flat = flatten_heights(wall.heights, wall.cell_m)
        print(score(wall, flat, seed), flush=True)
        for axis, heights in zip(row[:3], (wall.heights, wall.relief, flat.heights), strict=True):
            axis.imshow(1e3 * heights, cmap="RdBu_r", vmin=-12, vmax=12)
        for axis, heights in zip(row[3:], (wall.heights, flat.heights), strict=True):
            axis.imshow(shaded(heights, wall.cell_m), cmap="gray", vmin=0, vmax=1)
        row[0].set_ylabel(f"{wall.layout}, {wall.kind}".replace("_", " "))
        for axis in row:
            axis.set_xticks([])
            axis.set_yticks([])
    titles = ("measured, -12 to 12 mm", "as it is", "flattened", "measured, shaded", "flattened, shaded")
    for axis, title in zip(axes[0], titles, strict=True):
        axis.set_title(title)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=60, bbox_inches="tight", pil_kwargs={"optimize": True})
    plt.close(figure)


def flatten_scan(scan: RangeImage, path: Path) -> None:
    """Mesh a range image, flatten the planes found in it along its rays, and draw it before and after."""
    seen = observe(scan, scan.world_from_sensor)
    regions = [one for one in segment(seen, SegmentationOptions()) if one.n_pixels >= LEAST]
    labels = np.zeros(seen.scan.shape, np.int64)
    for number, region in enumerate(regions, 1):
        labels[region.pixels.mask] = number
    fits = [region.fit for region in regions]
    points = seen.points_at(np.arange(labels.size)).reshape(*labels.shape, 3)
    valid, footprint = (
        seen.valid,
        np.where(seen.valid, seen.scan.ranges, 0) * seen.scan.projection.pixel_angle,
    )
    longest = REACH * (footprint + seen.noise.deviation(seen.scan.ranges.ravel()).reshape(labels.shape))
    faces = mesh_range_image(points, valid, longest, seen.scan.origin)
    number = np.cumsum(valid.ravel()) - 1
    vertices, faces, labels = points[valid], number[faces].astype(np.int32), labels[valid]

    begin = time.process_time()
    flat = flatten_mesh(vertices, faces, labels, fits, origin=seen.scan.origin)
    spent = time.process_time() - begin
    for one in flat.surfaces:
        own, plane = labels == one.label, fits[one.label - 1].surface
        before, after = (1e3 * np.std(plane.distance(at[own])) for at in (vertices, flat.vertices))
        kept = sum(region.kind is RegionKind.RELIEF for region in one.regions)
        print(
            f"plane {one.label}: {own.sum()} pixels, cells {1e3 * one.cell_m:.1f} mm, "
            f"rms {before:.2f} -> {after:.2f} mm, "
            f"ripple {1e3 * one.ripple_sd_m:.2f}, noise {1e3 * one.noise_sd_m:.2f} mm, "
            f"{kept} reliefs on {100 * np.mean(flat.is_relief[own]):.1f} % {one.reason}"
        )
    normals = [
        np.cross(at[faces[:, 1]] - at[faces[:, 0]], at[faces[:, 2]] - at[faces[:, 0]])
        for at in (vertices, flat.vertices)
    ]
    turned = int(np.sum(np.sum(normals[0] * normals[1], axis=1) <= 0))
    crossing = int(new_crossings(vertices, flat.vertices, faces, np.ones(len(faces), bool)).sum())
    print(
        f"{len(faces)} faces: {turned} turned over, {crossing} cross newly; {flat.is_held.sum()} held; "
        f"moved by {1e3 * np.median(flat.moved_m):.2f} mm in the median, {1e3 * flat.moved_m.max():.1f} "
        f"at most; {spent:.0f} CPU s"
    )
    pictures = []
    light = seen.scan.world_from_sensor.rotation @ [0.6, -0.6, 0.53]
    for at, title in zip(normals, ("before", "after"), strict=True):
        shade = np.full(valid.size, np.nan)
        unit = at / np.maximum(np.linalg.norm(at, axis=1), 1e-30)[:, None]
        shade[np.flatnonzero(valid)[faces[:, 0]]] = np.abs(unit @ light)
        pictures.append((title, shade.reshape(valid.shape)))
    figure, axes = plt.subplots(1, 2, figsize=(16, 6))
    for axis, (title, shade) in zip(axes, pictures, strict=True):
        axis.imshow(shade, cmap="gray")
        axis.set_title(title)
        axis.axis("off")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=70, bbox_inches="tight")
    plt.close(figure)


def main(arguments: list[str] | None = None) -> None:
    """Draw generated walls, or a scan."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scan", nargs="?", help="an organised scan; without one, generated walls are drawn")
    parser.add_argument("--docs", type=Path, default=ROOT / "docs")
    parser.add_argument("--seeds", type=int, nargs="+", default=SEEDS, help="of the walls")
    parser.add_argument("-o", "--out", type=Path, default=ROOT / "out/flattening")
    asked = parser.parse_args(arguments)
    if asked.scan is None:
        draw_walls(tuple(asked.seeds), asked.docs / "pictures/flattening_walls.png")
    else:
        flatten_scan(read_scan(asked.scan), asked.out / "scan.png")


if __name__ == "__main__":
    main()
