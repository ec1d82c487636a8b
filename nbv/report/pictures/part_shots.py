# SPDX-License-Identifier: MIT
"""Pictures of a part: coloured by surface, from the sides that show most surfaces."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nbv.report.pictures.camera import Camera, overview_cameras
from nbv.report.pictures.drawing import MeshDrawing, SeenFaces
from nbv.report.pictures.picture import Picture, height_colours, picture_of
from scenes.checks import FloatArray, IntArray
from scenes.mesh.labelled_mesh import Appearance, LabelledMesh
from scenes.scan.colour import surface_bytes

_WIDTH, _TRIAL_WIDTH = 760, 96
_HEIGHTS_DEG = (38.0, -38.0)
_GREY = 0.55  # of what has no height
_SIZE_M = 1.0  # at which a part is drawn, whatever its own


class PartDrawing:
    """A part ready for drawing: a mesh of which both sides are shown, and the surface (m,) of each face.

    It has the colours (m, 3, 3) of the faces' corners, or else those of the surfaces.
    """

    def __init__(self, mesh: LabelledMesh, place: IntArray, colour: FloatArray | None = None) -> None:
        low, high = mesh.bounds()
        scale = _SIZE_M / max(float(np.linalg.norm(high - low)), 1e-300)
        if colour is None:
            colour = np.repeat((surface_bytes(place) / 255.0)[:, None], 3, axis=1)
        self.scale, self.middle = scale, (low + high) / 2
        self.mesh = LabelledMesh(
            (mesh.vertices - self.middle) * scale,
            mesh.faces,
            appearance=Appearance(colour.astype(np.float32)),
        )
        self.place = place
        self._normals, self._centres = self.mesh.face_normals(), self.mesh.corners.mean(axis=1)

    def cameras(self, height_deg: float) -> list[Camera]:
        """Return cameras all around, in the drawing's frame."""
        return overview_cameras(self.mesh.bounds(), height_deg=height_deg)

    def look(self, camera: Camera, width: int) -> tuple[MeshDrawing, SeenFaces]:
        """Return what a camera sees; all faces turn their front to it."""
        towards = np.einsum("ij,ij->i", camera.origin - self._centres, self._normals)
        drawing = MeshDrawing(self.mesh, self._normals * np.where(towards < 0, -1.0, 1.0)[:, None])
        return drawing, drawing.look(camera, camera.shape(width))

    def n_shown(self, camera: Camera) -> float:
        """How many surfaces a camera shows well, each by the root of its pixels."""
        _, seen = self.look(camera, _TRIAL_WIDTH)
        count = np.bincount(self.place[seen.face[seen.hit]])
        return float(np.sqrt(count[1:]).sum())

    def picture(self, camera: Camera, title: str, caption: str) -> Picture:
        """Return the picture that a camera takes."""
        drawing, seen = self.look(camera, _WIDTH)
        return picture_of(drawing.colour(seen), title, caption)

    def in_world(self, camera: Camera) -> Camera:
        """Return a camera of the drawing's frame in that of the part."""
        return Camera(camera.origin / self.scale + self.middle, camera.axes, camera.slope)


def part_pictures(drawing: PartDrawing) -> tuple[tuple[Picture, ...], Camera]:
    """Return pictures from above and from below, and the first camera in the part's own frame."""
    best = [_best(drawing, drawing.cameras(height)) for height in _HEIGHTS_DEG]
    titles = ("The part, coloured by surface.", "From below.")
    captions = ("Grey belongs to no surface.", "The same from below.")
    pictures = tuple(drawing.picture(*one) for one in zip(best, titles, captions, strict=True))
    return pictures, drawing.in_world(best[0])


def height_pictures(
    mesh: LabelledMesh, place: IntArray, before: FloatArray, after: FloatArray, most_m: float
) -> tuple[Picture, ...]:
    """Return a part coloured by heights (n,) of its vertices over their planes, before and after a change.

    NaN where there is no plane; the scale ends at `most_m` metres either way.
    """
    drawings = [PartDrawing(mesh, place, _opaque(height_colours(heights, most_m))[mesh.faces])
                for heights in (before, after)]  # fmt: skip
    camera = _best(drawings[0], [one for height in _HEIGHTS_DEG for one in drawings[0].cameras(height)])
    scale = f"{-1000 * most_m:.2g} mm (blue) to {1000 * most_m:.2g} mm (red) over each plane"
    return (
        drawings[0].picture(camera, "As measured", f"{scale}; grey is no plane."),
        drawings[1].picture(camera, "Flattened", "The same: planes are white, relief keeps its colour."),
    )


def _opaque(colours: FloatArray) -> FloatArray:
    """Colours (n, 3) of colours (n, 4) on grey."""
    return np.where(colours[:, 3:] > 0, colours[:, :3], _GREY)


def _best(drawing: PartDrawing, cameras: Sequence[Camera]) -> Camera:
    shown: FloatArray = np.array([drawing.n_shown(camera) for camera in cameras])
    return cameras[int(np.argmax(shown))]
