# SPDX-License-Identifier: MIT
"""Options of `complete`, those of its stages included."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from completion.backs.options import BackOptions
from completion.boundary.continuation import ALL_CUES, Cue
from completion.edits.edit import Anchor, Edit
from completion.extension.extent import ExtensionRules
from completion.features.engine.options import FITTED, FeatureOptions
from completion.flattening.flat import FlatteningOptions
from completion.merging.scan_surfaces import SurfaceOptions
from completion.observe.tolerance import EvidenceOptions
from completion.observe.user_options import UserOptions
from completion.relations.options import BUILT, RelationOptions
from completion.relations.relation import StatedRelation
from completion.segmentation.regions import SegmentationOptions
from completion.texturing.pipeline import TexturingOptions
from scenes.checks import FloatArray, InputError, check_number
from scenes.inclination import Up


@dataclass(frozen=True, kw_only=True, slots=True)
class CompletionOptions(UserOptions):
    """Options of `complete`: those of `UserOptions`, which a person sets, and these.

    Attributes
    ----------
    pose_deviations_m : tuple of float
        Standard deviation of each scan's pose, metres, from registration (`Registered.pose_deviation`): one
        per scan, or none. Where scans hide the error of poses, twice this replaces `registration_m`.
    cues : tuple of Cue
        Cues of continuation that are used; all of them by default.
    edits : tuple of Edit
        Edits of the surfaces by a person.
    relations : RelationOptions, optional
        How exactly things are built, and which relations of surfaces are inferred; none when None.
    features : FeatureOptions, optional
        Which openings are fitted whole, and their known values; none when None.
    stated_relations : tuple of StatedRelation
        Relations of surfaces that a person states or forbids.
    flattening : FlatteningOptions, optional
        Removes ripple from measured planes in the meshes that are written and keeps their relief; no
        flattening when None. Inferred area and evidence never depend on it.
    backs : BackOptions, optional
        Closes the things that stand in the room behind what was seen of them; when None, they are left open.
    up : Up, optional
        Which way is up in the world of the poses (`Up.along`); when None, it is estimated (`find_up`).
    segmentation, evidence, texturing : options
        Of the stages.

    Raises
    ------
    InputError
        An unknown mode, cue or kind, a length outside its limits, or a negative pose deviation.
    """

    pose_deviations_m: tuple[float, ...] = ()
    cues: tuple[Cue, ...] = ALL_CUES
    edits: tuple[Edit, ...] = ()
    relations: RelationOptions | None = BUILT
    features: FeatureOptions | None = FITTED
    stated_relations: tuple[StatedRelation[Anchor], ...] = ()
    flattening: FlatteningOptions | None = None
    backs: BackOptions | None = None
    up: Up | None = None
    segmentation: SegmentationOptions = field(default_factory=SegmentationOptions)
    evidence: EvidenceOptions = field(default_factory=EvidenceOptions)
    texturing: TexturingOptions = field(default_factory=TexturingOptions)

    def __post_init__(self) -> None:
        UserOptions.__post_init__(self)
        for cue in self.cues:
            if cue not in ALL_CUES:
                raise InputError(f"cues must be some of {', '.join(ALL_CUES)}, got {cue!r}")
        if self.stated_relations and self.relations is None:
            raise InputError("stated relations are imposed where relations are on; give relations=BUILT")
        for number, deviation in enumerate(self.pose_deviations_m):
            check_number(f"pose_deviations_m[{number}]", deviation)
        _ = self.of_surfaces  # its checks

    def rules(self) -> ExtensionRules:
        """Return what a continuation may use, and how sure it must be."""
        return ExtensionRules(
            wishes=self,
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

    def in_force(self, flatness_m: float, left_m: FloatArray) -> CompletionOptions:
        """Return the options with the tolerances that a completion used, edits and stated relations apart.

        Parameters
        ----------
        flatness_m : float
            Deviation of real surfaces from their ideal form that it used (`Completion.flatness_m`), metres.
        left_m : (n,) float
            Pose errors that its scans show (`Completion.registration`), NaN where they do not, metres.
        """
        registration_m = float(self.of_surfaces.pose_errors(left_m).min())
        evidence = replace(self.evidence, flatness_m=flatness_m, registration_m=registration_m)
        return replace(self, edits=(), stated_relations=(), evidence=evidence)
