# SPDX-License-Identifier: MIT
"""Compare the texture engine with its readable reference, pixel by pixel, over the whole matrix.

3 textures and 3 periodic tiles (exact ties), 1 and 3 channels, windows 5, 11, 15, 23, 2 seeds, 1 and 2
threads, both orders, with and without wrap: images and source indices must be identical. Takes minutes,
because the reference is slow; the gate runs a thinned matrix.

    python examples/check_texture_engine.py [--size 48] [--hole 7]
"""

import argparse
from itertools import product

import numpy as np
from numpy.typing import NDArray
from skimage import data

from texture import fill


def cut(name: str, size: int, n_channels: int) -> NDArray[np.uint8]:
    """Return a square piece of a texture, or of a periodic one ("ties 3" has period 3)."""
    if name.startswith("ties"):
        period = int(name.split()[1])
        tile = np.random.default_rng(period).integers(0, 256, (period, period, n_channels), dtype=np.uint8)
        return np.tile(tile, (-(-size // period), -(-size // period), 1))[:size, :size]
    full = getattr(data, name)()
    return np.stack([full[140 : 140 + size, 130 + k : 130 + k + size] for k in range(n_channels)], axis=2)


def main() -> None:
    """Compare, and print how many cases agree."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", type=int, default=48)
    parser.add_argument("--hole", type=int, default=7)
    arguments = parser.parse_args()
    n_cases, n_different = 0, 0
    for name, n_channels, window, seed, order, wraps in product(
        ("brick", "grass", "gravel", "ties 2", "ties 5", "ties 8"),
        (1, 3),
        (5, 11, 15, 23),
        (0, 1),
        ("paper", "window"),
        (False, True),
    ):
        image = cut(name, arguments.size, n_channels)
        hole = np.zeros(image.shape[:2], dtype=np.bool_)
        first = 0 if wraps else (arguments.size - arguments.hole) // 2
        hole[first : first + arguments.hole, first : first + arguments.hole] = True
        options = {"window": window, "order": order, "wrap": (wraps, wraps), "rng": seed}
        expected = fill(image, hole, **options, engine="reference")
        for n_threads in (1, 2):
            found = fill(image, hole, **options, n_threads=n_threads)
            n_cases += 1
            pairs = [
                (found.image, expected.image),
                (found.source_rows, expected.source_rows),
                (found.source_cols, expected.source_cols),
                (found.error, expected.error),
            ]
            if not all(np.array_equal(a, b) for a, b in pairs):
                n_different += 1
                print("different:", name, n_channels, options, n_threads)
    print(f"{n_cases - n_different} of {n_cases} cases identical")


if __name__ == "__main__":
    main()
