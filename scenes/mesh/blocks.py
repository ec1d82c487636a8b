# SPDX-License-Identifier: MIT
"""Blocks of space: parts of a large model by where they are, so that a viewer shows some of them alone."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from scenes.checks import FloatArray
from scenes.mesh.mesh_parts import MeshPart

_SIDE_M = 10.0  # of a block: a room with what stands in it
_MOST = 16  # blocks along an axis


@dataclass(frozen=True, slots=True, eq=False)
class Blocks:
    """Cubes that fill a box, counted from 1 along each axis from its lowest corner.

    Attributes
    ----------
    low : (3,) float
        The lowest corner, metres.
    longest_m : float
        The box's longest side, metres.
    """

    low: FloatArray
    longest_m: float

    @classmethod
    def over(cls, parts: Sequence[MeshPart]) -> Blocks:
        """Blocks over all vertices of `parts`: of 10 m, or of a sixteenth of the box's longest side."""
        ends = [end for part in parts if len(part.vertices) for end in _ends(part.vertices)] or [np.zeros(3)]
        low = np.min(ends, axis=0)
        return cls(low, float((np.max(ends, axis=0) - low).max()))

    @property
    def side_m(self) -> float:
        """Of each cube, metres."""
        return max(_SIDE_M, self.longest_m / _MOST * (1 + 1e-9))

    def numbers(self, points: FloatArray) -> NDArray[np.int64]:
        """Return the block (n, 3) that points (n, 3), metres, lie in."""
        return np.floor((points - self.low) / self.side_m).astype(np.int64) + 1


def in_blocks(parts: Sequence[MeshPart]) -> list[MeshPart]:
    """Return parts with the block that each is in, `block 1 2 1` for the second along y.

    Models that are no longer than two blocks are left as they are.

    What is of a surface stays whole: it is in the block of its middle, or in none where it reaches across
    more than one block's side. Of what is of no surface (0) each block has a part of its own, whose triangles
    have their middles there; its name ends in the block's numbers.

    Examples
    --------
    >>> triangle = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.0]])
    >>> faces = np.array([[0, 1, 2], [3, 4, 5]])
    >>> loose = MeshPart("rest", np.concatenate([triangle, triangle + [25, 0, 0]]), faces, 0)
    >>> wall = MeshPart("wall", triangle + [12, 0, 0], faces[:1], 1)
    >>> [(part.name, part.block) for part in in_blocks([loose, wall])]
    [('rest 1 1 1', 'block 1 1 1'), ('rest 3 1 1', 'block 3 1 1'), ('wall', 'block 2 1 1')]
    """
    blocks = Blocks.over(parts)
    if blocks.longest_m <= 2 * _SIDE_M:
        return list(parts)
    found: list[MeshPart] = []
    for part in parts:
        if part.surface == 0:
            found += _cut(part, blocks)
        elif len(part.vertices):
            low, high = _ends(part.vertices)
            is_wide = float((high - low).max()) > blocks.side_m
            middle = blocks.numbers((low + high)[None] / 2)[0]
            found.append(part if is_wide else replace(part, block=_name(middle)))
    return found


def _cut(part: MeshPart, blocks: Blocks) -> Iterator[MeshPart]:
    """A part for each block in which there are triangles, with the vertices that these have."""
    middles = sum(part.vertices[part.faces[:, k]] for k in range(3)) / 3
    numbers, which = np.unique(blocks.numbers(np.asarray(middles)), axis=0, return_inverse=True)
    for index, number in enumerate(numbers):
        used, faces = np.unique(part.faces[which.reshape(-1) == index], return_inverse=True)
        name = _name(number)
        yield replace(
            part,
            name=part.name + name.removeprefix("block"),
            vertices=part.vertices[used],
            faces=faces.reshape(-1, 3).astype(np.int64),
            colour=None if part.colour is None else part.colour[used],
            uv=None if part.uv is None else part.uv[used],
            block=name,
        )


def _name(number: NDArray[np.int64]) -> str:
    return "block " + " ".join(map(str, number.tolist()))


def _ends(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The lowest and the highest coordinates."""
    return points.min(axis=0), points.max(axis=0)
