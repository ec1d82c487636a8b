# SPDX-License-Identifier: MIT
"""Invariants: what holds of all that a reader returns; what does not hold is a silently wrong result."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from completion.edits.edit import Edit
from nbv.plan.plan import Plan
from nbv.visibility.viewpoints import Candidates
from scenes.io.point_files import PointCloud
from scenes.pose import Pose
from scenes.rays.raycast import RayCaster
from scenes.scan.colour import unit_colour
from scenes.scan.range_image import RangeImage
from scenes.world.scene import Scene

MOST_M = 1e30  # lengths whose products are finite in double precision


class BrokenInvariantError(AssertionError):
    """A reader returned what it promises not to return."""


def hold(truth: object, what: str) -> None:
    """Raise BrokenInvariantError unless something is true."""
    if not truth:
        raise BrokenInvariantError(what)


def check_pose(pose: Pose) -> None:
    """Rigid: a rotation and a finite place."""
    rotation = pose.rotation
    hold(np.isfinite(pose.matrix).all(), "pose is not finite")
    hold(np.abs(rotation.T @ rotation - np.eye(3)).max() < 1e-9, "rotation is not orthonormal")
    hold(np.linalg.det(rotation) > 0, "pose is left-handed")
    hold(np.abs(pose.translation).max() < MOST_M, "pose stands beyond any number")


def check_scan(scan: RangeImage) -> None:
    """Shapes agree; where something came back all is finite, elsewhere nothing is claimed."""
    check_pose(scan.world_from_sensor)
    shape = scan.projection.shape
    hold(scan.ranges.shape == shape and min(shape) > 0, f"ranges {scan.ranges.shape} for {shape}")
    hold((scan.ranges > 0).all(), "a range is not positive")
    points, valid = scan.points(), scan.valid
    hold(points.shape == (*shape, 3), "points have another shape")
    hold(np.isfinite(points[valid]).all(), "a return has no finite point")
    hold(np.isnan(points[~valid]).all(), "there is a point where nothing came back")
    rays = scan.rays()
    hold(np.abs(np.linalg.norm(rays, axis=-1) - 1).max() < 2e-6, "a viewing ray has not length one")
    if scan.colour is not None:
        hold(scan.colour.shape == (*shape, 3), "colours have another shape")
        known = unit_colour(scan.colour)
        hold(((known >= 0) & (known <= 1)).all(), "a colour is not in 0..1")
    if scan.intensity is not None:
        hold(scan.intensity.shape == shape, "intensities have another shape")
        hold(np.isfinite(scan.intensity[valid]).all(), "an intensity is not finite")
    hold(scan.sigma_m is None or (np.isfinite(scan.sigma_m) and scan.sigma_m >= 0), "sigma is no deviation")
    for text in (scan.name, scan.sensor, scan.noise):
        hold(isinstance(text, str), "a name is no text")
        text.encode("utf-8")


def check_points(cloud: PointCloud) -> None:
    """Finite points, at least one, and as many of all else."""
    n = len(cloud.points)
    hold(n > 0 and cloud.points.shape == (n, 3), f"points have shape {cloud.points.shape}")
    hold(np.isfinite(cloud.points).all(), "a point is not finite")
    hold(np.abs(cloud.points).max() < MOST_M, "a point lies beyond any number")
    for name in ("normals", "origins", "colour"):
        array = getattr(cloud, name)
        hold(array is None or array.shape == (n, 3), f"{name} have another shape")
        hold(array is None or np.isfinite(array).all(), f"{name} are not finite")
    check_texts(cloud.warnings)


def check_texts(texts: Sequence[str]) -> None:
    """Sentences of one line each."""
    for text in texts:
        hold(isinstance(text, str) and text, "a warning is no text")
        hold("\n" not in text and len(text) < 2000, "a warning has several lines")


def check_scene(scene: Scene) -> None:
    """Finite vertices, faces in range, a name for each surface, colours in 0..1, and rays that meet it."""
    mesh = scene.mesh
    hold(len(mesh.faces) > 0, "no faces")
    hold(np.isfinite(mesh.vertices).all() and np.abs(mesh.vertices).max() < MOST_M, "a vertex is not usable")
    hold(mesh.faces.min() >= 0 and mesh.faces.max() < len(mesh.vertices), "a face names no vertex")
    hold(len(mesh.face_surface) == len(mesh.faces), "a face has no surface")
    hold(
        mesh.face_surface.min() >= 0 and mesh.face_surface.max() < len(scene.surfaces), "a face of no surface"
    )
    hold(len(scene.surface_names) == len(scene.surfaces), "a surface without name")
    hold(len(set(scene.surface_names)) == len(scene.surface_names), "two surfaces have one name")
    areas = mesh.face_areas()
    hold(np.isfinite(areas).all() and (areas >= 0).all(), "an area is not finite")
    check_texts(scene.warnings)
    look = mesh.appearance
    if look is not None:
        hold(((look.corner_colour >= 0) & (look.corner_colour <= 1)).all(), "a colour is not in 0..1")
        hold(
            look.corner_uv is None or np.isfinite(look.corner_uv).all(), "texture coordinates are not finite"
        )
    _check_rays(scene)


def _check_rays(scene: Scene) -> None:
    """Embree takes it, and what it hits is there."""
    mesh = scene.mesh
    middles = mesh.corners[:4].mean(axis=1)
    away = middles - mesh.vertices.mean(axis=0) + np.array([1e-3, 2e-3, 3e-3])
    hits = RayCaster(mesh.vertices, mesh.faces, n_threads=1).first_hit(middles + away, -away)
    hold(((hits.face >= -1) & (hits.face < len(mesh.faces))).all(), "a ray met a face that is not there")
    hold(
        np.isfinite(hits.ranges[hits.hit]).all() and (hits.ranges[hits.hit] >= 0).all(), "a hit has no range"
    )


def check_plan(plan: Plan) -> None:
    """Numbers where numbers are promised, poses that are rigid."""
    for view in plan.views:
        check_pose(view.world_from_sensor)
        for value in (view.gain_m2, view.met_fraction, view.predicted_gain_m2):
            _check_number(value, "of a view")
    coverage = plan.coverage
    if coverage is not None:
        for name in ("total_m2", "met", "reachable", "unreachable", "inferred", "modelled", "unknown"):
            _check_number(getattr(coverage, name), name)
    for shares in plan.shares:
        for name in ("views", "met", "modelled", "inferred", "unknown", "reached"):
            _check_number(getattr(shares, name), name)
    hold(plan.n_candidates >= 0, "less than no candidates")
    hold(isinstance(plan.method, str), "method is no text")
    plan.sensor.to_json()
    if plan.resumed_from is not None:
        for pose in plan.resumed_from.poses:
            check_pose(pose)


def _check_number(value: Any, name: str) -> None:
    number = value is None or (isinstance(value, int | float) and not isinstance(value, bool))
    hold(
        number and (value is None or np.isfinite(value)),
        f"{name} is {type(value).__name__}, no finite number",
    )


def check_candidates(candidates: Candidates) -> None:
    """Finite positions, unit directions, poses that are rigid."""
    hold(candidates.n_poses > 0, "no candidates")
    hold(np.isfinite(candidates.positions).all(), "a position is not finite")
    length = np.linalg.norm(candidates.directions, axis=-1)
    hold(np.abs(length - 1).max() < 1e-9, "a direction has not length one")
    check_pose(candidates.pose(0))
    check_pose(candidates.pose(candidates.n_poses - 1))
    if candidates.patch_points is not None and candidates.patch_normals is not None:
        hold(candidates.patch_points.shape == candidates.patch_normals.shape, "patches without normals")


def check_edits(edits: Sequence[Edit]) -> None:
    """Finite points."""
    for edit in edits:
        hold(edit.surfaces, "an edit of no surface")
        for anchor in edit.surfaces:
            hold(np.isfinite(anchor.point).all() and anchor.point.shape == (3,), "an anchor is no point")
            hold(anchor.kind is None or isinstance(anchor.kind, str), "a kind is no text")
        if edit.outline is not None:
            hold(np.isfinite(edit.outline).all(), "an outline is not finite")


def check_description(held: Any) -> None:
    """JSON, with a kind and warnings of a line each."""
    hold(isinstance(held, dict) and isinstance(held.get("kind"), str), "no kind")
    json.dumps(held, allow_nan=False).encode("utf-8")
    check_texts(held.get("warnings", []))
