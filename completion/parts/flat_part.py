# SPDX-License-Identifier: MIT
"""Flat part: the planes of a part without their ripple, and with their relief."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from completion.fitting.result import SurfaceFit
from completion.flattening.flat import FlatSurface, FlatteningOptions
from completion.flattening.pipeline import flatten_mesh
from completion.parts.division.limits import NEAR_RMS
from completion.parts.part import Part, kinds_text
from scenes.checks import ArrayValue, BoolArray, FloatArray, InputError, IntArray
from scenes.surfaces.catalogue import Plane

_MOST_TOLD = 3  # planes that are named
_N_BESIDE = 8  # points that are beside one, where there are no triangles


@dataclass(frozen=True, slots=True, eq=False)
class FlatPart(ArrayValue):
    """A part with its planes flattened: its points, or vertices, in their order.

    Attributes
    ----------
    points : (n, 3) float
        Metres.
    moved_m : (n,) float
        How far each was moved.
    is_relief : (n,) bool
        Those of relief that stayed.
    surface : (n,) int
        Label of the plane that each was flattened with, or of the surface that it is on; 0 for none.
    surfaces : tuple of FlatSurface
        What became of each plane, by the label that it has in the part.
    n_held : int
        Vertices that stayed since a triangle would have turned over or crossed another.
    n_turned, n_crossing : int
        Triangles that turned over, or cross others anew, counted at the end: 0, or it is a fault.
    level : float
        With which probability a plane without relief keeps any.
    """

    points: FloatArray
    moved_m: FloatArray
    is_relief: BoolArray
    surface: IntArray
    surfaces: tuple[FlatSurface, ...]
    n_held: int
    n_turned: int
    n_crossing: int
    level: float

    @property
    def doubts(self) -> tuple[str, ...]:
        """What is to be known of it, a sentence each: planes left as they were, and faults."""
        doubts = [
            f"surface {surface.label} is not flattened: {surface.reason}"
            for surface in self.surfaces
            if surface.reason
        ]
        if len(doubts) > _MOST_TOLD:
            doubts[_MOST_TOLD:] = [f"{len(doubts) - _MOST_TOLD} other planes are too small to be flattened"]
        if self.n_turned or self.n_crossing:
            doubts.append(
                f"flattening turned {self.n_turned} triangles over and made {self.n_crossing} cross others"
            )
        return (
            *doubts,
            *(f"surface {surface.label}: {text}" for surface in self.surfaces if (text := surface.doubt)),
        )


def flatten_part(
    part: Part,
    options: FlatteningOptions = FlatteningOptions(),
    rng: np.random.Generator | int | None = 0,
) -> FlatPart:
    """Take the ripple from the planes of a part, and leave their relief.

    After Cantzler, Fisher & Devy (2002); see `flatten_mesh`. Planes are those of `part.fits`, where relations
    hold. What lies on no surface, and beside planes alone, is flattened with these, as relief or as ripple.
    Vertices on a crease of two planes go onto it.

    Parameters
    ----------
    part : Part
        Whose planes were found beneath their ripple (`divide_part` with `has_ripple`), or labelled.
    options : FlatteningOptions
        The level of the test, the cells.
    rng : Generator, int or None
        Of the walls without relief from which p values are learned.

    Raises
    ------
    InputError
        A part without planes, or whose planes are too coarse to tell ripple from relief.
    """
    planes = [place for place, fit in enumerate(part.fits, start=1) if isinstance(fit.surface, Plane)]
    if not planes:
        raise InputError(f"there is no plane to flatten: the part has {kinds_text(part.fits)}")
    points, first, where = np.unique(part.points, axis=0, return_index=True, return_inverse=True)
    where = where.reshape(-1)
    place = np.where(part.surface > 0, np.searchsorted(part.labels, part.surface) + 1, 0)[first]
    faces = np.zeros((0, 3), np.int32) if part.faces is None else where[part.faces].astype(np.int32)
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    place = _with_those_between(part, points, faces, place.astype(np.int64))
    flat = flatten_mesh(points, faces, place.astype(np.int64), part.fits, options, rng=rng)
    if not any(surface.is_flattened for surface in flat.surfaces):
        largest = max(flat.surfaces, key=lambda surface: surface.n)
        raise InputError(
            f"no plane can be flattened; the largest, surface {part.labels[largest.label - 1]}, has "
            f"{largest.reason}: give a finer mesh, or denser points"
        )
    return FlatPart(
        points=flat.vertices[where],
        moved_m=flat.moved_m[where],
        is_relief=flat.is_relief[where],
        surface=np.array([0, *part.labels])[place][where],
        surfaces=tuple(surface.with_label(part.labels[surface.label - 1]) for surface in flat.surfaces),
        n_held=int(flat.is_held[where].sum()),
        n_turned=flat.n_turned,
        n_crossing=flat.n_crossing,
        level=options.level,
    )


def _with_those_between(part: Part, points: FloatArray, faces: IntArray, place: IntArray) -> IntArray:
    """Places (n,) of the surfaces of points (n, 3), those on none given to the planes around them.

    What is connected and lies beside planes alone goes to the nearest of them, if it is near. If it is beside
    a single one and its triangles face as those of the plane do, it goes to that at any height: it is relief.
    """
    links = _links(points, faces)
    free = np.flatnonzero(place == 0)
    if not len(free):
        return place
    n, piece = connected_components(csr_array(links[free][:, free]), directed=False)
    beside = links[free].tocoo()
    piece_number, label = piece[beside.row], place[beside.col]
    touched = np.zeros((n, len(part.fits) + 1), dtype=np.bool_)
    touched[piece_number, label] = True
    touched[:, 0] = False
    is_plane = np.array([True, *(isinstance(fit.surface, Plane) for fit in part.fits)])
    only: BoolArray = np.asarray(touched.any(axis=1) & ~touched[:, ~is_plane].any(axis=1))
    off = np.full((len(free), len(part.fits) + 1), np.inf)
    for number in np.flatnonzero(is_plane)[1:]:
        fit, item = part.fits[number - 1], touched[piece, number]
        off[item, number] = np.abs(fit.surface.distance(points[free[item]])) / max(fit.rms, 1e-300)
    best = off.argmin(axis=1)
    single: BoolArray = np.asarray(only & (touched.sum(axis=1) == 1))
    piece_at = np.full(len(points), -1)
    piece_at[free] = piece
    plane_of = np.where(single, touched.argmax(axis=1), 0)
    single &= _faces_alike(part.fits, points[faces], place[faces], piece_at[faces], plane_of)
    taken = only[piece] & ((off.min(axis=1) <= NEAR_RMS) | single[piece])
    out = place.copy()
    out[free[taken]] = best[taken]
    return out


def _links(points: FloatArray, faces: IntArray) -> csr_array:
    """Which points (n, 3) are beside one another: by triangles (m, 3), or by distance; symmetric."""
    n = len(points)
    if len(faces):
        first, two = faces.ravel(), np.roll(faces, 1, axis=1).ravel()
    else:
        near = cKDTree(points).query(points, k=min(_N_BESIDE + 1, n))[1]
        first, two = np.repeat(np.arange(n), near.shape[1]), near.ravel()
    graph = coo_array((np.ones(len(first)), (first, two)), shape=(n, n)).tocsr()
    return csr_array(graph + graph.T)


def _faces_alike(
    fits: Sequence[SurfaceFit],
    corners: FloatArray,
    place: IntArray,
    piece: IntArray,
    plane_of: IntArray,
) -> BoolArray:
    """Pieces (k,) all of whose triangles face as most of their plane's do.

    Of triangles (m, 3, 3) the surface at each corner (m, 3), 0 for none, the piece there (m, 3), -1 for none;
    of each piece its plane (k,).
    """
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    is_uniform = np.full(len(plane_of), len(corners) > 0)
    for number in np.unique(plane_of):
        surface = fits[number - 1].surface if number else None
        if not isinstance(surface, Plane):
            continue
        along = normals @ surface.normal_direction
        side = np.sign(along[(place == number).all(axis=1)].sum())
        turned: BoolArray = np.asarray(along * side < 0)
        against = np.unique(piece[turned])
        is_uniform[against[(against >= 0) & (plane_of[against] == number)]] = False
    return is_uniform
