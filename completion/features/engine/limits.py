# SPDX-License-Identifier: MIT
"""Limits of fits of templates, each with its unit and where it comes from.

"By eye" stands for a value that was tried on examples, without a measurement of its own. Numbers of points,
members and steps that a search takes are by choice: they stand where they are used.
"""

import numpy as np

REACH = 0.1
"""Of the diagonal: points that are farther from all faces tell nothing. By eye."""
LEAST_GAIN = 1e-3
"""Share by which the best falls in six generations a parameter, while a search goes on. By eye."""
LEAST_EVIDENCE = float(np.log(100.0))
"""Nats against a plain surface, of what is found: odds of a hundred."""
LEAST_TILES = 2
"""Tiles that confirm a side: one may be a stray."""
TILE_SPACINGS = 6.0
"""Typical distances between points, a tile's side. By eye: some thirty points."""
TILE_POINTS = 4
"""Points on a tile that counts. By eye."""
SCATTER_SD = 5.0
"""Noises by which points lie about a true face at most, where that is more than `FORM_ERROR`. By eye."""
FORM_ERROR = 0.01
"""Of the size of what is explained, by which true faces differ from their template. By eye."""
OPEN_VARIANCE = 0.5
"""Of a parameter's variance between its bounds, from which on it is not known. By eye."""
FEWEST_POINTS = 8
"""Points of a template. By choice: about its parameters."""
