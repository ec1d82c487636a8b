# SPDX-License-Identifier: MIT
"""Points of a blend between two walls and an end, and the patch that joins all three exactly.

Run it with `python examples/plot_patches.py [-o FOLDER]`: it writes patches.png and prints what became of the
joins, with and without them.
"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import LightSource

from completion import Boundary, fit_patch
from completion.fitting.patches.pipeline import measured_join
from scenes.surfaces.catalogue import Plane

ROOT = Path(__file__).resolve().parents[1]
SIGMA = 0.3  # mm
BETWEEN = {
    "u0": Boundary(Plane((0, 0, 0), (1, 0, 0)), "tangent"),
    "u1": Boundary(Plane((0, 0, 0), (0, 0, 1)), "tangent"),
    "v0": Boundary(Plane((0, 0, 0), (0, 1, 0)), "orthogonal"),
}


def blend(n: int, rng: np.random.Generator) -> np.ndarray:
    """Points (n, 3) of a fillet whose radius changes, with a wave, off by SIGMA along the normal; mm."""

    def at(turn: np.ndarray, y: np.ndarray) -> np.ndarray:
        radius, wave = 40 + 15 * (y / 100) ** 2, 4 * np.sin(2 * turn) ** 2 * np.cos(np.pi * y / 50)
        x, z = radius * (1 - np.cos(turn)), radius * (1 - np.sin(turn))
        return np.column_stack([x + wave * np.cos(turn), y, z + wave * np.sin(turn)])

    turn, y = rng.uniform(0, np.pi / 2, n), rng.uniform(0, 100, n)
    across = np.cross(at(turn + 1e-5, y) - at(turn - 1e-5, y), at(turn, y + 1e-5) - at(turn, y - 1e-5))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return at(turn, y) + SIGMA * rng.normal(size=(n, 1)) * across


def main(arguments: list[str] | None = None) -> None:
    """Fit the blend, draw it and tell how its boundaries are met."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--out", type=Path, default=ROOT / "docs/pictures")
    out = parser.parse_args(arguments).out
    out.mkdir(parents=True, exist_ok=True)
    points = blend(8000, np.random.default_rng(0))
    joined, loose = fit_patch(points, BETWEEN), fit_patch(points, {})
    for side, one in joined.joins.items():
        print(f"{side}: {one.angle:.0e} rad, {one.gap:.0e} mm")
    print(f"rms {joined.rms:.3f} mm, {joined.ratio:.4f} of that of a patch joined to nothing")
    print(f"joined to nothing: {max(map(float, np.degrees(loose_angles(loose)))):.1f} deg at most")

    n = 61
    places = np.linspace(0, 1, n)
    uv = np.stack(np.meshgrid(places, places, indexing="ij"), axis=-1).reshape(-1, 2)
    grid = joined.patch.at(uv).reshape(n, n, 3)
    deviation = 1000 * joined.deviation(uv).reshape(n, n)
    figure = plt.figure(figsize=(12, 4.4), dpi=110)
    axes = [figure.add_subplot(1, 3, k + 1, projection="3d") for k in range(3)]
    axes[0].scatter(*points[::2].T, s=1.2, c=points[::2, 0], cmap="viridis", linewidths=0)
    most = float(np.quantile(deviation, 0.98))
    colours = plt.get_cmap("magma")(np.clip(deviation / most, 0, 1))
    for ax, paint in ((axes[1], None), (axes[2], colours)):
        light = LightSource(azdeg=300, altdeg=40)
        look = {"color": "#d9894a"} if paint is None else {"facecolors": paint, "shade": False}
        ax.plot_surface(*grid.transpose(2, 0, 1), rcount=n, ccount=n, lightsource=light, linewidth=0, **look)
    edges = grid[0], grid[-1]  # up the wall, and out on the floor
    for ax in axes[1:]:
        for edge, outward in zip(edges, (2, 0), strict=True):
            far = edge.copy()
            far[:, outward] = 75.0
            sheet = np.stack([edge, far])
            ax.plot_surface(*sheet.transpose(2, 0, 1), color="#8fb3d9", alpha=0.6, shade=False)
    for ax, title in zip(
        axes, ("points, off by .3 mm", "the patch between its planes", "its standard deviation"),
        strict=True,
    ):  # fmt: skip
        ax.set(xlim=(0, 80), ylim=(0, 100), zlim=(0, 80), title=title)
        ax.set_box_aspect((80, 100, 80), zoom=1.0)
        ax.set_axis_off()
        ax.view_init(28, 38)
    scale = plt.cm.ScalarMappable(plt.Normalize(0, most), "magma")
    figure.colorbar(scale, ax=axes[2], shrink=0.6, label="um", pad=0.02)
    figure.subplots_adjust(0.0, 0.0, 0.97, 0.92, 0.02)
    figure.savefig(out / "patches.png")
    plt.close(figure)


def loose_angles(loose) -> list[float]:
    """The largest angles, radians, between the planes and the boundaries nearest to them."""
    found = []
    for one in BETWEEN.values():
        joins = [measured_join(loose.patch, side, one) for side in ("u0", "u1", "v0", "v1")]
        found.append(min(joins, key=lambda join: join.gap).angle)
    return found


if __name__ == "__main__":
    main()
