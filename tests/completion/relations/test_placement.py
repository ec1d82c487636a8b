# SPDX-License-Identifier: MIT
"""Placement: what a change of a chart's parameters does to a surface is what its fit's gradient says."""

import numpy as np
import pytest

from completion.fitting.result import SurfaceFit
from completion.relations.equations import move_surface
from scenes.surfaces.catalogue import Cone, Cylinder, Plane, Sphere, Torus

STEP = 1e-6
SURFACES = (
    Plane((0.3, 0.1, 0.2), (0.2, -0.3, 1.0)),
    Sphere((0.1, 0.2, 0.3), 0.7),
    Cylinder((0.1, 0.0, 0.2), (0.3, 0.2, 1.0), 0.4),
    Cone((0.0, 0.1, 0.2), (0.1, -0.2, 1.0), 0.5, 0.3),
    Torus((0.1, 0.0, 0.0), (0.2, 0.1, 1.0), 0.8, 0.2),
)


@pytest.mark.parametrize("surface", SURFACES, ids=lambda one: one.kind)
def test_gradients_are_derivatives_of_distances_by_the_parameters(surface) -> None:
    """Errors that surfaces share would else move planes one way and cylinders the other."""
    k = {"plane": 3, "sphere": 4, "cylinder": 5, "cone": 6, "torus": 7}[surface.kind]
    points = surface.from_uv(np.random.default_rng(0).uniform(-0.3, 0.3, (20, 2)))
    fit = SurfaceFit(surface, 1e-3, np.eye(k), 20)
    ends = [
        [move_surface(surface, way * STEP * unit).distance(points) for way in (1, -1)] for unit in np.eye(k)
    ]
    slopes = np.stack([(ahead - behind) / (2 * STEP) for ahead, behind in ends], axis=1)
    np.testing.assert_allclose(fit.gradient(points), slopes, atol=1e-6)
