# SPDX-License-Identifier: MIT
"""Drawings of a completed model before a camera, as measured, completed, and completed with marks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from completion.result.completion import Completion
from completion.result.meshes import display_mesh
from nbv.report.figures.drawing import MeshDrawing, SeenFaces, mark_inferred, mark_unknown, passes_hidden
from nbv.report.figures.picture import Camera, Picture, picture_of
from scenes.checks import BoolArray, FloatArray
from scenes.mesh.labelled_mesh import Appearance, LabelledMesh
from scenes.scan.projection import SphericalProjection
from scenes.scan.range_image import RangeImage

_WIDTH, _TRIAL_WIDTH = 760, 96
_CAMERA_LIKE = np.radians(80.0)  # field of view up to which a step aside shows what a scan saw
_INFERRED = 1  # surface of inferred faces in the mesh for display


def is_single_camera(scans: Sequence[RangeImage]) -> bool:
    """Tell whether there is one scan, and that of no more than a camera would see."""
    if len(scans) != 1:
        return False
    projection = scans[0].projection
    if isinstance(projection, SphericalProjection):
        spans = np.ptp(projection.azimuths), np.ptp(projection.elevations)
        return bool(max(spans) <= _CAMERA_LIKE)
    return True


@dataclass(frozen=True, slots=True, eq=False)
class ModelDrawings:
    """What was measured and what was inferred, ready for drawing.

    `bounds` (2, 3) are those of nearly all of it, and `scans`; all in coordinates of drawings, z up.
    """

    model: MeshDrawing
    bounds: FloatArray
    scans: tuple[RangeImage, ...]

    @classmethod
    def of(
        cls, completion: Completion, n_threads: int | None = None, *, in_colour: bool = True
    ) -> ModelDrawings:
        """Set up a completed model; without colour its shape alone is drawn, in grey."""
        mesh = display_mesh(completion)
        mesh = mesh if in_colour else replace(mesh, appearance=None)
        bounds = solid_bounds(mesh) if len(mesh.faces) else np.zeros((2, 3))
        return cls(MeshDrawing(mesh, n_threads=n_threads), bounds, completion.drawn_scans)

    @property
    def is_empty(self) -> bool:
        """Whether there is no surface at all."""
        return not len(self.model.mesh.faces)

    def is_inferred(self, layer: SeenFaces) -> BoolArray:
        """Return the pixels (rows, columns) that show inferred area."""
        labels = self.model.mesh.face_surface
        return np.asarray(layer.hit & (labels[np.maximum(layer.face, 0)] == _INFERRED), dtype=np.bool_)

    def count_shown(self, camera: Camera) -> int:
        """How many pixels show the model to a camera; those of inferred area count twice."""
        layer = self.model.look(camera, camera.shape(_TRIAL_WIDTH))
        return int(self.is_inferred(layer).sum()) + int(layer.hit.sum())

    def shoot(self, camera: Camera, where: str) -> tuple[Picture, Picture, Picture]:
        """Return the pictures as measured, completed, and completed with inferred area marked."""
        shape = camera.shape(_WIDTH)
        measured = self.model.mesh.face_surface != _INFERRED
        first, last = self.model.look(camera, shape, measured), self.model.look(camera, shape)
        hidden, inferred = self._find_hidden(camera, ~first.hit), self.is_inferred(last)
        unknown = (hidden | inferred) & ~first.hit
        colour = self.model.colour(last)
        return (
            picture_of(mark_unknown(self.model.colour(first), unknown), "Measured.", where),
            picture_of(
                mark_unknown(colour, hidden & ~last.hit),
                "Completed.",
                "With what was inferred, texture and all.",
            ),
            self._mark(last, colour, hidden & ~last.hit),
        )

    def shoot_marked(self, camera: Camera) -> Picture:
        """Return the last of these pictures alone."""
        last = self.model.look(camera, camera.shape(_WIDTH))
        return self._mark(last, self.model.colour(last), self._find_hidden(camera, ~last.hit))

    def _mark(self, last: SeenFaces, colour: FloatArray, unknown: BoolArray) -> Picture:
        marked = mark_inferred(colour, self.is_inferred(last), self.model.shade(last))
        return picture_of(
            mark_unknown(marked, unknown),
            "Completed, marked.",
            "What was inferred is blue; nothing is known where it is hatched.",
        )

    def _find_hidden(self, camera: Camera, where: BoolArray) -> BoolArray:
        """Of the pixels (rows, columns) `where` nothing is seen those that look into what is hidden."""
        beside = not is_single_camera(self.scans) and len(self.scans) > 1
        return passes_hidden(camera, where, self.scans, _inner(self.bounds), beside_counts=beside)


def _inner(bounds: FloatArray) -> FloatArray:
    """Return a box 1 % smaller, so that its own walls hide nothing in it."""
    inner: FloatArray = bounds.mean(axis=0) + 0.99 * (bounds - bounds.mean(axis=0))
    return inner


def solid_bounds(mesh: LabelledMesh) -> FloatArray:
    """Bounds (2, 3) of the mesh without its most remote half percents."""
    return np.quantile(mesh.vertices, [0.005, 0.995], axis=0)


def part_of(mesh: LabelledMesh, kept: Any) -> LabelledMesh:
    """Return the mesh with some of its faces."""
    look = mesh.appearance
    part = None
    if look is not None:
        part = Appearance(
            look.corner_colour[kept],
            look.images,
            None if look.face_image is None else look.face_image[kept],
            None if look.corner_uv is None else look.corner_uv[kept],
        )
    return LabelledMesh(mesh.vertices, mesh.faces[kept], mesh.face_surface[kept], part)
