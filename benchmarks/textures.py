# SPDX-License-Identifier: MIT
"""Speed of texture filling in one run, beside the float32 GEMM floor: `python benchmarks/textures.py`.

The floor is what a brute-force search costs with every distance taken by matrix products alone, masked
templates, one thread: 2 * (2 window**2) operations for each template and position. Seconds are the
processor's, the best of a few rounds; with two threads those on the clock.
"""

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import argparse
import resource
import time
from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray
from skimage import data

from texture import fill, grow

WINDOWS = (11, 23)


def best_seconds(work: Callable[[], object], rounds: int, clock: Callable[[], float]) -> float:
    """Return the shortest of a few runs."""
    seconds = []
    for _ in range(rounds):
        start = clock()
        work()
        seconds.append(clock() - start)
    return min(seconds)


def cut_hole(size: int, side: int) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """Return a crop of brick and a square hole in its middle."""
    image = data.brick()[128 : 128 + size, 128 : 128 + size] if size < 512 else data.brick()
    hole = np.zeros(image.shape, dtype=np.bool_)
    first = (size - side) // 2 if size == 512 else 96
    hole[first : first + side, first : first + side] = True
    return image, hole


def measure_floor(window: int, n_templates: int, n_positions: int, rounds: int) -> float:
    """Return the seconds of the matrix products of a brute-force masked search, from a slice of them."""
    rng = np.random.default_rng(0)
    templates = rng.random((256, 2 * window**2), dtype=np.float32)
    positions = rng.random((2 * window**2, 8192), dtype=np.float32)
    slice_seconds = best_seconds(lambda: templates @ positions, 3 * rounds, time.process_time)
    return slice_seconds * n_templates / 256 * n_positions / 8192


def measure_match_template(image: NDArray[np.uint8], window: int, n_templates: int) -> float:
    """Return the seconds of OpenCV's masked matchTemplate for so many templates, from a few of them."""
    cv2.setNumThreads(1)
    pixels = image.astype(np.float32)
    weights = np.ones((window, window), dtype=np.float32)
    start = time.process_time()
    for k in range(20):
        cv2.matchTemplate(pixels, pixels[k : k + window, k : k + window], cv2.TM_SQDIFF, mask=weights)
    return (time.process_time() - start) / 20 * n_templates


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=3)
    rounds = parser.parse_args().rounds
    image, hole = cut_hole(256, 64)
    fill(image, hole, window=3, rng=0)  # compiled once
    for window in WINDOWS:
        n_positions = (256 - window + 1) ** 2 - (64 + window - 1) ** 2
        floor = measure_floor(window, int(hole.sum()), n_positions, rounds)

        def run(n_threads: int, window: int = window) -> object:
            return fill(image, hole, window=window, rng=0, n_threads=n_threads)

        one = best_seconds(lambda: run(1), rounds, time.process_time)
        one_clock = best_seconds(lambda: run(1), rounds, time.perf_counter)
        two_clock = best_seconds(lambda: run(2), rounds, time.perf_counter)
        growing = best_seconds(
            lambda window=window: grow(image[:64, :64], (128, 128), window=window, rng=0, n_threads=1),
            rounds,
            time.process_time,
        )
        matching = measure_match_template(image, window, int(hole.sum()))
        print(
            f"window {window}: hole 64 in 256 {one:.2f} s; GEMM floor {floor:.2f} s, ratio {one / floor:.2f}"
        )
        print(f"  two threads {two_clock:.2f} s on the clock, {two_clock / one_clock:.2f} of one")
        print(f"  growth 64 to 128 {growing:.2f} s; masked matchTemplate {matching:.1f} s")
    image, hole = cut_hole(512, 128)
    for n_threads in (1, 2):
        large = best_seconds(
            lambda n=n_threads: fill(image, hole, window=11, rng=0, n_threads=n), 1, time.perf_counter
        )
        print(f"hole 128 in 512, window 11, {n_threads} threads: {large:.2f} s on the clock")
    print(f"peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB")


if __name__ == "__main__":
    main()
