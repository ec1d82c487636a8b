# SPDX-License-Identifier: MIT
"""The method on one page: from scans to surfaces that go on behind what stood in front."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from completion.boundary.boundary_pixels import find_rim
from completion.boundary.cues import ALL_CUES, Cue
from completion.edits.application import apply_edits
from completion.edits.edit import Edit
from completion.extension.adjacency import survey
from completion.extension.extent import Mode, limit, with_ends
from completion.extension.patch import Patch, extend
from completion.merging.pipeline import MergedSurface, merge
from completion.observe.observation import Observation, observe
from completion.observe.tolerance import EvidenceOptions
from completion.result.audit import audit
from completion.result.completed_model import CompletedModel, hypothesised_mesh
from completion.result.export import export_completion, save_completion
from completion.result.verification import Verification
from completion.segmentation.pipeline import segment
from completion.segmentation.regions import SegmentationOptions
from completion.texturing.chart_texture import ChartTexture
from completion.texturing.pipeline import texture_patch
from completion.texturing.problem import TexturingOptions
from scenes.checks import InputError, check_options
from scenes.run.journal import NO_JOURNAL, Journal
from scenes.run.memory import require, threads
from scenes.scan.range_image import RangeImage

Progress = Callable[[str, int, int], None]
_BYTES_KEPT = 350  # of every pixel, to the end: points, normals, regions, surfaces, textures
_BYTES_A_PIXEL = 400  # of the largest scan, for a thread: texturing a surface that fills it
_In = TypeVar("_In")
_Out = TypeVar("_Out")


@dataclass(frozen=True, kw_only=True, slots=True)
class CompletionOptions:
    """Options of `complete`.

    Attributes
    ----------
    mode : "conservative", "standard" or "bold"
        How probable inferred area must be (`LEAST_CONFIDENCE`); conservative area also lies in the hull of
        what was measured.
    sigma_m : float, optional
        Range noise in metres; when None it is read off each scan.
    registration_m : float
        Error of the poses when there are several scans, metres.
    texture : bool
        Whether hypothesised area is textured.
    max_sd_m : float
        A surface is continued only as far as its predicted standard deviation stays below this, metres.
    cues : tuple of Cue
        What is made use of; all that is known.
    edits : tuple of Edit
        What a person says of the surfaces.
    segmentation, evidence, texturing : options
        Of the stages.
    """

    mode: Mode = "standard"
    sigma_m: float | None = None
    registration_m: float = 0.005
    texture: bool = True
    max_sd_m: float = 0.02
    cues: tuple[Cue, ...] = ALL_CUES
    edits: tuple[Edit, ...] = ()
    segmentation: SegmentationOptions = field(default_factory=SegmentationOptions)
    evidence: EvidenceOptions = field(default_factory=EvidenceOptions)
    texturing: TexturingOptions = field(default_factory=TexturingOptions)

    def __post_init__(self) -> None:
        if self.mode not in ("conservative", "standard", "bold"):
            raise InputError(f"mode must be conservative, standard or bold, got {self.mode!r}")
        lengths = ("sigma_m", "registration_m", "max_sd_m")
        check_options(self, **dict.fromkeys(lengths, (0.0, np.inf)))


class Completion(CompletedModel):
    """What `complete` found: the completed model, and the way to save it.

    Attributes
    ----------
    observations : tuple of Observation
        The scans as they were used; their frame is the first scan's sensor frame, the working frame.
    patches : tuple of Patch
        The completed surfaces, working frame; number i + 1 in files.
    textures : tuple of ChartTexture or None
        Colour of each patch; empty when texture was not asked for.
    hypothesised : LabelledPoints
        All inferred area as one mesh, working frame, with provenance, confidence and predicted standard
        deviation (metres) at every vertex.
    audit : AuditResult
        How much of it stands where a beam went through.
    owners : tuple of (rows, columns) int32
        For each scan, the number of the surface that each pixel belongs to; 0 for none.
    mode : str
        Mode it was made in.
    edits : tuple of Edit
        What a person said of the surfaces, world coordinates.
    world_from_reference : Pose
        From the working frame to the world.
    """

    __slots__ = ()

    def save(self, folder: str | PathLike[str], verification: Verification | None = None) -> None:
        """Write completed.glb, observed.ply, hypothesised.ply, polygons.json and completion.json.

        All is in world coordinates.

        With `verification`, completion.json also says what later scans say of what the first one inferred.

        Raises
        ------
        InputError
            The folder cannot be made or written.
        """
        save_completion(self, folder, verification)

    def export(self, path: str | PathLike[str]) -> list[Path]:
        """Write the whole model to one file: .glb, .obj, .e57 or .json; see `export_completion`.

        Raises
        ------
        InputError
            Another suffix, a folder that does not exist, or pye57 is not installed.
        """
        return export_completion(self, path)

    def _repr_html_(self) -> str:
        """What a notebook shows: measured and inferred area, the largest surfaces, a small picture."""
        from completion.result.cards import card_of_completion  # only notebooks need it

        return card_of_completion(self).to_html()


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

    The scans are cut into regions on planes and cylinders; regions that one surface explains are joined
    across what stood before them; each surface is continued where it was hidden, never where a beam went
    through, until it meets another surface or its own edges, which are continued behind the occluder; and
    its texture is continued with it. A person may have a say in which surfaces there are and how far they go.

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
    scans = [scans] if isinstance(scans, RangeImage) else list(scans)
    if not scans:
        raise InputError("nothing to complete: give at least one scan")
    seed = int(np.random.default_rng(rng).integers(2**63))
    tell = progress or (lambda _stage, _done, _total: None)
    world_from_reference = scans[0].world_from_sensor
    evidence = replace(options.evidence, registration_m=options.registration_m if len(scans) > 1 else 0.0)

    largest, together = (f(scan.ranges.size for scan in scans) for f in (max, sum))
    require(
        _BYTES_KEPT * together,
        f"completing {len(scans)} scans of {together:,} pixels",
        "complete fewer of them at once, smaller ones, or give more memory",
    )
    with threads(_BYTES_A_PIXEL * largest, n_threads) as pool:
        observations = _each(
            pool,
            tell,
            "noise and normals",
            lambda scan: observe(scan, world_from_reference.inverse(), options.sigma_m),
            scans,
        )
        regions = _each(
            pool,
            tell,
            stage="segment",
            work=lambda seen: segment(seen, options.segmentation),
            items=observations,
            journal=journal,
        )
        scales = [np.hypot(seen.sigma, options.segmentation.flatness_m) for seen in observations]
        across = Cue.MERGING in options.cues
        found = journal.step("merge", lambda: merge(observations, regions, evidence, across=across))
        edited = apply_edits(found, options.edits, observations, world_from_reference, evidence.flatness_m)
        surfaces = [one.surface for one in edited]
        owners = number_pixels(surfaces, observations)

        rims = [find_rim(surface.fit, surface.masks, observations, evidence) for surface in surfaces]
        surroundings = survey(surfaces, rims, owners, observations, scales)

        def continued(index: int) -> Patch:
            limits = limit(
                index,
                surfaces,
                rims=rims,
                surroundings=surroundings,
                observations=observations,
                cues=options.cues,
            )
            verdict = edited[index].verdict
            return extend(
                surfaces[index],
                rims[index],
                limits=with_ends(limits, verdict.ends),
                observations=observations,
                owners=owners,
                owner=index + 1,
                options=evidence,
                mode=options.mode,
                max_sd_m=options.max_sd_m,
                verdict=verdict,
                cues=options.cues,
            )

        patches = _each(
            pool, tell, stage="extend", work=continued, items=range(len(surfaces)), journal=journal
        )

        def textured(index: int) -> ChartTexture | None:
            return texture_patch(patches[index], observations, options.texturing, seed + index)

        textures: list[ChartTexture | None] = []
        if options.texture:
            textures = _each(
                pool, tell, stage="texture", work=textured, items=range(len(patches)), journal=journal
            )
    mesh = hypothesised_mesh(patches, textures)
    tell("audit", 0, 1)
    result = audit(
        mesh.vertices,
        mesh.faces,
        mesh.sd,
        [seen.scan for seen in observations],
        [seen.sigma for seen in observations],
        n_sigma=evidence.n_sigma,
        flatness_m=evidence.flatness_m,
        registration_m=evidence.registration_m,
        max_tolerance_m=evidence.max_tolerance_m,
        n_threads=n_threads,
    )
    tell("audit", 1, 1)
    return Completion(
        observations=tuple(observations),
        patches=tuple(patches),
        textures=tuple(textures),
        hypothesised=mesh,
        audit=result,
        owners=tuple(owners),
        mode=options.mode,
        edits=options.edits,
        world_from_reference=world_from_reference,
    )


def number_pixels(
    surfaces: Sequence[MergedSurface], observations: Sequence[Observation]
) -> list[NDArray[np.int32]]:
    """For each scan the number of the surface that each pixel belongs to, from 1; 0 for none."""
    owners = [np.zeros(seen.valid.shape, np.int32) for seen in observations]
    for number, surface in enumerate(surfaces, start=1):
        for owner, mask in zip(owners, surface.masks, strict=True):
            owner[mask] = number
    return owners


def _each(
    pool: ThreadPoolExecutor,
    tell: Progress,
    stage: str,
    work: Callable[[_In], _Out],
    items: Iterable[_In],
    journal: Journal = NO_JOURNAL,
) -> list[_Out]:
    """Apply `work` to every item on the pool, in order; tell the progress, and the journal what comes."""

    def step(number: int, item: _In) -> _Out:
        return journal.step(f"{stage}-{number:04d}", lambda: work(item))

    jobs = [pool.submit(step, number, item) for number, item in enumerate(items, start=1)]
    tell(stage, 0, len(jobs))
    results = []
    for done, job in enumerate(jobs, start=1):
        results.append(job.result())
        tell(stage, done, len(jobs))
    return results
