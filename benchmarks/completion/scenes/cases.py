# SPDX-License-Identifier: MIT
"""Cases: a scene with its simulated scans, its truth as arrays, and a completion as a hypothesis."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from benchmarks.completion.truth.cells import TrueCells, look
from benchmarks.completion.truth.hypothesis import Hypothesis, continued_surfaces
from benchmarks.completion.truth.truth import TrueChart, TrueModel, true_charts
from completion.extension.patch import Provenance
from completion.result.completed_model import CompletedModel
from completion.result.record import completion_record
from nbv.scanning.effects.effects import Effects
from nbv.scanning.scanner import scan_scene
from nbv.scanning.view import View
from scenes.checks import FloatArray
from scenes.run.atomic import json_text
from scenes.scan.range_image import RangeImage
from scenes.surfaces.surface import Opening
from scenes.world.scene import Scene

UNSCORED = ("outside",)  # what is seen through openings


@dataclass(frozen=True)
class Case:
    """A scene and the views it is scanned from.

    Attributes
    ----------
    name : str
        What to call it.
    scene : Scene
        The truth.
    views : tuple of View
        Where it is scanned from; all scans are completed together.
    breaks : (k, 2, 3) float
        Boxes in which the scene breaks the prior that hidden surface goes on.
    scored : tuple of str, optional
        Names of the surfaces that are scored; all but what is seen through openings when not given.
    """

    name: str
    scene: Scene
    views: tuple[View, ...]
    breaks: FloatArray = field(default_factory=lambda: np.zeros((0, 2, 3)))
    scored: tuple[str, ...] | None = None

    @property
    def breaks_prior(self) -> bool:
        """Whether it is one of the scenes of S7."""
        return len(self.breaks) > 0

    @cached_property
    def model(self) -> TrueModel:
        """The truth as arrays."""
        scene = self.scene
        scored = tuple(
            name not in UNSCORED if self.scored is None else name in self.scored
            for name in scene.surface_names
        )
        return TrueModel(scene.mesh, scene.surfaces, scored, scene.openings, self.breaks)

    @cached_property
    def charts(self) -> tuple[TrueChart, ...]:
        """The charts of the true surfaces."""
        return true_charts(self.model)

    @cached_property
    def fingerprint(self) -> str:
        """Digest of the geometry, the views and what is scored."""
        mesh = self.scene.mesh
        digest = hashlib.sha256(json_text([self.name, self.scene.surface_names, self.scored]).encode())
        for array in (mesh.vertices, mesh.faces, mesh.face_surface, self.breaks):
            digest.update(np.ascontiguousarray(array).tobytes())
        for view in self.views:
            digest.update(view.world_from_sensor.matrix.tobytes() + json_text(view.sensor.to_json()).encode())
        return digest.hexdigest()

    def scans(self, effects: Effects, rng: int) -> tuple[RangeImage, ...]:
        """Scan from all views; `rng` is the seed of the first scan's noise."""
        caster = self.scene.ray_caster()
        return tuple(
            scan_scene(self.scene, view, effects=effects, rng=rng + index, caster=caster, name=self.name)
            for index, view in enumerate(self.views)
        )

    def cells(self, scans: Sequence[RangeImage]) -> tuple[TrueCells, ...]:
        """Return what the scans see and miss of the truth."""
        return look(self.model, self.charts, scans)


def hypothesis_of(completed: CompletedModel, scans: Sequence[RangeImage]) -> Hypothesis:
    """Return what a completion inferred from `scans`, in world coordinates."""
    mesh = completed.hypothesised
    first = mesh.faces[:, 0]
    provenance = mesh.provenance[mesh.faces].max(axis=1, initial=0)
    openings = tuple(
        Opening(number, np.asarray(opening["points"], dtype=np.float64))
        for number, surface in enumerate(completion_record(completed)["surfaces"])
        for opening in surface["openings"]
    )
    return Hypothesis(
        vertices=completed.world_from_reference.apply(mesh.vertices),
        faces=mesh.faces,
        surface=mesh.surface[first] - 1,
        sd=mesh.sd[mesh.faces].max(axis=1, initial=0.0),
        confidence=mesh.confidence[mesh.faces].mean(axis=1),
        true_surface=continued_surfaces(completed.owners, scans, len(completed.patches)),
        openings=openings,
        reason=provenance,
        reasons=tuple(member.name.lower().replace("_", "-") for member in Provenance),
    )
