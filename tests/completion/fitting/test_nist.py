# SPDX-License-Identifier: MIT
"""NIST's certified least-squares fits: 1e-9 relative, 1e-8 rad, no start given.

The certified answer of con7 may not be unique: six points, six parameters, so that any cone through them has
no residual (NIST_README.md says so). sph9 (4 points) also leaves no degree of freedom, but one sphere alone
passes through four points. cyl7 has one degree of freedom only. All are held to the same limits.
"""

import numpy as np
import pytest

from completion.fitting.pipeline import fit
from scenes.surfaces.catalogue import Cone, Cylinder, Plane, Sphere
from tests.helpers.data_paths import data_path, requires_data
from tests.helpers.long_cases import first_in_gate

SHAPES = {"Plane": "plane", "Sphere": "sphere", "Cylinder": "cylinder", "Cone": "cone"}
SETS = [f"{folder}/{folder[:3].lower()}{number}" for folder in SHAPES for number in range(1, 30, 2)]


@requires_data
@pytest.mark.parametrize("name", first_in_gate(20, SETS))
def test_nist_sets_are_met_without_a_start(name: str) -> None:
    path = data_path(f"fitting/nist_l2/{name}.ds")
    points = np.array(path.read_text().split()[1:], float).reshape(-1, 3)
    certified = np.array(path.with_suffix(".fit").read_text().split(), float)
    surface = fit(points, SHAPES[name.split("/")[0]]).surface  # type: ignore[arg-type]
    size = float(np.ptp(points, axis=0).max())
    if isinstance(surface, Sphere):
        assert np.linalg.norm(surface.centre - certified[:3]) < 1e-9 * size
        assert 2 * surface.radius == pytest.approx(certified[3], rel=1e-9)
        return
    place, direction = certified[:3], certified[3:6]
    if isinstance(surface, Plane):
        assert abs(float(surface.distance(place[None])[0])) < 1e-9 * size
        assert np.linalg.norm(np.cross(surface.normal_direction, direction)) < 1e-8
        return
    assert isinstance(surface, Cylinder | Cone)
    offset = np.linalg.norm(np.cross(place - surface.point, surface.direction))
    assert offset < 1e-9 * max(size, surface.radius)
    assert np.linalg.norm(np.cross(surface.direction, direction)) < 1e-8
    if isinstance(surface, Cylinder):
        assert 2 * surface.radius == pytest.approx(certified[6], rel=1e-9)
    else:
        assert surface.direction @ direction > 0
        across = float(surface.radius_at(place[None])[0] * np.cos(surface.half_angle))
        assert across == pytest.approx(certified[6], rel=1e-9)  # NIST: at right angles to the surface
        assert 2 * np.degrees(surface.half_angle) == pytest.approx(certified[7], rel=1e-9)
