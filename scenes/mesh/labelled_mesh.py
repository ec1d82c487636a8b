# SPDX-License-Identifier: MIT
"""Labelled triangle mesh: geometry, a surface id per face, and what it looks like."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from scenes.checks import (
    BoolArray,
    FloatArray,
    InputError,
    IntArray,
    Value,
    check_faces,
    check_places,
    frozen_copy,
    given_faces,
    given_points,
    read_only_view,
)
from scenes.pose import Pose
from scenes.run.libraries import import_extra
from scenes.run.memory import in_blocks

if TYPE_CHECKING:
    from trimesh import Trimesh


@dataclass(frozen=True, slots=True, eq=False)
class Appearance(Value):
    """Colour of every face: corner colours times, where a face has one, a texture image.

    Parameters
    ----------
    corner_colour : (m, 3, 3) float32
        RGB in 0..1 (sRGB) at the three corners of each face.
    images : tuple of (h, w, 3) uint8
        Textures, sRGB; they repeat outside 0..1.
    face_image : (m,) int32
        Index into `images`, -1 for faces without a texture.
    corner_uv : (m, 3, 2) float32
        Texture coordinates of the corners, (0, 0) the lower left corner of the image.
    opacity : (m,) float32, optional
        From 0, clear glass, to 1; all 1 when not given.

    Raises
    ------
    InputError
        Arrays of other shapes, or a face that names an image that is not there.
    """

    corner_colour: NDArray[np.float32]
    images: tuple[NDArray[np.uint8], ...] = ()
    face_image: NDArray[np.int32] | None = None
    corner_uv: NDArray[np.float32] | None = None
    opacity: NDArray[np.float32] | None = None

    def __post_init__(self) -> None:
        n = len(self.corner_colour)
        shapes = {
            "corner_colour": (n, 3, 3), "face_image": (n,), "corner_uv": (n, 3, 2), "opacity": (n,)
        }  # fmt: skip
        for name, shape in shapes.items():
            array = getattr(self, name)
            if array is None:
                continue
            if np.shape(array) != shape:
                raise InputError(f"expected {name} with shape {shape}, got {np.shape(array)}")
            dtype = np.int32 if name == "face_image" else np.float32
            object.__setattr__(self, name, frozen_copy(array, dtype))
        for index, image in enumerate(self.images):
            if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8 or image.size == 0:
                raise InputError(
                    f"expected image {index} as (h, w, 3) uint8, got {image.shape} {image.dtype}"
                )
        if self.face_image is not None and n and int(self.face_image.max()) >= len(self.images):
            raise InputError(
                f"faces name image {int(self.face_image.max())}, but there are {len(self.images)} images"
            )
        object.__setattr__(self, "images", tuple(frozen_copy(image) for image in self.images))

    def colour(
        self,
        faces: NDArray[np.int32],
        barycentric: FloatArray,
        nothing: float = 0.5,
        n_threads: int | None = None,
    ) -> NDArray[np.float32]:
        """RGB (n, 3) in 0..1 at points of `faces` (n,) with weights (n, 3) of their corners.

        Where the face is -1 there is nothing to see: all channels are `nothing`. Colours do not depend on
        `n_threads`.
        """
        from scenes.mesh.texel import plain_colours, textured_colours  # numba: imported when first needed

        colour = np.empty((len(faces), 3), np.float32)
        is_plain = self.face_image is None or self.corner_uv is None
        face_image = np.full(len(self.corner_colour), -1, np.int32) if is_plain else self.face_image
        given = (faces, barycentric, self.corner_colour, face_image)
        faces, barycentric, corners, face_image = (read_only_view(np.ascontiguousarray(a)) for a in given)

        def look_up(part: slice) -> None:
            at = faces[part], barycentric[part], corners
            plain_colours(*at, face_image, nothing, colour[part])
            for number, image in enumerate(() if is_plain else self.images):
                textured_colours(*at, self.corner_uv, face_image, number, image, colour[part])

        in_blocks(len(faces), look_up, n_threads)
        return colour


def triangle_areas(corners: FloatArray) -> FloatArray:
    """Return the areas (m,) of triangles (m, 3, 3), in square metres for corners in metres."""
    a, b, c = np.moveaxis(corners, 1, 0)
    areas: FloatArray = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    return areas


def spread_points(corners: FloatArray, n: int) -> tuple[FloatArray, IntArray]:
    """Return points (n, 3) spread evenly over triangles (m, 3, 3), and the triangle (n,) of each.

    By the plastic number, whose multiples are even in two dimensions (Roberts 2018).
    """
    total = np.cumsum(triangle_areas(corners))
    triangle = np.minimum(np.searchsorted(total, (np.arange(n) + 0.5) / n * total[-1]), len(corners) - 1)
    plastic = 1.32471795724474602596
    a, b = ((0.5 + np.arange(1, n + 1)[:, None] / [plastic, plastic**2]) % 1.0).T[:, :, None]
    over = a + b > 1
    a, b = np.where(over, 1 - a, a), np.where(over, 1 - b, b)
    first, second, third = np.moveaxis(corners[triangle], 1, 0)
    return first + a * (second - first) + b * (third - first), triangle


@dataclass(frozen=True, slots=True, eq=False)
class LabelledMesh(Value):
    """A triangle mesh whose faces know their surface.

    Parameters
    ----------
    vertices : (n, 3) float
        World coordinates, metres.
    faces : (m, 3) int
        Corners, counter-clockwise seen from outside (for a room: from within).
    face_surface : (m,) int, optional
        Surface id of each face; 0 for all when not given.
    appearance : Appearance, optional
        None means mid grey.

    Raises
    ------
    InputError
        Vertices not finite, faces out of range or of the wrong shape, labels or colours for another
        number of faces.
    """

    vertices: FloatArray
    faces: NDArray[np.int32]
    face_surface: NDArray[np.int32] = field(default_factory=lambda: np.zeros(0, np.int32))
    appearance: Appearance | None = None

    def __post_init__(self) -> None:
        vertices = check_places("vertices", self.vertices)
        faces = check_faces(self.faces, len(vertices))
        labels = np.asarray(self.face_surface, dtype=np.int32)
        if labels.shape == (0,):
            labels = np.zeros(len(faces), np.int32)
        if labels.shape != (len(faces),):
            raise InputError(f"expected face_surface with shape ({len(faces)},), got {labels.shape}")
        if self.appearance is not None and len(self.appearance.corner_colour) != len(faces):
            raise InputError(
                f"{len(self.appearance.corner_colour)} faces have colours, but there are {len(faces)}"
            )
        object.__setattr__(self, "vertices", frozen_copy(vertices))
        object.__setattr__(self, "faces", frozen_copy(faces))
        object.__setattr__(self, "face_surface", frozen_copy(labels))

    @classmethod
    def of(cls, shape: object) -> LabelledMesh:
        """Return (vertices, faces), or a mesh of trimesh, Open3D or pyvista, as one without labels.

        Raises
        ------
        InputError
            Something else, faces that are no triangles, and as above.
        """
        if isinstance(shape, LabelledMesh):
            return shape
        vertices, faces = (
            shape if isinstance(shape, tuple) and len(shape) == 2 else (shape, given_faces(shape))
        )
        if faces is None:
            raise InputError(
                "a mesh must be of trimesh, Open3D or pyvista, a LabelledMesh or (vertices, faces), "
                f"got {type(shape).__name__}; read files with load_scene"
            )
        return cls(given_points(vertices), faces)

    def to_trimesh(self) -> Trimesh:
        """Return it as a `trimesh.Trimesh` with colours of faces and `face_attributes["surface"]`."""
        import trimesh  # slow to load

        look = None if self.appearance is None else self.appearance.corner_colour.mean(axis=1)
        colours = None if look is None else np.rint(255 * look).astype(np.uint8)
        labels = {"surface": self.face_surface}
        return trimesh.Trimesh(
            self.vertices, self.faces, face_colors=colours, face_attributes=labels, process=False
        )

    def to_open3d(self) -> Any:
        """Return its geometry as an `open3d.geometry.TriangleMesh`; raises InputError without Open3D."""
        open3d = import_extra("open3d", "open3d")
        vertices = open3d.utility.Vector3dVector(np.array(self.vertices))  # it takes no read-only arrays
        return open3d.geometry.TriangleMesh(vertices, open3d.utility.Vector3iVector(np.array(self.faces)))

    @property
    def corners(self) -> FloatArray:
        """Corner points (m, 3, 3) of the faces."""
        return self.vertices[self.faces]

    def face_areas(self) -> FloatArray:
        """Areas (m,) in square metres."""
        return triangle_areas(self.corners)

    def face_normals(self) -> FloatArray:
        """Unit normals (m, 3) by the right-hand rule; zero for faces without area."""
        a, b, c = np.moveaxis(self.corners, 1, 0)
        normals = np.cross(b - a, c - a)
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        unit: FloatArray = np.divide(normals, length, out=np.zeros_like(normals), where=length > 0)
        return unit

    def bounds(self) -> FloatArray:
        """Smallest and largest coordinates, shape (2, 3), metres."""
        if not len(self.vertices):
            raise InputError("a mesh without vertices has no bounds")
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])

    def some(self, faces: BoolArray) -> LabelledMesh:
        """Return the mesh of the chosen faces (m,) alone; vertices that none of them has are dropped."""
        used, index = np.unique(self.faces[faces], return_inverse=True)
        look = self.appearance
        if look is not None:
            image = None if look.face_image is None else look.face_image[faces]
            uv = None if look.corner_uv is None else look.corner_uv[faces]
            opacity = None if look.opacity is None else look.opacity[faces]
            look = Appearance(look.corner_colour[faces], look.images, image, uv, opacity)
        corners = index.reshape(-1, 3).astype(np.int32)
        return LabelledMesh(self.vertices[used], corners, self.face_surface[faces], look)

    def at(self, vertices: FloatArray) -> LabelledMesh:
        """Return the mesh with its vertices at other places (n, 3)."""
        return LabelledMesh(vertices, self.faces, self.face_surface, self.appearance)

    def transform(self, pose: Pose) -> LabelledMesh:
        """Return the mesh moved by `pose`."""
        return self.at(pose.apply(self.vertices))

    transformed = transform  # earlier name


def mesh_or_points(shape: object) -> object:
    """Return a mesh of trimesh, Open3D or pyvista as a LabelledMesh, and anything else as it is."""
    is_done = isinstance(shape, LabelledMesh) or given_faces(shape) is None
    return shape if is_done else LabelledMesh.of(shape)


def join_meshes(meshes: Sequence[LabelledMesh]) -> LabelledMesh:
    """Return all faces as one mesh, with their labels and without appearance."""
    start = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [mesh.faces + offset for mesh, offset in zip(meshes, start, strict=False)]
    return LabelledMesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate(faces).astype(np.int32),
        np.concatenate([mesh.face_surface for mesh in meshes]),
    )
