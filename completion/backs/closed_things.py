# SPDX-License-Identifier: MIT
"""Closed things: what stands in a room, each with the sides that nobody saw, in world coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from completion.backs.closing import MEASURED, SYMMETRY, TURN
from completion.backs.intervals import Extent
from completion.backs.options import BackOptions
from completion.backs.pipeline import Back, find_back
from completion.backs.symmetry import Symmetry
from completion.backs.thing import Thing
from completion.backs.thing_records import Surroundings, surroundings, thing_record
from completion.backs.things import find_things
from completion.backs.views import Setting, ThingView
from completion.evidence.evidence import Scans
from completion.extension.patch import Patch
from completion.observe.observation import Observation
from completion.room.roles import Room
from scenes.checks import BoolArray, FloatArray, InputError, IntArray, Value
from scenes.inclination import Up
from scenes.mesh.labelled_mesh import triangle_areas
from scenes.pose import Pose
from scenes.run.steps import Steps

_NOTHING_LEFT = "no room is left behind what was measured of it"
_NO_SUPPORT = "what it stands on was not seen"
_MOST_TOLD = 8  # hypotheses of a thing in things.json


@dataclass(frozen=True, slots=True, eq=False)
class ClosedThing(Value):
    """A thing with its closed shape.

    Attributes
    ----------
    thing : Thing
        What was seen of it.
    around : Surroundings
        What bounds it.
    back : Back or None
        Its symmetries and closed shape, in coordinates whose z is up; None where there is none.
    why_open : str
        Why there is none; "" where there is.
    world_from_upright : Pose
        From those coordinates to the world.
    least : float
        Probability from which surface is inferred.
    """

    thing: Thing
    around: Surroundings
    back: Back | None
    why_open: str
    world_from_upright: Pose
    least: float

    @property
    def is_inferred(self) -> BoolArray:
        """Tell which faces (m,) of the closed shape are inferred surface: a sure symmetry implies them."""
        if self.back is None:
            return np.zeros(0, np.bool_)
        shape = self.back.shape
        return np.asarray(np.isin(shape.origin, (SYMMETRY, TURN)) & (shape.probability >= self.least))

    @property
    def face_states(self) -> IntArray:
        """0 of measured, 1 of inferred, 2 of unknown faces (m,) of the closed shape."""
        if self.back is None:
            return np.zeros(0, np.int64)
        return np.where(self.back.shape.origin == MEASURED, 0, np.where(self.is_inferred, 1, 2))

    @property
    def inferred_m2(self) -> float:
        """Area of inferred surface, square metres."""
        if self.back is None:
            return 0.0
        shape = self.back.shape
        return float(triangle_areas(shape.vertices[shape.faces])[self.is_inferred].sum())

    def back_points(self) -> FloatArray:
        """Vertices (n, 3) of the closed shape, z up, metres."""
        return np.zeros((0, 3)) if self.back is None else self.back.shape.vertices

    def world_vertices(self) -> FloatArray:
        """Vertices (n, 3) of the closed shape, world coordinates, metres."""
        return self.world_from_upright.apply(self.back_points())


def close_things(
    patches: Sequence[Patch],
    scans: Scans,
    room: Room,
    up: Up,
    *,
    world_from_reference: Pose,
    options: BackOptions,
    steps: Steps,
) -> tuple[ClosedThing, ...]:
    """Find what stands in a room, and infer the sides of each thing that no scan shows.

    Parameters
    ----------
    patches, scans, room, up, world_from_reference
        As of `find_things`.
    options : BackOptions
        From which probability surface is inferred.
    steps : Steps
        Where to run.
    """
    things = steps.one("things", lambda: find_things(patches, scans, room, up, world_from_reference))
    upright = up.drawing_from_world
    seen = scans.observations

    def close_thing(thing: Thing) -> ClosedThing:
        around = surroundings(thing, patches, room, world_from_reference)
        back, why = None, _NO_SUPPORT
        if around.support_m is not None:
            try:
                views, sigma_m = views_of(thing, seen, upright @ world_from_reference)
                walls = [[*upright.rotate(wall.normal[None])[0], wall.offset_m] for wall in around.walls]
                setting = Setting(around.support_m, sigma_m, np.array(walls).reshape(-1, 4))
                found = find_back(views, setting, options, seed=thing.index)
                back, why = (found, "") if len(found.shape.faces) else (None, _NOTHING_LEFT)
            except InputError as error:  # too small or too large
                why = str(error)
        return ClosedThing(
            thing=thing,
            around=around,
            back=back,
            why_open=why,
            world_from_upright=upright.inverse(),
            least=options.least,
        )

    return tuple(steps.each("backs", close_thing, things))


def views_of(
    thing: Thing, seen: Sequence[Observation], upright_from_reference: Pose
) -> tuple[list[ThingView], float]:
    """Return the scans that show a thing, turned z up, and the standard deviation of ranges on it, metres.

    Parameters
    ----------
    thing : Thing
        Of the scans `seen`.
    upright_from_reference : Pose
        From the working frame to one whose z is up.
    """
    views, sigmas = [], [0.0]
    for scan, (one, pixels) in enumerate(zip(seen, thing.pixels, strict=True)):
        if len(pixels):
            views.append(
                ThingView(one.scan.transform(upright_from_reference), thing.mask(scan, one.scan.shape))
            )
            sigmas.append(float(np.hypot(np.median(one.sigma_at(pixels)), one.pose_error_m)))
    return views, max(sigmas)


def things_record(things: Sequence[ClosedThing], up: Up, options: BackOptions) -> dict[str, Any]:
    """Return what things.json holds; things, surfaces and scans are numbered from 1, lengths in metres.

    Directions and places are world coordinates.
    """
    return {"least": options.least, **up.to_json(), "things": [_record(one) for one in things]}


def _record(one: ClosedThing) -> dict[str, Any]:
    """What things.json holds of one thing."""
    record = thing_record(one.thing, one.around)
    back = one.back
    if back is None:
        return {**record, "closed": None, "why_open": one.why_open}
    sure = [_key(symmetry) for symmetry in back.sure]
    told = back.hypotheses[:_MOST_TOLD]
    return {
        **record,
        "closed": f"things/{one.thing.index + 1:02d}.ply",
        "why_open": None,
        "hypotheses": [_hypothesis(symmetry, one.world_from_upright) for symmetry in told],
        "sure": [number for number, symmetry in enumerate(told) if _key(symmetry) in sure],
        "inferred_m2": one.inferred_m2,
        **{f"{name}_m": _extent_record(getattr(back.extents, name)) for name in ("width", "depth", "height")},
        "volume_m3": {
            "closed": back.volume.closed,
            "least": back.volume.least,
            "most": back.volume.most,
            "share": back.volume.share,
            "certain_most": back.volume.certain_most,
        },
    }


def _extent_record(extent: Extent) -> dict[str, Any]:
    """An extent: that of the closed shape, between which lengths it lies, and why."""
    return {name: getattr(extent, name) for name in ("estimate", "least", "most", "why")}


def _key(symmetry: Symmetry) -> tuple[object, ...]:
    """What tells a hypothesis from all others of its thing."""
    return symmetry.kind, symmetry.n_fold, *symmetry.place.tolist()


def _hypothesis(symmetry: Symmetry, world: Pose) -> dict[str, Any]:
    """One symmetry, world coordinates."""
    e = symmetry.evidence
    told: dict[str, Any] = {"kind": symmetry.kind, "probability": symmetry.probability}
    if symmetry.kind == "mirror":
        normal = world.rotate(symmetry.normal[None])[0]
        told |= {"normal": normal.tolist(), "offset_m": symmetry.offset_m}
    else:
        told |= {"axis_at": world.apply(symmetry.axis[None])[0].tolist(), "n_fold": symmetry.n_fold or None}
    names = {"matched": "matched", "contradicted": "contradicted", "hidden": "hidden", "limb": "limb"}
    return {**told, **{name: e[key] for name, key in names.items() if key in e}}
