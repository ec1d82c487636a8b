# SPDX-License-Identifier: MIT
"""3-D view of scans without a model: what they measured, what was inferred, and where the unknown begins."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from nbv.report.pictures import picture
from nbv.report.pictures.camera import aside_cameras
from nbv.report.pictures.completion_shots import is_single_camera
from nbv.report.pictures.picture import Picture
from nbv.report.viewer.block import Viewer
from nbv.report.viewer.layers import Category, Classes, Layer, Numbers, confidence_channel, deviation_channel
from nbv.report.viewer.markers import given_markers, view_markers, zone_lines
from nbv.report.viewer.scan_channels import INFERRED, provenance_categories, quality_channels, scan_sightings
from nbv.report.viewer.scene_view import PALE
from nbv.scanning.sensor import Sensor
from nbv.scans.scan_coverage import ScanCoverage
from nbv.scans.state_mesh import FRONTIER, SEEN_WORSE, SHADOW, STATES, StateMesh
from nbv.scans.state_mesh import INFERRED as STATE_INFERRED
from nbv.visibility.zones import EVERYWHERE, Zones
from scenes.checks import FloatArray
from scenes.mesh.labelled_mesh import Appearance
from scenes.mesh.mesh_parts import thinned
from scenes.pose import Pose

_CATEGORIES = (
    Category(STATES[0], picture.MEASURED),
    Category(STATES[1], PALE),
    INFERRED,
    Category(STATES[SHADOW], picture.UNKNOWN, "hatched"),
    Category(STATES[FRONTIER], (0.86, 0.86, 0.84), "dotted"),
)
_MOST_FACES = 600_000  # that were measured; edges of the unknown have as many voxels' faces as they have


def state_view(
    coverage: ScanCoverage,
    state: StateMesh,
    pictures: tuple[Picture, ...],
    *,
    poses: Sequence[Pose] = (),
    sensor: Sensor | None = None,
    zones: Zones = EVERYWHERE,
) -> Viewer:
    """Return the view of what scans say of a place, with the next stations and the sensor there."""
    scans = coverage.scan_map.scans
    given = given_markers(
        [s.world_from_sensor for s in scans], [s.projection for s in scans], are_steps=not poses
    )
    following = view_markers(poses, [sensor.projection] * len(poses)) if sensor is not None else ()
    layers = (_measured(coverage, state), _inferred(coverage, state), *_edges(state))
    single = is_single_camera(list(scans))
    return Viewer(
        "What the scans measured, and where the unknown begins.",
        tuple(layer for layer in layers if len(layer.faces)),
        markers=(*given, *following),
        lines=zone_lines(zones),
        is_room=coverage.scan_map.mode == "room" and not single,
        pictures=pictures,
        camera=aside_cameras(scans[0])[0] if single else None,
        one="view" if poses else "scan",
    )


def _measured(coverage: ScanCoverage, state: StateMesh) -> Layer:
    """What was measured, as required or worse."""
    faces = _faces(state, state.mesh.face_surface <= SEEN_WORSE)
    vertices, faces, kept = thinned(state.mesh.vertices, faces, _MOST_FACES)
    scans = coverage.scan_map.scans
    value = state.state[kept][faces].max(axis=1, initial=0).astype(np.uint16)
    sightings = scan_sightings(scans, vertices, faces)
    channels = (_states(value), *quality_channels(sightings, len(scans)))
    has_colour = any(scan.colour is not None for scan in scans)
    skin = Appearance((state.colour[kept][faces] / 255.0).astype(np.float32)) if has_colour else None
    shown = (vertices, faces, _CATEGORIES[0])
    return Layer("measured", "measured", *shown, channels=channels, sightings=sightings, skin=skin)


def _inferred(coverage: ScanCoverage, state: StateMesh) -> Layer:
    """What completion inferred, with its provenance and standard deviation."""
    faces = _faces(state, state.mesh.face_surface == STATE_INFERRED)
    model = coverage.completion
    channels: tuple[Classes | Numbers, ...] = (_states(np.full(len(faces), STATE_INFERRED, np.uint16)),)
    if model is not None and len(faces):
        points = model.hypothesised
        sd = 1000 * points.sd[points.faces].mean(axis=1)
        likely = points.confidence[points.faces].min(axis=1)
        why = points.provenance[points.faces].max(axis=1).astype(np.uint16)
        channels += (
            Classes("provenance", "Provenance", provenance_categories(), why),
            deviation_channel(sd, float(sd.max())),
            confidence_channel(likely),
        )
    named = ("inferred", "hypothesised (inferred)")
    return Layer(*named, state.mesh.vertices, faces, INFERRED, channels=channels)


def _edges(state: StateMesh) -> tuple[Layer, ...]:
    """Where the unknown begins: edges of shadows; the frontier, which hides much, is not shown at first."""
    layers = []
    for key, label, value in (
        ("unseen", "unseen: edges of shadows", SHADOW),
        ("frontier", "frontier", FRONTIER),
    ):
        faces = _faces(state, state.mesh.face_surface == value)
        drawn = (state.mesh.vertices, faces, _CATEGORIES[value])
        channels = (_states(np.full(len(faces), value, np.uint16)),)
        layers.append(Layer(key, label, *drawn, channels=channels, shown=value == SHADOW))
    return tuple(layers)


def _states(values: NDArray[np.uint16]) -> Classes:
    return Classes("state", "State", _CATEGORIES, values)


def _faces(state: StateMesh, chosen: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Faces turned so that they are counter-clockwise seen from the side to which they look."""
    index = np.flatnonzero(chosen)
    faces = state.mesh.faces[index].astype(np.int64)
    turned = np.einsum("ij,ij->i", _normals(state.mesh.vertices, faces), state.front[index]) < 0
    faces[turned] = faces[turned][:, ::-1]
    return faces


def _normals(vertices: FloatArray, faces: NDArray[np.int64]) -> FloatArray:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normals: FloatArray = np.cross(b - a, c - a)
    return normals
