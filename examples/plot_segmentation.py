# SPDX-License-Identifier: MIT
"""Scans beside the surfaces found in them, and beside the labels that people gave them where there are any.

Run it with `python examples/plot_segmentation.py [SCAN...] [-o FOLDER]`: it writes a picture a scan (the
colours, the file's labels, the surfaces found; round ones with their radius in mm) and prints, for each
surface, kind, parts joined, pixels, residual, and shares in the labels. Without scans it takes the six
labelled ones of the data that CONTRIBUTING.md speaks of. Pictures of others' data stay out of the docs.
"""

import argparse
import os
from collections.abc import Iterator
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pypcd4

mpl.use("Agg")
from matplotlib import pyplot as plt
from scipy.ndimage import distance_transform_cdt

from completion.merging.merged_surface import MergedSurface
from completion.merging.pipeline import merge
from completion.observe.observation import observe
from completion.observe.tolerance import EvidenceOptions
from completion.segmentation.pipeline import segment
from completion.segmentation.regions import SegmentationOptions
from scenes import Cylinder, RangeImage, read_scan

ROOT = Path(__file__).resolve().parents[1]
LABELLED = [f"range/mOSD/learn{k}.pcd" for k in (0, 17, 25, 29, 33, 39)]


def find_surfaces(scan: RangeImage) -> list[MergedSurface]:
    """Segment a scan and join what is one surface, as `complete` does."""
    seen = observe(scan, scan.world_from_sensor)
    return merge([seen], [segment(seen, SegmentationOptions())], EvidenceOptions().tolerance())


def read_labels(path: Path) -> np.ndarray | None:
    """Return the labels (rows, columns) of a PCD file, None where it has none."""
    if path.suffix != ".pcd":
        return None
    cloud = pypcd4.PointCloud.from_path(path)
    if "label" not in cloud.fields:
        return None
    return cloud.pc_data["label"].reshape(cloud.metadata.height, cloud.metadata.width).astype(int)


def rows(surfaces: list[MergedSurface], labels: np.ndarray | None) -> Iterator[str]:
    """Yield a line of the table for each surface."""
    for number, one in enumerate(surfaces, start=1):
        shape = one.fit.surface
        radius = f"{1e3 * shape.radius:.1f}" if isinstance(shape, Cylinder) else ""
        shares = ""
        if labels is not None:
            label, count = np.unique(one.pixels[0].pick(labels), return_counts=True)
            named = zip(label.tolist(), count / count.sum(), strict=True)
            shares = ", ".join(f"{100 * share:.0f} % on {k}" for k, share in named if share >= 0.01)
        cells = [number, shape.kind, radius, one.n_parts, one.n_pixels, f"{1e3 * one.fit.rms:.2f}", shares]
        yield f"| {' | '.join(map(str, cells))} |"


def draw(scan: RangeImage, surfaces: list[MergedSurface], labels: np.ndarray | None, path: Path) -> None:
    """Write the picture of one scan."""
    found = np.zeros(scan.shape, int)
    for number, one in enumerate(surfaces, start=1):
        found[one.pixels[0].mask] = number
    colours = np.random.default_rng(8).uniform(0.25, 1, (max(found.max(), 99) + 1, 3))
    colours[0] = 0
    depth = np.repeat(1 / np.maximum(scan.ranges, 0.3)[..., None] * 0.3, 3, axis=2)
    images = [depth if scan.colour is None else scan.colour, colours[found]]
    if labels is not None:
        images.insert(1, colours[labels % 100])
    figure, axes = plt.subplots(1, len(images), figsize=(6.4 * len(images), 5), layout="constrained")
    for ax, image in zip(axes, images, strict=True):
        ax.imshow(image)
        ax.axis("off")
    for number, one in enumerate(surfaces, start=1):
        depths = distance_transform_cdt(one.pixels[0].mask)
        row, column = np.unravel_index(int(depths.argmax()), depths.shape)
        shape = one.fit.surface
        name = f"r {1e3 * shape.radius:.0f}" if isinstance(shape, Cylinder) else str(number)
        axes[-1].text(column, row, name, ha="center", va="center", fontsize=9)
    figure.savefig(path, dpi=80)
    plt.close(figure)


def main(arguments: list[str] | None = None) -> None:
    """Segment, draw and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scans", nargs="*", type=Path)
    parser.add_argument("-o", "--out", type=Path, default=ROOT / "out/segmentation")
    asked = parser.parse_args(arguments)
    data = Path(os.environ.get("UNSEEN_DATA", ROOT.parent / "shared/data"))
    scans = asked.scans or [data / name for name in LABELLED]
    missing = [path for path in scans if not path.exists()]
    if missing:
        print(f"skipped: there is no {missing[0]}; set UNSEEN_DATA to the folder with the real data")
        return
    asked.out.mkdir(parents=True, exist_ok=True)
    for path in scans:
        scan, labels = read_scan(path), read_labels(path)
        surfaces = find_surfaces(scan)
        draw(scan, surfaces, labels, asked.out / f"{path.stem}.png")
        print(
            f"\n{path.stem}\n\n| | kind | radius, mm | parts | pixels | residual, mm | labels |\n"
            + "|-" * 7
            + "|"
        )
        print(*rows(surfaces, labels), sep="\n")


if __name__ == "__main__":
    main()
