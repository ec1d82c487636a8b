# SPDX-License-Identifier: MIT
"""Texture filling beside floors and peers in one run, speed and quality: `python benchmarks/textures.py`.

Seconds are the processor's on one thread, the best of a few rounds; with two threads those on the clock. The
floor is what a brute-force search costs with every distance taken by float32 matrix products alone, masked
templates: 2 * (2 window**2) operations for each template and position. "distance" is the sliced Wasserstein
distance of the fill to what was cut out, over that between what was cut out and other pieces of the image (1:
as like as another piece); "seam" is the border's distance to the nearest known patch over that of the truth.
Both are means over seeds 0, 1, 2.
"""

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"
os.environ["OMP_NUM_THREADS"] = "1"  # of the peers

import argparse
import resource
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from skimage import data
from texture_peers import Image8, list_peers, time_match_template, time_products, time_transforms

from texture import fill, grow, measure_distance, measure_seam

WINDOWS = (11, 23)
SEEDS = (0, 1, 2)
PIECES = [(row, column) for row in (0, 64, 384, 448) for column in (0, 150, 300, 448)]


def best_seconds(
    work: Callable[[], object], rounds: int, clock: Callable[[], float] = time.process_time
) -> float:
    """Return the shortest of a few runs."""
    seconds = []
    for _ in range(rounds):
        start = clock()
        work()
        seconds.append(clock() - start)
    return min(seconds)


def cut_hole(size: int, side: int) -> tuple[Image8, NDArray[np.bool_]]:
    """Return a crop of brick and a square hole in it."""
    image = data.brick()[128 : 128 + size, 128 : 128 + size] if size < 512 else data.brick()
    hole = np.zeros(image.shape, dtype=np.bool_)
    first = 96 if size == 256 else (size - side) // 2
    hole[first : first + side, first : first + side] = True
    return image, hole


def rate(make: Callable[[int], Image8], image: Image8, hole: NDArray[np.bool_]) -> str:
    """Return distance and seam of fills, relative to the truth, as text."""
    side = int(np.sqrt(np.count_nonzero(hole)))
    corner = np.argwhere(hole)[0]
    here = np.s_[corner[0] : corner[0] + side, corner[1] : corner[1] + side]
    others = [data.brick()[row : row + side, column : column + side] for row, column in PIECES]
    scale = np.mean([measure_distance(other, image[here]) for other in others])
    fills = [make(seed) for seed in SEEDS]
    distance = np.mean([measure_distance(filled[here], image[here]) for filled in fills]) / scale
    seam = np.mean([measure_seam(np.where(hole, filled, image), hole, image) for filled in fills])
    return f"distance {distance:5.2f}  seam {seam:5.2f}"


def bench_hole(window: int, rounds: int) -> None:
    """Fill 64 x 64 in 256 x 256 by all means."""
    image, hole = cut_hole(256, 64)
    n_templates = int(hole.sum())
    n_positions = (256 - window + 1) ** 2 - (64 + window - 1) ** 2
    print(f"\nhole 64 x 64 in 256 x 256 of brick, window {window}")
    for order in ("paper", "window"):

        def make(seed: int, n_threads: int = 1, order: str = order) -> Image8:
            return np.asarray(
                fill(image, hole, window=window, order=order, rng=seed, n_threads=n_threads).image
            )

        one = best_seconds(lambda: make(0), rounds)
        one_clock = best_seconds(lambda: make(0), rounds, time.perf_counter)
        two_clock = best_seconds(lambda: make(0, 2), rounds, time.perf_counter)
        tell(f"exact Efros-Leung, {order} order", one, rate(make, image, hole))
        print(f"{'':36}two threads {two_clock:.2f} s on the clock, {two_clock / one_clock:.2f} of one")
        if order == "paper":
            floor = time_products(window, n_templates, n_positions)
            tell("float32 matrix products (the floor)", floor, f"we take {one / floor:.2f} of it")
    tell("FFT, brute force", time_transforms(image, window, n_templates), "")
    tell("masked matchTemplate, brute force", time_match_template(image, window, n_templates), "")
    for peer in list_peers():
        if peer.fill is None:
            print(f"{peer.name:36}{peer.reason}")
        else:
            seconds = best_seconds(lambda peer=peer: peer.fill(image, hole, window, 0), rounds)
            quality = rate(lambda seed, peer=peer: peer.fill(image, hole, window, seed), image, hole)
            tell(peer.name, seconds, quality)


def bench_rest(rounds: int) -> None:
    """Grow 64 to 128, and fill a large hole."""
    sample = cut_hole(256, 64)[0][:64, :64]
    print()
    for window in WINDOWS:

        def grow_it(n_threads: int, window: int = window) -> object:
            return grow(sample, (128, 128), window=window, rng=0, n_threads=n_threads)

        one = best_seconds(lambda: grow_it(1), rounds)
        clocks = [best_seconds(lambda n=n: grow_it(n), rounds, time.perf_counter) for n in (1, 2)]
        tell(f"growth 64 to 128, window {window}", one, f"two threads {clocks[1] / clocks[0]:.2f} of one")
    image, hole = cut_hole(512, 128)
    one = best_seconds(lambda: fill(image, hole, window=11, rng=0, n_threads=1), 1)
    clocks = [
        best_seconds(lambda n=n: fill(image, hole, window=11, rng=0, n_threads=n), 1, time.perf_counter)
        for n in (1, 2)
    ]
    tell("hole 128 in 512, window 11", one, f"two threads {clocks[1] / clocks[0]:.2f} of one")


def tell(what: str, seconds: float, more: str) -> None:
    """Print a row."""
    print(f"{what:36}{seconds:6.2f} s  {more}", flush=True)


def peak_mb() -> float:
    """Return the most memory that this process has held, in MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=3)
    rounds = parser.parse_args().rounds
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors; {Path(__file__).name}")
    fill(*cut_hole(256, 4), window=3, rng=0)  # compiled once
    before = peak_mb()
    bench_rest(rounds)
    print(f"peak memory {peak_mb():.0f} MB, of which {before:.0f} before the first of these")
    for window in WINDOWS:
        bench_hole(window, rounds)


if __name__ == "__main__":
    main()
