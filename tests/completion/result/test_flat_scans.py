# SPDX-License-Identifier: MIT
"""Scans flattened along their rays: planes lose their ripple in written meshes, and nothing else changes."""

import json
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.cases.relief import smooth
from completion import CompletionOptions, complete
from completion.flattening.flat import FlatteningOptions
from completion.result.record import completion_record
from tests.helpers.completion_examples import example

PLAIN = CompletionOptions(texture=False)
FLAT = replace(PLAIN, flattening=FlatteningOptions())


@pytest.fixture(scope="module")
def scan():
    """A wall behind a chair with ripple of 2 mm along the rays."""
    clean = example("chair_before_wall", pixels=120)
    ripple = 0.002 * smooth(clean.shape, 7.0, np.random.default_rng(0))
    return replace(clean, ranges=clean.ranges + ripple, sigma_m=0.002, truth=None)


@pytest.fixture(scope="module")
def both(scan):
    return complete(scan, PLAIN, rng=0), complete(scan, FLAT, rng=0)


@pytest.mark.long
def test_pixels_move_along_their_rays_onto_their_planes(both):
    plain, flat = both
    before, after = plain.observed_mesh(), flat.observed_mesh()
    np.testing.assert_array_equal(before.faces, after.faces)
    origin = flat.observations[0].scan.origin
    assert np.abs(np.cross(before.vertices - origin, after.vertices - origin)).max() < 1e-6
    moved = np.linalg.norm(after.vertices - before.vertices, axis=1)
    assert not moved[after.surface == 0].any()
    own = (after.surface == 1) & (moved > 0)
    assert own.mean() > 0.1
    surface = flat.patches[0].source.fit.surface
    assert np.median(np.abs(surface.distance(before.vertices[own]))) > 5e-4
    assert np.median(np.abs(surface.distance(after.vertices[own]))) < 1e-6


def test_what_is_inferred_does_not_depend_on_it(both):
    plain, flat = both
    for name in plain.hypothesised.of_vertices:
        np.testing.assert_array_equal(getattr(plain.hypothesised, name), getattr(flat.hypothesised, name))
    said, other = completion_record(plain), completion_record(flat)
    assert "flattening" not in said
    del other["flattening"]
    for one in other["surfaces"]:
        one.pop("flattening", None)
    for record in (said, other):
        del record["panels"]  # what borders on panels is flattened, and its nodes are theirs
    assert json.dumps(said, default=repr) == json.dumps(other, default=repr)


def test_the_record_tells_of_each_plane(both):
    told = completion_record(both[1])
    whole, first = told["flattening"], told["surfaces"][0]["flattening"]
    assert first["is_flattened"]
    assert first["ripple_after_m"] < 1e-6 < 5e-4 < first["ripple_before_m"]
    assert whole["turned_over"] == whole["crossing_anew"] == 0
    assert first["scans"][0]["points"] > 1000
    assert {"p", "height_m", "area_m2"} <= set().union(
        *first["scans"][0]["relief"], {"p", "height_m", "area_m2"}
    )
