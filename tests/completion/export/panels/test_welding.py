# SPDX-License-Identifier: MIT
"""Places of charts are told apart at any size of the chart."""

import numpy as np
import pytest

from completion.export.panels.welding import _find, _keys


@pytest.mark.parametrize("size_m", [1.0, 400.0, 4_000.0, 100_000.0])
def test_places_are_found_again(size_m):
    rng = np.random.default_rng(0)
    places = rng.uniform(-size_m, size_m, (500, 2))
    known, first = np.unique(_keys(places), axis=0, return_index=True)
    asked = rng.integers(0, len(known), 2_000)
    np.testing.assert_array_equal(_find(known, _keys(places[first][asked])), asked)
