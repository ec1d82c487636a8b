# SPDX-License-Identifier: MIT
"""Placing: in which of some surfaces the features lie that a file states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from completion.merging.merged_surface import MergedSurface
from completion.observe.observation import Observation
from completion.templates.applied.file import JOINTS, PATTERNS
from completion.templates.applied.joints import ends_of
from completion.templates.engine.features import moved_geometry
from completion.templates.engine.template import TemplateFit
from scenes.checks import FloatArray, InputError
from scenes.pose import Pose
from scenes.surfaces.catalogue import Plane

_MOST_POINTS = 5000  # of a surface, that say where it was measured
_NEAR_M = 0.10  # between the corners of an opening and its wall
_ON_PLATE = 0.5  # of the radius of holes, by which their centres may lie off a plate


def place_features(
    stated: Sequence[TemplateFit],
    surfaces: Sequence[MergedSurface],
    observations: Sequence[Observation],
    reference_from_world: Pose,
) -> list[TemplateFit]:
    """Return features in the frame of some surfaces, each with the numbers of those that it lies in.

    Raises InputError: an opening that lies in none of them (within 10 cm of its plane, and no farther from
    what was measured of it than it is large); a pattern of holes of whose plane none is; a joint that no
    surface ends at.
    """
    pose, out = reference_from_world, []
    for number, fit in enumerate(stated, start=1):
        geometry = moved_geometry(fit, pose.rotation, pose.translation)
        if fit.kind in JOINTS:
            ends = ends_of(replace(fit, geometry=geometry), surfaces, observations)
            if not ends:
                raise InputError(f"{fit.kind} {number} of the features joins no surfaces of these scans")
            out.append(replace(fit, geometry={**geometry, "ends": ends}))
            continue
        places = np.asarray(geometry["centres" if fit.kind in PATTERNS else "corners"])
        allowed = _ON_PLATE * float(str(geometry["radius"])) if fit.kind in PATTERNS else _NEAR_M
        away = [_away(one, places, observations, allowed) for one in surfaces]
        nearest = int(np.argmin(away)) if away else 0
        if not away or away[nearest] > allowed:
            least = f"{100 * away[nearest]:.0f} cm away" if away and np.isfinite(away[nearest]) else "none"
            what, where = ("pattern of holes", "plane") if fit.kind in PATTERNS else ("opening", "wall")
            raise InputError(
                f"{what} {number} of the features lies in no {where} of these scans: nearest {least}"
            )
        slack = {side.name: (0.0, 0.0 if side.is_seen else np.inf) for side in fit.sides}
        out.append(replace(fit, geometry={**geometry, "surface": nearest + 1, "slack": slack}))
    return out


def _away(
    surface: MergedSurface, places: FloatArray, observations: Sequence[Observation], allowed: float
) -> float:
    """How far places (n, 3) are from a plane, metres; inf where it was measured nowhere near them."""
    plane = surface.fit.surface
    if not isinstance(plane, Plane):
        return np.inf
    off = float(np.abs(plane.distance(places)).max())
    if off > allowed:
        return off
    middle, size = places.mean(axis=0), float(np.linalg.norm(np.ptp(places, axis=0)))
    nearest = np.linalg.norm(surface.points(observations, _MOST_POINTS) - middle, axis=1).min()
    return off if nearest <= size else np.inf
