# SPDX-License-Identifier: MIT
"""Sequences: scans merged some at a time come to the surfaces of a room, as all of them together do."""

from dataclasses import replace

import numpy as np
import pytest

from completion.evidence.sight import sight_of
from completion.merging import pipeline
from completion.merging.pieces import SurfacePiece, UnconfirmedRegions, drop_unconfirmed
from completion.observe.observation import PixelSet, observe
from completion.observe.tolerance import EvidenceOptions
from completion.segmentation.pipeline import segment
from completion.segmentation.regions import SegmentationOptions
from nbv import PinholeSensor, scan_scene
from scenes import Pose, RayCaster
from scenes.world.builtin import Finish, SceneBuilder

N_FRAMES = 12


@pytest.fixture(scope="module")
def frames():
    """A turn in the middle of a room without furniture, and the regions of each frame."""
    x, y, z = np.diag([5.0, 4.0, 2.7])
    corner, white, builder = np.zeros(3), Finish((0.8, 0.8, 0.8)), SceneBuilder("room", "room")
    builder.add_rectangle("floor", corner, x, y, white)
    builder.add_rectangle("ceiling", z + y, x, -y, white)
    builder.add_rectangle("south", x, -x, z, white)
    builder.add_rectangle("north", y, x, z, white)
    builder.add_rectangle("west", corner, y, z, white)
    builder.add_rectangle("east", x + y, -y, z, white)
    scene = builder.finish()
    caster = RayCaster(scene.mesh.vertices, scene.mesh.faces)
    sensor, eye, scans = PinholeSensor(fov_deg=75.0, width=96, height=96), np.array([2.5, 2.0, 1.4]), []
    for k in range(N_FRAMES):
        way = 2 * np.pi * k / N_FRAMES
        pose = Pose.looking_at(eye, eye + [np.cos(way), np.sin(way), 0.1 * np.sin(3 * k)])
        scans.append(scan_scene(scene, pose, sensor, noise="gaussian-2mm", rng=k, caster=caster))
    observations = [observe(scan, scans[0].world_from_sensor) for scan in scans]
    return observations, [segment(seen, SegmentationOptions()) for seen in observations]


@pytest.mark.parametrize(("most", "block"), [(2, 2), (4, 3), (11, 5)])
def test_blocks_of_scans_come_to_what_all_scans_come_to(frames, monkeypatch, most, block):
    observations, regions = frames
    tolerance = EvidenceOptions().tolerance()
    together = pipeline.merge(observations, regions, tolerance)
    monkeypatch.setattr(pipeline, "_MOST_SCANS", most)
    monkeypatch.setattr(pipeline, "_BLOCK", block)
    apart = pipeline.merge(observations, regions, tolerance)
    assert len(apart) == len(together) == 6
    assert UnconfirmedRegions.of(regions, apart) == UnconfirmedRegions.of(regions, together) == (0, 0)
    left_out = apart[1:]
    assert UnconfirmedRegions.of(regions, left_out) == (apart[0].n_parts, apart[0].n_pixels)
    for one, other in zip(apart, together, strict=True):
        assert one.n_parts == other.n_parts
        for own, expected in zip(one.pixels, other.pixels, strict=True):
            np.testing.assert_array_equal(own.flat, expected.flat)
        points = other.points(observations)[::50]  # parameters are about a place of each fit's own
        deviation = other.fit.standard_deviation(points)
        np.testing.assert_allclose(one.fit.standard_deviation(points), deviation, rtol=0.05)
        moved = one.fit.surface.distance(points) - other.fit.surface.distance(points)
        assert (np.abs(moved) < deviation).all()


def test_up_to_64_scans_are_merged_all_together(frames, monkeypatch):
    observations, regions = frames
    fits = [one.fit for one in pipeline.merge(observations, regions, EvidenceOptions().tolerance())]
    monkeypatch.setattr(pipeline, "_BLOCK", 2)
    again = [one.fit for one in pipeline.merge(observations, regions, EvidenceOptions().tolerance())]
    for one, other in zip(fits, again, strict=True):
        np.testing.assert_array_equal(one.covariance, other.covariance)


PLACES = {  # how many other frames, where along, whether something hides it: whether the piece is left
    "five that look from as near": (5, 0.0, False, False),
    "only four": (4, 0.0, False, True),
    "five from half as far again": (5, -1.0, False, True),
    "five that something stands before": (5, 0.0, True, True),
}


@pytest.mark.parametrize("law", PLACES)
def test_what_five_other_frames_do_not_find_is_no_surface(law):
    n_others, along, is_hidden, is_left = PLACES[law]
    builder, white = SceneBuilder("wall", "room"), Finish((0.8, 0.8, 0.8))
    builder.add_rectangle("wall", (2.0, -2, -2), (0, 4.0, 0), (0, 0, 4.0), white)
    if is_hidden:
        builder.add_rectangle("board", (1.0, 0.3, -2), (0, 4.0, 0), (0, 0, 4.0), white)
    scene, sensor = builder.finish(), PinholeSensor(fov_deg=50.0, width=64, height=64)
    caster = RayCaster(scene.mesh.vertices, scene.mesh.faces)
    places = [np.zeros(3), *np.tile([along, 0.9 if is_hidden else 0.0, 0.0], (n_others, 1))]
    poses = [Pose.looking_at(place, np.array([2.0, 0.0, 0.0])) for place in places]
    scans = [
        scan_scene(scene, pose, sensor, noise="gaussian-2mm", rng=k, caster=caster)
        for k, pose in enumerate(poses)
    ]
    seen, tolerance = [observe(scan, poses[0]) for scan in scans], EvidenceOptions().tolerance()
    (wall, *_) = segment(seen[0], SegmentationOptions())
    rows, columns = np.divmod(wall.pixels.flat, 64)
    amid = wall.pixels.flat[(np.abs(rows - 32) < 6) & (np.abs(columns - 32) < 6)]
    piece = SurfacePiece.of_region(3, replace(wall, pixels=PixelSet(amid, (64, 64))), seen[0], tolerance)
    found = drop_unconfirmed([[piece], [piece, piece]], [sight_of(one, tolerance) for one in seen], 3)
    assert found == ([[piece]] if is_left else []) + [[piece, piece]]
