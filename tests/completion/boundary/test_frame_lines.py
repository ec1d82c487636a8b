# SPDX-License-Identifier: MIT
"""The edge of the view: inferred floor ends on the image's edge, without teeth, and inside it."""

import numpy as np
import pytest

from benchmarks.cases.houses.solids import Part, box, quads, scene_of
from completion import CompletionOptions, complete
from completion.boundary.meshing import frame_normals
from completion.evidence.evidence import Label
from nbv import PinholeSensor, scan_scene
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection, SphericalProjection
from scenes.scan.range_image import RangeImage


def image(projection, pose=None) -> RangeImage:
    return RangeImage(np.ones(projection.shape), projection, pose or Pose.identity())


@pytest.mark.parametrize("fy", [60.0, -60.0])
def test_planes_hold_what_an_image_sees(fy):
    projection = PinholeProjection(40, 30, 50.0, fy, 12.0, 17.0)
    pose = Pose.looking_at((1.0, -2.0, 1.5), (0.0, 0.0, 0.3))
    normals = frame_normals(image(projection, pose))
    places = np.random.default_rng(0).uniform(-4, 4, (20_000, 3))
    seen = np.isfinite(projection.pixels(pose.inverse().apply(places))).all(axis=1)
    inside = (pose.inverse().apply(places) @ pose.inverse().rotate(normals).T >= 0).all(axis=1)
    assert 100 < seen.sum() < 19_000
    np.testing.assert_array_equal(seen, inside)


def test_turning_scanners_have_no_frame():
    assert len(frame_normals(image(SphericalProjection.regular(8, 16, 360.0, (-40.0, 40.0))))) == 0


@pytest.mark.parametrize("n_scans", [1, 2])
def test_inferred_floor_ends_at_the_edge_of_the_view(n_scans):
    """A board stands across the image's edges, which run obliquely over the floor's cells."""
    room = quads([[[-3, 3, 0], [3, 3, 0], [3, 3, 2.5], [-3, 3, 2.5]],
                  [[-3, -3, 0], [3, -3, 0], [3, 3, 0], [-3, 3, 0]]])  # fmt: skip
    board = box([-3.0, 0.6, 0.3], [3.0, 0.62, 0.6])
    scene = scene_of("board", [Part("room", room, (0.8,) * 3), Part("board", board, (0.5,) * 3)])
    camera = PinholeSensor(fov_deg=50, width=160, height=120)
    poses = [Pose.looking_at((-1.2, -1.5, 1.5), (-0.4 + 0.2 * k, 1.5, 0.3)) for k in range(n_scans)]
    scans = [scan_scene(scene, pose, camera, rng=k) for k, pose in enumerate(poses)]
    completed = complete(scans, CompletionOptions(texture=False), rng=0)
    assert completed.free_space_violation_m2 == 0
    floor = max(completed.patches, key=lambda patch: patch.observed_m2 * patch.limits.is_level)
    mesh = completed.inferred[completed.patches.index(floor)]

    def depth_in_view(points):
        scans = [seen.scan for seen in completed.observations]
        sides = [frame_normals(scan) for scan in scans]
        unit = [side / np.linalg.norm(side, axis=1, keepdims=True) for side in sides]
        return np.max(
            [((points - scan.origin) @ four.T).min(axis=1) for four, scan in zip(unit, scans, strict=True)],
            axis=0,
        )

    depth = depth_in_view(mesh.vertices)
    cell = float(floor.grid.cell.max())
    assert depth.min() > -1e-9
    assert np.count_nonzero(depth < 1e-9) > 20  # it ends there, and not half a cell before
    out = floor.hypothesised & (floor.evidence.labels == Label.OUT)
    assert out.any()
    assert (floor.confidence[out] >= 0.5).all()
    assert (depth_in_view(floor.grid.centres()[out.ravel()]) > -cell).all()
