# SPDX-License-Identifier: MIT
"""Options: how far poses may be off, by what scans show, by registration, and as stated."""

import numpy as np
import pytest

from completion.features.engine.options import FeatureOptions
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


def test_resolved_options_hold_the_tolerances_that_were_used():
    """Two scans show 12 mm, more than the 5 mm stated; their regions show a relief of 3 mm."""
    evidence = CompletionOptions().in_force(0.003, np.array([0.012, 0.012])).evidence
    assert (evidence.flatness_m, evidence.registration_m) == (0.003, 0.012)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"given": {"widht": 1.0}}, "widht is no value of doorway, window, niche: width, height, depth"),
        ({"given": {"width": -3}}, "width must be above 0, got -3"),
        ({"given": {"width": np.nan}}, "width must be .*, got nan"),
        ({"kinds": ("door",)}, "got 'door'"),
    ],
)
def test_known_values_of_features_are_checked(options, text):
    with pytest.raises(InputError, match=text):
        FeatureOptions(**options)
