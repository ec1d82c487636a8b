# SPDX-License-Identifier: MIT
"""A part: its points divided among surfaces, and what these are to each other."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from completion.fitting.result import SurfaceFit
from completion.relations.graph import RelationGraph
from completion.relations.relation import RelationStatus
from scenes.checks import FloatArray, InputError, IntArray, Value, frozen_copy
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.run.atomic import write_bytes

if TYPE_CHECKING:
    from trimesh import Trimesh


@dataclass(frozen=True, slots=True, eq=False)
class Part(Value):
    """A part, divided into surfaces.

    Attributes
    ----------
    points : (n, 3) float
        As they were given, metres; of a mesh its vertices.
    surface : (n,) int
        Label of the surface of each point; 0 for none.
    labels : tuple of int
        Label of each of the k surfaces, ascending.
    measured : tuple of SurfaceFit
        The surfaces (k) as their own points say, with covariances that allow for neighbours that err alike.
    fits : tuple of SurfaceFit
        The surfaces (k) where their relations hold, with their covariances given these.
    groups : tuple of int
        One a surface: those with equal numbers lie on one and the same, as far as the points tell.
    noise_m, spacing_m : float
        Estimated deviation of the points along the normal, and their sampling distance; metres.
    relations : RelationGraph, optional
        What the surfaces of `related` are to each other; None where nobody asked.
    related : tuple of int
        Places, from 0, of the surfaces that relations were inferred of: those that are known well enough.
    faces : (m, 3) int, optional
        Corners of the triangles of a mesh.
    triangle_surface : (m,) int, optional
        Label of the surface of each triangle.
    is_model : bool
        Whether the mesh is a tessellated model, whose edges are those of its faces.
    warnings : tuple of str
        What is doubtful, a sentence each.
    """

    points: FloatArray
    surface: IntArray
    labels: tuple[int, ...]
    measured: tuple[SurfaceFit, ...]
    fits: tuple[SurfaceFit, ...]
    groups: tuple[int, ...]
    noise_m: float
    spacing_m: float
    relations: RelationGraph | None = None
    related: tuple[int, ...] = ()
    faces: IntArray | None = None
    triangle_surface: IntArray | None = None
    is_model: bool = False
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", frozen_copy(self.points, np.float64))
        for name in ("surface", "faces", "triangle_surface"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, frozen_copy(getattr(self, name), np.int32))

    def members(self, label: int) -> IntArray:
        """Places (m,) of the points of the surface with a label."""
        return np.flatnonzero(self.surface == label)

    def n_points(self, label: int) -> int:
        """How many points a surface has; of a mesh the distinct corners of its triangles."""
        if self.faces is None or self.triangle_surface is None:
            return int((self.surface == label).sum())
        corners = np.unique(self.faces[self.triangle_surface == label])
        return len(np.unique(self.points[corners], axis=0))

    def count_relations(self, status: RelationStatus) -> int:
        """How many relations came to a status."""
        return 0 if self.relations is None else self.relations.count_with(status)

    def export(self, path: str | PathLike[str]) -> list[Path]:
        """Write the part to one file by suffix, `.step` or `.stp`; return all files that were written.

        STEP (AP214, millimetres) has analytic faces trimmed where surfaces meet, a solid where they close;
        what is to be known of it, `completion.parts.step_export.step_model` says. Of a part with features
        (`completion.parts.part_features.features_of`) a second file, NAME.features.step, has these as a tree.

        Raises
        ------
        InputError
            Another suffix, a folder that does not exist, a part without surfaces, or without any that can be
            trimmed; or OCP is not installed (`pip install "unseen[step]"`).
        """
        target = Path(path)
        if target.suffix.lower() not in (".step", ".stp"):
            wrong = target.suffix or "a name without suffix"
            raise InputError(f"{target}: cannot export a part to {wrong}; known: .step, .stp")
        from completion.parts.step_export import (
            named_model,
        )  # its kernel is only loaded where it is asked for

        model, features = named_model(self, target.stem), target.with_suffix(f".features{target.suffix}")
        write_bytes(target, model.data)
        if model.feature_data is None:
            return [target]
        write_bytes(features, model.feature_data)
        return [target, features]

    def to_trimesh(self) -> Trimesh:
        """Return a part of a mesh as a `trimesh.Trimesh`, with `face_attributes["surface"]`.

        Raises
        ------
        InputError
            A part of points.
        """
        if self.faces is None or self.triangle_surface is None:
            raise InputError("a part of points has no mesh; its points and their surfaces are arrays")
        faces, labels = (held.astype(np.int32) for held in (self.faces, self.triangle_surface))
        return LabelledMesh(self.points, faces, labels).to_trimesh()

    def _facts(self) -> list[tuple[str, str]]:
        """The surfaces, how many points lie on them, and which relations hold."""
        share = float(np.mean(self.surface > 0)) if len(self.surface) else 0.0
        graph = self.relations
        holding = "not sought" if graph is None else str(sum(relation.holds for relation in graph.relations))
        return [
            ("surfaces", kinds_text(self.fits)),
            ("measured", f"{share:.1%} of {len(self.surface)} points lie on them"),
            ("relations", holding),
            ("noise", f"{1000 * self.noise_m:.3g} mm"),
            *(("doubtful", sentence) for sentence in self.warnings),
        ]


def kinds_text(fits: Sequence[SurfaceFit]) -> str:
    """How many surfaces of which kind, in words: "3 planes, 1 torus"."""
    kinds = Counter(fit.surface.kind for fit in fits)
    plural = {"torus": "tori"}
    named = [f"{n} {kind if n == 1 else plural.get(kind, kind + 's')}" for kind, n in sorted(kinds.items())]
    return ", ".join(named) or "no surface"
