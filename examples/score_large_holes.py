# SPDX-License-Identifier: MIT
"""Large holes filled exactly and by a budget, against what was cut out; a table and a picture.

scikit-image's brick, grass and gravel, and with UNSEEN_DATA (default ../shared/data) pebbles, bricks and a
wooden floor at 512 pixels, crop [64:448], holes of 112 and 176 pixels, and of 112 around which 10 pixels are
known, 4,880 samples. The window is chosen for each. Means over the seeds: processor's seconds, sliced
Wasserstein distance to the truth in 8-bit levels, seam relative to the truth's, phase error in periods
(`measure_phase_error`), error of the mean colour in levels.

    python examples/score_large_holes.py [--seeds 4] [-o docs]
"""

import argparse
import os
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from skimage import data

from texture import fill, find_lattice, measure_distance, measure_phase_error, measure_seam

CASES = ((112, 384), (176, 384), (112, 10))  # pixels: side of the hole, and how far around it all is known
CROP = np.s_[64:448, 64:448]
OTHERS = {
    "pebbles": "sh3d_pebbles.jpg", "small bricks": "sh3d_smallRedBricks.jpg", "wood": "sh3d_woodenFloor.jpg",
}  # fmt: skip
BUILT_IN = ("brick", "grass", "gravel")


def textures(folder: Path) -> dict[str, NDArray[np.uint8]]:
    """Return the images (384, 384) or (384, 384, 3)."""
    found = {name: np.asarray(getattr(data, name)())[CROP] for name in BUILT_IN}
    for name, file in OTHERS.items():
        if (folder / file).exists():
            image = Image.open(folder / file).convert("RGB")
            scale = 512 / min(image.size)
            size = (round(image.width * scale), round(image.height * scale))
            found[name] = np.asarray(image.resize(size, Image.Resampling.LANCZOS))[CROP]
    return found


def score(
    image: NDArray[np.uint8], side: int, rim: int, search: str, seeds: int
) -> tuple[list[float], NDArray[np.uint8]]:
    """Return seconds, distance, seam, phase and colour error, means over the seeds, and the last fill."""
    hole, known = np.zeros((2, *image.shape[:2]), dtype=np.bool_)
    first, last = (384 - side) // 2, (384 + side) // 2
    hole[first:last, first:last] = True
    known[max(0, first - rim) : last + rim, max(0, first - rim) : last + rim] = True
    known &= ~hole
    emptied, lattice, rows = image.copy(), find_lattice(image, ~hole), []
    emptied[hole] = 0
    for seed in range(seeds):
        begun = time.process_time()
        filled = fill(emptied, hole, known=known, search=search, order="window", rng=seed, n_threads=1)  # type: ignore[arg-type]
        seconds = time.process_time() - begun
        made = np.where(hole[..., None] if image.ndim == 3 else hole, filled.image, image)
        seam = measure_seam(made, hole) / measure_seam(image, hole)
        colour = np.abs(made[hole].mean(axis=0) - image[hole].mean(axis=0)).mean()
        phase = measure_phase_error(made, hole, ~hole, lattice)
        rows.append([seconds, measure_distance(made, image, hole, hole), seam, float(phase), float(colour)])
    return list(np.mean(rows, axis=0)), made


def main() -> None:
    """Print the table, write the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("-o", "--out", type=Path, default=Path("docs"))
    arguments = parser.parse_args()
    folder = Path(os.environ.get("UNSEEN_DATA", "../shared/data")) / "textures"
    strips = []
    print("| texture | hole | search | seconds | distance | seam | phase | colour |")
    print("|---|---|---|---|---|---|---|---|")
    for name, image in textures(folder).items():
        for side, rim in CASES:
            fills = []
            for search in ("exact", "budget"):
                (seconds, *found), made = score(image, side, rim, search, arguments.seeds)
                cells = " | ".join("-" if np.isnan(value) else f"{value:.2f}" for value in found)
                print(f"| {name} | {side}, {rim} known | {search} | {seconds:.2f} | {cells} |", flush=True)
                fills.append(made)
            if name in BUILT_IN and side == 176:
                strips.append(np.concatenate(fills, axis=0))
    path = arguments.out / "pictures" / "texture_large_holes.jpg"
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.concatenate(strips, axis=1)).save(path, quality=80)
    print(f"{path}: exact above, by a budget below")


if __name__ == "__main__":
    main()
