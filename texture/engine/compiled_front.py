# SPDX-License-Identifier: MIT
"""The front of a canvas kept by compiled loops; on one thread they fill it, too."""

import numpy as np

from texture.engine.engine import Passes, view
from texture.engine.front_kernels import FrontArrays, advance, list_visits, run_passes
from texture.engine.scan_kernels import SampleArrays
from texture.sampling.canvas import Canvas
from texture.sampling.front import Front, OrderName
from texture.sampling.sample import IntArray


class CompiledFront:
    """As `texture.sampling.front.Front`, to the bit; imported only when something is filled."""

    def __init__(self, canvas: Canvas, order: OrderName) -> None:
        """Find the front of a canvas as it is; from here on `advance` must hear of each pixel filled."""
        found, shape = Front(canvas, order), canvas.known.shape
        rows, columns = np.divmod(found.places, shape[1])
        room = np.empty(found.n_unfilled, np.int64)
        room[: found.places.size] = rows * canvas.unfilled.shape[1] + columns
        self._canvas = view(canvas)
        self._front = FrontArrays(
            n_known=found.n_known.reshape(shape),
            belongs=found.belongs.reshape(shape),
            pixels=room,
            sizes=np.array([found.places.size, found.n_unfilled]),
            visits=np.empty(room.size, np.int64),
            words=np.empty(room.size, np.uint64),
            reach=found.reach,
            share=found.share,
        )

    @property
    def n_unfilled(self) -> int:
        """Pixels that are to be filled and are not yet."""
        return int(self._front.sizes[1])

    def list_visits(self, key: int, pass_number: int) -> IntArray:
        """List the pixels (n,) that a pass visits, row * width + column, as `Front.list_visits`."""
        n_visits = list_visits(self._canvas, self._front, np.uint64(key), pass_number)
        return self._front.visits[:n_visits].copy()

    def advance(self, visits: IntArray) -> int:
        """Take out the visited pixels (n,), row * width + column, that were filled; return how many."""
        return int(advance(self._canvas, self._front, visits))

    def run_passes(
        self, sample: SampleArrays, key: int, relaxation: float, pass_number: int, threshold: float, most: int
    ) -> Passes:
        """Run up to `most` passes of the exact search on this thread."""
        word = np.uint64(key)
        arrays = (sample, self._canvas, self._front)
        return Passes(*run_passes(*arrays, word, relaxation, pass_number, threshold, most))
