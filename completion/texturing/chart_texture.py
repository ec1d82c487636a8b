# SPDX-License-Identifier: MIT
"""Chart texture: the colour of a surface's chart, measured and made, and all of them on few images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from completion.evidence.chart_grid import ChartGrid
from completion.texturing.limits import DOUBTFUL
from scenes.checks import BoolArray, FloatArray, Value

GREY = 158  # of a texel of which nothing is known
_MARGIN = 2  # texels around what is coloured that repeat its colour
_PADDING = 4  # texels around each texture, so that coarser levels of a viewer mix no two of them
_PAGE_TEXELS = 3000 * 3000  # of the textures on one page; with gaps between them it stays within 4096 x 4096
_TRIALS = 30


@dataclass(frozen=True, slots=True, eq=False)
class ChartTexture(Value):
    """Colour of a surface's chart.

    Attributes
    ----------
    image : (rows, columns, 3) uint8
        sRGB, grey where nothing is known; row 0 is the chart's lowest v.
    grid : ChartGrid
        Its texels.
    measured, synthesised : (rows, columns) bool
        Texels that scans coloured, and those made by sampling.
    synthesised_m : float
        Side of what was sampled as one texel, metres: a larger one than the grid's where there was too much.
    n_samples : int
        Texels of that size that were sampled from.
    window : int
        Side of the Efros-Leung window, 0 where nothing was synthesised.
    search : str
        How its candidates were searched for, "exact" or "budget" (`texture.fill`).
    is_plain : bool
        Whether the surface has one colour, and was filled by its mean and noise.
    confidence : float
        Mean over the synthesised texels of how well their surroundings agree (`texture.Synthesis`).
    verbatim_share : float
        Share of them copied in one piece (`texture.measure_verbatim_share`).
    """

    image: NDArray[np.uint8]
    grid: ChartGrid
    measured: BoolArray
    synthesised: BoolArray
    synthesised_m: float = 0.0
    n_samples: int = 0
    window: int = 0
    search: str = "exact"
    is_plain: bool = False
    confidence: float = 1.0
    verbatim_share: float = 0.0

    @property
    def n_synthesised(self) -> int:
        """Texels made by sampling."""
        return int(np.count_nonzero(self.synthesised))

    @property
    def is_doubtful(self) -> bool:
        """Whether the surroundings of what was synthesised agree less than half as well as copies do."""
        return self.confidence < DOUBTFUL

    def texels(self, uv: FloatArray) -> FloatArray:
        """Fractional rows and columns (n, 2) of chart coordinates (n, 2); integers are texel corners."""
        return np.asarray((uv - self.grid.corner)[:, ::-1] / self.grid.cell[::-1], dtype=np.float64)

    def colour_at(self, uv: FloatArray) -> NDArray[np.uint8]:
        """Colours (n, 3) of the texels that chart coordinates (n, 2) lie in, of the nearest ones outside."""
        index = np.floor(self.texels(uv)).astype(np.int64)
        row, column = np.clip(index, 0, np.array(self.grid.shape) - 1).T
        return np.asarray(self.image[row, column], dtype=np.uint8)


def spread_colour(
    image: NDArray[np.uint8], known: BoolArray, wraps: bool, reach: int = _MARGIN
) -> NDArray[np.uint8]:
    """Repeat the colour of known texels in those beside them, so that interpolation at edges stays in it.

    The image (rows, columns, 3) is sRGB; it comes back grey where nothing is `known`, (rows, columns), within
    `reach` texels, two at least: beyond two, texels have the colour of the nearest. `wraps`: columns close.
    """
    sides = ((_MARGIN, _MARGIN), (_MARGIN, _MARGIN))
    done, result = np.pad(known, sides), np.pad(np.where(known[..., None], image, GREY), (*sides, (0, 0)))
    if wraps:
        for padded in (done, result):
            padded[:, :_MARGIN], padded[:, -_MARGIN:] = (
                padded[:, -2 * _MARGIN : -_MARGIN],
                padded[:, _MARGIN : 2 * _MARGIN],
            )
    for _ in range(_MARGIN):
        weight = cv2.blur(done.astype(np.float32), (3, 3), borderType=cv2.BORDER_CONSTANT)
        coloured = np.where(done[..., None], result, 0).astype(np.float32)
        mean = cv2.blur(coloured, (3, 3), borderType=cv2.BORDER_CONSTANT)
        new = ~done & (weight > 0.01)
        result[new] = np.rint(mean[new] / weight[new, None])
        done |= new
    if reach > _MARGIN and done.any() and not done.all():
        distance, label = cv2.distanceTransformWithLabels(
            (~done).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
        )
        source = np.zeros(int(label.max()) + 1, np.int64)
        source[label[done]] = np.flatnonzero(done)
        near = ~done & (distance <= reach - _MARGIN)
        result[near] = result.reshape(-1, 3)[source[label[near]]]
    return np.ascontiguousarray(result[_MARGIN:-_MARGIN, _MARGIN:-_MARGIN], dtype=np.uint8)


@dataclass(frozen=True, slots=True, eq=False)
class Atlas(Value):
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
    """Pack the textures of surfaces, one each, on as few pages as hold them."""
    page = np.full(len(textures), -1, np.int32)
    corner = np.zeros((len(textures), 2), np.int64)
    pages: list[NDArray[np.uint8]] = []
    for members in _groups(textures):
        from trimesh.path.packing import rectangles  # loads networkx and scipy.stats: only to pack

        padded = [_pad_texture(texture) for k in members if (texture := textures[k]) is not None]
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


def _pad_texture(texture: ChartTexture) -> NDArray[np.uint8]:
    """The texture, upwards, with what lies beyond its edges: its other side where it closes."""
    rows, columns = ((_PADDING, _PADDING), (0, 0), (0, 0)), ((0, 0), (_PADDING, _PADDING), (0, 0))
    image = np.pad(texture.image[::-1], rows, mode="edge")
    return np.pad(image, columns, mode="wrap") if texture.grid.wraps else np.pad(image, columns, mode="edge")
