# SPDX-License-Identifier: MIT
"""Chamfers: narrow planes and cones that cut off the edge in which two faces would meet."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import permutations

import numpy as np
from scipy.special import chdtrc

from completion.parts.dimensions.contacts import contact, spread, surfaces_at, turns
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
_N_EDGE = 7
_SHARP_SD = 4.0  # standard deviations, from which a width is one
_LOOSE = 1e-2  # of their deviation without relations, within which widths that relations make equal are so
_EXACT = 1e-7  # of the part's size, of rounding
_LEAST_SHARE = 1e-6  # of the greatest variance
_ANY_SIDE = np.ones(2)


def find_chamfers(known: JointSurfaces, faces: FaceSamples, level: float) -> Iterator[Blend]:
    """The chamfers of a part: narrow faces that take one width of a face all along, and one of another.

    Whether widths are the same all along is tested at a level by the joint covariance.
    """
    for place, surface in enumerate(faces.surfaces):
        if isinstance(surface, Plane | Cone) and len(faces.of(place)):
            beside = [other for other in sorted(faces.neighbours[place])
                      if isinstance(faces.surfaces[other], Plane | Cylinder | Cone)]  # fmt: skip
            found = [_chamfer((place, *pair), known, faces, level) for pair in permutations(beside, 2)]
            yield from [blend for blend in found if blend is not None][:1]


def _chamfer(
    places: tuple[int, int, int], known: JointSurfaces, faces: FaceSamples, level: float
) -> Blend | None:
    """A face, the first, as a chamfer of two others, of which it takes no less of the first."""
    like, own = [faces.surfaces[place] for place in places], faces.of(places[0])
    far = [np.linalg.norm(faces.of(place) - contact(like[1:], _ANY_SIDE, 0.0, faces.of(place)).centre, axis=1)
           for place in places]  # fmt: skip
    if not all(np.isfinite(each).all() for each in far):
        return None
    behind = contact(like[1:], _ANY_SIDE, 0.0, own).centre
    is_ring, middle = isinstance(like[0], Cone), behind.mean(axis=0)
    way = np.linalg.svd(behind - middle, full_matrices=False)[2][0]
    along = turns(known.at[places[0]], own) if is_ring else (behind - middle) @ way
    start = spread(behind, along, _N_EDGE)
    found = known.estimate(places, lambda at: _widths(at, like, start))
    covariance = found.covariance + _LOOSE**2 * found.measured_covariance
    width = found.value.reshape(2, -1).mean(axis=1)
    sd = np.sqrt(np.diag(covariance).reshape(2, -1).max(axis=1))
    reach = [float(np.quantile(each, _MOST)) for each in far]
    is_narrow = reach[0] <= width.max() and all(width < _NARROW * np.array(reach[1:]))
    if not is_narrow or width[0] < width[1] - sd.sum() or not (width > _SHARP_SD * sd).all():
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
    edge = known.estimate(
        places[1:], lambda at: contact(surfaces_at(at, like[1:]), _ANY_SIDE, 0.0, start).centre.ravel()
    )
    row = known.estimate(places, lambda at: _widths(at, like, start)[:_N_EDGE].mean())
    turn = np.einsum("ij,ij->i", like[0].normal(start), like[1].normal(start))
    return Blend(
        labels=(labels[places[0]],), supports=(labels[places[1]], labels[places[2]]), kind="chamfer",
        size_m=float(row.value[0]), sd_m=row.sd, p=p, edge=edge.value.reshape(-1, 3),
        edge_covariance=edge.covariance.reshape(_N_EDGE, 3, _N_EDGE, 3)[np.arange(_N_EDGE), :, np.arange(_N_EDGE)],
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
            middle = start[len(start) // 2]
            end = contact(like[:2], _ANY_SIDE, 0.0, middle[None]).centre[0]
            yield known.dimension(
                "chamfer", places, lambda at, like=like, start=start: float(_widths(at, like, start)[: len(start)].mean()),
                ends=np.stack([middle, end]), note=blend.note,
            )  # fmt: skip
