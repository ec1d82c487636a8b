# SPDX-License-Identifier: MIT
"""Rays a second: our checked ray caster beside the raw Embree calls that it needs, same rays, same run."""

import numpy as np
import pytest
import trimesh
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from scenes import PinholeProjection, Pose, RayCaster

SIDE = 1000


@pytest.fixture(scope="module")
def scene():
    """A closed room with spheres, about 330,000 triangles, and a million primary rays."""
    ball = trimesh.creation.icosphere(subdivisions=6, radius=0.4)
    room = trimesh.creation.box((8, 8, 3))
    room.invert()
    places = [(-2, -2, -1), (2, -1, 0), (-1, 2, 0.5), (2, 2, -0.5)]
    mesh = trimesh.util.concatenate([room, *(ball.copy().apply_translation(place) for place in places)])
    pose = Pose.looking_at((-3.5, -3.5, 1.0), (0, 0, 0))
    rays = pose.rotate(PinholeProjection.from_fov(SIDE, SIDE, 70).directions().reshape(-1, 3))
    return mesh, np.broadcast_to(pose.translation, rays.shape), rays


@pytest.mark.benchmark(group="first hits of a million primary rays")
@pytest.mark.parametrize("n_threads", [1, 2])
def test_ray_caster(benchmark, scene, n_threads):
    mesh, origins, rays = scene
    caster = RayCaster(mesh.vertices, mesh.faces, n_threads)
    hits = benchmark.pedantic(caster.first_hit, (origins, rays), rounds=5, warmup_rounds=1)
    assert hits.hit.all()


@pytest.mark.benchmark(group="first hits of a million primary rays")
def test_raw_embreex_face_ids_only(benchmark, scene):
    mesh, origins, rays = scene
    raw = EmbreeScene(robust=True)
    TriangleMesh(raw, np.asarray(mesh.vertices, np.float32), np.asarray(mesh.faces, np.int32))
    start, along = np.asarray(origins, np.float32), np.asarray(rays, np.float32)
    face = benchmark.pedantic(raw.run, (start, along), rounds=5, warmup_rounds=1)
    assert (face >= 0).all()
