# SPDX-License-Identifier: MIT
"""Appearance of loaded geometry: trimesh's visuals as corner colours, texture images and coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from scenes.checks import FloatArray
from scenes.mesh.labelled_mesh import Appearance

_GREY = 0.5  # what a face without any colour shows


@dataclass(frozen=True, slots=True, eq=False)
class GeometryLook:
    """How one geometry looks.

    Attributes
    ----------
    corner_colour : (m, 3, 3) float32
        RGB in 0..1 of each face's corners; multiplies the texture where there is one.
    image : PIL image or None
        The texture.
    corner_uv : (m, 3, 2) float32 or None
        Texture coordinates of the corners, (0, 0) the lower left corner of the image.
    is_plain : bool
        True when the file says nothing of its colour.
    opacity : (m,) float32 or None
        From 0, clear glass, to 1; None: all 1.
    """

    corner_colour: NDArray[np.float32]
    image: Any = None
    corner_uv: NDArray[np.float32] | None = None
    is_plain: bool = False
    opacity: NDArray[np.float32] | None = None

    def flip(self) -> GeometryLook:
        """Return the look of the same faces with their corners in reverse order."""
        uv = None if self.corner_uv is None else self.corner_uv[:, ::-1]
        return replace(self, corner_colour=self.corner_colour[:, ::-1], corner_uv=uv)


class PlacedGeometry(NamedTuple):
    """One placed geometry: name, world vertices (n, 3), faces (m, 3) and what it looks like."""

    name: str
    vertices: FloatArray
    faces: Any
    look: GeometryLook


def look_of(geometry: Any) -> GeometryLook:
    """Return the look of a trimesh geometry: texture, vertex colours, face colours or none."""
    faces, visual = np.asarray(geometry.faces), geometry.visual
    if visual.kind == "texture":
        return _texture_look(visual, faces)
    if visual.kind == "vertex":
        colours = np.asarray(visual.vertex_colors)[:, :3].astype(np.float32) / np.float32(255)
        return GeometryLook(colours[faces])
    if visual.kind == "face":
        colours = np.asarray(visual.face_colors)[:, :3].astype(np.float32) / np.float32(255)
        return GeometryLook(np.repeat(colours[:, None], 3, axis=1))
    return GeometryLook(np.full((len(faces), 3, 3), _GREY, np.float32), is_plain=True)


def _texture_look(visual: Any, faces: NDArray[Any]) -> GeometryLook:
    """Texture image times base colour; the base colour alone where image or coordinates are missing."""
    material = visual.material
    image = getattr(material, "baseColorTexture", None)
    if image is None:
        image = getattr(material, "image", None)
    if _is_stand_in(image):
        return GeometryLook(np.full((len(faces), 3, 3), _GREY, np.float32), is_plain=True)
    base = _base_colour(material, has_image=image is not None)
    colour = np.broadcast_to(base, (len(faces), 3, 3)).astype(np.float32)
    uv = visual.uv
    places = None if uv is None else np.asarray(uv, dtype=np.float32)
    opacity = _opacity(material, len(faces))
    if image is None or places is None or not np.isfinite(places).all():
        return GeometryLook(colour, opacity=opacity)
    return GeometryLook(colour, image, places[faces], opacity=opacity)


def _opacity(material: Any, n: int) -> NDArray[np.float32] | None:
    """Opacity (n,) by the base colour of a material with alphaMode BLEND (glTF), None for full."""
    factor = getattr(material, "baseColorFactor", None)
    if getattr(material, "alphaMode", None) != "BLEND" or factor is None or len(factor) < 4:
        return None
    alpha = float(factor[3])
    return np.full(n, alpha / 255 if np.asarray(factor).dtype.kind in "iu" else alpha, np.float32)


def _is_stand_in(image: Any) -> bool:
    """Tell whether this is the 2 x 2 grey image that trimesh puts where coordinates have no material."""
    return (
        image is not None and image.size == (2, 2) and bool((np.asarray(image.convert("RGB")) == 100).all())
    )


def _base_colour(material: Any, has_image: bool) -> NDArray[np.float32]:
    """Base colour factor (glTF), or diffuse colour (MTL, only without a texture), as RGB in 0..1."""
    white = np.ones(3, np.float32)
    if hasattr(material, "baseColorFactor"):
        factor = material.baseColorFactor
        if factor is None:
            return white
        values = np.asarray(factor)[:3].astype(np.float64)
        return srgb_from_linear(values / 255 if np.asarray(factor).dtype.kind in "iu" else values)
    if has_image:  # what exporters write as Kd beside map_Kd stands in for the texture, it is no factor
        return white
    diffuse = getattr(material, "diffuse", None)
    if diffuse is None:
        return np.full(3, _GREY, np.float32)
    return np.asarray(diffuse)[:3].astype(np.float32) / np.float32(255)


def srgb_from_linear(linear: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return linear light 0..1, of any shape, as sRGB 0..1; glTF has its colour factors in linear light."""
    light = np.clip(linear, 0.0, 1.0)
    encoded = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return encoded.astype(np.float32)


def linear_from_srgb(encoded: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return sRGB 0..1, of any shape, as linear light 0..1."""
    value = np.clip(np.asarray(encoded, dtype=np.float64), 0.0, 1.0)
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def join_looks(looks: Sequence[GeometryLook]) -> Appearance | None:
    """Return the looks of several geometries as one appearance, None when the file tells no colour."""
    if all(look.is_plain for look in looks):
        return None
    images: list[NDArray[np.uint8]] = []
    number_of: dict[int, int] = {}
    face_image, corner_uv = [], []
    for look in looks:
        n_faces = len(look.corner_colour)
        number = -1
        if look.image is not None:
            if id(look.image) not in number_of:
                number_of[id(look.image)] = len(images)
                images.append(np.asarray(look.image.convert("RGB"), dtype=np.uint8))
            number = number_of[id(look.image)]
        face_image.append(np.full(n_faces, number, np.int32))
        empty = np.zeros((n_faces, 3, 2), np.float32)
        corner_uv.append(empty if look.corner_uv is None else look.corner_uv)
    opacity = [
        np.ones(len(look.corner_colour), np.float32) if look.opacity is None else look.opacity
        for look in looks
    ]
    return Appearance(
        np.concatenate([look.corner_colour for look in looks]),
        tuple(images),
        np.concatenate(face_image) if images else None,
        np.concatenate(corner_uv) if images else None,
        None if all(look.opacity is None for look in looks) else np.concatenate(opacity),
    )
