# SPDX-License-Identifier: MIT
"""Tree of features: the body of a part, and beside it its holes, pockets and others as products of faces.

Features are shells, no solids: a reader counts one body, whose volume is the part's.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from completion.export.step.kernel import NamedFace, NamedShape, kernel
from completion.export.step.sewing import compound, numbered_edges


class FaceGroup(NamedTuple):
    """A feature: what its product and each of its faces are called, and the numbers of its surfaces.

    One of several features has these as `parts`.
    """

    title: str
    name: str
    numbers: tuple[int, ...] = ()
    parts: tuple[FaceGroup, ...] = ()


def names_by_surface(features: Sequence[FaceGroup]) -> dict[int, str]:
    """The names of the features that each surface is of, by its number, joined by commas."""
    names = dict[int, str]()
    for feature in features:
        within = names_by_surface(feature.parts) or dict.fromkeys(feature.numbers, feature.name)
        for number, own in within.items():
            names[number] = f"{names[number]}, {own}" if number in names else own
    return names


def feature_tree(
    body: NamedShape, numbers: Sequence[int], features: Sequence[FaceGroup], title: str
) -> NamedShape | None:
    """Return the assembly of a body, whose faces are of surfaces by `numbers`, and of its features.

    None where no feature has a face.
    """
    products = [_product(feature, body.faces, numbers) for feature in features]
    some = [product for product in products if product is not None]
    if not some:
        return None
    return NamedShape(title, parts=[body._replace(name="body"), NamedShape("features", parts=some)])


def _product(feature: FaceGroup, faces: Sequence[NamedFace], numbers: Sequence[int]) -> NamedShape | None:
    """A feature's product, or the assembly of its parts'; None where it has no face."""
    if feature.parts:
        parts = [_product(part, faces, numbers) for part in feature.parts]
        some = [part for part in parts if part is not None]
        return NamedShape(feature.title, parts=some) if some else None
    own = [face for face, number in zip(faces, numbers, strict=True) if number in feature.numbers]
    if not own:
        return None
    shape = _shells([face.face for face in own])
    copied = kernel().BRepBuilderAPI.BRepBuilderAPI_Copy(shape)  # each product has geometry of its own
    moved = [face._replace(face=copied.ModifiedShape(face.face)) for face in own]
    return NamedShape(feature.title, copied.Shape(), moved)


def _shells(faces: Sequence[Any]) -> Any:
    """A shell of faces that meet at edges; a compound of several where not all do."""
    edges = [{number for number, _ in own} for own in numbered_edges(faces)]
    left, shells = list(range(len(faces))), list[Any]()
    while left:
        shell, build = kernel().TopoDS.TopoDS_Shell(), kernel().BRep.BRep_Builder()
        build.MakeShell(shell)
        border, todo = set[int](), [left[0]]
        while todo:
            left = [place for place in left if place not in todo]
            for place in todo:
                build.Add(shell, faces[place])
                border |= edges[place]
            todo = [place for place in left if edges[place] & border]
        shells.append(shell)
    return shells[0] if len(shells) == 1 else compound(shells)
