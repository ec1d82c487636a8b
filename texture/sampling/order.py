# SPDX-License-Identifier: MIT
"""The order of filling: which unfilled pixels a pass visits, and which comes first."""

from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from texture.sampling.canvas import Canvas
from texture.sampling.randomness import Purpose, random_words

OrderName: TypeAlias = Literal["paper", "window"]

SHARE_PER_PASS = 8  # the window order visits the best eighth of the front


def list_visits(canvas: Canvas, order: OrderName, key: int, pass_number: int) -> NDArray[np.int64]:
    """List the pixels that a pass visits: the front, those with most filled neighbours first, ties at random.

    The paper (Efros & Leung 1999, section 2.2 and the pseudocode) leaves open which neighbours count.
    "paper" counts the eight around the pixel and visits the whole front; "window" counts the whole window and
    visits the best eighth of the front.

    Parameters
    ----------
    canvas : Canvas
        As it is when the pass begins.
    order : {"paper", "window"}
        See above.
    key, pass_number : int
        Random ties are a pure function of them and the pixel.

    Returns
    -------
    array, shape (n,), int64
        row * width + column; empty when no unfilled pixel has a filled neighbour.
    """
    box = canvas.find_unfilled_box()
    n_neighbours = canvas.count_known(box, radius=1)
    front = np.nonzero(canvas.unfilled[box] & (n_neighbours > 0))
    n_filled = (canvas.count_known(box, canvas.radius) if order == "window" else n_neighbours)[front]
    n_visits = -(-front[0].size // (SHARE_PER_PASS if order == "window" else 1))
    pixels = (front[0] + box[0].start) * canvas.unfilled.shape[1] + front[1] + box[1].start
    ties = random_words(key, Purpose.ORDER, pass_number, pixels)
    visits: NDArray[np.int64] = pixels[np.lexsort((ties, -n_filled))][:n_visits]
    return visits
