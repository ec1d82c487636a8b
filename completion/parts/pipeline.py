# SPDX-License-Identifier: MIT
"""Parts on one page: from points or a mesh to surfaces, and to what these are to each other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from completion.fitting.result import SurfaceFit
from completion.parts.dimensions.pipeline import dimensions_of
from completion.parts.dimensions.preferred import preferred_relations
from completion.parts.division.limits import MANY_FACES
from completion.parts.division.meshes import segment_mesh
from completion.parts.division.pipeline import fit_labelled, segment_part
from completion.parts.division.result import PartSegmentation
from completion.parts.division.rippled import segment_rippled
from completion.parts.part import Part
from completion.relations.estimate import NO_DOUBT, Doubt
from completion.relations.graph import RelationGraph, is_settled
from completion.relations.options import RelationOptions
from completion.relations.pipeline import infer
from completion.relations.relation import RelationStatus, StatedRelation
from completion.uncertainty.space_warp import SpaceWarp, find_warp
from scenes.checks import FloatArray, InputError, IntArray
from scenes.mesh.labelled_mesh import LabelledMesh, mesh_or_points
from scenes.run.journal import NO_JOURNAL, Journal
from scenes.run.steps import Progress

MACHINED = RelationOptions()
"""How machined parts are: what holds, holds exactly."""


def model_part(
    shape: object,
    labels: object | None = None,
    *,
    normals: object | None = None,
    noise_m: float | None = None,
    relations: RelationOptions | None = MACHINED,
    stated: Sequence[StatedRelation[int]] = (),
    progress: Progress | None = None,
    journal: Journal = NO_JOURNAL,
) -> Part:
    """Divide a part into surfaces, and find what these are to each other.

    After Fisher (2004), Applying knowledge to reverse engineering problems, section 2. Points are divided
    into connected faces on planes, spheres, cylinders, cones and tori. Relations between these (parallel,
    at right angles, coaxial, of one radius, ...) are proposed, tested, and imposed together where they hold.

    Parameters
    ----------
    shape : (n, 3) float, or LabelledMesh
        Points in any order, or a mesh; metres. Meshes and clouds of trimesh, Open3D and pyvista will do.
    labels : (n,) int, optional
        Which surface each point (vertex) belongs to, where that is known; 0 and less for none. Points are
        then not divided.
    normals : (n, 3) float, optional
        Of points, of any length, with or without a side; where they are not given, they are estimated.
    noise_m : float, optional
        Deviation of the points along the normal, metres; else it is estimated.
    relations : RelationOptions, optional
        Which relations are looked for, and how exactly they hold; None leaves surfaces as measured.
    stated : sequence of StatedRelation
        What a person states and forbids, by labels.
    progress : callable, optional
        Called with stage, done and total.
    journal : Journal
        Remembers the division, so that a run that was killed goes on after it.

    Raises
    ------
    InputError
        Arrays of wrong shape, points that are not finite, a mesh without area, a noise below zero; a stated
        relation of labels that there are not, or that their surfaces cannot have.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> top, side = rng.uniform(0, 1, (2, 800, 2))
    >>> corner = np.vstack([np.insert(top, 2, 0.0, axis=1), np.insert(side, 0, 0.0, axis=1)])
    >>> part = model_part(corner + rng.normal(0, 1e-3, corner.shape))
    >>> part.fits[0].surface.kind, part.relations.relations[0].kind
    ('plane', 'perpendicular')
    """
    shape = mesh_or_points(shape)

    # 1. Divide: which surface each point is on, and a fit for each; given labels are kept.
    part = divide_part(shape, labels, normals=normals, noise_m=noise_m, progress=progress, journal=journal)

    # 2. Relate: of the surfaces that are known well enough, and of all that a person names.
    return relate_part(shape, part, relations=relations, stated=stated, progress=progress)


def divide_part(
    shape: object,
    labels: object | None = None,
    *,
    normals: object | None = None,
    noise_m: float | None = None,
    step_m: float = 0.0,
    has_ripple: bool = False,
    progress: Progress | None = None,
    journal: Journal = NO_JOURNAL,
) -> PartSegmentation:
    """Divide a part into surfaces, or fit one to the points of each label.

    Parameters and errors are those of `model_part`; `step_m` is the step between coordinates of the file,
    metres: corners of a model's mesh are known to it. With `has_ripple` planes may bear ripple, as before
    they are flattened: they are then sought beneath it (`segment_rippled`). So they are where no model has
    more faces than parts have: ripple looks like many.
    """

    def divide() -> PartSegmentation:
        if has_ripple:
            return segment_rippled(shape, labels, normals, noise_m=noise_m, progress=progress)
        if labels is not None:
            points = shape.vertices if isinstance(shape, LabelledMesh) else shape
            return fit_labelled(points, labels, normals, noise_m=noise_m)
        if isinstance(shape, LabelledMesh):
            found = segment_mesh(shape, noise_m=noise_m, step_m=step_m, progress=progress)
        else:
            found = segment_part(shape, normals, noise_m=noise_m, progress=progress)
        if found.is_model or len(found.fits) < MANY_FACES:
            return found
        return segment_rippled(shape, normals=normals, noise_m=noise_m, progress=progress, found=found)

    return journal.step("divided", divide)


def relate_part(
    shape: object,
    segmentation: PartSegmentation,
    *,
    relations: RelationOptions | None = MACHINED,
    stated: Sequence[StatedRelation[int]] = (),
    imposes_preferred: bool = False,
    progress: Progress | None = None,
) -> Part:
    """The part that a division makes, its relations found and imposed; as for `model_part`.

    With `imposes_preferred` dimensions that are probably preferred values are stated to be these, as
    relations that are tested like others and may be rejected; then all is solved again.
    """
    tell = progress or (lambda _stage, _done, _total: None)
    tell("relate", 0, 1)
    part = _related_part(shape, segmentation, relations, stated)
    if imposes_preferred and relations is not None:
        probable = preferred_relations(part, dimensions_of(part).rows)
        part = _related_part(shape, segmentation, relations, [*stated, *probable])
    tell("relate", 1, 1)
    return part


def _related_part(
    shape: object,
    segmentation: PartSegmentation,
    relations: RelationOptions | None,
    stated: Sequence[StatedRelation[int]],
) -> Part:
    points = np.asarray(shape.vertices if isinstance(shape, LabelledMesh) else shape, dtype=np.float64)
    made = None if relations is None else related_faces(segmentation, relations, stated, points)
    fits = list(segmentation.fits)
    for place, number in enumerate(made.numbers if made else ()):
        fits[number] = fits[number] if made is None else made.graph.fits[place]
    return part_of(shape, segmentation, made, fits)


class RelatedFaces(NamedTuple):
    """The relations of a division's surfaces, the places of those that take part, and how all are warped."""

    graph: RelationGraph
    numbers: tuple[int, ...]
    warp: SpaceWarp | None


def related_faces(
    segmentation: PartSegmentation,
    options: RelationOptions,
    stated: Sequence[StatedRelation[int]],
    points: FloatArray | None = None,
) -> RelatedFaces:
    """The relations of a division's surfaces, which may be warped as a whole where `points` (n, 3) show it.

    A warp is taken for real where relations are rejected without it, and with it those that hold leave fewer
    parameters free.

    Raises InputError: a label that there is not, a relation that its surfaces cannot have.
    """
    place = {label: number for number, label in enumerate(segmentation.names)}
    named = [[_place_of(label, relation.source, place) for label in relation.surfaces] for relation in stated]
    known = {number for number, fit in enumerate(segmentation.fits) if is_settled(fit)}
    chosen = tuple(sorted(known.union(*named)))
    among = {number: k for k, number in enumerate(chosen)}
    given = [
        relation.of([among[number] for number in numbers])
        for relation, numbers in zip(stated, named, strict=True)
    ]
    fits = [segmentation.fits[number] for number in chosen]
    graph = infer(fits, given, options)
    if points is None or not graph.count_with(RelationStatus.REJECTED):
        return RelatedFaces(graph, chosen, None)
    warp = find_warp(fits, [points[segmentation.members(number + 1)] for number in chosen])
    if warp is not None:
        again = infer(fits, given, options, doubt=doubt_of_warp(warp, len(fits)))
        if again.free < graph.free:
            return RelatedFaces(again, chosen, warp)
    return RelatedFaces(graph, chosen, None)


def doubt_of_warp(warp: SpaceWarp | None, n: int) -> Doubt:
    """What is doubtful of n surfaces of a part that is warped as a whole, or of one that is not."""
    return NO_DOUBT if warp is None else Doubt((warp.freedom,) * n, warp.shared)


def part_of(
    shape: object,
    segmentation: PartSegmentation,
    made: RelatedFaces | None,
    fits: Sequence[SurfaceFit],
) -> Part:
    """The part that a division and its relations make."""
    mesh = shape if isinstance(shape, LabelledMesh) else None
    names = np.array([0, *segmentation.names], dtype=np.int64)
    triangles = segmentation.triangle_labels
    if mesh is not None and triangles is None:
        triangles = _of_corners(mesh, segmentation.labels)
    return Part(
        points=np.asarray(shape if mesh is None else mesh.vertices, dtype=np.float64),
        surface=names[segmentation.labels],
        labels=segmentation.names,
        measured=segmentation.fits,
        fits=tuple(fits),
        groups=segmentation.groups,
        noise_m=segmentation.noise_m,
        spacing_m=segmentation.spacing_m,
        relations=None if made is None else made.graph,
        related=() if made is None else made.numbers,
        faces=None if mesh is None else mesh.faces,
        triangle_surface=None if triangles is None else names[triangles],
        is_model=segmentation.is_model,
        warnings=(*segmentation.warnings, *_warp_text(None if made is None else made.warp)),
    )


def _warp_text(warp: SpaceWarp | None) -> tuple[str, ...]:
    """What is to be known of a warp."""
    if warp is None:
        return ()
    return (
        f"the whole is warped by {1000 * warp.rms_m:.3g} mm: what that may do to surfaces counts as an error "
        "of theirs, so that relations are neither rejected for it nor as well known",
    )


def _of_corners(mesh: LabelledMesh, labels: IntArray) -> IntArray:
    """The label (m,) that two corners of a triangle have, else that of its first."""
    corners = labels[mesh.faces]
    return np.asarray(np.where(corners[:, 1] == corners[:, 2], corners[:, 1], corners[:, 0]))


def _place_of(label: int, source: str, place: dict[int, int]) -> int:
    if label not in place:
        known = ", ".join(str(number) for number in list(place)[:20]) or "none"
        raise InputError(f"{source}: there is no surface {label}; there are {known}")
    return place[label]
