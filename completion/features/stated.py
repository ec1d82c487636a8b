# SPDX-License-Identifier: MIT
"""Openings that a person states, and reveals: faces that lead from a wall into an opening."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import shapely
from numpy.typing import NDArray

from completion.edits.application import EditedSurface
from completion.edits.edit import FittedHole, FittedJoint, FittedOpening, KnownFace, outline_uv
from completion.features import limits
from completion.features.engine.options import OPENINGS
from completion.features.engine.template import (
    FeatureSide,
    FeatureStatus,
    SideState,
    TemplateFit,
    moved_geometry,
)
from completion.features.openings.limits import ON_FACE_SD
from completion.features.openings.recess import SIDES
from completion.fitting.result import SurfaceFit
from completion.merging.merged_surface import MergedSurface
from completion.observe.observation import Observation, PixelSet, ScanPixels
from scenes.checks import BoolArray, FloatArray, InputError, check_coordinates, check_direction, check_places
from scenes.io.checks.documents import read_json
from scenes.pose import Pose
from scenes.run.mapping import trim
from scenes.surfaces.catalogue import Cylinder, Plane

AROUND = ("bottom", "right", "top", "left")
"""Sides of an opening from each of its corners to the next."""

_MOST_POINTS = 5000  # of a surface, that show where it was measured


def reveals_of(
    features: Sequence[TemplateFit],
    surfaces: Sequence[MergedSurface],
    observations: Sequence[Observation],
    owners: Sequence[NDArray[np.int32]],
    flatness_m: float,
) -> list[KnownFace]:
    """Return the reveals of found openings, side by side.

    The side of an opening gives the place of its reveal, the depth how far that goes. Where a side was not
    seen, or the depth is not known, nothing is. A doorway's foot is the floor. Reveals that are surfaces of
    their own already are left out: they are continued as such.

    Parameters
    ----------
    features : sequence of TemplateFit
        With the surface that each lies in.
    surfaces : sequence of MergedSurface
        All n, working frame.
    observations : sequence of Observation
        The scans.
    owners : sequence of (rows, columns) int
        Number, from 1, of the surface that each pixel is of; 0 for none.
    flatness_m : float
        By how much surfaces may stray from planes, metres.
    """
    outlines = [
        outline
        for number, fit in enumerate(features, start=1)
        if fit.status is FeatureStatus.FOUND
        for outline in _outlines(fit, number, surfaces)
        if not any(_is_on(outline, surface, observations, flatness_m) for surface in surfaces)
    ]
    pixels: list[list[PixelSet]] = [[] for _ in outlines]
    for seen, owner in zip(observations, owners, strict=True) if outlines else ():
        free = np.flatnonzero(seen.valid.ravel() & (owner.ravel() == 0)).astype(np.int32)
        points, sigma = seen.points_at(free), seen.sigma_at(free)
        for held, outline in zip(pixels, outlines, strict=True):
            on = outline.holds(points, ON_FACE_SD * np.hypot(sigma, outline.deviation))
            held.append(PixelSet(free[on], owner.shape))
            free, points, sigma = free[~on], points[~on], sigma[~on]
        trim()
    return [
        outline.face(ScanPixels.of(held), observations)
        for held, outline in zip(pixels, outlines, strict=True)
    ]


@dataclass(frozen=True, slots=True, eq=False)
class _RevealOutline:
    """Where a reveal lies: its plane, from one corner of the opening along a side and into the wall."""

    plane: Plane
    size: FloatArray  # (2,) metres
    deviation: float  # of the side across itself, metres
    feature: int

    def holds(self, points: FloatArray, allowed: FloatArray | float) -> BoolArray:
        """Whether points (n, 3) lie on it, to an allowed distance (n,), metres; none on its rim."""
        uv = self.plane.to_uv(points)
        inside = ((uv > self.deviation) & (uv < self.size - self.deviation)).all(axis=1)
        return np.asarray(inside & (np.abs(self.plane.distance(points)) <= allowed))

    def face(self, pixels: ScanPixels, observations: Sequence[Observation]) -> KnownFace:
        """Return it with what was measured of it."""
        tilts = 2 * self.deviation / self.size
        covariance = np.diag(np.square([self.deviation, *tilts]))
        middle = Plane(self.plane.from_uv(self.size / 2), self.plane.normal_direction, self.plane.u_direction)
        bare = MergedSurface(SurfaceFit(middle, 0.0, covariance, pixels.n_pixels), pixels, 1)
        off = self.plane.distance(bare.points(observations))
        rms = float(np.sqrt(np.mean(np.square(off)))) if len(off) else self.deviation
        fit = SurfaceFit(middle, rms, covariance, pixels.n_pixels)
        return KnownFace(MergedSurface(fit, pixels, 1), self.size, self.feature)


def _outlines(fit: TemplateFit, number: int, surfaces: Sequence[MergedSurface]) -> Iterator[_RevealOutline]:
    """The reveals of one opening whose sides were seen."""
    depth = float(str(fit.geometry.get("depth_m", np.nan)))
    off = float(str(fit.geometry.get("depth_sd_m", 0.0)))
    if not (np.isfinite(depth) and np.isfinite(off)) or depth < max(limits.LEAST_REVEAL_M, ON_FACE_SD * off):
        return
    wall = surfaces[int(str(fit.geometry["surface"])) - 1].fit.surface
    if not isinstance(wall, Plane):
        return
    into = np.asarray(fit.geometry.get("into", -wall.normal_direction), dtype=np.float64)
    corners = np.asarray(fit.geometry["corners"], dtype=np.float64)
    sides = {side.name: side for side in fit.sides}
    for name, start, end in zip(AROUND, corners, np.roll(corners, -1, axis=0), strict=True):
        is_floor = name == "bottom" and fit.kind == "doorway"
        if not sides[name].is_seen or is_floor or not np.isfinite(sides[name].deviation):
            continue
        along = end - start
        length = float(np.linalg.norm(along))
        plane = Plane(start, np.cross(along, into), along)
        yield _RevealOutline(plane, np.array([length, depth]), float(sides[name].deviation), number)


def _is_on(
    outline: _RevealOutline, surface: MergedSurface, observations: Sequence[Observation], flatness_m: float
) -> bool:
    """Whether a surface is the face: parallel to it, and measured on it."""
    plane = surface.fit.surface
    if not isinstance(plane, Plane):
        return False
    if float(plane.normal_direction @ outline.plane.normal_direction) < np.cos(limits.TILT):
        return False
    middle = outline.plane.from_uv(outline.size / 2)
    allowed = ON_FACE_SD * float(np.hypot(np.hypot(surface.fit.rms, outline.deviation), flatness_m))
    if abs(float(plane.distance(middle[None])[0])) > allowed + limits.TILT * float(outline.size.max()) / 2:
        return False
    points = surface.points(observations, _MOST_POINTS)
    return int(np.count_nonzero(outline.holds(points, allowed))) >= limits.FACE_POINTS


PATTERNS = ("hole-row", "hole-grid", "bolt-circle")
JOINTS = ("junction", "elbow")

_N_RADII = 2  # of an elbow
_CURE = "give a features.json that `unseen feature` wrote"


def read_features(path: str | os.PathLike[str]) -> list[TemplateFit]:
    """Return the openings, patterns of holes and joints that a features.json calls found; world coordinates.

    Raises InputError: no such file, another kind of JSON, an opening without corners or sides, a pattern
    without centres and radius, a joint without its ends.
    """
    source = os.fspath(path)
    held = read_json(Path(source), dict).get("features")
    if not isinstance(held, list):
        raise InputError(f'{source}: holds no list "features"; {_CURE}')
    return [
        _READERS[entry["kind"]](f"{source}: feature {number}", entry)
        for number, entry in enumerate(held, start=1)
        if isinstance(entry, Mapping) and entry.get("kind") in _READERS and entry.get("status") == "found"
    ]


def _read_opening(source: str, entry: Mapping[str, Any]) -> TemplateFit:
    sides, corners = entry.get("sides"), entry.get("corners")
    if not isinstance(sides, Mapping) or not all(isinstance(sides.get(name), Mapping) for name in SIDES):
        raise InputError(f"{source}: has no sides {', '.join(SIDES)}; {_CURE}")
    places = _places(source, "corners", corners)
    if places.shape != (4, 3):
        raise InputError(f"{source}: corners must be four points, got {len(places)}; {_CURE}")
    if (np.linalg.norm(places - np.roll(places, 1, axis=0), axis=1) < limits.LEAST_CORNER_M).any():
        raise InputError(f"{source}: two corners lie at one place; {_CURE}")
    stated_sd = entry.get("standard_deviation")
    sd = stated_sd.get("depth") if isinstance(stated_sd, Mapping) else None
    geometry = {
        "corners": places,
        "depth_m": _number(source, "depth_m", entry.get("depth_m")),
        "depth_sd_m": np.inf if sd is None else _number(source, "standard_deviation", sd),
    }
    return _fit(source, entry, {name: sides[name] for name in SIDES}, geometry)


def _read_pattern(source: str, entry: Mapping[str, Any]) -> TemplateFit:
    sides, centres = entry.get("sides"), _places(source, "centres", entry.get("centres"))
    radius = _number(source, "radius", entry.get("radius"))
    if not len(centres) or radius <= 0:
        raise InputError(f"{source}: needs centres and a radius above 0; {_CURE}")
    if not isinstance(sides, Mapping) or len(sides) != len(centres):
        raise InputError(f"{source}: needs a side for each of its {len(centres)} holes; {_CURE}")
    axis = _axis(source, entry)
    return _fit(source, entry, sides, {"centres": centres, "radius": radius, "axis": axis})


def _read_joint(source: str, entry: Mapping[str, Any]) -> TemplateFit:
    ends, axis = entry.get("joint"), _axis(source, entry)
    geometry = {"joint": _places(source, "joint", ends), "axis": axis}
    joint = geometry["joint"]
    if joint.shape != (2, 3) or np.linalg.norm(joint[1] - joint[0]) < limits.LEAST_CORNER_M:
        raise InputError(f"{source}: joint must be two places; {_CURE}")
    if entry["kind"] == "elbow":
        radii = entry.get("radii")
        if not isinstance(radii, list) or len(radii) != _N_RADII:
            raise InputError(f"{source}: radii must be that of the bend and that of the tube; {_CURE}")
        geometry["radii"] = np.array([_number(source, "radii", radius) for radius in radii])
        geometry["centres"] = _places(source, "centres", entry.get("centres"))
        away = np.linalg.norm(np.cross(axis, joint - geometry["centres"][:1]), axis=1)
        if len(geometry["centres"]) != 1 or (away < limits.LEAST_CORNER_M).any():
            raise InputError(f"{source}: centres must be the middle of the bend, off its joint; {_CURE}")
    return _fit(source, entry, {}, geometry)


_READERS: dict[str, Callable[[str, Mapping[str, Any]], TemplateFit]] = {
    **dict.fromkeys(OPENINGS, _read_opening),
    **dict.fromkeys(PATTERNS, _read_pattern),
    **dict.fromkeys(JOINTS, _read_joint),
}


def _fit(
    source: str, entry: Mapping[str, Any], sides: Mapping[str, Any], geometry: Mapping[str, object]
) -> TemplateFit:
    """A feature that is found, by its sides and its geometry."""
    return TemplateFit(
        kind=str(entry["kind"]),
        status=FeatureStatus.FOUND,
        names=(),
        x=np.zeros(0),
        covariance=np.zeros((0, 0)),
        sides=tuple(_side(f"{source}: {name}", name, side) for name, side in sides.items()),
        evidence=_number(source, "evidence", entry.get("evidence")),
        faces=(),
        assignment=np.zeros(0, np.int64),
        geometry=geometry,
    )


def _side(source: str, name: str, entry: object) -> FeatureSide:
    held = entry if isinstance(entry, Mapping) else {}
    seen, sd = held.get("seen"), held.get("sd_m")
    if not isinstance(seen, bool) or not (sd is None or (isinstance(sd, int | float) and 0 <= sd < np.inf)):
        raise InputError(f"{source}: needs seen (true or false) and sd_m (metres, or null); {_CURE}")
    confirmed, tiles = (int(_number(source, what, held.get(what))) for what in ("confirmed", "tiles"))
    tiles = max(tiles, 2)
    confirmed = min(max(confirmed, 2), tiles) if seen else 0
    against = tiles if held.get("state") == SideState.CONTRADICTED else 0
    return FeatureSide(name, confirmed, against, tiles, np.inf if sd is None else float(sd))


def _places(source: str, name: str, value: object) -> FloatArray:
    """Points (n, 3) of the world."""
    try:
        return check_places(name, check_coordinates(value))
    except InputError as error:
        raise InputError(f"{source}: {name}: {error}; {_CURE}") from error


def _axis(source: str, entry: Mapping[str, Any]) -> FloatArray:
    """The axis of a pattern or a joint, (3,)."""
    try:
        return check_direction("axis", check_coordinates(entry.get("axis")))
    except InputError as error:
        raise InputError(f"{source}: {error}; {_CURE}") from error


def _number(source: str, name: str, value: object) -> float:
    """A finite number, 0 for null."""
    if value is None:
        return 0.0
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
        raise InputError(f"{source}: {name} must be a number or null, got {value!r}; {_CURE}")
    return float(value)


def ends_of(
    fit: TemplateFit, surfaces: Sequence[MergedSurface], observations: Sequence[Observation]
) -> list[tuple[int, Plane]]:
    """Return the surfaces, from 1, that a joint ends, each with the plane that it ends at.

    A tube of an elbow ends in the circle where the bend begins; two surfaces that touch end in the line along
    which they do. A surface lies on its plane's side. Those of which more than a fifth was measured beyond
    are not ended.

    Parameters
    ----------
    fit : TemplateFit
        The junction or the elbow, in the frame of the surfaces.
    surfaces : sequence of MergedSurface
        All n.
    observations : sequence of Observation
        The scans.
    """
    ends = []
    for end in _tubes(fit) if fit.kind == "elbow" else _seams(fit, surfaces):
        index, plane = end
        if index is None:
            index = _tube_at(plane, fit, surfaces)
        if index is None:
            continue
        points = surfaces[index].points(observations, _MOST_POINTS)
        sides = plane.distance(points)
        if np.mean(sides > 0) >= limits.ONE_SIDE:
            ends.append((index + 1, plane))
        elif fit.kind != "elbow" and np.mean(sides < 0) >= limits.ONE_SIDE:
            ends.append((index + 1, plane.flip()))
    return ends


def _tubes(fit: TemplateFit) -> Iterator[tuple[int | None, Plane]]:
    """The circles at which the tubes of an elbow end, their normals away from the bend."""
    joint, axis = np.asarray(fit.geometry["joint"]), np.asarray(fit.geometry["axis"])
    centre = np.asarray(fit.geometry["centres"])[0]
    for place, other in zip(joint, joint[::-1], strict=True):
        away = np.cross(axis, place - centre)
        yield None, Plane(place, away if away @ (place - other) > 0 else -away)


def _tube_at(end: Plane, fit: TemplateFit, surfaces: Sequence[MergedSurface]) -> int | None:
    """The cylinder of a tube's radius whose axis passes an end's middle along its normal."""
    radius = float(np.asarray(fit.geometry["radii"])[1])
    best, least = None, limits.OFF_JOINT * radius
    for number, surface in enumerate(surfaces):
        tube = surface.fit.surface
        if not isinstance(tube, Cylinder) or abs(tube.radius - radius) > limits.OFF_JOINT * radius:
            continue
        if abs(float(tube.direction @ end.normal_direction)) < limits.ALONG:
            continue
        across = end.point - tube.point
        off = float(np.linalg.norm(across - (across @ tube.direction) * tube.direction))
        if off <= least:
            best, least = number, off
    return best


def _seams(fit: TemplateFit, surfaces: Sequence[MergedSurface]) -> Iterator[tuple[int | None, Plane]]:
    """Surfaces on which the line of a tangent junction lies, and the planes across them there."""
    joint, axis = np.asarray(fit.geometry["joint"]), np.asarray(fit.geometry["axis"])
    allowed = limits.OFF_JOINT * float(np.linalg.norm(joint[1] - joint[0]))
    for number, surface in enumerate(surfaces):
        shape = surface.fit.surface
        if isinstance(shape, Cylinder):
            runs_along = abs(float(shape.direction @ axis)) >= limits.ALONG
            allowed_here = min(allowed, limits.OFF_JOINT * shape.radius)
        elif isinstance(shape, Plane):
            runs_along = abs(float(shape.normal_direction @ axis)) <= np.sqrt(1 - limits.ALONG**2)
            allowed_here = allowed
        else:
            continue
        if runs_along and np.abs(shape.distance(joint)).max() <= allowed_here:
            normal: FloatArray = shape.normal(joint[:1])[0]
            yield number, Plane(joint.mean(axis=0), np.cross(axis, normal))


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
        allowed = (
            limits.ON_PLATE * float(str(geometry["radius"])) if fit.kind in PATTERNS else limits.NEAR_WALL_M
        )
        away = [_away(surface, places, observations, allowed) for surface in surfaces]
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


def with_features(surfaces: Sequence[EditedSurface], features: Sequence[TemplateFit]) -> list[EditedSurface]:
    """Return the surfaces with the openings, holes and joints that were found in them.

    Features that are not found change nothing, nor do openings where a person declared one. A side that
    nobody saw lies where beams still went through, and may lie farther out; holes of a pattern that nobody
    saw, or that are filled, are none.
    """
    edits = [surface.edits for surface in surfaces]
    for number, fit in enumerate(features, start=1):
        if fit.status is not FeatureStatus.FOUND or fit.geometry.get("is_closed"):
            continue
        for surface, plane in cast(Sequence[tuple[int, Plane]], fit.geometry.get("ends", ())):
            surface_edits = edits[surface - 1]
            edits[surface - 1] = replace(
                surface_edits, joints=(*surface_edits.joints, FittedJoint(plane, number))
            )
        if "surface" not in fit.geometry:
            continue
        index = int(str(fit.geometry["surface"])) - 1
        surface_edits = edits[index]
        if fit.kind in PATTERNS:
            edits[index] = replace(surface_edits, holes=(*surface_edits.holes, *_holes(fit, number)))
        elif not _is_declared(opening := _opening_of(fit, number), surfaces[index]):
            edits[index] = replace(surface_edits, fitted=(*surface_edits.fitted, opening))
    return [replace(surface, edits=edit) for surface, edit in zip(surfaces, edits, strict=True)]


def _is_declared(opening: FittedOpening, surface: EditedSurface) -> bool:
    """Whether a person declared an opening where this one is."""
    chart = surface.surface.fit.surface
    fitted = shapely.Polygon(outline_uv(chart, opening.outline))
    declared = (shapely.Polygon(outline_uv(chart, outline)) for outline in surface.edits.openings)
    return any(fitted.intersects(outline) for outline in declared)


def _holes(fit: TemplateFit, number: int) -> Iterator[FittedHole]:
    """The holes of a pattern that were seen, all of one radius."""
    radius, axis = float(str(fit.geometry["radius"])), np.asarray(fit.geometry["axis"])
    for centre, side in zip(np.asarray(fit.geometry["centres"]), fit.sides, strict=True):
        if side.is_seen:
            seen = side.confirmed / side.total
            yield FittedHole(centre, axis, radius, side.deviation, seen=seen, number=number)


def _opening_of(fit: TemplateFit, number: int) -> FittedOpening:
    corners = np.asarray(fit.geometry["corners"], dtype=np.float64)
    sides: dict[str, FeatureSide] = {side.name: side for side in fit.sides}
    slack = cast(Mapping[str, tuple[float, float]], fit.geometry["slack"])
    off = np.array([slack[name] for name in AROUND])
    deviation = np.array([sides[name].deviation for name in AROUND])
    seen = np.array([sides[name].is_seen * sides[name].confirmed / sides[name].total for name in AROUND])
    return FittedOpening(corners, deviation, seen, off, number)
