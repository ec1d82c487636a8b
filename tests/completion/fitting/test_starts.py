"""Truth table of starts: points on known surfaces in, the surface in closed form out, without a guess."""

import numpy as np
import pytest

from completion.fitting.chart import ConeChart, CylinderChart, axis_frame
from completion.fitting.starts import cones_along, starts
from scenes.surfaces.catalogue import Cone, Cylinder, EllipticCylinder, Sphere

AXES = {"up": (0, 0, 1), "along x": (1, 0, 0), "aslant": (0.3, -0.5, 0.8)}
POINT = (0.1, 0.2, 0.0)
SEARCHED = 2e-4  # metres that the search of the axis leaves; spheres need none
# the shape asked for, the surface that the points lie on, how far they reach along its axis, what is left
TABLE = {
    "sphere": ("sphere", lambda _: Sphere(POINT, 0.8), 0.6, 1e-9),
    "cap of a sphere": ("sphere", lambda _: Sphere(POINT, 0.8), 0.2, 1e-9),
    "cylinder": ("cylinder", lambda axis: Cylinder(POINT, axis, 0.5), 0.8, SEARCHED),
    "ring of a cylinder": ("cylinder", lambda axis: Cylinder(POINT, axis, 0.9), 0.2, SEARCHED),
    "cone": ("cone", lambda axis: Cone(POINT, axis, 0.5, np.radians(20)), 0.5, SEARCHED),
    "blunt cone": ("cone", lambda axis: Cone(POINT, axis, 0.9, np.radians(80)), 0.1, SEARCHED),
    "ellipse": ("elliptic-cylinder", lambda axis: EllipticCylinder(POINT, axis, (0.7, 0.4)), 0.8, SEARCHED),
    "circle": ("elliptic-cylinder", lambda axis: Cylinder(POINT, axis, 0.5), 0.8, SEARCHED),
}


def sampled(surface, half):
    """Points (n, 3) all around a surface, to either side of its point."""
    turn, along = np.meshgrid(2 * np.pi * np.arange(24) / 24, np.linspace(-half, half, 9), indexing="ij")
    if isinstance(surface, Cone):
        across = surface.radius + along * np.tan(surface.half_angle)
        local = np.stack([across * np.cos(turn), across * np.sin(turn), along], axis=-1).reshape(-1, 3)
        return surface.point + local @ axis_frame(surface.direction)
    uv = np.stack([surface.period * turn / (2 * np.pi), along], axis=-1)
    return surface.from_uv(uv.reshape(-1, 2))


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("name", TABLE)
def test_points_of_a_surface_start_at_it(name, axis):
    shape, make, half, off = TABLE[name]
    points = sampled(make(AXES[axis]), half)
    centre = points.mean(axis=0)
    scale = float(np.sqrt(np.square(points - centre).sum(axis=1).mean()))
    charts = starts(shape, (points - centre) / scale, 4)
    charts = [chart.turn_to_growth() if isinstance(chart, ConeChart) else chart for chart in charts]
    surfaces = [chart.surface(centre, scale, concave=False) for chart in charts]
    assert min(np.abs(surface.distance(points)).max() for surface in surfaces) <= off


def test_cones_touch_a_cylinder_along_a_line_and_curve_as_it_does():
    radius, step = 0.8, 1e-3
    cylinder = CylinderChart(np.array([radius, 0.0, 0.0]), axis_frame(np.array([0.0, 0.0, 1.0])), radius)
    turn = np.array([-step, 0.0, step])  # the points lie at the origin, where the cylinder passes
    circle = np.column_stack([radius - radius * np.cos(turn), radius * np.sin(turn), np.zeros(3)])
    line = np.array([[0, 0, -0.01], [0, 0, 0.01]])
    cones = cones_along(cylinder)
    assert len(cones) == 16
    for chart in cones:
        assert isinstance(chart, ConeChart)
        cone = chart.surface(np.zeros(3), 1.0, concave=False)
        np.testing.assert_allclose(cone.distance(line), 0, atol=1e-9)
        np.testing.assert_allclose(cone.distance(circle), 0, atol=10 * step**3)
