# SPDX-License-Identifier: MIT
"""Options of `complete`, those of its stages included."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from completion.boundary.continuation import ALL_CUES, Cue
from completion.edits.edit import Anchor, Edit
from completion.extension.claims import KINDS
from completion.extension.extent import ExtensionRules, Mode
from completion.features.engine.options import FITTED, FeatureOptions
from completion.flattening.flat import FlatteningOptions
from completion.merging.scan_surfaces import SurfaceOptions
from completion.observe.tolerance import REGISTRATION_M, EvidenceOptions
from completion.relations.options import BUILT, RelationOptions
from completion.relations.relation import StatedRelation
from completion.segmentation.regions import SegmentationOptions
from completion.texturing.pipeline import TexturingOptions
from scenes.checks import InputError, check_number, check_options


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
    projector_m : float, optional
        Where the projector, or second camera, of triangulating cameras stands on their x axis, metres, to the
        right when positive, 0 for none; when None it is read off each scan. What is hidden from it may be
        inferred.
    registration_m : float
        Error of the poses of several scans, metres, where these do not show it: scans that measured the same
        surfaces do. Of such scans it is what they show, and at least this, but no more than 5 mm.
    pose_deviations_m : tuple of float
        How well the pose of each scan is known, metres, where registration told
        (`Registered.pose_deviation`): twice this counts where scans hide the error of poses, instead of the
        one number above.
    moves_scans : bool
        Whether scans whose poses contradict what they measured are moved, by as much as brings them together.
    texture : bool
        Whether hypothesised area is textured.
    min_area_m2 : float
        Surfaces of which less was measured, square metres, are not continued and have no number: they stay in
        the model as they were measured.
    only : tuple of str
        The kinds of surface that are continued and numbered, of `extension.choice.KINDS`; all, when empty.
        The others bound them, and hide them, all the same.
    max_sd_m : float
        A surface is continued only as far as its predicted standard deviation stays below this, metres.
    cues : tuple of Cue
        What is made use of; all that is known.
    edits : tuple of Edit
        What a person says of the surfaces.
    relations : RelationOptions, optional
        How exactly things are built, and which relations of surfaces are inferred; when None, none are.
    features : FeatureOptions, optional
        Which openings are fitted whole, and what is known of them; when None, none are.
    stated_relations : tuple of StatedRelation
        What a person says that surfaces are, or are not, to each other.
    flattening : FlatteningOptions, optional
        Whether ripple is taken from measured planes in the meshes that are written, their relief left; when
        None, they are as measured. What is inferred, and evidence, never depend on it.
    segmentation, evidence, texturing : options
        Of the stages.

    Raises
    ------
    InputError
        An unknown mode, cue or kind, or a length that is negative or not finite.
    """

    mode: Mode = "standard"
    sigma_m: float | None = None
    projector_m: float | None = None
    registration_m: float = REGISTRATION_M
    pose_deviations_m: tuple[float, ...] = ()
    moves_scans: bool = True
    texture: bool = True
    min_area_m2: float = 0.0
    only: tuple[str, ...] = ()
    max_sd_m: float = 0.02
    cues: tuple[Cue, ...] = ALL_CUES
    edits: tuple[Edit, ...] = ()
    relations: RelationOptions | None = BUILT
    features: FeatureOptions | None = FITTED
    stated_relations: tuple[StatedRelation[Anchor], ...] = ()
    flattening: FlatteningOptions | None = None
    segmentation: SegmentationOptions = field(default_factory=SegmentationOptions)
    evidence: EvidenceOptions = field(default_factory=EvidenceOptions)
    texturing: TexturingOptions = field(default_factory=TexturingOptions)

    def __post_init__(self) -> None:
        if self.mode not in ("conservative", "standard", "bold"):
            raise InputError(f"mode must be conservative, standard or bold, got {self.mode!r}")
        for cue in self.cues:
            if cue not in ALL_CUES:
                raise InputError(f"cues must be some of {', '.join(ALL_CUES)}, got {cue!r}")
        for kind in self.only:
            if kind not in KINDS:
                raise InputError(f"only must be some of {', '.join(KINDS)}, got {kind!r}")
        if self.stated_relations and self.relations is None:
            raise InputError("stated relations are imposed where relations are on; give relations=BUILT")
        for number, deviation in enumerate(self.pose_deviations_m):
            check_number(f"pose_deviations_m[{number}]", deviation)
        lengths = ("sigma_m", "registration_m", "max_sd_m", "min_area_m2")
        check_options(self, **dict.fromkeys(lengths, (0.0, np.inf)), projector_m=(-1.0, 1.0))
        _ = self.of_surfaces  # its checks

    def rules(self) -> ExtensionRules:
        """Return what a continuation may use, and how sure it must be."""
        return ExtensionRules(
            mode=self.mode,
            max_sd_m=self.max_sd_m,
            max_cells=self.evidence.max_cells,
            cues=self.cues,
            cell_m=self.evidence.cell_m,
        )

    @property
    def of_surfaces(self) -> SurfaceOptions:
        """Those of `find_surfaces`."""
        return SurfaceOptions(
            sigma_m=self.sigma_m,
            projector_m=self.projector_m,
            registration_m=self.registration_m,
            pose_deviations_m=self.pose_deviations_m,
            moves_scans=self.moves_scans,
            across=Cue.MERGING in self.cues,
            segmentation=self.segmentation,
            evidence=self.evidence,
        )

    def in_force(self, n_scans: int) -> CompletionOptions:
        """Return the options with the tolerances that hold for so many scans, the edits apart."""
        held = self.of_surfaces.tolerance(n_scans)
        evidence = replace(self.evidence, flatness_m=held.flatness_m, registration_m=held.registration_m)
        return replace(self, edits=(), stated_relations=(), evidence=evidence)
