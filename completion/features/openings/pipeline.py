# SPDX-License-Identifier: MIT
"""Openings on one page: doorways, windows and niches of one wall, of a scan, and of all scans."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from completion.features.engine.options import OPENINGS
from completion.features.engine.template import FeatureStatus, Given, TemplateFit, best_first, moved_geometry
from completion.features.openings import limits
from completion.features.openings.decision import (
    FittedRecess,
    all_sides,
    decide,
    fit_recess,
    floor_of,
    height_of,
    is_strip,
    silent_feature,
    with_unseen,
    with_wall,
)
from completion.features.openings.recess import Recess, SideEstimate
from completion.features.openings.rectangles import WallChart, propose
from completion.features.openings.walls import Floor, Wall, WallBeams, WallFrame, wall_beams
from completion.merging.merged_surface import MergedSurface
from completion.merging.scan_surfaces import ScanSurfaces
from completion.observe.observation import Observation
from completion.registration.registered import pose_doubts
from scenes.checks import FloatArray
from scenes.run.steps import Steps
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Plane


def image_share(frame: WallFrame, beams: WallBeams, observations: Sequence[Observation]) -> float:
    """Return the share of points behind a wall whose mirror images were measured before it; NaN of too few.

    Each point is reflected in the wall. A beam through its image that ends there agrees; one that goes on
    refutes it, since a mirror would show what stands there; one that ends before says nothing.
    """
    agrees = refutes = 0
    for number in np.unique(beams.scan):
        seen = observations[int(number)]
        of_scan = beams.select((beams.scan == number) & np.isfinite(beams.ranges))
        points = seen.points_at(of_scan.pixel)
        into = frame.axes[1]
        images = points - 2 * ((points - frame.origin) @ into)[:, None] * into
        for other in observations:
            numbers = _count_images(images, other)
            agrees, refutes = agrees + numbers[0], refutes + numbers[1]
    return agrees / (agrees + refutes) if agrees + refutes >= limits.FEWEST_IMAGES else np.nan


def _count_images(images: FloatArray, seen: Observation) -> tuple[int, int]:
    """How many images (n, 3) a scan's beams end at, and how many they go on behind."""
    place = seen.scan.pixels(images)
    rows, columns = seen.scan.shape
    with np.errstate(invalid="ignore"):
        row, column = np.rint(place).T
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    flat = (row[inside] * columns + column[inside]).astype(np.int64)
    away = np.linalg.norm(images[inside] - seen.scan.origin, axis=1)
    measured = seen.scan.ranges.ravel()[flat]
    slack = limits.IMAGE_TOLERANCE[0] * np.maximum(away, 1.0) + limits.IMAGE_TOLERANCE[
        1
    ] * seen.noise.deviation(away)
    back = np.isfinite(measured)
    agrees = back & (np.abs(measured - away) <= slack)
    return int(agrees.sum()), int((back & (measured > away + slack)).sum())


def find_openings_in(
    wall: Wall,
    observations: Sequence[Observation],
    up: FloatArray,
    floors: Sequence[Floor],
    given: Given,
    *,
    is_assigned: bool = True,
) -> Iterator[TemplateFit]:
    """Yield the openings that are proposed in a wall, accepted or refused, the most probable first.

    Parameters
    ----------
    wall : Wall
        The plane.
    observations : sequence of Observation
        All scans, in one frame.
    up : (3,) float
        What is up in that frame.
    floors : sequence of Floor
        Level planes, of which one may be the floor before the wall; no opening goes on above a second one.
    given : mapping
        What a person knows: "width", "height", "depth", "sill" (above the floor), metres.
    is_assigned : bool
        Whether they say which face each pixel is of: a number for every pixel of every scan.
    """
    # 1. Frame: u to the right as seen from the room, v up, y into the wall.
    plane = wall.fit.surface
    if not isinstance(plane, Plane) or not wall.fit.inclination(up).is_upright:
        return
    before = np.mean([seen.scan.origin for seen in observations], axis=0)
    frame = WallFrame.of(plane, before, up)
    local = frame.local(wall.points)[:, [0, 2]]
    if np.ptp(local, axis=0).min() < limits.LEAST_WALL_M:
        return
    low, high = local.min(axis=0) - limits.BESIDE_M, local.max(axis=0) + limits.BESIDE_M
    levels = [height_of(frame, floor.fit) for floor in floors]
    reached = [_meets(frame, floor) for floor in floors]

    # 2. Beams: where each crosses the wall's plane, and whether it stopped before, at, or behind it.
    beams = wall_beams(frame, observations, low, high, wall)

    def closely(rough: Recess) -> WallBeams:
        corners = rough.corners()
        low, high = corners.min(axis=0) - limits.BESIDE_M, corners.max(axis=0) + limits.BESIDE_M
        return wall_beams(frame, observations, low, high, wall, among=beams)

    def fit_and_decide(
        rough: Recess, every: WallBeams, chart: WallChart, others: Sequence[Recess]
    ) -> TemplateFit:
        near = closely(rough)
        sample = near.silent_as_open() if every is not beams else near
        opened = _fit_opening(
            wall, frame, (sample, every), rough, observations=observations, given=given, levels=levels
        )
        turned = sample.turn(opened.turn)
        bare = [
            side.name
            for side in opened.sides
            if side.is_seen
            and is_strip(turned, opened.recess, side.name, opened.known[side.name], others=others)
        ]
        fit = decide(replace(opened, chart=chart, bare=tuple(bare)), sample, observations, given)
        return fit if is_assigned else replace(fit, assignment=np.zeros(0, np.int64))

    # 3. Propose, fit, decide: the rectangles whose beams speak most for no wall, exactly.
    fits: list[TemplateFit] = []
    if len(beams):
        chart = WallChart.of(beams)
        proposed = [rough for rough, _ in propose(chart, reached)]
        fits = [fit_and_decide(rough, beams, chart, _without(proposed, rough)) for rough in proposed]
    yield from fits

    # 4. Silence: rectangles from which nothing came back may be panes; they are told, and never claimed.
    silent = beams.is_silent
    if silent.sum() < limits.FEWEST_SILENT:
        return
    as_open = beams.silent_as_open()
    chart = WallChart.of(as_open)
    proposed = [rough for rough, _ in propose(chart, reached)]
    for rough in proposed:
        inside = rough.holds(beams.uv)
        share = float(silent[inside].mean()) if inside.any() else 0.0
        if share > limits.MOSTLY and not any(_overlaps(fit, frame, rough) for fit in fits):
            yield silent_feature(fit_and_decide(rough, as_open, chart, _without(proposed, rough)), share)


def _without(proposed: Sequence[Recess], rough: Recess) -> list[Recess]:
    return [recess for recess in proposed if recess is not rough]


def _meets(frame: WallFrame, floor: Floor) -> FloatArray:
    """Where points of a floor that lie before a wall, close to it, meet its plane: u and v (n, 2)."""
    local = frame.local(floor.points)
    return np.asarray(local[(local[:, 1] > -limits.BESIDE_M) & (local[:, 1] < 0)][:, [0, 2]])


def _fit_opening(
    wall: Wall,
    frame: WallFrame,
    near_and_all: tuple[WallBeams, WallBeams],
    rough: Recess,
    *,
    observations: Sequence[Observation],
    given: Given,
    levels: Sequence[SideEstimate],
) -> FittedRecess:
    """A proposed rectangle fitted by the beams near it, with what supports each of its sides."""
    beams, every = near_and_all
    # a. Fit: sides, depth and turn, each by its posterior with the others as they are.
    recess, known, turn = fit_recess(beams, rough, given, levels)
    turned = beams.turn(turn)
    known = with_wall(turned, recess, known, wall, frame.turn(turn))
    floor = None if (level := floor_of(recess, levels)) is None else level.value

    # b. Support: tiles along each side, which confirm or contradict it.
    sides = all_sides(turned, recess, known, floor)
    recess, sides, slack = with_unseen(turned, recess, sides, given, farther=every.turn(turn))
    return FittedRecess(
        frame=frame.turn(turn),
        turn=turn,
        recess=recess,
        known=known,
        sides=sides,
        floor=floor,
        lowest=min((level.value for level in levels if np.isfinite(level.value)), default=np.nan),
        image_share=lambda: image_share(frame, turned.select(recess.holds(turned.uv)), observations),
        wall=wall,
        slack=slack,
        bare=(),
        chart=None,
    )


def _overlaps(fit: TemplateFit, frame: WallFrame, rough: Recess) -> bool:
    """Whether the middle of a rectangle lies in an opening that was found."""
    corners = frame.local(np.asarray(fit.geometry["corners"]))[:, [0, 2]]
    middle = rough.corners().mean(axis=0)
    inside = (middle > corners.min(axis=0)).all() and (middle < corners.max(axis=0)).all()
    return bool(inside) and fit.status is not FeatureStatus.NONE


_MOST_POINTS = 20_000
_LEVEL_POINTS = 4000  # of a level plane, that say where it is

Each = Callable[[Callable[[int], list[TemplateFit]], Iterable[int]], list[list[TemplateFit]]]


def find_openings(
    surfaces: Sequence[MergedSurface],
    observations: Sequence[Observation],
    owners: Sequence[NDArray[np.int32]],
    up: FloatArray,
    *,
    given: Given | None = None,
    kinds: Sequence[str] = OPENINGS,
    each: Each | None = None,
    is_assigned: bool = True,
) -> list[TemplateFit]:
    """Return doorways, windows and niches of upright planes, found ones first, refused ones last.

    Parameters
    ----------
    surfaces : sequence of MergedSurface
        All that were found, in the frame of the observations.
    observations : sequence of Observation
        The scans.
    owners : sequence of (rows, columns) int
        Number, from 1, of the surface that each pixel is of; 0 for none.
    up : (3,) float
        What is up in that frame.
    given : mapping, optional
        What a person knows: "width", "height", "depth", metres.
    kinds : sequence of str
        Which are wanted. A hole whose foot nobody saw may be a doorway or a window, whatever it is called.
    each : callable, optional
        Applies a function to all numbers, on threads for example.
    is_assigned : bool
        Whether they say which face each pixel is of: a number for every pixel of every scan.
    """
    walls = {number for number, _ in walls_of(surfaces, up)}
    floors = floors_of(surfaces, observations, up)

    def of_wall(number: int) -> list[TemplateFit]:
        surface = surfaces[number]
        if number not in walls:
            return []
        points = surface.points(observations, _MOST_POINTS)
        wall = Wall(surface.fit, points, number + 1, owners)
        return list(find_openings_in(wall, observations, up, floors, given or {}, is_assigned=is_assigned))

    numbers = range(len(surfaces))
    openings = [of_wall(number) for number in numbers] if each is None else each(of_wall, numbers)
    return _each_once([fit for fits in openings for fit in fits if fit.kind in kinds or _may_be(fit, kinds)])


def _may_be(fit: TemplateFit, kinds: Sequence[str]) -> bool:
    return fit.kind != "niche" and "bottom" in fit.unseen and bool({"doorway", "window"} & set(kinds))


def walls_of(surfaces: Sequence[MergedSurface], up: FloatArray) -> list[tuple[int, MergedSurface]]:
    """Return the upright planes that enough points were measured of, with their numbers, from 0.

    `up` (3,) is what is up in their frame.
    """
    return [
        (number, surface)
        for number, surface in enumerate(surfaces)
        if surface.n_pixels >= limits.LEAST_WALL_POINTS
        and isinstance(surface.fit.surface, Plane)
        and surface.fit.inclination(up).is_upright
    ]


def floors_of(
    surfaces: Sequence[MergedSurface], observations: Sequence[Observation], up: FloatArray
) -> list[Floor]:
    """Return the level planes that people stand on, by `up` (3,).

    What stands on a floor is none: seats, beds and tables lie within the outline of a lower level, less than
    a person's height above it. Neither is what is narrow, as a sill.
    """
    frame = np.linalg.svd(up[None])[2][1:]  # two directions along the ground
    sampled = [
        (surface, surface.points(observations, _LEVEL_POINTS))
        for surface in surfaces
        if _is_level(surface, up)
    ]
    wide = [pair for pair in sampled if _is_wide(pair[1] @ frame.T)]
    points = [floor_points for _, floor_points in wide]
    height = [float(np.median(point @ up)) for point in points]
    plans = [point @ frame.T for point in points]
    few = [plan[:: max(1, len(plan) // limits.LEAST_LEVEL_POINTS)] for plan in plans]

    def stands(k: int) -> bool:
        return any(
            limits.FLOOR_M < height[k] - height[j] < limits.DOOR_M and _share_within(few[k], plans[j]) > 0.5
            for j in range(len(wide))
        )

    return [
        Floor(surface.fit, floor_points) for k, (surface, floor_points) in enumerate(wide) if not stands(k)
    ]


def _is_wide(plan: FloatArray) -> bool:
    """Whether places (n, 2) fill a square of three cells somewhere."""
    column, row = np.floor((plan - plan.min(axis=0)) / limits.FLOOR_CELL_M).astype(np.int64).T
    filled = np.zeros((row.max() + 1, column.max() + 1), dtype=np.bool_)
    filled[row, column] = True
    return bool(ndimage.binary_erosion(filled, np.ones((3, 3))).any())


def _share_within(plan: FloatArray, other: FloatArray) -> float:
    """The share of places (n, 2) that lie within the convex hull of others (m, 2)."""
    hull = cv2.convexHull(other.astype(np.float32))[:, 0].astype(np.float64)
    edge = np.roll(hull, -1, axis=0) - hull
    away = plan[:, None] - hull
    side = edge[:, 0] * away[..., 1] - edge[:, 1] * away[..., 0]
    return float(((side >= 0).all(axis=1) | (side <= 0).all(axis=1)).mean())


def _is_level(surface: MergedSurface, up: FloatArray) -> bool:
    plane = surface.fit.surface
    faces_up = isinstance(plane, Plane) and float(plane.normal_direction @ up) > 0
    return faces_up and surface.fit.inclination(up).is_level


def _each_once(fits: Sequence[TemplateFit]) -> list[TemplateFit]:
    """The fits, best first, without those of a parallel plane that are the same hole.

    Of refused ones those go whose middle lies in one that is found.
    """
    kept: list[TemplateFit] = []
    for fit in best_first(fits):
        if not any(_is_same(fit, other) for other in kept):
            kept.append(fit)
    return kept


def _is_same(fit: TemplateFit, other: TemplateFit) -> bool:
    """Whether two holes look the same way, near one plane, and share more than a fifth of the smaller one.

    Of a found one and a refused one the middle of the refused one must lie within the other.
    """
    if other.status is FeatureStatus.NONE and fit.status is not FeatureStatus.NONE:
        return False
    into, beyond = np.asarray(fit.geometry["into"]), np.asarray(other.geometry["into"])
    if float(into @ beyond) < limits.SAME_WAY:
        return False
    corners_here, corners = np.asarray(fit.geometry["corners"]), np.asarray(other.geometry["corners"])
    if abs(float((corners_here.mean(axis=0) - corners.mean(axis=0)) @ beyond)) >= limits.SAME_M:
        return False
    u, v = corners[1] - corners[0], corners[3] - corners[0]
    at = (corners_here - corners[0]) @ np.column_stack(
        [u / (u @ u), v / (v @ v)]
    )  # in the other's width and height
    if fit.status is FeatureStatus.NONE:
        return bool((np.abs(at.mean(axis=0) - 0.5) < 0.5).all())
    low, high = at.min(axis=0), at.max(axis=0)
    shared = np.prod(np.clip(np.minimum(high, 1.0) - np.maximum(low, 0.0), 0.0, None))
    return bool(shared > limits.SHARED_AREA * min(1.0, float(np.prod(high - low))))


def find_openings_of_scans(
    scans: Sequence[RangeImage],
    openings: ScanSurfaces,
    kinds: Sequence[str],
    given: Mapping[str, Given],
    *,
    steps: Steps,
    up: FloatArray,
) -> tuple[list[TemplateFit], list[str]]:
    """Return the openings of registered scans, and doubts about poses and recesses; world coordinates.

    Parameters
    ----------
    scans : sequence of RangeImage
        Registered.
    openings : ScanSurfaces
        Their surfaces, those of completion.
    kinds : sequence of str
        Of "doorway", "window", "niche". What nobody saw the foot of may be a doorway or a window.
    given : mapping
        What a person knows of each kind.
    steps : Steps
        Where to run.
    up : (3,) float
        The direction that is up in their world.
    """
    surfaces, observations, owners = openings.surfaces, openings.observations, openings.evidence(steps).owners
    world_from_reference = scans[0].world_from_sensor

    # 1. Find: what is known of a kind holds for all that are sought with it.
    up = up @ world_from_reference.rotation
    fits: list[TemplateFit] = []
    for asked_kinds, known in _alike(kinds, given):

        def each(work: Callable[[int], list[TemplateFit]], numbers: Iterable[int]) -> list[list[TemplateFit]]:
            return steps.each("openings", work, numbers)

        fits += find_openings(surfaces, observations, owners, up, given=known, kinds=asked_kinds, each=each)

    # 2. World: what was found in the frame of the first scan; points are those that came back, in turn.
    valid = np.concatenate([scan.valid.ravel() for scan in scans])
    pose = world_from_reference
    moved = [
        replace(
            fit,
            geometry=moved_geometry(fit, pose.rotation, pose.translation),
            assignment=fit.assignment[valid],
        )
        for fit in fits
    ]
    is_any = any(fit.status is not FeatureStatus.NONE for fit in moved)
    doubts = pose_doubts(openings.registration)
    return moved, doubts if is_any else [*doubts, _why_none(surfaces, observations, up)]


def _alike(kinds: Sequence[str], given: Mapping[str, Given]) -> list[tuple[list[str], Given]]:
    """Kinds of which the same is known, together."""
    groups: dict[tuple[tuple[str, float], ...], list[str]] = {}
    for kind in kinds:
        groups.setdefault(tuple(sorted(given.get(kind, {}).items())), []).append(kind)
    return [(group, dict(known)) for known, group in groups.items()]


def _why_none(surfaces: Sequence[MergedSurface], observations: Sequence[Observation], up: FloatArray) -> str:
    """What was looked at, and how shallow a recess would not have been told."""
    walls = walls_of(surfaces, up)
    if not walls:
        return "no upright plane was found: openings are sought in walls"
    away = np.concatenate(
        [
            seen.scan.ranges.ravel()[subset]
            for _, surface in walls
            for seen, subset in surface.sampled_by(observations, 200)
        ]
    )
    far = float(np.median(away[np.isfinite(away)]))
    sd = float(np.max([seen.noise.deviation(np.array([far]))[0] for seen in observations]))
    shallow = 1000 * max(limits.ON_FACE_SD * sd, limits.LEAST_NICHE_M)
    return (
        f"no opening was found in {len(walls)} upright planes, at {far:.1f} m in the median; a leaf less "
        f"than {shallow:.0f} mm behind its wall cannot be told from it there, nor a hole from which nothing "
        "came back"
    )
