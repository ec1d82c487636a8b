# SPDX-License-Identifier: MIT
"""Ranges against closed forms, at home and in national coordinates; tessellations within their sagitta."""

import numpy as np
import pytest
import trimesh

from scenes.checks import FloatArray, IntArray
from scenes.rays.raycast import Backend, Hits, RayCaster

PLACES = [((0.0, 0.0, 0.0), 1e-9), ((5e5, 5e6, 100.0), 1e-8)]  # with the error allowed there, metres
N = 20_000
everywhere = pytest.mark.parametrize(("place", "allowed_m"), PLACES)
either = pytest.mark.parametrize("backend", ["packets", "embreex"])


def cast(
    vertices: FloatArray, faces: IntArray, origins: FloatArray, along: FloatArray, backend: Backend
) -> Hits:
    hits = RayCaster(vertices, faces, backend=backend).first_hit(origins, along)
    assert hits.hit.all()
    return hits


def facet_error(
    hits: Hits, vertices: FloatArray, faces: IntArray, origins: FloatArray, along: FloatArray
) -> FloatArray:
    """Difference to the range of the hit facet's plane, worked out in 64-bit mantissas."""
    corner, second, third = np.moveaxis(vertices.astype(np.longdouble)[faces[hits.face]], 1, 0)
    normal = np.cross(second - corner, third - corner)
    way = along.astype(np.longdouble)
    height = ((corner - origins.astype(np.longdouble)) * normal).sum(axis=1)
    expected = height / (way * normal).sum(axis=1) * np.sqrt((way * way).sum(axis=1))
    return np.abs(hits.ranges - expected).astype(np.float64)


def balls_rays(rng: np.random.Generator, centre: FloatArray, radius: float) -> tuple[FloatArray, FloatArray]:
    """From about the centre outwards, so that no ray grazes a facet."""
    return centre + rng.uniform(-0.3, 0.3, (N, 3)) * radius, rng.normal(size=(N, 3))


@either
@everywhere
def test_a_plane(place: tuple[float, float, float], allowed_m: float, backend: Backend) -> None:
    rng = np.random.default_rng(0)
    x, y = (axis.reshape(-1) for axis in np.meshgrid(np.linspace(-9, 9, 31), np.linspace(-9, 9, 31)))
    vertices = np.stack([x, y, 0.1 * x - 0.2 * y], axis=1) + place
    i = (np.arange(30)[:, None] * 31 + np.arange(30)).reshape(-1)
    faces = np.concatenate([np.stack([i, i + 1, i + 32], axis=1), np.stack([i, i + 32, i + 31], axis=1)])
    origins = rng.uniform([-2, -2, 1], [2, 2, 5], (N, 3))
    along = rng.uniform([-1, -1, -2], [1, 1, -1], (N, 3))
    hits = cast(vertices, faces, origins + place, along, backend)
    slope = along @ [-0.1, 0.2, 1.0]
    expected = -(origins @ [-0.1, 0.2, 1.0]) / slope * np.linalg.norm(along, axis=1)
    assert np.abs(hits.ranges - expected).max() < allowed_m
    cosine = np.abs(slope) / np.linalg.norm(along, axis=1) / np.linalg.norm([-0.1, 0.2, 1.0])
    np.testing.assert_allclose(hits.incidence_cosine, cosine, atol=allowed_m, rtol=0)


@either
@everywhere
def test_the_inside_of_a_box(place: tuple[float, float, float], allowed_m: float, backend: Backend) -> None:
    rng = np.random.default_rng(1)
    half = np.array([3.0, 2.5, 1.25])
    room = trimesh.creation.box(2 * half)
    origins, along = rng.uniform(-0.9, 0.9, (N, 3)) * half, rng.normal(size=(N, 3))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    walls = np.sort((np.copysign(half, along) - origins) / along, axis=1)
    inside = walls[:, 1] - walls[:, 0] > 1e-5  # at an edge float32 may name either wall
    assert inside.mean() > 0.999
    hits = cast(np.asarray(room.vertices) + place, np.asarray(room.faces), origins + place, along, backend)
    assert np.abs(hits.ranges - walls[:, 0])[inside].max() < allowed_m
    assert np.abs(hits.ranges - walls[:, 0]).max() < 1e-4


@either
@everywhere
def test_a_sphere(place: tuple[float, float, float], allowed_m: float, backend: Backend) -> None:
    rng, radius, centre = np.random.default_rng(2), 2.0, np.array(place)
    ball = trimesh.creation.icosphere(subdivisions=4, radius=radius)
    vertices, faces = np.asarray(ball.vertices) + centre, np.asarray(ball.faces)
    origins, along = balls_rays(rng, centre, radius)
    hits = cast(vertices, faces, origins, along, backend)
    assert facet_error(hits, vertices, faces, origins, along).max() < allowed_m
    points = origins - centre + along / np.linalg.norm(along, axis=1, keepdims=True) * hits.ranges[:, None]
    depth = radius - np.linalg.norm(points, axis=1)
    sagitta = radius - np.linalg.norm(ball.triangles.mean(axis=1), axis=1).min()
    assert depth.min() > -allowed_m
    assert 0.8 * sagitta < depth.max() < sagitta + allowed_m


@either
@everywhere
def test_a_cylinder(place: tuple[float, float, float], allowed_m: float, backend: Backend) -> None:
    rng, radius, n = np.random.default_rng(3), 1.5, 96
    angle = np.arange(n) * 2 * np.pi / n
    ring = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(n, -4.0)], axis=1)
    vertices = np.concatenate([ring, ring + [0, 0, 8]]) + place
    i, j = np.arange(n), (np.arange(n) + 1) % n
    faces = np.concatenate([np.stack([i, j, j + n], axis=1), np.stack([i, j + n, i + n], axis=1)])
    origins, along = balls_rays(rng, np.array(place), radius)
    along[:, 2] = np.hypot(along[:, 0], along[:, 1]) * rng.uniform(-1, 1, N)  # through the wall, not the ends
    hits = cast(vertices, faces, origins, along, backend)
    assert facet_error(hits, vertices, faces, origins, along).max() < allowed_m
    points = origins - place + along / np.linalg.norm(along, axis=1, keepdims=True) * hits.ranges[:, None]
    depth = radius - np.hypot(points[:, 0], points[:, 1])
    sagitta = radius * (1 - np.cos(np.pi / n))
    assert depth.min() > -allowed_m
    assert 0.9 * sagitta < depth.max() < sagitta + allowed_m
