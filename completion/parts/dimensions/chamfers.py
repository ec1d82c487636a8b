# SPDX-License-Identifier: MIT
"""Chamfers: narrow planes and cones that cut off the edge in which two faces would meet."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import combinations, islice

import numpy as np
from scipy.special import chdtrc

from completion.parts.dimensions.contacts import contact, meeting, spread, surfaces_at, turns
from completion.parts.dimensions.dimension import Blend, PartDimension
from completion.parts.dimensions.face_samples import FaceSamples
from completion.parts.dimensions.joint_surfaces import JointSurfaces
from completion.relations.equations import Placement
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Cone, Cylinder, Plane, Surface

_NARROW = 1 / 2  # of the way that either face goes on from the edge: a chamfer takes less than it leaves
_MOST = (
    0.9  # of the points of a chamfer that lie as near to the edge, and of a face's that tell how far it goes
)
_N_EDGE, _MOST_ASKED = 7, 200  # points of the edge behind a chamfer, and of a face that tell how far it goes
_SHARP_SD = 4.0  # standard deviations, from which a width is one
_LOOSE = 1e-2  # of their deviation without relations, within which widths that relations make equal are so
_EXACT = 1e-7  # of the part's size, of rounding
_LEAST_SHARE = 1e-6  # of the greatest variance
_ANY_SIDE = np.ones(2)


def find_chamfers(known: JointSurfaces, faces: FaceSamples, level: float) -> Iterator[Blend]:
    """The chamfers of a part: faces smaller than two that they lie between, and as wide all along both.

    Whether widths are the same all along is tested at a level by the joint covariance.
    """
    for place, surface in enumerate(faces.surfaces):
        if isinstance(surface, Plane | Cone) and len(faces.of(place)):
            beside = [
                other
                for other in sorted(faces.neighbours[place])
                if isinstance(faces.surfaces[other], Plane | Cylinder | Cone)
                and faces.share(other) > faces.share(place)
            ]
            found = (_chamfer((place, *pair), known, faces, level) for pair in combinations(beside, 2))
            yield from islice((blend for blend in found if blend is not None), 1)


def _chamfer(
    places: tuple[int, int, int], known: JointSurfaces, faces: FaceSamples, level: float
) -> Blend | None:
    """A face, the first, as a chamfer of two others."""
    like = [faces.surfaces[place] for place in places]
    asked = [faces.of(place)[:: max(1, len(faces.of(place)) // _MOST_ASKED)] for place in places]
    behind = [contact(like[1:], _ANY_SIDE, 0.0, each).centre for each in asked]
    far = [np.linalg.norm(each - edge, axis=1) for each, edge in zip(asked, behind, strict=True)]
    if not all(np.isfinite(each).all() for each in far):
        return None
    is_ring, middle = isinstance(like[0], Cone), behind[0].mean(axis=0)
    way = np.linalg.svd(behind[0] - middle, full_matrices=False)[2][0]
    along = turns(known.at[places[0]], behind[0]) if is_ring else (behind[0] - middle) @ way
    start = spread(behind[0], along, _N_EDGE)
    width = _widths([known.at[place] for place in places], like, start).reshape(2, -1).mean(axis=1)
    reach = [float(np.quantile(each, _MOST)) for each in far]
    if not (reach[0] <= width.max() and all(width < _NARROW * np.array(reach[1:]))):
        return None
    found = known.estimate(places, lambda at: _widths(at, like, start))
    covariance = found.covariance + _LOOSE**2 * found.measured_covariance
    sd = np.sqrt(np.diag(covariance).reshape(2, -1).max(axis=1))
    if not (width > _SHARP_SD * sd).all():
        return None
    steps = np.kron(np.eye(2), np.diff(np.eye(_N_EDGE), axis=0))
    variance, ways = np.linalg.eigh(
        steps @ (covariance + (_EXACT * known.size_m) ** 2 * np.eye(len(covariance))) @ steps.T
    )
    told = variance > _LEAST_SHARE * variance[-1]
    misfit = (steps @ found.value) @ ways[:, told]
    p = float(chdtrc(np.count_nonzero(told), float((misfit**2 / variance[told]).sum())))
    if p < level:
        return None
    labels = known.part.labels
    edge, spread_m2 = meeting(known, places[1:], like[1:], start)
    row = known.estimate(places, lambda at: _widths(at, like, start)[:_N_EDGE].mean())
    turn = np.einsum("ij,ij->i", like[0].normal(start), like[1].normal(start))
    return Blend(
        labels=(labels[places[0]],), supports=(labels[places[1]], labels[places[2]]), kind="chamfer",
        size_m=float(row.value[0]), sd_m=row.sd, p=p, edge=edge, edge_covariance=spread_m2,
        angle=float(np.arccos(np.clip(np.abs(turn).mean(), 0.0, 1.0))),
    )  # fmt: skip


def _widths(at: Sequence[Placement], like: Sequence[Surface], start: FloatArray) -> FloatArray:
    """What a chamfer takes of its first face at places (n, 3) of their edge, and of its second (2 n,)."""
    chamfer, *others = surfaces_at(at, like)
    behind = contact(others, _ANY_SIDE, 0.0, start).centre
    ends = [contact([chamfer, other], _ANY_SIDE, 0.0, behind).centre for other in others]
    return np.concatenate([np.linalg.norm(end - behind, axis=1) for end in ends])


def chamfer_rows(
    blends: Iterable[Blend], known: JointSurfaces, faces: FaceSamples
) -> Iterator[PartDimension]:
    """A row for each chamfer: the width that it takes of the first of its faces."""
    for blend in blends:
        if blend.kind == "chamfer":
            places = [known.part.labels.index(label) for label in (*blend.labels, *blend.supports)]
            like, start = [faces.surfaces[place] for place in places], blend.edge
            behind = start[[len(start) // 2]]
            ends = np.concatenate([behind, contact(like[:2], _ANY_SIDE, 0.0, behind).centre])

            def width(
                at: Sequence[Placement], like: Sequence[Surface] = like, start: FloatArray = start
            ) -> float:
                return float(_widths(at, like, start)[: len(start)].mean())

            yield known.dimension("chamfer", places, width, ends=ends, note=blend.note)
