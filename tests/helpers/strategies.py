# SPDX-License-Identifier: MIT
"""Hypothesis strategies for poses and surfaces, and the settings under which laws are tested."""

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from scenes.pose import Pose
from scenes.surfaces.catalogue import Cone, Cylinder, EllipticCylinder, Plane, Sphere, Surface, Torus

EPS = float(np.finfo(np.float64).eps)
REACH_M = 50.0  # no coordinate that a strategy draws is larger
ROUNDING_M = 64 * EPS * REACH_M  # a few dozen float64 operations on coordinates of that size

law = settings(derandomize=True, deadline=None, max_examples=40)

seeds = st.integers(0, 2**32 - 1)
coordinates = st.floats(-REACH_M / 4, REACH_M / 4, allow_subnormal=False)
vectors = st.tuples(coordinates, coordinates, coordinates).map(np.array)
_parts = st.floats(-1, 1, allow_subnormal=False)
directions = (
    st.tuples(_parts, _parts, _parts).map(np.array).filter(lambda vector: np.linalg.norm(vector) > 0.1)
)
quaternions = (
    st.tuples(_parts, _parts, _parts, _parts).map(np.array).filter(lambda four: np.linalg.norm(four) > 0.1)
)


@st.composite
def poses(draw: st.DrawFn) -> Pose:
    """Any rotation, a translation within a quarter of the reach."""
    return Pose.from_parts(Rotation.from_quat(draw(quaternions)).as_matrix(), draw(vectors))


@st.composite
def planes(draw: st.DrawFn) -> Plane:
    """Any plane, its chart turned anyhow."""
    pose = draw(poses())
    return Plane(pose.translation, pose.rotation[:, 2], pose.rotation[:, 0])


@st.composite
def cylinders(draw: st.DrawFn, concave: bool = False) -> Cylinder:
    """Any cylinder with a radius between 5 cm and 5 m, its chart turned anyhow."""
    pose, radius = draw(poses()), draw(st.floats(0.05, 5.0))
    return Cylinder(pose.translation, pose.rotation[:, 2], radius, pose.rotation[:, 0], concave)


@st.composite
def spheres(draw: st.DrawFn, concave: bool = False) -> Sphere:
    """Any sphere with a radius between 5 cm and 5 m, its chart turned anyhow."""
    pose, radius = draw(poses()), draw(st.floats(0.05, 5.0))
    return Sphere(pose.translation, radius, pose.rotation[:, 2], pose.rotation[:, 0], concave)


@st.composite
def cones(draw: st.DrawFn, concave: bool = False) -> Cone:
    """Any cone with a half angle between 10 and 80 degrees and a radius between 5 cm and 5 m at its point."""
    pose, radius = draw(poses()), draw(st.floats(0.05, 5.0))
    half_angle = np.radians(draw(st.floats(10.0, 80.0)))
    return Cone(pose.translation, pose.rotation[:, 2], radius, half_angle, pose.rotation[:, 0], concave)


@st.composite
def elliptic_cylinders(draw: st.DrawFn, concave: bool = False) -> EllipticCylinder:
    """Any elliptic cylinder with radii between 5 cm and 5 m, one up to four times the other."""
    pose, greater, ratio = draw(poses()), draw(st.floats(0.2, 5.0)), draw(st.floats(0.25, 1.0))
    radii = (greater, ratio * greater)
    return EllipticCylinder(pose.translation, pose.rotation[:, 2], radii, pose.rotation[:, 0], concave)


@st.composite
def tori(draw: st.DrawFn, concave: bool = False) -> Torus:
    """Any torus with a tube between 5 cm and 2 m about a circle up to ten times and 5 % as large."""
    pose, tube, ratio = draw(poses()), draw(st.floats(0.05, 2.0)), draw(st.floats(1.05, 10.0))
    return Torus(pose.translation, pose.rotation[:, 2], ratio * tube, tube, pose.rotation[:, 0], concave)


SURFACES: dict[str, st.SearchStrategy[Surface]] = {
    "plane": planes(),
    "convex cylinder": cylinders(),
    "concave cylinder": cylinders(concave=True),
    "convex sphere": spheres(),
    "concave sphere": spheres(concave=True),
    "convex cone": cones(),
    "concave cone": cones(concave=True),
    "convex elliptic-cylinder": elliptic_cylinders(),
    "concave elliptic-cylinder": elliptic_cylinders(concave=True),
    "convex torus": tori(),
    "concave torus": tori(concave=True),
}
surfaces = st.one_of(*SURFACES.values())
