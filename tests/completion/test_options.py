# SPDX-License-Identifier: MIT
"""Options: how far poses may be off, by what scans show, by registration, and as stated."""

import numpy as np
import pytest

from completion.observe.tolerance import EvidenceOptions
from completion.options import CompletionOptions
from scenes.checks import InputError


@pytest.mark.parametrize(
    ("options", "errors"),
    [
        ({}, [0.005, 0.02, 0.005]),
        ({"registration_m": 0.03}, [0.005, 0.02, 0.03]),
        ({"pose_deviations_m": (0.0, 0.001, 0.05)}, [0.005, 0.02, 0.1]),
        ({"pose_deviations_m": (0.0, 0.05, 0.001)}, [0.005, 0.1, 0.005]),
        ({"evidence": EvidenceOptions(registration_m=0.01)}, [0.01, 0.01, 0.01]),
    ],
)
def test_each_pose_is_as_doubtful_as_the_worst_that_is_known_of_it(options, errors):
    """The first two scans show what poses leave between them, 1 and 20 mm; the third shares nothing."""
    shown = np.array([0.001, 0.02, np.nan])
    np.testing.assert_allclose(CompletionOptions(**options).of_surfaces.pose_errors(shown), errors)


@pytest.mark.parametrize("deviations", [(-0.001, 0.0), (np.nan, 0.0), (np.inf, 0.0)])
def test_pose_deviations_that_are_no_lengths_are_refused(deviations):
    with pytest.raises(InputError, match=r"pose_deviations_m\[0\] must be 0 or more, got"):
        CompletionOptions(pose_deviations_m=deviations)


def test_pose_deviations_for_another_number_of_scans_are_refused_with_the_cure():
    options = CompletionOptions(pose_deviations_m=(0.0, 0.001))
    with pytest.raises(InputError, match="holds 2 deviations for 3 scans; give one per scan, or none"):
        options.of_surfaces.pose_errors(np.array([0.001, 0.02, np.nan]))
