# SPDX-License-Identifier: MIT
"""Texture filling against what was cut out, beside floors and peers: quality, windows, large holes, speed."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image
from skimage import data

from benchmarks.cases.frames import DATA
from benchmarks.methods.textures import (
    Image8,
    list_peers,
    time_match_template,
    time_products,
    time_transforms,
)
from benchmarks.run import head, row, suite
from benchmarks.store import each
from scenes.checks import BoolArray
from texture import (
    fill,
    fill_surface,
    find_lattice,
    measure_distance,
    measure_phase_error,
    measure_seam,
    measure_verbatim_share,
)
from texture.sampling.canvas import OrderName

HOLE, CROP = np.s_[96:160, 96:160], np.s_[128:384, 128:384]
PIECES = [(line, column) for line in (0, 64, 384, 448) for column in (0, 150, 300, 448)]
NAMES = ("brick", "grass", "gravel")
_OTHERS = {
    "pebbles": "sh3d_pebbles.jpg",
    "small bricks": "sh3d_smallRedBricks.jpg",
    "wood": "sh3d_woodenFloor.jpg",
}
_LARGE = ((112, 384), (176, 384), (112, 10))  # pixels: side of the hole, and how far around it all is known
_WINDOWS = (7, 11, 15, 23, 31)


def _cut(name: str) -> tuple[Image8, NDArray[np.bool_], float]:
    """A crop of a texture of scikit-image, a hole in it, and the truth's mean distance to other pieces."""
    full = getattr(data, name)()
    hole = np.zeros(full[CROP].shape, dtype=np.bool_)
    hole[HOLE] = True
    others = [measure_distance(full[r : r + 64, c : c + 64], full[CROP][HOLE]) for r, c in PIECES]
    return full[CROP], hole, float(np.mean(others))


def _filled(name: str, order: str, window: int, seed: int) -> dict[str, float]:
    """Figures of one fill: order "paper", "window", "Telea", or "shaded" and "lit" under a lamp's light."""
    image, hole, scale = _cut(name)
    if order in ("shaded", "lit"):
        rows, columns = np.indices(image.shape) / max(image.shape)
        light = np.exp(0.5 - 1.1 * rows - 0.6 * columns + 0.4 * rows * columns)
        lit = np.rint(np.clip(image * light, 0, 255)).astype(np.uint8)
        apart = fill_surface(lit, hole, window=window, rng=seed) if order == "shaded" else None
        made = apart.image if apart else fill(lit, hole, window=window, order="window", rng=seed).image
        return {"distance, levels": float(measure_distance(made[HOLE], lit[HOLE]))}
    if order == "Telea":
        blur = cv2.inpaint(image, hole.astype(np.uint8), 3, cv2.INPAINT_TELEA)
        return {
            "distance": float(measure_distance(blur[HOLE], image[HOLE])) / scale,
            "seam": float(measure_seam(blur, hole, image)),
        }
    whole = fill(image, hole, window=window, order=order, rng=seed)  # type: ignore[arg-type]
    return {
        "distance": float(measure_distance(whole.image[HOLE], image[HOLE])) / scale,
        "seam": float(measure_seam(whole.image, hole, image)),
        "phase": float(measure_phase_error(whole.image, hole, lattice=find_lattice(image, ~hole))),
        "verbatim": float(measure_verbatim_share(whole.source_rows, whole.source_cols, hole)),
    }


@suite("textures", smallest="--seeds 1")
def textures(seeds: int = 30, window: int = 11) -> Iterator[str]:
    """Fills of brick, grass and gravel against what was cut out: hole of 64 x 64 in 256 x 256 pixels.

    "distance" is the sliced Wasserstein distance to the truth over the mean distance of the truth to other
    pieces; "seam" is relative to the truth's; "phase" is in periods; "verbatim" the share copied whole.
    """
    yield from head("texture", "fill", "figure", "mean", "standard error")
    for name in NAMES:
        for order in ("paper", "window", "Telea", "shaded", "lit"):
            n = 1 if order == "Telea" else seeds
            results = list(each(_filled, name, order, window, range(n)))
            for figure in results[0]:
                values = np.array([result[figure] for result in results])
                error = np.std(values, ddof=min(1, n - 1)) / np.sqrt(n)
                if np.isfinite(values).all():
                    yield row(name, order, figure, f"{values.mean():.3f}", f"{error:.3f}")


def _large(name: str) -> Image8:
    """A texture of 384 x 384 pixels, grey or in colour."""
    if name in NAMES:
        return np.asarray(getattr(data, name)())[64:448, 64:448]
    image = Image.open(DATA / "textures" / _OTHERS[name]).convert("RGB")
    scale = 512 / min(image.size)
    size = (round(image.width * scale), round(image.height * scale))
    return np.asarray(image.resize(size, Image.Resampling.LANCZOS))[64:448, 64:448]


def _large_hole(name: str, side: int, rim: int, search: str, seed: int) -> list[float]:
    """CPU seconds, distance, seam, phase error and error of the mean colour of one fill of a large hole."""
    image = _large(name)
    hole, known = np.zeros((2, *image.shape[:2]), dtype=np.bool_)
    first, last = (384 - side) // 2, (384 + side) // 2
    hole[first:last, first:last] = True
    known[max(0, first - rim) : last + rim, max(0, first - rim) : last + rim] = True
    known &= ~hole
    emptied, lattice = image.copy(), find_lattice(image, ~hole)
    emptied[hole] = 0
    begun = time.process_time()
    filled = fill(emptied, hole, known=known, search=search, order="window", rng=seed, n_threads=1)  # type: ignore[arg-type]
    seconds = time.process_time() - begun
    made = np.where(hole[..., None] if image.ndim == 3 else hole, filled.image, image)
    colour = np.abs(made[hole].mean(axis=0) - image[hole].mean(axis=0)).mean()
    seam = measure_seam(made, hole) / measure_seam(image, hole)
    phase = measure_phase_error(made, hole, ~hole, lattice)
    distance = measure_distance(made, image, hole, hole)
    return [float(value) for value in (seconds, distance, seam, phase, colour)]


@suite("large-holes", smallest="--seeds 1")
def large_holes(seeds: int = 4) -> Iterator[str]:
    """Large holes filled exactly and by a budget, in 384 x 384 pixels: means over the seeds."""
    yield from head("texture", "hole", "search", "CPU s", "distance", "seam", "phase", "colour")
    for name in (*NAMES, *(n for n, file in _OTHERS.items() if (DATA / "textures" / file).exists())):
        for side, rim in _LARGE:
            for search in ("exact", "budget"):
                means = np.mean(list(each(_large_hole, name, side, rim, search, range(seeds))), axis=0)
                cells = ("-" if np.isnan(value) else f"{value:.2f}" for value in means)
                yield row(name, f"{side}, {rim} known", search, *cells)


def _window_costs(name: str) -> list[float]:
    """Cost of each window, distance times 1 + 5 phase errors; the window chosen, and its CPU seconds."""
    image, hole, scale = _cut(name)
    lattice, costs = find_lattice(image), np.zeros(len(_WINDOWS))
    for place, window in enumerate(_WINDOWS):
        for seed in (0, 1):
            made = fill(image, hole, window=window, order="window", rng=seed).image
            phase = float(np.nan_to_num(measure_phase_error(made, hole, lattice=lattice)))
            costs[place] += measure_distance(made[HOLE], image[HOLE]) / scale * (1 + 5 * phase) / 2
    start = time.process_time()
    chosen = fill(image, hole, order="window", rng=0, n_threads=1, time_budget_s=1e-9).window
    return [*costs.tolist(), float(chosen), time.process_time() - start]


@suite("windows")
def windows() -> Iterator[str]:
    """The window that the self-check chooses beside the one that fills best: relative cost of each."""
    yield from head("texture", "best", "chosen", "cost", *map(str, _WINDOWS), "CPU s")
    for name in NAMES:
        for *costs, chosen, seconds in each(_window_costs, name):
            relative = np.array(costs) / min(costs)
            cost = np.interp(chosen, _WINDOWS, relative)
            cells = [f"{value:.2f}" for value in (cost, *relative)]
            yield row(name, _WINDOWS[int(np.argmin(costs))], int(chosen), *cells, f"{seconds:.1f}")


def _best(work: Callable[[], object], rounds: int) -> float:
    """Least CPU seconds of a few runs."""
    seconds = []
    for _ in range(rounds):
        start = time.process_time()
        work()
        seconds.append(time.process_time() - start)
    return min(seconds)


def _filled_by_one_thread(image: Image8, hole: BoolArray, window: int, order: OrderName, seed: int) -> Image8:
    """The image with its hole filled by one thread."""
    return np.asarray(fill(image, hole, window=window, order=order, rng=seed, n_threads=1).image)


_ORDERS: tuple[OrderName, ...] = ("paper", "window")


@suite("texture-speed", smallest="--rounds 1")
def texture_speed(rounds: int = 3) -> Iterator[str]:
    """CPU seconds and quality of a fill of 64 x 64 in 256 x 256 of brick, beside other programs."""
    yield from head("window", "fill", "CPU s", "distance", "seam")
    image, hole, scale = _cut("brick")
    fill(image, hole, window=3, rng=0)  # compiled once
    for window in (11, 23):
        n_templates, n_positions = int(hole.sum()), (256 - window + 1) ** 2 - (64 + window - 1) ** 2
        makers: dict[str, Callable[[int], Image8]] = {
            f"unseen, {order} order": partial(_filled_by_one_thread, image, hole, window, order)
            for order in _ORDERS
        }
        for peer in list_peers():
            if peer.fill is None:
                yield row(window, peer.name, peer.reason, None, None)
            else:
                makers[peer.name] = partial(peer.fill, image, hole, window)
        for name, make in makers.items():
            fills = [make(seed) for seed in range(3)]
            distance = np.mean([measure_distance(made[HOLE], image[HOLE]) for made in fills]) / scale
            seam = np.mean([measure_seam(np.where(hole, made, image), hole, image) for made in fills])
            spent = _best(partial(make, 0), rounds)
            yield row(window, name, f"{spent:.2f}", f"{distance:.2f}", f"{seam:.2f}")
        floors = {
            "float32 matrix products (the floor)": time_products(window, n_templates, n_positions),
            "FFT, brute force": time_transforms(image, window, n_templates),
            "masked matchTemplate, brute force": time_match_template(image, window, n_templates),
        }
        for name, seconds in floors.items():
            yield row(window, name, f"{seconds:.2f}", None, None)
