# SPDX-License-Identifier: MIT
"""Profile: loops of lines and arcs in a plane, how they are swept, and what their walls are to each other."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
import shapely

from completion.fitting.result import SurfaceFit
from completion.parts.profiles.chain import Segment
from completion.parts.profiles.sweep import Sweep
from completion.relations.graph import RelationGraph
from completion.relations.relation import Relation
from scenes.checks import Value
from scenes.surfaces.catalogue import Plane

LoopKind = Literal["outer", "boss", "rib", "hole", "slot", "pocket", "turned", "open"]


@dataclass(frozen=True, eq=False)
class Loop(Value):
    """Segments in a ring, or a chain of them that is open.

    Attributes
    ----------
    segments : tuple of Segment
        In their order: anticlockwise where material is within, else clockwise.
    kind : str
        "outer", "boss" or "rib" (a narrow boss) with material within; "hole" (round), "slot" (two parallel
        lines between two arcs) or "pocket" without; "turned": about the axis; "open": its ends do not meet.
    low_m, high_m : float
        Heights along an extrusion between which it is swept.
    end_sd_m : (float, float)
        Standard deviation of these; NaN where no plane ends it.
    is_through : bool
        Of what is cut out, whether both ends are open.
    """

    segments: tuple[Segment, ...]
    kind: LoopKind
    low_m: float = 0.0
    high_m: float = 0.0
    end_sd_m: tuple[float, float] = (np.nan, np.nan)
    is_through: bool = False

    @property
    def is_closed(self) -> bool:
        """Whether it is a ring."""
        return self.kind != "open"

    @property
    def is_hollow(self) -> bool:
        """Whether it is cut out."""
        return self.kind in ("hole", "slot", "pocket")

    @cached_property
    def polygon(self) -> shapely.Polygon:
        """The area within; empty of an open chain."""
        places = [place for one in self.segments
                  for place in one.places(2 if one.centre is None else 24)[:-1]]  # fmt: skip
        return shapely.Polygon(places) if self.is_closed and len(places) > 2 else shapely.Polygon()


@dataclass(frozen=True, slots=True, eq=False)
class Profile(Value):
    """What is swept once.

    Attributes
    ----------
    sweep : Sweep
        How.
    loops : tuple of Loop
        The largest first.
    faces : tuple of tuple of int
        Labels of the part's faces on each wall (k,).
    measured : tuple of SurfaceFit
        The walls (k,) in the profile's frame, each as its own face says.
    graph : RelationGraph
        The walls where their relations hold, and these.
    alike : int
        How many profiles of the part are the same, this one among them.
    """

    sweep: Sweep
    loops: tuple[Loop, ...]
    faces: tuple[tuple[int, ...], ...]
    measured: tuple[SurfaceFit, ...]
    graph: RelationGraph
    alike: int = 1

    @property
    def walls(self) -> tuple[SurfaceFit, ...]:
        """The walls where relations hold."""
        return self.graph.fits

    @property
    def labels(self) -> set[int]:
        """All faces that it explains as walls."""
        return {label for labels in self.faces for label in labels}

    @property
    def free(self) -> int:
        """Parameters of lines (2, or 1 of a held direction) and arcs (3) less what relations say."""
        n = sum(int((np.diag(fit.covariance) > 0).sum()) for fit in self.measured)
        return n - self.graph.rank - (self.sweep.kind == "revolved")

    def relations(self) -> Iterator[Relation]:
        """The relations that hold and say something of lines and arcs in a plane."""
        for relation in self.graph.relations:
            flat = {isinstance(self.measured[number].surface, Plane) for number in relation.surfaces}
            is_plain = relation.kind in ("parallel", "perpendicular") and flat != {True}
            if relation.holds and not is_plain:
                yield relation


WORDS = {
    "coplanar": "collinear", "coaxial": "concentric", "equal_radius": "equal radius",
}  # fmt: skip


def profile_record(profile: Profile) -> dict[str, Any]:
    """Return what profiles.json holds of a profile, metres, degrees; places in its own frame."""
    return {
        "sweep": profile.sweep.kind,
        "profile_from_world": profile.sweep.profile_from_world.matrix.tolist(),
        "direction": profile.sweep.direction.tolist(),
        "alike": profile.alike,
        "walls": [
            _wall_record(fit, labels) for fit, labels in zip(profile.walls, profile.faces, strict=True)
        ],
        "loops": [_loop_record(loop) for loop in profile.loops],
        "relations": [
            {
                "type": WORDS.get(relation.kind, relation.kind),
                "walls": [number + 1 for number in relation.surfaces],
                "value_deg": None if relation.value is None else float(np.degrees(relation.value)),
                "status": relation.status.value,
                "p": relation.p if np.isfinite(relation.p) else None,
            }
            for relation in profile.relations()
        ],
        "free": profile.free,
    }


def _wall_record(fit: SurfaceFit, labels: tuple[int, ...]) -> dict[str, Any]:
    deviations = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    if isinstance(fit.surface, Plane):
        angle = float(np.degrees(np.arctan2(*fit.surface.u_direction[1::-1]))) % 180.0
        size = {"kind": "line", "point": fit.surface.point[:2].tolist(), "angle_deg": angle}
        spread = {"offset": deviations[0], "angle_deg": float(np.degrees(deviations[1]))}
    else:
        size = {"kind": "arc", "centre": fit.surface.point[:2].tolist(), "radius": fit.surface.radius}  # type: ignore[attr-defined]
        spread = {"centre": deviations[:2].tolist(), "radius": deviations[4]}
    return {**size, "standard_deviation": spread, "faces": list(labels)}


def _loop_record(loop: Loop) -> dict[str, Any]:
    ends = [None if not np.isfinite(sd) else sd for sd in loop.end_sd_m]
    return {
        "kind": loop.kind, "closed": loop.is_closed, "through": loop.is_through,
        "from_m": loop.low_m, "to_m": loop.high_m, "end_standard_deviation_m": ends,
        "segments": [
            {
                "wall": segment.wall + 1, "kind": "line" if segment.centre is None else "arc",
                "start": segment.start.tolist(), "end": segment.end.tolist(),
                **({} if segment.centre is None else {"turn_deg": float(np.degrees(segment.sweep_rad))}),
            }
            for segment in loop.segments
        ],
    }  # fmt: skip
