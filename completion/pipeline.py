# SPDX-License-Identifier: MIT
"""Completion on one page: from scans to surfaces continued behind their occluders."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from completion.boundary.boundary_pixels import find_boundary_pixels
from completion.boundary.continuation import Cue
from completion.boundary.meshing import ChartMesh, mesh_cells
from completion.edits.application import apply_edits
from completion.evidence.evidence import Scans
from completion.extension.adjacency import find_adjacency
from completion.extension.choice import Choice, is_chosen, numbered_anew
from completion.extension.claims import overlap_m2, settle_claims
from completion.extension.extent import find_extent
from completion.extension.known_faces import extend_face, with_faces
from completion.extension.patch import Patch
from completion.extension.pipeline import extend
from completion.features.engine.template import TemplateFit
from completion.features.openings.scene import find_openings
from completion.features.reveals import reveals_of
from completion.features.stated import place_features, with_features
from completion.merging.merged_surface import number_pixels
from completion.merging.pipeline import merge
from completion.merging.unconfirmed import Unconfirmed
from completion.observe.key_frames import find_key_frames
from completion.observe.observation import observe
from completion.options import CompletionOptions
from completion.registration.pipeline import correct_poses
from completion.relations.surfaces import relate_surfaces
from completion.result.audit import AuditResult, Bundles, audit, bundle
from completion.result.completion import Completion
from completion.result.flat_scans import flatten_scan
from completion.result.verification import Verification, held_against
from completion.segmentation.pipeline import segment
from completion.texturing.chart_texture import ChartTexture
from completion.texturing.pipeline import settled, texture_patch
from completion.uncertainty.pipeline import state_fits
from scenes.checks import InputError, check_kind, check_rng
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
    # 1. Observe: the points, rays and range noise of each scan, in the sensor frame of the first. Scans whose
    #    poses contradict what they measured are moved until they agree.
    scans = [scans] if isinstance(scans, RangeImage) else list(scans)
    if not scans:
        raise InputError("nothing to complete: give at least one scan")
    for scan in scans:
        check_kind(
            "a scan",
            scan,
            RangeImage,
            "read_scan(path, ...) reads one, scan_from_station makes one of points",
        )
    seed = int(check_rng(rng).integers(2**63))
    world_from_reference, stated = scans[0].world_from_sensor, options.tolerance(len(scans))
    with Steps.over([scan.ranges.size for scan in scans], n_threads, progress, journal) as steps:
        observations = steps.each(
            "noise and normals",
            lambda scan: observe(scan, world_from_reference, options.sigma_m, options.projector_m),
            scans,
            remember=False,
        )
        keys = find_key_frames(observations)
        registration = steps.one(
            "registration",
            lambda: correct_poses(
                observations,
                keys,
                stated_m=stated.registration_m,
                moves=options.moves_scans,
                spill=steps.spill,
            ),
        )
        errors = options.pose_errors(registration.left_m)
        observations = registration.applied(observations, errors)
        tolerance = replace(stated, registration_m=float(errors.min()))

        # 2. Segment: cut each scan into regions on planes and cylinders, and see how uneven surfaces are.
        regions = steps.each("segment", lambda seen: segment(seen, options.segmentation), observations)
        tolerance = replace(tolerance, flatness_m=options.flatness(regions))

        # 3. Merge: join the regions that are one surface, then join and part as a person says.
        across = Cue.MERGING in options.cues
        merged = steps.one(
            "merge",
            lambda: merge(observations, regions, tolerance, across=across, keys=keys, spill=steps.spill),
        )
        edited = apply_edits(merged, options.edits, observations, world_from_reference, tolerance.flatness_m)

        # 4. Relate: say how well each surface is known, infer what they are to each other, and impose that.
        told = state_fits([one.surface for one in edited], observations, tolerance.flatness_m)
        related = relate_surfaces(
            edited,
            told,
            observations,
            options.relations if Cue.RELATIONS in options.cues else None,
            options.stated_relations,
            world_from_reference=world_from_reference,
        )
        surfaces = [one.surface for one in related.surfaces]
        numbered = (number_pixels(surfaces, number, one) for number, one in enumerate(observations))
        seen = Scans(tuple(observations), tuple(map(steps.keep, numbered)), tolerance, keys, steps.spill)

        # 5. Features: fit doorways and windows whole, from the beams that pass through them; or take the
        # openings, rows of holes and joints that a person states.
        up = world_from_reference.matrix[2, :3]
        features: list[TemplateFit] = []
        wanted = options.features
        if wanted is not None and wanted.stated is not None:
            features = place_features(wanted.stated, surfaces, observations, world_from_reference.inverse())
        elif wanted is not None:
            features = find_openings(
                surfaces,
                observations,
                owners=seen.owners,
                up=up,
                given=wanted.given,
                kinds=wanted.kinds,
                each=lambda work, numbers: steps.each("features", work, numbers),
                is_assigned=False,
            )
        known = with_features(related.surfaces, features)
        faces = reveals_of(features, surfaces, observations, seen.owners, tolerance.flatness_m)

        # 6. Bound: find where each surface was seen to end, and which of them meet and enclose the room.
        boundaries = [
            steps.keep(find_boundary_pixels(one.fit, one.pixels, observations, tolerance, keys))
            for one in surfaces
        ]
        adjacency = find_adjacency(surfaces, boundaries, seen, up)

        # 7. Extend: continue each surface that is wanted behind its occluders, as far as it may go and is
        # probable; then the faces of features. Where several claim a place, the most probable one has it.
        def extended(index: int) -> Patch | None:
            said, encloses = related.surfaces[index].edits, bool(adjacency.encloses[index])
            if not said.actions and not is_chosen(
                surfaces[index].fit.surface, options.only, encloses=encloses, up=up
            ):
                return None
            extent = find_extent(
                index, surfaces, boundaries, adjacency, observations, cues=options.cues, up=up
            )
            patch = extend(
                boundaries[index],
                extent,
                known[index],
                related.stated[index],
                scans=seen,
                number=index + 1,
                rules=options.rules(),
            )
            return patch if said.actions or patch.observed_m2 >= options.min_area_m2 else None

        every = steps.each("extend", extended, range(len(surfaces)))
        seen = with_faces(seen, faces, len(surfaces), steps.keep) if faces else seen

        def revealed(index: int) -> Patch | None:
            is_wanted = is_chosen(faces[index].surface.fit.surface, options.only, encloses=False, up=up)
            patch = extend_face(faces[index], seen, len(surfaces) + index + 1, options.rules())
            is_large = patch.observed_m2 >= options.min_area_m2 and (patch.provenance >= 0).any()
            return patch if is_wanted and is_large else None

        of_features = steps.each("faces", revealed, range(len(faces))) if faces else []
        chosen, owners = numbered_anew([*every, *of_features], seen.owners, steps.keep)
        relations = related.found and related.found.numbered([one is not None for one in every])
        joint = related.errors.and_own([one.surface.fit.covariance for one in faces])
        joint = joint.only([one is not None for one in (*every, *of_features)])
        patches = [steps.keep(one) for one in settle_claims(chosen, tolerance.flatness_m)]

        # 8. Texture: continue the colour of each surface over its inferred part.
        texturing = settled(options.texturing, patches if options.texture else (), observations)

        def textured(index: int) -> ChartTexture | None:
            return texture_patch(patches[index], observations, texturing, seed + index)

        textures = steps.each("texture", textured, range(len(patches))) if options.texture else []

        # 9. Audit: cast the measured beams against the inferred area, and look for places inferred twice.
        bundles = [steps.keep(bundle(one)) for one in observations]
        found = steps.each("audit", lambda patch: _audited(patch, seen, bundles), patches)

        # 10. Flatten, on request: take the ripple from measured planes, for the meshes that are written.
        flat = options.flattening
        flattened = (
            steps.each(
                "flatten",
                lambda one: flatten_scan(*one, patches, flat, seed),
                list(zip(seen.observations, owners, strict=True)),
            )
            if flat is not None
            else []
        )
    return Completion(
        observations=seen.observations,
        patches=tuple(patches),
        textures=tuple(textures),
        inferred=tuple(mesh for mesh, _ in found),
        audit=_together(found, overlap_m2(patches, tolerance.flatness_m)),
        owners=owners,
        flatness_m=tolerance.flatness_m,
        choice=Choice(options.only, options.min_area_m2, len(every) + len(of_features) - len(patches)),
        mode=options.mode,
        edits=options.edits,
        world_from_reference=world_from_reference,
        key_frames=keys,
        unconfirmed=Unconfirmed.of(regions, merged),
        registration=registration,
        relations=relations,
        errors=joint,
        flattened=tuple(flattened),
        features=tuple(features),
    )


def verify_first(
    completion: Completion,
    scans: Sequence[RangeImage],
    options: CompletionOptions,
    *,
    n_threads: int | None = None,
    journal: Journal = NO_JOURNAL,
) -> Verification:
    """Complete the first of `scans` alone; let the others confirm or refute what was inferred.

    They are those of `completion`, that of all scans together, and stand where it moved them.
    """
    alone = complete_first(scans, options, n_threads=n_threads, journal=journal)
    others = completion.registration.seen_from_first(completion.observations)[1:]
    least = min(seen.pose_error_m for seen in others)
    evidence = replace(options.evidence, flatness_m=alone.flatness_m)
    return held_against(alone, others, evidence.tolerance(registration_m=least))


def complete_first(
    scans: Sequence[RangeImage],
    options: CompletionOptions,
    *,
    n_threads: int | None = None,
    journal: Journal = NO_JOURNAL,
) -> Completion:
    """Complete the first scan alone, without what a person says, and without texture."""
    plain = replace(options, texture=False, edits=(), stated_relations=(), flattening=None)
    return complete(scans[:1], plain, n_threads=n_threads, journal=journal)


def _audited(patch: Patch, scans: Scans, bundles: Sequence[Bundles]) -> tuple[ChartMesh, AuditResult]:
    """The inferred cells of a surface as a mesh, and what the beams say of it."""
    mesh = mesh_cells(patch.grid, patch.hypothesised, patch.limits.cuts, patch.trims, merged=False)
    sd, seen = patch.source.fit.standard_deviation(mesh.vertices), scans.observations
    return mesh, audit(mesh.vertices, mesh.faces, sd, seen, bundles, tolerance=scans.tolerance)


def _together(found: Sequence[tuple[ChartMesh, AuditResult]], overlap: float) -> AuditResult:
    """What the beams say of all surfaces, faces numbered on from one to the next, and where they overlap."""
    first = np.cumsum([0, *(len(mesh.faces) for mesh, _ in found)])
    faces = [result.faces + start for (_, result), start in zip(found, first, strict=False)]
    area = float(sum(result.violation_m2 for _, result in found))
    return AuditResult(area, np.concatenate([np.zeros(0, np.int64), *faces]), overlap)
