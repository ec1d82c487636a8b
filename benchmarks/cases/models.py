# SPDX-License-Identifier: MIT
"""CAD models of machined parts as meshes whose triangles know their face; every second seed turns them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import Rotation

from benchmarks.cases.model_shapes import HELD_OUT, KINDS, TUNING, kind_of, occ, sub_shapes
from completion.export.step.faces import is_valid, volume_of
from scenes.checks import FloatArray, InputError, IntArray

TOLERANCES = {"coarse": (0.5, 0.6), "middle": (0.1, 0.35), "fine": (0.01, 0.12)}
"""Largest distance of chords from their surface, millimetres, and turn between chords, radians."""
FORMATS = ("stl", "ascii.stl", "ply", "obj")
_SAME = 1e-6  # millimetres and radians, within which surfaces are one
_TRIES = 20


@dataclass(frozen=True, slots=True, eq=False)
class ModelMesh:
    """A model as triangles.

    Attributes
    ----------
    corners : (m, 3, 3) float
        Millimetres, single precision.
    face : (m,) int
        Face of each triangle, from 0; what touches and lies on one surface is one face.
    kinds : tuple of str
        Kind of each face.
    volume_mm3 : float
        Of the model, without chords.
    """

    corners: FloatArray
    face: IntArray
    kinds: tuple[str, ...]
    volume_mm3: float

    @property
    def areas(self) -> FloatArray:
        """Areas (m,) of the triangles, mm^2."""
        sides = self.corners[:, 1:] - self.corners[:, :1]
        return np.asarray(np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) / 2)

    def write(self, folder: Path, name: str, format_: str) -> Path:
        """Write a file in one of `FORMATS`: STL, STL as text with six digits, PLY, OBJ with six decimals."""
        path = folder / f"{name}.{format_}"
        if format_ == "ascii.stl":
            facet = "facet normal 0 0 0\nouter loop\n{}\n{}\n{}\nendloop\nendfacet"
            rows = [" ".join(["vertex", *(f"{x:.6g}" for x in row)]) for row in self.corners.reshape(-1, 3)]
            facets = [facet.format(*rows[k : k + 3]) for k in range(0, len(rows), 3)]
            path.write_text("\n".join(["solid part", *facets, "endsolid part", ""]))
            return path
        points, place = np.unique(self.corners.reshape(-1, 3), axis=0, return_inverse=True)
        mesh = trimesh.Trimesh(points, place.reshape(-1, 3), process=False, validate=False)
        options = {"digits": 6} if format_ == "obj" else {}
        mesh.export(path, **options)
        return path


def model_mesh(name: str, tolerance: str, seed: int = 0) -> ModelMesh:
    """Return a model with chords of a tolerance; the seed counts for held-out ones only.

    Raises InputError: OCP is not installed, or the kernel made no sound solid of 20 draws.
    """
    rng = np.random.default_rng([seed, [*TUNING, *HELD_OUT].index(name)])
    if name in TUNING:
        return _tessellated(TUNING[name](), TOLERANCES[tolerance], np.eye(3))
    for _ in range(_TRIES):
        try:
            shape = HELD_OUT[name](rng)
        except Exception as error:  # the kernel's exceptions have no class in common
            reason = str(error)
            continue
        if is_valid(shape) and volume_of(shape) > 0:
            turn = Rotation.random(random_state=seed).as_matrix() if seed % 2 else np.eye(3)
            return _tessellated(shape, TOLERANCES[tolerance], turn)
        reason = "not valid"
    raise InputError(f"no sound {name} of seed {seed}: {reason}")


def _tessellated(shape: Any, tolerance: tuple[float, float], turn: FloatArray) -> ModelMesh:
    """The triangles of a shape, those of faces that are one joined."""
    occ.BRepMesh_IncrementalMesh(shape, tolerance[0], False, tolerance[1], False)
    corners, face, faces = list[FloatArray](), list[int](), sub_shapes(shape, "FACE")
    for k, one in enumerate(faces):
        place = occ.TopLoc_Location()
        net = occ.BRep_Tool.Triangulation_s(one, place)
        points = np.array([
            net.Node(n).Transformed(place.Transformation()).Coord() for n in range(1, net.NbNodes() + 1)
        ])  # fmt: skip
        triangles = np.array([net.Triangle(n).Get() for n in range(1, net.NbTriangles() + 1)]) - 1
        is_turned = one.Orientation() == occ.TopAbs_Orientation.TopAbs_REVERSED
        corners.append(points[triangles[:, ::-1] if is_turned else triangles])
        face += [k] * len(triangles)
    surfaces = [occ.BRepAdaptor_Surface(one) for one in faces]
    number, first = _joined(faces, surfaces)
    kinds = tuple(KINDS[kind_of(surfaces[k])] for k in first)
    rounded = (np.concatenate(corners) @ turn.T).astype(np.float32).astype(np.float64)
    return ModelMesh(rounded, number[np.array(face)], kinds, volume_of(shape))


def _joined(faces: Sequence[Any], surfaces: Sequence[Any]) -> tuple[IntArray, IntArray]:
    """Number (k,) of each face, equal where they share an edge and a surface; and the first of each."""
    edges = [sub_shapes(one, "EDGE") for one in faces]
    same = [
        (i, j)
        for i in range(len(faces))
        for j in range(i)
        if _is_one(surfaces[i], surfaces[j]) and any(a.IsSame(b) for a in edges[i] for b in edges[j])
    ]
    rows = np.array(same or np.zeros((0, 2)), dtype=np.int64).T
    graph = coo_array((np.ones(len(same)), (rows[0], rows[1])), shape=(len(faces), len(faces)))
    number = connected_components(graph, directed=False)[1].astype(np.int64)
    return number, np.unique(number, return_index=True)[1]


def _is_one(one: Any, two: Any) -> bool:
    """Whether two faces lie on one surface: sizes equal, axes on one line, places where they should be."""
    if kind_of(one) != kind_of(two):
        return False
    (place, axis, sizes), (other, turned, others) = _placed(one), _placed(two)
    gap = other - place
    if KINDS[kind_of(one)] == "plane":
        gap = gap @ axis * axis
    elif KINDS[kind_of(one)] == "cylinder":
        gap = gap - gap @ axis * axis
    skew = 0.0 if KINDS[kind_of(one)] == "sphere" else float(np.linalg.norm(np.cross(axis, turned)))
    return max(float(np.abs(gap).max()), skew, float(np.abs(sizes - others).max(initial=0.0))) < _SAME


def _placed(surface: Any) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Place (3,), axis (3,) and sizes of a face's surface; of a cone its apex."""
    name = KINDS[kind_of(surface)]
    own = getattr(surface, name.capitalize())()
    axis = own.Axis() if name != "sphere" else None
    place = np.array((own.Apex() if name == "cone" else own.Location()).Coord())
    way = np.array(axis.Direction().Coord() if axis is not None else (0.0, 0.0, 1.0))
    sizes = {
        "cylinder": ("Radius",), "sphere": ("Radius",), "cone": ("SemiAngle",),
        "torus": ("MajorRadius", "MinorRadius"),
    }.get(name, ())  # fmt: skip
    return place, way, np.abs([getattr(own, size)() for size in sizes])
