# SPDX-License-Identifier: MIT
"""Atlas: the textures of all surfaces on few images, as files and viewers want them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from completion.texturing.chart_texture import GREY, ChartTexture
from scenes.checks import FloatArray

_PADDING = 4  # texels around each texture, so that coarser levels of a viewer mix no two of them
_PAGE_TEXELS = 3000 * 3000  # of the textures on one page; with gaps between them it stays within 4096 x 4096
_TRIALS = 30


@dataclass(frozen=True, slots=True, eq=False)
class Atlas:
    """Pages of textures.

    Attributes
    ----------
    pages : tuple of (rows, columns, 3) uint8
        Images, row 0 their upper edge; a texture's lowest v is its lower edge.
    page : (n,) int32
        The page of each texture, -1 for a surface that has none.
    corner : (n, 2) int64
        Row and column of each texture's lower left corner on its page: texel corners, rows downwards.
    textures : tuple of ChartTexture or None
        What is on the pages.
    """

    pages: tuple[NDArray[np.uint8], ...]
    page: NDArray[np.int32]
    corner: NDArray[np.int64]
    textures: tuple[ChartTexture | None, ...]

    def coordinates(self, number: int, uv: FloatArray) -> FloatArray:
        """Texture coordinates (n, 2) of chart coordinates (n, 2) of a surface, (0, 0) its page's lower left.

        Zeros for a surface without texture.
        """
        texture = self.textures[number]
        if texture is None:
            return np.zeros((len(uv), 2))
        rows, columns = self.pages[self.page[number]].shape[:2]
        texel = texture.texels(uv)
        row, column = self.corner[number]
        return np.column_stack([(column + texel[:, 1]) / columns, 1 - (row - texel[:, 0]) / rows])


def make_atlas(textures: Sequence[ChartTexture | None]) -> Atlas:
    """Pack textures on as few pages as hold them.

    Parameters
    ----------
    textures : sequence of ChartTexture or None
        One for each surface.
    """
    from trimesh.path.packing import rectangles  # loads networkx and scipy.stats, and packs at the very end

    page = np.full(len(textures), -1, np.int32)
    corner = np.zeros((len(textures), 2), np.int64)
    pages: list[NDArray[np.uint8]] = []
    for members in _groups(textures):
        padded = [_padded(texture) for k in members if (texture := textures[k]) is not None]
        extents = np.array([image.shape[1::-1] for image in padded], dtype=np.float64)
        bounds, _ = rectangles(extents, rotate=False, iterations=_TRIALS, seed=0)
        low = np.rint(bounds[:, 0]).astype(np.int64)  # column, row
        columns, rows = (low + extents.astype(np.int64)).max(axis=0)
        image = np.full((rows, columns, 3), GREY, np.uint8)
        for k, piece, (left, top) in zip(members, padded, low, strict=True):
            image[top : top + piece.shape[0], left : left + piece.shape[1]] = piece
            page[k], corner[k] = len(pages), (top + piece.shape[0] - _PADDING, left + _PADDING)
        pages.append(image)
    return Atlas(tuple(pages), page, corner, tuple(textures))


def _groups(textures: Sequence[ChartTexture | None]) -> list[list[int]]:
    """The numbers of the textures on each page, in order."""
    groups: list[list[int]] = []
    room = 0
    for number, texture in enumerate(textures):
        if texture is None:
            continue
        size = (texture.grid.shape[0] + 2 * _PADDING) * (texture.grid.shape[1] + 2 * _PADDING)
        if not groups or size > room:
            groups.append([])
            room = _PAGE_TEXELS
        groups[-1].append(number)
        room -= size
    return groups


def _padded(texture: ChartTexture) -> NDArray[np.uint8]:
    """The texture, upwards, with what lies beyond its edges: its other side where it closes."""
    rows, columns = ((_PADDING, _PADDING), (0, 0), (0, 0)), ((0, 0), (_PADDING, _PADDING), (0, 0))
    image = np.pad(texture.image[::-1], rows, mode="edge")
    return np.pad(image, columns, mode="wrap") if texture.grid.wraps else np.pad(image, columns, mode="edge")
