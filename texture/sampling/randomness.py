# SPDX-License-Identifier: MIT
"""Counter-based random numbers: pure functions of (key, purpose, pass, pixel), whatever is drawn before.

So the result of a synthesis depends neither on the engine nor on the order in which pixels are computed.
"""

from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

GOLDEN = 0x9E3779B97F4A7C15  # the odd number nearest to 2**64 divided by the golden ratio
_WORD = 2**64 - 1


class Purpose(IntEnum):
    """What a random number is for: numbers of different purposes are unrelated."""

    ORDER = 0
    PICK = 1
    SEED_PLACE = 2
    SEED_SOURCE = 3


def draw_key(rng: np.random.Generator) -> int:
    """Draw the 64-bit key of one synthesis."""
    return int(rng.integers(_WORD, dtype=np.uint64, endpoint=True))


def random_words(key: int, purpose: Purpose, round_number: int, pixels: ArrayLike) -> NDArray[np.uint64]:
    """Return one random 64-bit word a pixel, in the shape of `pixels` (splitmix64, Steele et al. 2014).

    The key has 64 bits, one a synthesis; the round is the pass, 0, 1, ...: a pixel that is tried again draws
    anew. Pixels are row * width + column.

    Examples
    --------
    >>> random_words(0, Purpose.PICK, 0, [5, 6]) == random_words(0, Purpose.PICK, 0, [6, 5])[::-1]
    array([ True,  True])
    """
    stream = (key + GOLDEN * (1 + len(Purpose) * round_number + purpose)) & _WORD
    start = _mix(np.array([stream], dtype=np.uint64))
    counters = np.atleast_1d(np.asarray(pixels)).astype(np.uint64)
    return _mix(start + np.uint64(GOLDEN) * (counters + np.uint64(1)))


def pick(word: np.uint64 | int, n_choices: int) -> int:
    """Return a uniform choice 0..n_choices-1 made by a random word.

    Examples
    --------
    >>> pick(0, 7), pick(2**64 - 1, 7)
    (0, 6)
    """
    return int(word) * n_choices >> 64


def _mix(words: NDArray[np.uint64]) -> NDArray[np.uint64]:
    words = (words ^ (words >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    words = (words ^ (words >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return words ^ (words >> np.uint64(31))
