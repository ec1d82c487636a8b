# SPDX-License-Identifier: MIT
"""Snapshots for issues of a check: each element that deviates or is missing, as the nearest scan saw it."""

from __future__ import annotations

import numpy as np

from completion.asbuilt.findings import DesignCheck
from nbv.inspection.verdict_colours import VERDICT_COLOURS, rgb_of
from nbv.report.figures.drawing import MeshDrawing, paint_states
from nbv.report.figures.picture import Camera, aim, picture_of
from scenes.checks import FloatArray

_SHAPE = (240, 320)  # rows and columns
_MOST = 40  # snapshots: later topics have none
_MARGIN, _WIDEST = 1.3, 1.2  # of the element in the picture; tangent of half the widest field of view
_THROUGH = 0.6  # opacity of what other elements hide
_GREY = (0.80, 0.82, 0.83)


def check_snapshots(check: DesignCheck, n_threads: int | None = None) -> dict[int | str, bytes]:
    """Return PNGs by the surface ids of the elements, which have the colour of their verdict."""
    told = [finding for finding in check.elements if finding.verdict in ("deviates", "missing")][:_MOST]
    if not told or not check.alignment.poses:
        return {}
    mesh = check.design.mesh
    drawing = MeshDrawing(mesh, n_threads=n_threads)
    places = np.array([pose.translation for pose in check.alignment.poses])
    pictures: dict[int | str, bytes] = {}
    for finding in told:
        corners = mesh.corners[mesh.face_surface == finding.surface].reshape(-1, 3)
        camera = _camera(corners, places, finding.directions_measured)
        around = drawing.look(camera, _SHAPE)
        own = drawing.look(camera, _SHAPE, mesh.face_surface == finding.surface)
        image = paint_states(np.where(around.hit, 0, -1), drawing.shade(around), {0: _GREY})
        white = image[..., :3] * image[..., 3:] + 1.0 - image[..., 3:]
        hue = paint_states(
            np.where(own.hit, 0, -1), drawing.shade(own), {0: rgb_of(VERDICT_COLOURS[finding.verdict])}
        )
        covers = np.where(own.face == around.face, 1.0, _THROUGH)[..., None] * hue[..., 3:]
        white = covers * hue[..., :3] + (1 - covers) * white
        pictures[finding.surface] = picture_of(white, "").png
    return pictures


def _camera(corners: FloatArray, places: FloatArray, directions: tuple[tuple[float, ...], ...]) -> Camera:
    """A camera at the nearest of the places (s, 3) before the measured side of corners (n, 3)."""
    centre = (corners.min(axis=0) + corners.max(axis=0)) / 2
    towards = places - centre
    away = np.linalg.norm(towards, axis=1)
    before = towards @ np.array(directions[0]) > 0 if directions else np.ones(len(places), np.bool_)
    eye = places[np.argmin(np.where(before, away, away + away.max()))]
    sight = (centre - eye) / max(float(np.linalg.norm(centre - eye)), 1e-9)
    up = np.array([0.0, 1.0, 0.0]) if abs(sight[2]) > 0.95 else np.array([0.0, 0.0, 1.0])
    across = float(np.linalg.norm(corners.max(axis=0) - corners.min(axis=0))) / 2
    half = min(_MARGIN * across / max(float(np.linalg.norm(centre - eye)), 1e-6), _WIDEST)
    return aim(eye, eye + sight, up, half * np.array([_SHAPE[1] / _SHAPE[0], 1.0]), mirrored=False)
