# SPDX-License-Identifier: MIT
"""Completion on one page: from scans to surfaces continued behind their occluders."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from completion.backs.closed_things import close_things
from completion.boundary.boundary_pixels import BoundaryPixels, find_boundary_pixels
from completion.boundary.continuation import Cue
from completion.boundary.meshing import ChartMesh, mesh_cells
from completion.edits.application import apply_edits
from completion.evidence.evidence import Scans
from completion.extension.adjacency import find_adjacency
from completion.extension.bounded import BoundedSurfaces
from completion.extension.claims import Choice, is_chosen, numbered_anew, overlap_m2, settle_claims
from completion.extension.extent import find_extent
from completion.extension.features import extend_face, with_faces
from completion.extension.patch import Patch
from completion.extension.pipeline import extend
from completion.features.engine.options import FeatureOptions
from completion.features.engine.template import TemplateFit
from completion.features.openings.pipeline import find_openings
from completion.features.stated import place_features, reveals_of, with_features
from completion.merging.merged_surface import MergedSurface
from completion.merging.scan_surfaces import ScanSurfaces, find_surfaces
from completion.options import CompletionOptions
from completion.relations.pipeline import RelatedSurfaces, relate_surfaces
from completion.result.audit import AuditResult, Bundles, audit, bundle
from completion.result.completed_model import CompletedSurfaces
from completion.result.completion import Completion
from completion.result.flat_scans import flatten_scan
from completion.result.verification import Verification, compare_patches, unowned_scans
from completion.room.pipeline import find_room
from completion.texturing.chart_texture import ChartTexture
from completion.texturing.pipeline import choose_search, texture_patch
from completion.uncertainty.pipeline import state_fits
from scenes.checks import FloatArray, InputError, check_kind, check_rng
from scenes.pose import Pose
from scenes.run.journal import NO_JOURNAL, Journal
from scenes.run.steps import Progress, Steps
from scenes.scan.range_image import RangeImage


def complete(
    scans: Sequence[RangeImage] | RangeImage,
    options: CompletionOptions = CompletionOptions(),
    *,
    rng: np.random.Generator | int | None = None,
    n_threads: int | None = None,
    progress: Progress | None = None,
    journal: Journal = NO_JOURNAL,
) -> Completion:
    """Complete the surfaces of `scans` behind their occluders (after Dell'Acqua & Fisher 2002).

    The scans are cut into regions on planes and cylinders. Regions that one surface explains are joined
    across what stood before them. Each surface is continued where it was hidden, and never where a beam went
    through. It ends where it meets another surface, or at its own edges, which are continued behind the
    occluder. Its texture is continued with it. A person may say which surfaces there are and how far they go.

    Parameters
    ----------
    scans : RangeImage or sequence of RangeImage
        One scan, or several registered ones. An empty scan gives an empty completion.
    options : CompletionOptions
        What to do; see there.
    rng : Generator, int or None
        Seed of the texture.
    n_threads : int, optional
        Threads; results do not depend on it.
    progress : callable, optional
        Called with a stage's name, steps done and steps in all.
    journal : Journal
        Remembers what the steps of these scans and options came to, so that a run that was killed goes on.

    Raises
    ------
    InputError
        No scans, an unknown mode, edits that fit no surface of these scans, or more pixels than fit into
        memory.
    """
    scans, seed = _check_scans(scans), int(check_rng(rng).integers(2**63))
    world_from_reference = scans[0].world_from_sensor
    with Steps.over([scan.ranges.size for scan in scans], n_threads, progress, journal) as steps:
        # 1. Surfaces: observe, register, segment and merge.
        surfaces = find_surfaces(scans, options.of_surfaces, steps)

        # 2. All that follows from them.
        return complete_surfaces(surfaces, world_from_reference, options, steps, seed=seed)


def complete_surfaces(
    surfaces: ScanSurfaces,
    world_from_reference: Pose,
    options: CompletionOptions,
    steps: Steps,
    *,
    seed: int,
    bounded: BoundedSurfaces | None = None,
) -> Completion:
    """Complete the surfaces of scans: what `complete` does once these were found.

    Parameters
    ----------
    surfaces : ScanSurfaces
        Of `find_surfaces`, working frame.
    world_from_reference : Pose
        From the working frame to the world.
    options : CompletionOptions
        What to do; `options.of_surfaces` are those that the surfaces were found with.
    steps : Steps
        Where to run.
    seed : int
        Of the texture.
    bounded : BoundedSurfaces, optional
        Of `bound_surfaces` with these surfaces and options, where it is at hand.
    """
    # 1. Continue: relate the surfaces, fit features, and extend each behind its occluders.
    bounded = bounded or bound_surfaces(surfaces, world_from_reference, options, steps)
    completed = continue_surfaces(bounded, world_from_reference, options, steps)
    patches, observations = completed.patches, surfaces.observations

    # 2. Back sides, on request: separate what stands in the room, and close each thing by its symmetries.
    things = (
        close_things(
            patches, completed.scans, completed.room, completed.up,
            world_from_reference=world_from_reference, options=options.backs, steps=steps,
        )
        if options.backs is not None
        else ()
    )  # fmt: skip

    # 3. Texture: continue the colour of each surface over its inferred part.
    texturing = choose_search(options.texturing, patches if options.texture else (), observations)

    def texture_surface(index: int) -> ChartTexture | None:
        return texture_patch(patches[index], observations, texturing, seed + index)

    textures = steps.each("texture", texture_surface, range(len(patches))) if options.texture else []

    # 4. Audit: cast the measured beams against the inferred area, and look for places inferred twice.
    bundles = [steps.keep(bundle(seen)) for seen in observations]
    audits = steps.each("audit", lambda patch: _audit_patch(patch, completed.scans, bundles), patches)

    # 5. Flatten, on request: take the ripple from measured planes, for the meshes that are written.
    flat = options.flattening
    pairs = [] if flat is None else list(zip(observations, completed.scans.owners, strict=True))
    flattened = (
        steps.each("flatten", lambda pair: flatten_scan(*pair, patches, flat, seed), pairs)
        if flat is not None
        else []
    )
    return Completion(
        measured_surfaces=surfaces,
        completed=completed,
        textures=tuple(textures),
        inferred=tuple(mesh for mesh, _ in audits),
        audit=_join_audits(audits, overlap_m2(patches, surfaces.tolerance.flatness_m)),
        flattened=tuple(flattened),
        things=things,
        backs=options.backs,
        world_from_reference=world_from_reference,
    )


def bound_surfaces(
    scan_surfaces: ScanSurfaces, world_from_reference: Pose, options: CompletionOptions, steps: Steps
) -> BoundedSurfaces:
    """Find what the surfaces of scans are to each other, and where each was seen to end.

    Parameters
    ----------
    scan_surfaces : ScanSurfaces
        The surfaces, working frame.
    world_from_reference : Pose
        From the working frame to the world.
    options : CompletionOptions
        What to do.
    steps : Steps
        Where to run.
    """
    # 1. Room and relations: say what is up, and join pieces of one floor or wall; join and part as a person
    #    says; infer relations of surfaces, and impose them.
    across = Cue.MERGING in options.cues
    stated_up, joined = find_room(scan_surfaces, world_from_reference, options.up, across=across)
    here = stated_up.within(world_from_reference)
    related = _edit_and_relate(joined, world_from_reference, options)
    surfaces = [edit.surface for edit in related.surfaces]
    scans = joined.evidence(steps, surfaces)

    # 2. Features: fit doorways and windows whole, or take the openings, rows of holes and joints that a
    #    person states.
    features = _features(
        surfaces, scans, world_from_reference, options.features, up=here.direction, steps=steps
    )

    # 3. Bound: find where each surface was seen to end, and which of them meet and enclose the room.
    boundaries = _find_boundaries(surfaces, scans, steps)
    return BoundedSurfaces(
        joined=joined,
        up=stated_up,
        related=related,
        scans=scans,
        features=features,
        boundaries=boundaries,
        adjacency=find_adjacency(surfaces, boundaries, scans, here),
    )


def continue_surfaces(
    bounded: BoundedSurfaces, world_from_reference: Pose, options: CompletionOptions, steps: Steps
) -> CompletedSurfaces:
    """Continue surfaces behind their occluders.

    Parameters
    ----------
    bounded : BoundedSurfaces
        Of `bound_surfaces` with these options.
    world_from_reference : Pose
        From the working frame to the world.
    options : CompletionOptions
        What to do.
    steps : Steps
        Where to run.
    """
    related, scans, adjacency = bounded.related, bounded.scans, bounded.adjacency
    observations, flatness_m = scans.observations, bounded.joined.tolerance.flatness_m
    surfaces, boundaries = [edit.surface for edit in related.surfaces], bounded.boundaries
    up = bounded.up.within(world_from_reference).direction

    # 4. A known hole is no surface, and its reveals are surfaces of their own.
    known = with_features(related.surfaces, bounded.features)
    faces = reveals_of(bounded.features, surfaces, observations, scans.owners, flatness_m)

    # 5. Extend: continue each surface that is wanted as far as it may go and is probable.
    def extend_surface(index: int) -> Patch | None:
        shape, role = surfaces[index].fit.surface, adjacency.room.role(index)
        if not related.surfaces[index].edits.actions and not is_chosen(shape, options.only, role):
            return None
        extent = find_extent(index, surfaces, boundaries, adjacency, observations, cues=options.cues, up=up)
        return extend(
            boundaries[index],
            extent,
            known[index],
            related.stated[index],
            scans=scans,
            room=adjacency.room,
            number=index + 1,
            rules=options.rules(),
        )

    patches = steps.each("extend", extend_surface, range(len(surfaces)))

    # 6. Faces: the same for the faces of features.
    with_reveals = with_faces(scans, faces, len(surfaces), steps.keep) if faces else scans

    def extend_reveal(index: int) -> Patch | None:
        is_wanted = is_chosen(faces[index].surface.fit.surface, options.only)
        patch = extend_face(faces[index], with_reveals, len(surfaces) + index + 1, options.rules())
        return patch if is_wanted and (patch.provenance >= 0).any() else None

    reveals = steps.each("faces", extend_reveal, range(len(faces))) if faces else []

    # 7. Claims: what is small stays as measured; where several claim a place, the most probable one has it.
    choice = Choice.of(options.only, options.min_area_m2, patches)
    is_named = [bool(edit.edits.actions) for edit in related.surfaces] + [not choice.is_stated] * len(faces)
    every = [
        patch if patch is None or named or choice.keeps(patch) else None
        for patch, named in zip([*patches, *reveals], is_named, strict=True)
    ]
    is_kept = [patch is not None for patch in every]
    chosen, owners = numbered_anew(every, with_reveals.owners, steps.keep)
    errors = related.errors.and_own([face.surface.fit.covariance for face in faces])
    return CompletedSurfaces(
        patches=tuple(steps.keep(patch) for patch in settle_claims(chosen, flatness_m)),
        scans=with_reveals.with_owners(owners),
        relations=related.inferred and related.inferred.renumber(is_kept[: len(surfaces)]),
        errors=errors.only(is_kept),
        room=adjacency.room,
        features=tuple(bounded.features),
        choice=replace(choice, n_left_out=len(every) - len(chosen)),
        mode=options.mode,
        edits=options.edits,
        up=bounded.up,
    )


def _edit_and_relate(
    scan_surfaces: ScanSurfaces, world_from_reference: Pose, options: CompletionOptions
) -> RelatedSurfaces:
    """The surfaces as a person's edits make them, where their relations hold."""
    observations, flatness_m = scan_surfaces.observations, scan_surfaces.tolerance.flatness_m
    edited = apply_edits(
        scan_surfaces.surfaces, options.edits, observations, world_from_reference, flatness_m
    )
    return relate_surfaces(
        edited,
        state_fits([edit.surface for edit in edited], observations, flatness_m),
        observations,
        options.relations if Cue.RELATIONS in options.cues else None,
        options.stated_relations,
        world_from_reference=world_from_reference,
    )


def _find_boundaries(surfaces: Sequence[MergedSurface], scans: Scans, steps: Steps) -> list[BoundaryPixels]:
    """The boundary pixels of each surface in its own chart, kept where the run keeps arrays."""
    return [
        steps.keep(
            find_boundary_pixels(surface.fit, surface.pixels, scans.observations, scans.tolerance, scans.keys)
        )
        for surface in surfaces
    ]


def _features(
    surfaces: Sequence[MergedSurface],
    scans: Scans,
    world_from_reference: Pose,
    options: FeatureOptions | None,
    *,
    up: FloatArray,
    steps: Steps,
) -> list[TemplateFit]:
    """The features of scans, working frame: as stated, else openings that are fitted."""
    if options is None:
        return []
    if options.stated is not None:
        return place_features(options.stated, surfaces, scans.observations, world_from_reference.inverse())
    return find_openings(
        surfaces,
        scans.observations,
        owners=scans.owners,
        up=up,
        given=options.given,
        kinds=options.kinds,
        each=lambda work, numbers: steps.each("features", work, numbers),
        is_assigned=False,
    )


def _check_scans(scans: Sequence[RangeImage] | RangeImage) -> list[RangeImage]:
    """The scans as a list. Raises InputError: there are none, or something else is among them."""
    scans = [scans] if isinstance(scans, RangeImage) else list(scans)
    if not scans:
        raise InputError("nothing to complete: give at least one scan")
    cure = "read_scan(path, ...) reads one, scan_from_station makes one of points"
    for scan in scans:
        check_kind("a scan", scan, RangeImage, cure)
    return scans


def verify_first(
    completion: Completion,
    options: CompletionOptions,
    *,
    n_threads: int | None = None,
    journal: Journal = NO_JOURNAL,
) -> Verification:
    """Let the other scans of `completion` confirm or refute what its first scan alone leads to.

    The scans are used as `completion` prepared them, with their corrected poses.
    """
    surfaces, alone = (
        completion.measured_surfaces,
        complete_first(completion, options, n_threads=n_threads, journal=journal),
    )
    others = surfaces.registration.seen_from_first(surfaces.observations)[1:]
    evidence = replace(options.evidence, flatness_m=alone.scans.tolerance.flatness_m)
    tolerance = evidence.tolerance(registration_m=min(seen.pose_error_m for seen in others))
    is_same = all(seen is other for seen, other in zip(others, surfaces.observations[1:], strict=True))
    return compare_patches(
        alone.patches,
        alone.scans.observations,
        unowned_scans(others, tolerance, surfaces.reach[1:] if is_same else ()),
        completion.world_from_reference,
    )


def complete_first(
    completion: Completion,
    options: CompletionOptions,
    *,
    n_threads: int | None = None,
    journal: Journal = NO_JOURNAL,
) -> CompletedSurfaces:
    """Continue the surfaces that the first scan shows by itself, without what a person says."""
    plain = replace(options, edits=(), stated_relations=(), up=completion.up)
    size = completion.measured_surfaces.observations[0].scan.ranges.size
    with Steps.over([size], n_threads, None, journal) as steps:
        alone = completion.measured_surfaces.first(plain.of_surfaces, steps)
        bounded = bound_surfaces(alone, completion.world_from_reference, plain, steps)
        return continue_surfaces(bounded, completion.world_from_reference, plain, steps)


def _audit_patch(patch: Patch, scans: Scans, bundles: Sequence[Bundles]) -> tuple[ChartMesh, AuditResult]:
    """The inferred cells of a surface as a mesh, and what the beams say of it."""
    mesh = mesh_cells(patch.grid, patch.hypothesised, patch.limits.cuts, patch.trims, merged=False)
    sd, seen = patch.source.fit.standard_deviation(mesh.vertices), scans.observations
    return mesh, audit(mesh.vertices, mesh.faces, sd, seen, bundles, tolerance=scans.tolerance)


def _join_audits(pairs: Sequence[tuple[ChartMesh, AuditResult]], overlap: float) -> AuditResult:
    """What the beams say of all surfaces, faces numbered on from one to the next, and where they overlap."""
    first = np.cumsum([0, *(len(mesh.faces) for mesh, _ in pairs)])
    faces = [result.faces + start for (_, result), start in zip(pairs, first, strict=False)]
    area = float(sum(result.violation_m2 for _, result in pairs))
    return AuditResult(area, np.concatenate([np.zeros(0, np.int64), *faces]), overlap)
