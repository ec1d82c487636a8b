# SPDX-License-Identifier: MIT
"""Score fills of brick, grass and gravel against what was cut out, and write the pictures.

Crop [128:384] of scikit-image's textures, hole [96:160]. "distance" is the sliced Wasserstein distance of the
fill to the truth over the mean distance of the truth to other pieces of the whole image; "seam" is relative
to the truth's; "shaded" is the same hole under a lamp's light, filled with and without shading apart:
distance to the truth in 8-bit levels.

    python examples/score_textures.py [--seeds 6] [--window 11] [-o out/textures]
"""

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from skimage import data

from texture import fill, fill_surface, measure_distance, measure_seam, measure_verbatim_share

HOLE = np.s_[96:160, 96:160]
CROP = np.s_[128:384, 128:384]
PIECES = [(row, column) for row in (0, 64, 384, 448) for column in (0, 150, 300, 448)]


def score(filled: NDArray[np.uint8], full: NDArray[np.uint8]) -> float:
    """Return the fill's distance to the truth relative to that of other pieces."""
    truth = full[CROP][HOLE]
    others = [measure_distance(full[r : r + 64, c : c + 64], truth) for r, c in PIECES]
    return measure_distance(filled[HOLE], truth) / float(np.mean(others))


def light(shape: tuple[int, int]) -> NDArray[np.float64]:
    """Return the light of a lamp from the upper left."""
    rows, columns = np.indices(shape) / max(shape)
    return np.asarray(np.exp(0.5 - 1.1 * rows - 0.6 * columns + 0.4 * rows * columns))


def main() -> None:
    """Score and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("--window", type=int, default=11)
    parser.add_argument("-o", "--out", type=Path, default=Path("out/textures"))
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    for name in ("brick", "grass", "gravel"):
        full = getattr(data, name)()
        image = full[CROP]
        hole = np.zeros(image.shape, dtype=np.bool_)
        hole[HOLE] = True
        for order in ("paper", "window"):
            scores = []
            for seed in range(arguments.seeds):
                made = fill(image, hole, window=arguments.window, order=order, rng=seed)
                verbatim = measure_verbatim_share(made.source_rows, made.source_cols, hole)
                scores.append((score(made.image, full), measure_seam(made.image, hole, image), verbatim))
            mean = np.mean(scores, axis=0)
            error = np.std(scores, axis=0) / np.sqrt(len(scores))
            print(f"{name:7}{order:7} distance {mean[0]:.2f} +- {error[0]:.2f}  seam {mean[1]:.2f}  "
                  f"verbatim {mean[2]:.2f}", flush=True)  # fmt: skip
            Image.fromarray(np.hstack([np.where(hole, 0, image), made.image, image]).astype(np.uint8)).save(
                arguments.out / f"{name}-{order}.png"
            )
        shaded = np.rint(np.clip(image * light(image.shape), 0, 255)).astype(np.uint8)
        plain = fill(shaded, hole, window=arguments.window, order="window", rng=0).image
        apart = fill_surface(shaded, hole, window=arguments.window, rng=0).image
        before, after = (measure_distance(filled[HOLE], shaded[HOLE]) for filled in (plain, apart))
        print(
            f"{name:7}shaded  {before:.1f} levels off the truth, {after:.1f} with shading apart", flush=True
        )
        Image.fromarray(np.hstack([np.where(hole, 0, shaded), plain, apart, shaded])).save(
            arguments.out / f"{name}-shaded.png"
        )


if __name__ == "__main__":
    main()
