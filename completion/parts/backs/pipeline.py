# SPDX-License-Identifier: MIT
"""Unseen sides of parts on one page: symmetries of the division's surfaces, tested, and the faces they imply.

A symmetry is a virtual scan: where a mirror maps a part into itself, each scan of it is also one of its other
side, whose surface is surface and whose free space is free space.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from completion.parts.backs.assertion import InferredFace, Places, assert_surface, choose
from completion.parts.backs.axes import find_axes
from completion.parts.backs.hypothesis import Hypothesis, probability
from completion.parts.backs.mirrors import find_mirrors
from completion.parts.backs.sample import measured_of
from completion.parts.division.divided_part import DividedPart
from scenes.checks import InputError, Value, check_points

LEAST = 0.8
"""Probability from which a symmetry is asserted, unless it is said otherwise."""


@dataclass(frozen=True, slots=True, eq=False)
class PartBack(Value):
    """The unseen sides of a part: what its symmetries imply, inferred, never measured.

    Attributes
    ----------
    hypotheses : tuple of Hypothesis
        All mirrors and axes that were tested, the most probable first, right or not.
    chosen : tuple of Hypothesis
        Those that were asserted.
    places : Places or None
        Inferred surface as points; None where there is none.
    faces : tuple of InferredFace
        What these lie on: new faces, and rests of measured ones.
    told : str
        What was found, or why nothing was, one sentence with numbers.
    is_told : bool
        Whether the file told where scanners stood.
    """

    hypotheses: tuple[Hypothesis, ...]
    chosen: tuple[Hypothesis, ...]
    places: Places | None
    faces: tuple[InferredFace, ...]
    told: str
    is_told: bool

    @property
    def area_m2(self) -> float:
        """Area of inferred surface."""
        return sum(face.area_m2 for face in self.faces)

    def record(self) -> dict[str, Any]:
        """Return what part.json holds of it."""
        return {
            "told": self.told,
            "viewpoints_known": self.is_told,
            "inferred_m2": self.area_m2,
            "hypotheses": [{**one.record(), "asserted": one in self.chosen} for one in self.hypotheses],
            "faces": [face.record() for face in self.faces],
        }


def find_back(
    part: DividedPart, *, origins: object | None = None, normals: object | None = None, least: float = LEAST
) -> PartBack:
    """Infer the unseen sides of a part from mirror planes and axes of its surfaces.

    Parameters
    ----------
    part : DividedPart
        Divided into surfaces (`model_part`), scanned from one side or several.
    origins : (n, 3) float, optional
        Where the scanner stood that measured each point, metres. Without it, sides are tried from which all
        of the surface is seen; nothing is inferred where there is none.
    normals : (n, 3) float, optional
        Of points, out of the material, for files without `origins`; of a mesh its triangles are taken.
    least : float
        Probability from which a symmetry is asserted, 0.5 to 1.

    Returns
    -------
    PartBack
        Without places where no symmetry is probable enough, or none can be tested; `told` says why.

    Raises
    ------
    InputError
        A probability outside 0.5 to 1, arrays of other shapes.
    """
    if not 0.5 <= least <= 1:
        raise InputError(f"least must lie between 0.5 and 1, got {least}")
    eyes = None if origins is None else check_points("origins", origins)
    sides = None if normals is None else check_points("normals", normals)
    for name, given in (("origins", eyes), ("normals", sides)):
        if given is not None and len(given) != len(part.points):
            raise InputError(f"{len(given)} {name} for {len(part.points)} points; give one a point")
    try:
        measured = measured_of(part, eyes, sides)
    except InputError as error:
        told = f"no unseen side is inferred: {error}"
        return PartBack((), (), places=None, faces=(), told=told, is_told=eyes is not None)
    found = [*find_mirrors(measured), *find_axes(measured, part.labels)]
    weighed = sorted(
        (replace(one, probability=probability(one)) for one in found), key=lambda one: -one.probability
    )
    chosen = choose(weighed, least)
    places, faces = assert_surface(measured, part.labels, chosen, least)
    told = _told(weighed, chosen, faces, least, measured.is_told)
    kept = places if len(places.points) else None
    return PartBack(tuple(weighed), chosen, places=kept, faces=faces, told=told, is_told=measured.is_told)


def _told(
    found: Sequence[Hypothesis], chosen: Sequence[Hypothesis], faces: Sequence[InferredFace], least: float,
    is_told: bool,
) -> str:  # fmt: skip
    """What was found, or why nothing was."""
    sights = (
        "" if is_told else "; the file does not tell where the scanner stood, sides that see all were tried"
    )
    if not found:
        return f"no unseen side is inferred: no two surfaces and no axis propose a symmetry{sights}"
    if not chosen:
        best, e = found[0], found[0].evidence
        return (
            f"no unseen side is inferred: the best of {len(found)} hypotheses, {_article(best)}, has "
            f"probability {best.probability:.2f} of {least:g} needed ({100 * e['matched']:.0f} % matched, "
            f"{100 * (e['free'] + e['beside']):.0f} % refuted, {100 * e['hidden']:.0f} % unseen){sights}"
        )
    n_mirrors, worst = sum(one.kind == "mirror" for one in chosen), min(one.probability for one in chosen)
    counts = _count(n_mirrors, "mirror plane"), _count(len(chosen) - n_mirrors, "axis", "axes")
    named = [text for text in counts if not text.startswith("0 ")]
    holds = f"{' and '.join(named)} with probability {worst:.2f} or more"
    if not faces:
        return f"no unseen side is inferred: all that {holds} would imply was measured or is refuted{sights}"
    area, names = 1e4 * sum(face.area_m2 for face in faces), {face.label: face.is_new for face in faces}
    return (
        f"inferred from {holds}: {area:.3g} cm2 of unseen surface on {_count(len(names), 'face')}, "
        f"{sum(names.values())} new{sights}"
    )


def _count(n: int, singular: str, plural: str = "") -> str:
    return f"{n} {singular if n == 1 else plural or singular + 's'}"


def _article(one: Hypothesis) -> str:
    if one.kind == "mirror":
        return f"a mirror with normal ({', '.join(f'{value + 0.0:.2f}' for value in one.direction)})"
    return f"an axis of surface{'s' * (len(one.surfaces) > 1)} {', '.join(map(str, one.surfaces))}"
