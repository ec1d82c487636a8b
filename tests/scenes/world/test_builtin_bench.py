# SPDX-License-Identifier: MIT
"""`office` and `drum_and_post` are the published instances: same ranges and surfaces from the same poses."""

from functools import cache

import numpy as np
import pytest

from scenes.checks import FloatArray
from scenes.world.builtin import builtin_scene
from scenes.world.scene import Scene
from tests.helpers.bench_scans import SIGMA_M, bench_frames, cast
from tests.helpers.data_paths import requires_bench

FRAMES = range(10)
both = pytest.mark.parametrize("name", ["office", "drum_and_post"])


@cache
def frames_of(name: str) -> tuple[FloatArray, FloatArray]:
    """Difference of the ranges in all frames, and how often our id meets theirs."""
    bench, scene = bench_frames(name), builtin_scene(name)
    residuals, meetings = [], np.zeros((len(scene.surfaces) + 1, int(bench.surface.max()) + 2), np.int64)
    for frame in FRAMES:
        ranges, surface = cast(scene, bench.poses[frame], bench.projection)
        residuals.append(bench.ranges[frame] - ranges)
        np.add.at(meetings, (surface.ravel(), bench.surface[frame].ravel()), 1)
    return np.stack(residuals), meetings.astype(np.float64)


@requires_bench
@both
def test_ranges_agree_within_the_noise_and_without_bias(name: str) -> None:
    residuals, _ = frames_of(name)
    assert np.isfinite(residuals).all()
    core = residuals[np.abs(residuals) < 6 * SIGMA_M]
    # Beside silhouettes float32 rays may meet the other surface: at most 1 in 10,000 pixels.
    assert len(core) > 0.9999 * residuals.size
    assert abs(core.mean()) < 4 * SIGMA_M / np.sqrt(core.size)
    assert core.std() == pytest.approx(SIGMA_M, rel=4 / np.sqrt(2 * core.size))


@requires_bench
@both
def test_no_surface_is_out_of_place(name: str) -> None:
    residuals, _ = frames_of(name)
    bench = bench_frames(name)
    for surface in np.unique(bench.surface[bench.surface >= 0]):
        own = residuals[bench.surface == surface]
        own = own[np.abs(own) < 6 * SIGMA_M]
        if len(own) > 30:
            assert abs(own.mean()) < 4.5 * SIGMA_M / np.sqrt(len(own))


@requires_bench
@both
def test_surfaces_are_the_same_up_to_their_numbers(name: str) -> None:
    _, meetings = frames_of(name)
    best = meetings.max(axis=1)
    assert best.sum() > 0.9999 * meetings.sum()
    partner = meetings.argmax(axis=1)[meetings.sum(axis=1) > 10]  # fewer are rays beside silhouettes
    assert len(set(partner.tolist())) == len(partner)


def opening_sizes(scene: Scene) -> list[list[float]]:
    return [np.ptp(opening.outline, axis=0).tolist() for opening in scene.openings]


def test_the_offices_openings_are_window_and_door() -> None:
    scene = builtin_scene("office")
    np.testing.assert_allclose(opening_sizes(scene), [[0, 0.9, 0.9], [0, 0.6, 2.0]], atol=1e-12)
    for opening in scene.openings:
        wall = scene.surfaces[opening.surface]
        assert wall is not None
        assert np.abs(wall.distance(opening.outline)).max() < 1e-12
        assert scene.surface_names[opening.surface] == "wall x=4"
        middle = opening.outline.mean(axis=0)
        hits = scene.ray_caster().first_hit([middle - [1.0, 0, 0]], [[1.0, 0, 0]])
        assert scene.surface_names[scene.mesh.face_surface[hits.face[0]]] == "outside"
