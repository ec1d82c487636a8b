# SPDX-License-Identifier: MIT
"""Beams through a design: which face each ended on, which bodies it passed, and before which it was stopped.

Each beam is cast at the design, and again behind each crossing, until a little behind what it measured. It
belongs to the face before it from which it ended least far. A body of an element on which it did not end it
passed, or it ended in, or was stopped before, where the design has that element first (Tuttas et al. 2017,
section 4.2, tell the same of cells).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from completion.asbuilt import limits
from completion.asbuilt.faces import DesignFaces
from completion.observe.observation import Observation
from completion.observe.rays import Rays, dot, minus, pick_rays, plus, ray_at
from scenes.checks import BoolArray, FloatArray, IntArray
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.rays.raycast import RayCaster
from scenes.run.mapping import trim
from scenes.run.memory import in_blocks
from texture.engine.compiled import compiled, inlined

EXTRA, NO_RETURN, NOT_USED = -1, -2, -3
"""Labels of beams beside the surface ids of elements that they ended on."""

_BLOCK = 1 << 16  # beams at a time


class Surfaces(NamedTuple):
    """A design as compiled loops read it: m triangles, F faces."""

    normal: FloatArray  # (m, 3) of triangles
    element: NDArray[np.int32]  # (m,) surface id
    face: NDArray[np.int32]  # (m,) -1 for none
    is_open: BoolArray  # (m,) of no closed body: seen from both sides
    is_sheet: BoolArray  # (m,) of an element that is no body: what is behind it has passed it
    is_solid: BoolArray  # (m,) not see-through
    centre: FloatArray  # (F, 3)
    axis: FloatArray  # (F, 3) normal of planes, direction of cylinders
    radius: FloatArray  # (F,) 0 of planes, negative of holes

    @classmethod
    def of(
        cls, mesh: LabelledMesh, faces: DesignFaces, is_closed: BoolArray, *, is_part: bool = False
    ) -> Surfaces:
        """Return the surfaces of a mesh whose triangles (m,) belong to closed bodies or not.

        Of a part the faces are its elements.
        """
        look = mesh.appearance
        opaque = np.ones(len(mesh.faces), np.bool_)
        if look is not None and look.opacity is not None:
            opaque = look.opacity >= limits.SEE_THROUGH
        return cls(
            normal=mesh.face_normals(),
            element=mesh.face_surface,
            face=faces.of_triangle,
            is_open=~is_closed,
            is_sheet=~is_closed | is_part,
            is_solid=opaque,
            centre=faces.centre,
            axis=faces.normal,
            radius=faces.sign * faces.radius,
        )


class Gates(NamedTuple):
    """Lengths within which beams agree with a design, metres."""

    near_m: float
    far_m: float
    gate_m: float
    beyond_m: float
    before_m: float
    at_once_m: float
    behind_m: float
    step_m: float
    registration: tuple[float, float]  # metres, radians
    most_sigma_m: float
    nearer: float = limits.NEARER

    @classmethod
    def of(cls, scale: float, registration: tuple[float, float]) -> Gates:
        """Return the gates of a design of a scale, for poses of some standard deviation (m, rad)."""
        return cls(
            near_m=limits.NEAR_M * scale,
            far_m=limits.FAR_M * scale,
            gate_m=limits.GATE_M * scale,
            beyond_m=limits.BEYOND_M * scale,
            before_m=limits.BEFORE_M * scale,
            at_once_m=limits.AT_ONCE_M * scale,
            behind_m=limits.BEHIND_M * scale,
            step_m=limits.STEP_M * scale,
            registration=registration,
            most_sigma_m=limits.MOST_SIGMA_M * scale,
        )


class Evidence(NamedTuple):
    """What beams of one scan say of E elements, F faces, and beam by beam.

    `on`, `through`, `hidden` (E,) and `reach` (F,), area that could be met, are square metres, `n_beams` (E,)
    counts. Of each of n beams `face` is the one it belongs to, -1 for none, -2 - f for one that is farther
    off; `label` an element or one of `EXTRA`, `NO_RETURN`, `NOT_USED`; `passed` the last element that it went
    through, -1 for none; `area` what it stands for at the place where it ended, across it, square metres.
    """

    on: FloatArray
    through: FloatArray
    hidden: FloatArray
    n_beams: NDArray[np.int64]
    reach: FloatArray
    face: NDArray[np.int32]
    label: NDArray[np.int32]
    passed: NDArray[np.int32]
    area: NDArray[np.float32]


def trace(
    seen: Observation,
    pixels: IntArray,
    caster: RayCaster,
    surfaces: Surfaces,
    gates: Gates,
    *,
    n_elements: int,
    no_return_is_free: bool = False,
    n_threads: int | None = None,
) -> Evidence:
    """Cast the beams of flat pixels (n,) of a scan through the design, and weigh what they say."""
    trim()
    n, n_faces = len(pixels), len(surfaces.centre)
    face, label, passed = (np.full(n, -1, np.int32) for _ in range(3))
    area = np.zeros(n, np.float32)
    noise = seen.noise.constant_m, seen.noise.linear, seen.noise.quadratic_per_m
    ranges, sums = seen.scan.ranges.ravel(), dict[int, tuple[FloatArray, FloatArray]]()
    stride = np.sqrt(ranges.size / max(n, 1)) if n < ranges.size else 1.0

    def weigh(part: slice) -> None:
        chosen = np.ascontiguousarray(pixels[part], dtype=np.int64)
        measured = ranges[chosen].copy()
        if no_return_is_free:
            measured[~np.isfinite(measured)] = 1e6
        crossings = _cross(caster, seen.rays, chosen, measured, surfaces, gates)
        of_elements, of_faces = np.zeros((4, n_elements)), np.zeros(n_faces)
        out = face[part], label[part], passed[part], area[part]
        _weigh(
            seen.rays, chosen, measured, noise, surfaces, gates, crossings, stride, of_elements, of_faces, out
        )
        sums[part.start] = of_elements, of_faces

    in_blocks(n, weigh, n_threads, _BLOCK)
    of_elements, of_faces = np.zeros((4, n_elements)), np.zeros(n_faces)
    for start in sorted(sums):
        of_elements += sums[start][0]
        of_faces += sums[start][1]
    on, through, hidden, count = of_elements
    return Evidence(
        on=on, through=through, hidden=hidden, n_beams=count.astype(np.int64), reach=of_faces,
        face=face, label=label, passed=passed, area=area,
    )  # fmt: skip


class _Crossings(NamedTuple):
    """Crossings of n beams with the design: triangles (n, 5), -1 behind the last, and distances, metres."""

    triangle: NDArray[np.int32]
    distance: FloatArray


def _cross(
    caster: RayCaster,
    rays: Rays,
    pixels: NDArray[np.int64],
    measured: FloatArray,
    surfaces: Surfaces,
    gates: Gates,
) -> _Crossings:
    """Cast beams from crossing to crossing; those that end on their first face, or far before it, once."""
    ways = np.empty((len(pixels), 3))
    pick_rays(rays, pixels, ways)
    triangle = np.full((len(pixels), limits.MOST_CROSSINGS), -1, np.int32)
    distance = np.full((len(pixels), limits.MOST_CROSSINGS), np.inf)
    left, origin = np.flatnonzero(np.isfinite(measured)), np.array(rays.origin)
    reached = np.zeros(len(left))
    for wave in range(limits.MOST_CROSSINGS):
        if not len(left):
            break
        along = ways[left]
        hits = caster.first_hit(origin + along * reached[:, None], along)
        reached = reached + hits.ranges
        is_near = hits.hit & (reached <= measured[left] + gates.behind_m)
        kept = np.flatnonzero(is_near if wave else hits.hit)
        triangle[left[kept], wave], distance[left[kept], wave] = hits.face[kept], reached[kept]
        if wave == 0:
            off = np.abs(measured[left] - reached) * np.where(hits.hit, hits.incidence_cosine, 1.0)
            is_near &= (off > gates.at_once_m) | (surfaces.face[hits.face] < 0)
        left, reached = left[is_near], reached[is_near]
        reached = reached + gates.step_m
    return _Crossings(triangle, distance)


@compiled
def _weigh(
    rays: Rays,
    pixels: NDArray[np.int64],
    measured: FloatArray,
    noise: tuple[float, float, float],
    surfaces: Surfaces,
    gates: Gates,
    crossings: _Crossings,
    stride: float,
    of_elements: FloatArray,
    of_faces: FloatArray,
    out: tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int32], NDArray[np.float32]],
) -> None:
    """Weigh beams; add areas on, through, hidden and counts to (4, E), what could be met to (F,)."""
    face, label, passed, area = out
    columns = rays.right.size
    most = crossings.triangle.shape[1]
    for k in range(pixels.size):
        r = measured[k]
        face[k], label[k], passed[k], area[k] = -1, NO_RETURN, -1, 0.0
        if not np.isfinite(r):
            continue
        sigma = np.sqrt(noise[0] ** 2 + (noise[1] * r) ** 2 + (noise[2] * r * r) ** 2)
        if sigma > gates.most_sigma_m:
            label[k] = NOT_USED
            continue
        row, column = pixels[k] // columns, pixels[k] % columns
        way = ray_at(rays, row, column)
        angle = _solid_angle(rays, row, column) * stride * stride
        area[k] = r * r * angle
        posed = np.sqrt(gates.registration[0] ** 2 + (gates.registration[1] * r) ** 2)
        gate = limits.GATE_SIGMAS * np.sqrt(sigma * sigma + posed * posed) + gates.gate_m
        best, nearest = _nearest(rays, way, r, crossings, k, surfaces, gates, of_faces, angle)
        own = -1
        if best >= 0:
            if nearest <= gates.near_m:
                face[k] = best
                own = _element_of(surfaces, crossings, k, best)
                label[k] = own
            else:
                face[k] = -2 - best
        if own < 0:
            label[k] = EXTRA
            closest = gate
            for j in range(most):
                t = crossings.triangle[k, j]
                if t < 0:
                    break
                off = abs(crossings.distance[k, j] - r) * abs(_slope(surfaces.normal, t, way))
                if off <= closest:
                    closest, label[k] = off, surfaces.element[t]
            if label[k] >= 0:
                face[k] = -1
        for j in range(most):
            t = crossings.triangle[k, j]
            if t < 0:
                break
            entry = crossings.distance[k, j]
            e = surfaces.element[t]
            if e == own or not surfaces.is_solid[t]:
                continue
            slope = _slope(surfaces.normal, t, way)
            if slope > 0.0 and not surfaces.is_open[t]:
                continue
            leave, is_known = entry, surfaces.is_sheet[t]
            for i in range(j + 1, most):
                other = crossings.triangle[k, i]
                if other < 0:
                    break
                if surfaces.element[other] == e and _slope(surfaces.normal, other, way) > 0.0:
                    leave, is_known = crossings.distance[k, i], True
                    break
            cosine = max(abs(slope), limits.LEAST_COSINE)
            met = entry * entry * angle / cosine
            if r < entry - gate / cosine - gates.before_m:
                if j == 0:
                    of_elements[2, e] += met
                    of_elements[3, e] += 1
            elif is_known and r > _behind_body(entry, leave, gate / cosine, gates.beyond_m):
                of_elements[1, e] += met
                of_elements[3, e] += 1
                passed[k] = e
            elif label[k] == e:
                of_elements[0, e] += met
                of_elements[3, e] += 1


@inlined
def _behind_body(entry: float, leave: float, gate: float, beyond_m: float) -> float:
    """Range from which on a beam has passed a body: of a thick one nearly to its back."""
    deep = limits.BODY_SHARE * (leave - entry)
    return entry + deep if deep >= gate + beyond_m else leave + gate + beyond_m


@inlined
def _slope(normals: FloatArray, t: int, way: tuple[float, float, float]) -> float:
    """Cosine between a triangle's normal and a ray: negative where the ray comes from outside."""
    return float(normals[t, 0] * way[0] + normals[t, 1] * way[1] + normals[t, 2] * way[2])


@inlined
def _element_of(surfaces: Surfaces, crossings: _Crossings, k: int, face: int) -> int:
    """The element of a face that a beam crosses."""
    for j in range(crossings.triangle.shape[1]):
        t = crossings.triangle[k, j]
        if t >= 0 and surfaces.face[t] == face:
            return int(surfaces.element[t])
    return -1


@inlined
def _nearest(
    rays: Rays,
    way: tuple[float, float, float],
    r: float,
    crossings: _Crossings,
    k: int,
    surfaces: Surfaces,
    gates: Gates,
    of_faces: FloatArray,
    angle: float,
) -> tuple[int, float]:
    """The face that a beam ended nearest to, of those that it meets from before, and how near, metres."""
    best, nearest = -1, gates.far_m
    place = plus(rays.origin, r, way)
    for j in range(crossings.triangle.shape[1]):
        t = crossings.triangle[k, j]
        if t < 0:
            break
        f = surfaces.face[t]
        slope = _slope(surfaces.normal, t, way)
        cosine = abs(slope)
        if f < 0 or cosine < limits.LEAST_COSINE or (slope > 0.0 and not surfaces.is_open[t]):
            continue
        centre = surfaces.centre[f, 0], surfaces.centre[f, 1], surfaces.centre[f, 2]
        away = minus(place, centre)
        axis = surfaces.axis[f, 0], surfaces.axis[f, 1], surfaces.axis[f, 2]
        along = dot(away, axis)
        if surfaces.radius[f] != 0.0:
            along = np.sqrt(max(dot(away, away) - along * along, 0.0)) - abs(surfaces.radius[f])
        t_met = crossings.distance[k, j]
        if (t_met - r) * cosine <= gates.near_m:
            of_faces[f] += t_met * t_met * angle / cosine
        if abs(along) < (nearest if best < 0 else gates.nearer * nearest):
            best, nearest = f, abs(along)
    return best, nearest


@inlined
def _solid_angle(rays: Rays, row: int, column: int) -> float:
    """Solid angle of a pixel, steradians, from its neighbours' rays."""
    rows, columns = rays.scale.size, rays.right.size
    at = _grid_ray(rays, row, column)
    down = _grid_ray(rays, row + 1 if row + 1 < rows else row - 1, column) if rows > 1 else at
    right = _grid_ray(rays, row, column + 1 if column + 1 < columns else column - 1) if columns > 1 else at
    a = down[0] - at[0], down[1] - at[1], down[2] - at[2]
    b = right[0] - at[0], right[1] - at[1], right[2] - at[2]
    if rows < 2 or columns < 2:
        return dot(a, a) + dot(b, b)
    x, y, z = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    return float(np.sqrt(x * x + y * y + z * z))


@inlined
def _grid_ray(rays: Rays, row: int, column: int) -> tuple[float, float, float]:
    """The unit ray of a pixel by the projection, sensor frame."""
    x, y, z = rays.scale[row] * rays.right[column], rays.down[row], rays.scale[row] * rays.forward[column]
    length = 1.0 / np.sqrt(x * x + y * y + z * z)
    return x * length, y * length, z * length
