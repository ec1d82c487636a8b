# SPDX-License-Identifier: MIT
"""Rings: cross-sections of a cylinder, each of which is there as a whole or not at all."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from completion.evidence.evidence import Evidence, Label
from scenes.checks import BoolArray


def rings_passed(evidence: Evidence) -> BoolArray:
    """Tell of which rows of a cylinder's chart beams say that the cylinder is not there, or has ended.

    A pipe or a column has one cross-section along its axis. Where beams passed more of a ring than was
    measured of it, the pipe is not there, and its hidden back is not either; nor are rings beyond, unless
    some part of it was measured again.

    Parameters
    ----------
    evidence : Evidence
        Of a grid on the cylinder, rows along its axis.

    Returns
    -------
    (rows,) bool
    """
    passed = np.count_nonzero(evidence.labels == Label.FREE, axis=1)
    measured = np.count_nonzero(evidence.own, axis=1)
    stands = passed <= measured
    part, n_parts = ndimage.label(stands)
    is_measured = np.bincount(part, measured, minlength=n_parts + 1) > 0
    is_measured[0] = False
    return np.asarray(~is_measured[part], dtype=np.bool_)
