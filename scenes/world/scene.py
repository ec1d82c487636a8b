# SPDX-License-Identifier: MIT
"""Scene: a labelled mesh with its true surfaces, the world that the simulated scanner looks at."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, Literal

import numpy as np

from scenes.card import Card
from scenes.checks import InputError, Value
from scenes.mesh.design import Design, Element, ElementMesh
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.mesh.orientation import Axis, decide_mode
from scenes.pose import Pose
from scenes.rays.raycast import RayCaster
from scenes.surfaces.catalogue import Surface
from scenes.surfaces.surface import Opening

if TYPE_CHECKING:
    from trimesh import Trimesh

Mode = Literal["room", "object"]
_NAMES_TOLD = 5


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Scene(Value):
    """What there is to scan.

    Parameters
    ----------
    mesh : LabelledMesh
        Geometry in world coordinates, metres, z up; `face_surface` indexes `surfaces`.
    surfaces : tuple of Surface or None
        The true surface of each id, None where it is only known as a mesh.
    surface_names : tuple of str
        A name for each surface id.
    name : str
        What to call the scene in reports.
    mode : "room" or "object"
        Whether it is scanned from within or from around.
    warnings : tuple of str
        What a reader noticed and mended.
    openings : tuple of Opening
        Windows and door openings, where they are known.
    file_up : "x", "y" or "z"
        Axis of the file that became z.
    design : Design, optional
        What a file tells of its elements, one for each surface.

    Raises
    ------
    InputError
        As many names as surfaces are needed, and no face and no opening may name another surface.
    """

    mesh: LabelledMesh
    surfaces: tuple[Surface | None, ...]
    surface_names: tuple[str, ...]
    name: str
    mode: Mode = "room"
    warnings: tuple[str, ...] = ()
    openings: tuple[Opening, ...] = ()
    file_up: Axis = "z"
    design: Design | None = None
    _trees: list[RayCaster] = field(default_factory=list, init=False, repr=False)

    def __post_init__(self) -> None:
        if len(self.surfaces) != len(self.surface_names):
            raise InputError(f"{len(self.surfaces)} surfaces but {len(self.surface_names)} names")
        if self.design is not None and len(self.design.elements) != len(self.surfaces):
            raise InputError(f"{len(self.surfaces)} surfaces but {len(self.design.elements)} elements")
        labels = self.mesh.face_surface
        unknown = labels[(labels < 0) | (labels >= len(self.surfaces))]
        if len(unknown):
            raise InputError(
                f"faces name surface {int(unknown[0])}, but there are {len(self.surfaces)} surfaces"
            )
        for opening in self.openings:
            if not 0 <= opening.surface < len(self.surfaces):
                raise InputError(
                    f"an opening names surface {opening.surface}, but there are {len(self.surfaces)} surfaces"
                )

    @classmethod
    def from_mesh(cls, mesh: object, *, name: str = "mesh", mode: Mode | None = None) -> Scene:
        """Return the scene of a mesh that is in memory.

        Parameters
        ----------
        mesh : LabelledMesh, (vertices, faces), or a mesh of trimesh, Open3D or pyvista
            World coordinates, metres, z up. Without labels all of it is one surface, of the scene's name.
        name : str
            What to call it.
        mode : "room" or "object", optional
            How to scan it; decided from the geometry when not given.

        Raises
        ------
        InputError
            Something else, vertices that are not finite, faces of other vertices.
        """
        labelled = LabelledMesh.of(mesh)
        n_surfaces = int(labelled.face_surface.max(initial=0)) + 1
        names = (name,) if n_surfaces == 1 else tuple(f"{name} {k}" for k in range(n_surfaces))
        kind = decide_mode(labelled) if mode is None else mode
        return cls(labelled, (None,) * n_surfaces, names, name, kind)

    def __repr__(self) -> str:
        return (
            f"Scene({self.name!r}, {self.mode}, {len(self.mesh.faces)} faces, {len(self.surfaces)} surfaces)"
        )

    def to_trimesh(self) -> Trimesh:
        """Return its mesh as a `trimesh.Trimesh`."""
        return self.mesh.to_trimesh()

    def ray_caster(self, n_threads: int | None = None) -> RayCaster:
        """Return the mesh prepared for ray casting: the tree is built once and kept as long as the scene."""
        if not self._trees:
            self._trees.append(RayCaster(self.mesh.vertices, self.mesh.faces))
        return self._trees[0].on_threads(n_threads)

    @property
    def element_mesh(self) -> ElementMesh:
        """The scene as a design: an element for each surface, by its name where the file tells no more."""
        known = None if self.design is None else self.design.elements
        return ElementMesh(self.mesh, known or tuple(map(Element, self.surface_names)), self.name)

    def without(self, patterns: Sequence[str]) -> Scene:
        """Return the scene without the surfaces whose names match any of `patterns`, as shells match files.

        Raises
        ------
        InputError
            A pattern that matches no name, or nothing left.
        """
        if not patterns:
            return self
        left_out = np.zeros(len(self.surface_names), np.bool_)
        for pattern in patterns:
            matches = np.array([fnmatchcase(name, pattern) for name in self.surface_names])
            if not matches.any():
                text = ", ".join(sorted(self.surface_names)[:_NAMES_TOLD])
                raise InputError(
                    f"no surface of {self.name} has a name like {pattern!r}; names are {text}, ..."
                )
            left_out |= matches
        kept = ~left_out[self.mesh.face_surface]
        if not kept.any():
            raise InputError(f"without {', '.join(patterns)} nothing is left of {self.name}")
        sentence = f"{int(left_out.sum())} of {len(left_out)} surfaces left out by name"
        openings = tuple(opening for opening in self.openings if not left_out[opening.surface])
        return replace(
            self, mesh=self.mesh.some(kept), openings=openings, warnings=(*self.warnings, sentence)
        )

    def __reduce__(self) -> tuple[type[Scene], tuple[object, ...]]:
        return Scene, tuple(
            getattr(self, field_of_scene.name) for field_of_scene in fields(self) if field_of_scene.init
        )

    def transform(self, pose: Pose) -> Scene:
        """Return the scene moved by `pose`."""
        surfaces = tuple(None if surface is None else surface.transform(pose) for surface in self.surfaces)
        openings = tuple(opening.transform(pose) for opening in self.openings)
        return replace(self, mesh=self.mesh.transform(pose), surfaces=surfaces, openings=openings)

    transformed = transform  # earlier name

    def _repr_html_(self) -> str:
        """What a notebook shows: size, surfaces and warnings."""
        kinds = Counter(
            "mesh only" if surface is None else type(surface).__name__.lower() for surface in self.surfaces
        )
        vertices, area = self.mesh.vertices, float(self.mesh.face_areas().sum())
        size = (
            " x ".join(f"{side:.2f}" for side in np.ptp(vertices, axis=0)) if len(vertices) else "0 x 0 x 0"
        )
        figures = [
            ("extent x, y, z", f"{size} m"),
            ("surface", f"{area:.2f} m\u00b2 in {len(self.mesh.faces)} faces"),
            ("surfaces", ", ".join(f"{n} {kind}" for kind, n in sorted(kinds.items())) or "none"),
            ("scanned from", "within (room)" if self.mode == "room" else "around (object)"),
        ]
        figures += [("openings", str(len(self.openings)))] if self.openings else []
        return Card("Scene", self.name, figures, note=" ".join(self.warnings)).to_html()
