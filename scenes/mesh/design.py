# SPDX-License-Identifier: MIT
"""Design: what the file of a building tells of its elements, its unit, and the map that it lies in."""

from __future__ import annotations

from dataclasses import dataclass
from fnmatch import fnmatchcase

import numpy as np

from scenes.checks import FloatArray, InputError, Value
from scenes.mesh.labelled_mesh import LabelledMesh


@dataclass(frozen=True, slots=True)
class Element(Value):
    """What a file tells of one element of a design; "" for what it does not tell.

    Attributes
    ----------
    name : str
        As in the file; several may have the same.
    ifc_class : str
        "IfcWall".
    global_id : str
        Its GlobalId, 22 characters.
    storey : str
        Name of the storey that it is in.
    type_name : str
        Name of its type.
    """

    name: str
    ifc_class: str = ""
    global_id: str = ""
    storey: str = ""
    type_name: str = ""

    def is_like(self, pattern: str) -> bool:
        """Tell whether a pattern, as shells match files, fits its class, its name or its GlobalId."""
        return any(fnmatchcase(text, pattern) for text in (self.ifc_class, self.name, self.global_id))


@dataclass(frozen=True, slots=True)
class MapConversion(Value):
    """What leads from the frame of a design to a map (IfcMapConversion, ISO 16739-1).

    Attributes
    ----------
    system : str
        Name of the map's coordinate reference system, "EPSG:25832".
    shift_m : tuple of 3 float
        Easting, northing and height of the design's origin, metres.
    turn_deg : float
        From the map's east to the design's x axis, anticlockwise.
    scale : tuple of 3 float
        Of the design's metres to those of the map, along its own x, y and z.

    Raises
    ------
    InputError
        Numbers that are not finite, a scale that is not positive.
    """

    system: str
    shift_m: tuple[float, float, float]
    turn_deg: float
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)

    def __post_init__(self) -> None:
        numbers = [*self.shift_m, self.turn_deg, *self.scale]
        if not np.isfinite(numbers).all() or min(self.scale) <= 0:
            raise InputError(f"its map conversion has numbers that cannot be used: {numbers}")

    def apply(self, points: FloatArray) -> FloatArray:
        """Return points (n, 3) of the design, metres, in the map's frame."""
        moved: FloatArray = points * np.array(self.scale) @ self._turn().T + np.array(self.shift_m)
        return moved

    def undo(self, points: FloatArray) -> FloatArray:
        """Return points (n, 3) of the map in the design's own frame, metres."""
        own: FloatArray = (points - np.array(self.shift_m)) @ self._turn() / np.array(self.scale)
        return own

    def _turn(self) -> FloatArray:
        cosine, sine = np.cos(np.radians(self.turn_deg)), np.sin(np.radians(self.turn_deg))
        return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])

    def sentence(self) -> str:
        """Say where coordinates are, and how they came there."""
        shift = ", ".join(f"{value:.3f}".rstrip("0").rstrip(".") for value in self.shift_m)
        scaled = (
            "" if set(self.scale) == {1.0} else f", scaled by {' x '.join(f'{k:.9g}' for k in self.scale)}"
        )
        return (
            f"coordinates are those of the map {self.system or '(no name)'}, by the file's map conversion: "
            f"moved by ({shift}) m and turned by {self.turn_deg:.6g} deg{scaled}"
        )


@dataclass(frozen=True, slots=True)
class Design(Value):
    """What a file tells beside its geometry.

    Attributes
    ----------
    elements : tuple of Element
        One for each surface of the scene, in their order.
    schema : str
        "IFC4", "" for meshes.
    unit : str
        Of lengths, as the file names it; "" where it names none.
    conversion : MapConversion, optional
        Which was applied.
    """

    elements: tuple[Element, ...]
    schema: str = ""
    unit: str = ""
    conversion: MapConversion | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ElementMesh(Value):
    """A mesh whose surfaces are elements of a design.

    Attributes
    ----------
    mesh : LabelledMesh
        World coordinates of the design, metres, outside of closed bodies outside; `face_surface` indexes
        `elements`.
    elements : tuple of Element
        One for each surface.
    name : str
        What to call the design in reports.

    Raises
    ------
    InputError
        Faces of an element that is not there.
    """

    mesh: LabelledMesh
    elements: tuple[Element, ...]
    name: str = "design"

    def __post_init__(self) -> None:
        last = int(self.mesh.face_surface.max(initial=-1))
        if last >= len(self.elements):
            raise InputError(f"faces name element {last}, but {self.name} has {len(self.elements)} elements")
