# SPDX-License-Identifier: MIT
"""Score fills of brick, grass and gravel against what was cut out, with targets and verdicts; write pictures.

Crop [128:384] of scikit-image's textures, hole [96:160]. "distance" is the sliced Wasserstein distance of the
fill to the truth over the mean distance of the truth to other pieces of the whole image; "seam" is relative
to the truth's; "phase" is how far the fill is out of step with the lattice around it, in periods; "verbatim"
the share of patches copied in one piece; "SSIM" is said because it misleads, beside that of a blur (OpenCV's
Telea); "shaded" is the same hole under a lamp's light, filled with shading apart: distance to the truth in
8-bit levels ("lit as it is": without). A mean meets its target when it exceeds it by at most two standard
errors.

    python examples/score_textures.py [--seeds 30] [--window 11] [-o out/textures]
"""

import argparse
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image
from skimage import data
from skimage.metrics import structural_similarity

from texture import (
    Lattice,
    fill,
    fill_surface,
    find_lattice,
    measure_distance,
    measure_phase_error,
    measure_seam,
    measure_verbatim_share,
)

HOLE = np.s_[96:160, 96:160]
CROP = np.s_[128:384, 128:384]
PIECES = [(row, column) for row in (0, 64, 384, 448) for column in (0, 150, 300, 448)]
TARGETS = {
    ("brick", "paper", "distance"): 0.88,
    ("grass", "paper", "distance"): 1.09,
    ("gravel", "paper", "distance"): 1.12,
    ("brick", "window", "distance"): 0.65,
    ("brick", "window", "phase"): 0.1,
    ("grass", "surface", "shaded"): 7.0,
} | {(name, order, "seam"): 1.0 for name in ("brick", "grass", "gravel") for order in ("paper", "window")}


def report(name: str, order: str, measure: str, values: list[float]) -> None:
    """Print the mean over seeds, its standard error, the target if there is one, and whether it is met."""
    mean, error = float(np.mean(values)), float(np.std(values, ddof=min(1, len(values) - 1)))
    error /= np.sqrt(len(values))
    target = TARGETS.get((name, order, measure))
    verdict = ""
    if target is not None:
        verdict = f"target {target:5.2f}  {'met' if mean <= target + 2 * error else 'MISSED'}"
    print(f"{name:8}{order:9}{measure:13}{mean:7.3f} +- {error:5.3f}  {verdict}", flush=True)


def light(shape: tuple[int, int]) -> NDArray[np.float64]:
    """Return the light of a lamp from the upper left."""
    rows, columns = np.indices(shape) / max(shape)
    return np.asarray(np.exp(0.5 - 1.1 * rows - 0.6 * columns + 0.4 * rows * columns))


def score_orders(
    name: str,
    full: NDArray[np.uint8],
    hole: NDArray[np.bool_],
    lattice: Lattice,
    arguments: argparse.Namespace,
) -> None:
    """Fill in both orders with each seed; print the scores and write the last fill."""
    image = full[CROP]
    others = [measure_distance(full[r : r + 64, c : c + 64], image[HOLE]) for r, c in PIECES]
    for order in ("paper", "window"):
        scores: dict[str, list[float]] = {
            "distance": [], "seam": [], "phase": [], "verbatim": [], "SSIM": []
        }  # fmt: skip
        for seed in range(arguments.seeds):
            made = fill(image, hole, window=arguments.window, order=order, rng=seed)
            distance = measure_distance(made.image[HOLE], image[HOLE])
            scores["distance"].append(distance / float(np.mean(others)))
            scores["seam"].append(measure_seam(made.image, hole, image))
            scores["phase"].append(measure_phase_error(made.image, hole, lattice=lattice))
            scores["verbatim"].append(measure_verbatim_share(made.source_rows, made.source_cols, hole))
            scores["SSIM"].append(structural_similarity(made.image[HOLE], image[HOLE]))
        for measure, values in scores.items():
            if np.isfinite(values).all():
                report(name, order, measure, values)
        write(arguments.out / f"{name}-{order}.png", np.where(hole, 0, image), made.image, image)
    blur = cv2.inpaint(image, hole.astype(np.uint8), 3, cv2.INPAINT_TELEA)
    report(name, "Telea", "distance", [measure_distance(blur[HOLE], image[HOLE]) / float(np.mean(others))])
    report(name, "Telea", "seam", [measure_seam(blur, hole, image)])
    report(name, "Telea", "SSIM", [structural_similarity(blur[HOLE], image[HOLE])])


def score_shaded(
    name: str, image: NDArray[np.uint8], hole: NDArray[np.bool_], arguments: argparse.Namespace
) -> None:
    """Fill under a lamp's light, with and without shading apart; print distances, write the last fills."""
    shaded = np.rint(np.clip(image * light(image.shape), 0, 255)).astype(np.uint8)
    found: dict[str, list[float]] = {"shaded": [], "lit as it is": []}
    for seed in range(arguments.seeds):
        apart = fill_surface(shaded, hole, window=arguments.window, rng=seed).image
        plain = fill(shaded, hole, window=arguments.window, order="window", rng=seed).image
        found["shaded"].append(measure_distance(apart[HOLE], shaded[HOLE]))
        found["lit as it is"].append(measure_distance(plain[HOLE], shaded[HOLE]))
    for measure, values in found.items():
        report(name, "surface", measure, values)
    write(arguments.out / f"{name}-shaded.png", np.where(hole, 0, shaded), plain, apart, shaded)


def write(path: Path, *pictures: NDArray[np.generic]) -> None:
    """Write grey pictures side by side."""
    Image.fromarray(np.hstack(pictures).astype(np.uint8)).save(path)


def main() -> None:
    """Score and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=30)
    parser.add_argument("--window", type=int, default=11)
    parser.add_argument("-o", "--out", type=Path, default=Path("out/textures"))
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    print(f"{arguments.seeds} seeds, window {arguments.window}")
    for name in ("brick", "grass", "gravel"):
        full = getattr(data, name)()
        hole = np.zeros(full[CROP].shape, dtype=np.bool_)
        hole[HOLE] = True
        score_orders(name, full, hole, find_lattice(full[CROP], ~hole), arguments)
        score_shaded(name, full[CROP], hole, arguments)


if __name__ == "__main__":
    main()
