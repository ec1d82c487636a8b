# SPDX-License-Identifier: MIT
"""Plates, each with a chart of its own, and the survey of what was measured there: holes and lost data."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from completion.features.engine.template import Measurements, PixelBeams
from completion.features.holes import limits
from completion.fitting.robust import tukey_weights
from completion.fitting.starts import orient_normals
from scenes.checks import BoolArray, FloatArray, IntArray

_MOST = 8  # plates of one input
_N_SAMPLE, _N_DRAWN = 4_000, 300  # points that vote for planes, planes tried
_N_ROUNDS = 8


@dataclass(frozen=True, slots=True, eq=False)
class HolePlate:
    """A plane with a chart, and all points in it.

    Attributes
    ----------
    origin : (3,) float
        Of the chart.
    frame : (3, 3) float
        Rows: the chart's two axes and the normal.
    uv : (n, 2) float
        Places of all points of the input in the chart.
    height : (n,) float
        Above the plane.
    is_on : (n,) bool
        Points of the plate.
    noise : float
        Standard deviation of them across it.
    """

    origin: FloatArray
    frame: FloatArray
    uv: FloatArray
    height: FloatArray
    is_on: BoolArray
    noise: float

    @property
    def slab(self) -> float:
        """Return the height within which a point is the plate's."""
        return limits.SLAB_SD * self.noise

    def space(self, uv: FloatArray) -> FloatArray:
        """Return places (n, 2) of the chart in space (n, 3)."""
        return np.asarray(self.origin + uv @ self.frame[:2])

    def chart(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the places (n, 2) of points (n, 3) in the chart, and their heights (n,)."""
        local = (points - self.origin) @ self.frame.T
        return local[:, :2], local[:, 2]


def plates(measured: Measurements, *, rng: np.random.Generator) -> Iterator[HolePlate]:
    """Yield planes with many points, the largest first.

    Consensus of oriented points (normals by local principal components), then Tukey's weights; the points of
    each are taken out before the next is sought.
    """
    points = measured.points
    if len(points) < limits.PLATE_POINTS:
        return
    noise = max(
        measured.noise, limits.EXACT_PLATE * measured.diagonal, limits.EXACT_SPACING * measured.spacing
    )
    voters = rng.permutation(len(points))[:_N_SAMPLE]
    normals, _ = orient_normals(points[voters], points)
    least = max(limits.PLATE_POINTS, limits.PLATE_SHARE * len(points))
    free: BoolArray = np.ones(len(points), dtype=np.bool_)
    for _ in range(_MOST):
        left = free[voters]
        consensus = _consensus(points[voters[left]], normals[left], limits.SLAB_SD * noise, rng=rng)
        if consensus is None:
            return
        plate = _refine_plate(points, free, *consensus, noise)
        if plate is None or (plate.is_on & free).sum() < least:
            return
        free &= ~plate.is_on
        yield plate


def _consensus(
    points: FloatArray, normals: FloatArray, slab: float, *, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray] | None:
    """A point and the normal of the plane that most of the oriented points (n, 3) agree with."""
    if len(points) < 3:
        return None
    drawn = rng.integers(len(points), size=_N_DRAWN)
    heights = points @ normals[drawn].T - np.einsum("ij,ij->i", points[drawn], normals[drawn])
    agrees = (np.abs(heights) < slab) & (np.abs(normals @ normals[drawn].T) > limits.ALIGNED)
    best = drawn[int(agrees.sum(axis=0).argmax())]
    return points[best], normals[best]


def _refine_plate(
    points: FloatArray, free: BoolArray, place: FloatArray, normal: FloatArray, noise: float
) -> HolePlate | None:
    """The plate about a plane: Tukey's weights, its scale annealed to the noise."""
    near = points[free]
    for cut in np.geomspace(4.0, 1.0, _N_ROUNDS):
        weights = tukey_weights((near - place) @ normal, cut * 1.2 * limits.SLAB_SD * noise)
        if np.count_nonzero(weights) < limits.PLATE_POINTS:
            return None
        place = weights @ near / weights.sum()
        offset = near - place
        normal = np.linalg.eigh((weights * offset.T) @ offset)[1][:, 0]
    frame = _frame((np.abs((near - place) @ normal) < limits.SLAB_SD * noise), near - place, normal)
    local = (points - place) @ frame.T
    is_on = np.abs(local[:, 2]) < limits.SLAB_SD * noise
    return HolePlate(origin=place, frame=frame, uv=local[:, :2], height=local[:, 2], is_on=is_on, noise=noise)


def _frame(is_on: BoolArray, offset: FloatArray, normal: FloatArray) -> FloatArray:
    """Rows: the longest direction of the plate's points, the one across, and the normal."""
    flat = offset[is_on]
    along = np.linalg.eigh(flat.T @ flat)[1][:, 2]
    along = along - (along @ normal) * normal
    along = along / np.linalg.norm(along)
    return np.stack([along, np.cross(normal, along), normal])


def density(uv: FloatArray) -> float:
    """Points an area where places (n, 2) lie: the median of what eight neighbours tell."""
    tree = cKDTree(uv)
    sample = uv[:: max(1, len(uv) // 2_000)]
    far = tree.query(sample, k=min(9, len(uv)))[0][:, -1]
    return float((min(9, len(uv)) - 1.5) / (np.pi * np.median(far) ** 2))


_N_POINTS = 20_000


def scatter_points(measured: Measurements, *, rng: np.random.Generator) -> Measurements:
    """Return points all over the triangles, as many an area everywhere, instead of the mesh's corners."""
    faces = measured.faces
    if faces is None or not len(faces):
        return measured
    corners = measured.points[faces]
    edges = corners[:, 1:] - corners[:, :1]
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2
    if not area.sum() > 0:
        return measured
    # even steps along the sum of areas, so that no triangle has more than its share
    steps = (np.arange(_N_POINTS) + rng.random(_N_POINTS)) / _N_POINTS * area.sum()
    face = np.minimum(np.searchsorted(area.cumsum(), steps), len(area) - 1)
    r, s = np.sqrt(rng.random(_N_POINTS)), rng.random(_N_POINTS)
    weights = np.column_stack([1 - r, r * (1 - s), r * s])
    points = np.einsum("ni,nij->nj", weights, corners[face])
    return replace(measured, points=points, spacing=0.5 * float(np.sqrt(area.sum() / _N_POINTS)), faces=None)


def rim_corners(measured: Measurements, plate: HolePlate) -> FloatArray | None:
    """Return the places (k, 2) in the plate's chart of corners where its triangles end; None without any."""
    if measured.faces is None:
        return None
    uv, height = plate.chart(measured.points)
    faces = measured.faces[(np.abs(height) < plate.slab)[measured.faces].all(axis=1)]
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    once, counts = np.unique(edges, axis=0, return_counts=True)
    return np.asarray(uv[np.unique(once[counts == 1])])


_CELL = 0.5  # spacings
_MOST_CELLS = 2_000_000
_LARGE = 12.0  # spacings: radius of circles for which fewer points suffice
_FEWEST = 1_000  # points


@dataclass(frozen=True, slots=True, eq=False)
class PlateSurvey:
    """A plate as it was measured.

    Attributes
    ----------
    plate : HolePlate
        With its chart.
    spacing : float
        The side of the square that one point of the plate has to itself.
    trees : tuple of cKDTree
        Of the plate's points (m, 2), then of every fourth of them, every sixteenth ...
    corner : (2,) float
        Of the grid's first cell.
    cell : float
        Side of a cell.
    counts : (k, l) float
        Points of the plate in each cell.
    summed : (k + 1, l + 1) float
        Points in all cells before one.
    densities : (k, l) float
        Points an area near each cell, where there is surface.
    stray : float
        Density within the plate's slab of points that are not the plate's, as a share of its own.
    area : float
        Of the box round the plate.
    """

    plate: HolePlate
    spacing: float
    trees: tuple[cKDTree, ...]
    corner: FloatArray
    cell: float
    counts: FloatArray
    summed: FloatArray
    densities: FloatArray
    stray: float
    area: float

    def density_at(self, uv: FloatArray) -> FloatArray:
        """Return points an area of the plate about places (n, 2)."""
        cell = ((uv - self.corner) / self.cell).astype(np.int64)
        cell = np.clip(cell, 0, np.array(self.counts.shape) - 1)
        return np.asarray(self.densities[tuple(cell.T)])

    def is_no_hole(self, centres: FloatArray, radii: FloatArray) -> BoolArray:
        """Tell at which places (..., 2) no hole of radii (...) can be: the plate fills it, or ends.

        Quick, by a square within the hole: a fourth of the plate's points in it are too many.
        """
        half, shape = (limits.INNER_SQUARE * radii)[..., None], np.array(self.counts.shape)
        low = np.clip(np.rint((centres - half - self.corner) / self.cell).astype(np.int64), 0, shape)
        high = np.clip(np.rint((centres + half - self.corner) / self.cell).astype(np.int64), 0, shape)
        (i, j), (k, m) = np.moveaxis(low, -1, 0), np.moveaxis(high, -1, 0)
        within = self.summed[k, m] - self.summed[i, m] - self.summed[k, j] + self.summed[i, j]
        expected = (high - low).prod(axis=-1) * (self.cell / self.spacing) ** 2
        beside = (centres < self.corner) | (centres > self.corner + shape * self.cell)
        return np.asarray(
            (within > np.maximum(limits.FEW_POINTS, limits.FULL_SHARE * expected)) | beside.any(axis=-1)
        )

    def level(self, radii: FloatArray) -> IntArray:
        """Return how often a fourth of the points suffices for circles with radii (m,)."""
        doublings = np.log2(np.maximum(radii / (_LARGE * self.spacing), 1.0)).astype(np.int64)
        return np.asarray(np.minimum(doublings, len(self.trees) - 1))

    def near(self, centres: FloatArray, reach: FloatArray, level: int = 0) -> tuple[IntArray, FloatArray]:
        """Return the plate's points within `reach` (m,) of centres (m, 2): whose they are, and offsets."""
        tree = self.trees[level]
        lists = tree.query_ball_point(centres, reach, return_sorted=False)
        sizes = np.array([len(near_points) for near_points in lists], dtype=np.int64)
        owner = np.repeat(np.arange(len(centres)), sizes)
        members = np.concatenate(
            [np.asarray(near_points, dtype=np.int64) for near_points in lists] or [owner]
        )
        return owner, np.asarray(tree.data)[members] - centres[owner]


def survey(plate: HolePlate) -> PlateSurvey:
    """Return what was measured of a plate."""
    uv = plate.uv[plate.is_on]
    overall = density(uv)
    spacing = 1 / np.sqrt(overall)
    low, high = uv.min(axis=0), uv.max(axis=0)
    cell = max(_CELL * spacing, float(np.sqrt(np.prod(high - low + spacing) / _MOST_CELLS)))
    shape = np.maximum(((high - low) / cell).astype(np.int64) + 1, 1)
    edges = [low[k] + cell * np.arange(shape[k] + 1) for k in range(2)]
    counts = np.histogram2d(uv[:, 0], uv[:, 1], bins=edges)[0]
    covered = ndimage.distance_transform_edt(counts == 0) * cell < limits.COVERED * spacing
    wide = limits.DENSITY_WIDTH * spacing / cell
    mean = ndimage.gaussian_filter(counts, wide), ndimage.gaussian_filter(covered * cell**2, wide)
    local = np.divide(mean[0], mean[1], out=np.full(counts.shape, overall), where=mean[1] > 0.02 * cell**2)
    area, stray = float(np.prod(high - low)), _stray(plate, uv)
    return PlateSurvey(
        plate=plate, spacing=spacing, trees=_trees(uv), corner=low, cell=cell, counts=counts,
        summed=np.pad(counts.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0))),
        densities=local, stray=stray, area=area,
    )  # fmt: skip


def _trees(uv: FloatArray) -> tuple[cKDTree, ...]:
    """Of places (n, 2), in an order that no grid of pixels shows in, and of ever fewer of them."""
    mixed = uv[np.random.default_rng(0).permutation(len(uv))]
    steps = 4 ** np.arange(max(1, int(np.log2(max(len(uv) / _FEWEST, 1)) / 2) + 1))
    return tuple(cKDTree(mixed[::step]) for step in steps.tolist())


def _stray(plate: HolePlate, uv: FloatArray) -> float:
    """The share of stray points, from those a few slabs above and below the plate."""
    size = np.abs(plate.height)
    beside = (size > 2 * plate.slab) & (size < 5 * plate.slab)
    inside = ((plate.uv > uv.min(axis=0)) & (plate.uv < uv.max(axis=0))).all(axis=1)
    return float(np.clip((beside & inside).sum() / 3 / len(uv), 2e-3, 0.1))


N_SECTORS = 8
_N_RAYS = 200  # places of the plate from which surfaces are counted


@dataclass(frozen=True, slots=True, eq=False)
class Openings:
    """What is measured off a plate and through it.

    Attributes
    ----------
    outward : int
        1 where the plate's normal points to its outer side, -1 against it, 0 unknown.
    off : cKDTree or None
        Of the chart's places of points off the plate.
    heights : (m,) float
        Of these points.
    crossed : cKDTree or None
        Of the places where beams crossed the plate's plane and came back from behind it.
    behind : float
        Share of the beams beyond or beside the plate's surface that came back from behind it.
    reach : float
        Of a bore's wall on either side of its rim.
    is_solid : bool
        Whether walls stand along most of the plate's edges, as those of a whole part do.
    """

    outward: int
    off: cKDTree | None
    heights: FloatArray
    crossed: cKDTree | None
    behind: float
    reach: float
    is_solid: bool = False

    def evidence(self, centres: FloatArray, radii: FloatArray, spacing: float) -> FloatArray:
        """Return log odds (m,) of holes against lost data at circles (m, 2), (m,), nats."""
        gains = self._of_beams(centres, radii, spacing) + self._of_bores(centres, radii, spacing)
        return gains - (self._without_edge(centres, radii, spacing) if self.is_solid else 0.0)

    def _of_beams(self, centres: FloatArray, radii: FloatArray, spacing: float) -> FloatArray:
        if self.crossed is None:
            return np.zeros(len(radii))
        passed = self.crossed.query_ball_point(centres, limits.INNER_BORE * radii, return_length=True)
        hoped = np.minimum(0.3 * np.pi * (limits.INNER_BORE * radii / spacing) ** 2, 1.0)
        none = np.where(passed == 0, -limits.NONE_PASSED_NATS * self.behind * hoped, 0.0)
        return np.asarray(limits.SIGN_NATS * np.minimum(passed, limits.MOST_PASSED) + none)

    def none_passed(self, centres: FloatArray, radius: float) -> bool:
        """Whether no beam went through any of circles (m, 2), though most that miss the plate come back."""
        if self.crossed is None or self.behind < 0.5:
            return False
        return not np.any(
            self.crossed.query_ball_point(centres, limits.INNER_BORE * radius, return_length=True)
        )

    def _of_bores(self, centres: FloatArray, radii: FloatArray, spacing: float) -> FloatArray:
        up, down = self.walls(centres, radii, spacing)
        gain = [
            limits.SEEN_NATS * np.maximum(side.sum(axis=1) - limits.CHANCE_SECTORS, 0) for side in (up, down)
        ]
        if self.outward == 0:
            return np.asarray(np.maximum(*gain) - np.minimum(*gain))
        outer, inner = gain if self.outward > 0 else gain[::-1]
        return np.asarray(inner - limits.BOSS_FACTOR * outer)

    def _without_edge(self, centres: FloatArray, radii: FloatArray, spacing: float) -> FloatArray:
        """What tells against holes (m,) of a whole part: sectors of their rims from which no wall goes."""
        owner, gap, height, sector = self._around(centres, radii, limits.RIM_GAP * spacing)
        near = (np.abs(gap) < limits.RIM_GAP * spacing) & (np.abs(height) < limits.RIM_BAND * spacing)
        counts = np.bincount((owner * N_SECTORS + sector)[near], minlength=len(radii) * N_SECTORS)
        bare = (counts.reshape(len(radii), N_SECTORS) == 0).sum(axis=1)
        return np.asarray(limits.SIGN_NATS * np.maximum(bare - limits.CHANCE_SECTORS, 0))

    def _around(
        self, centres: FloatArray, radii: FloatArray, beyond: float
    ) -> tuple[IntArray, FloatArray, FloatArray, IntArray]:
        """Points off the plate about circles: whose (k,), how far outside, how high, and in which sector."""
        none = np.zeros(0, dtype=np.int64)
        if self.off is None:
            return none, np.zeros(0), np.zeros(0), none
        lists = self.off.query_ball_point(centres, radii + beyond, return_sorted=False)
        owner = np.repeat(np.arange(len(radii)), [len(near_points) for near_points in lists])
        members = np.concatenate([np.asarray(near_points, dtype=np.int64) for near_points in lists] or [none])
        offset = np.asarray(self.off.data)[members] - centres[owner]
        turn = np.arctan2(offset[:, 1], offset[:, 0]) / (2 * np.pi) % 1
        sector = (turn * N_SECTORS).astype(np.int64) % N_SECTORS
        return owner, np.hypot(*offset.T) - radii[owner], self.heights[members], sector

    def walls(self, centres: FloatArray, radii: FloatArray, spacing: float) -> tuple[BoolArray, BoolArray]:
        """Return in which of 8 sectors (m, 8) a wall stands on the rim above the plate, and below it."""
        shape = (len(radii), N_SECTORS)
        owner, gap, height, sector = self._around(centres, radii, 3 * self.reach)
        near = np.abs(height) < limits.BORE_DEPTH[0] * radii[owner] + limits.BORE_DEPTH[1] * spacing
        walls = []
        for side in (1, -1):
            chosen = near & (side * height > 0)
            on = chosen & (np.abs(gap) < self.reach)
            beside = chosen & ~on & (gap > -3 * self.reach)
            counted = [np.bincount((owner * N_SECTORS + sector)[which], minlength=shape[0] * N_SECTORS)
                       for which in (on, beside)]  # fmt: skip
            walls.append((counted[0] > counted[1]).reshape(shape))
        return walls[0], walls[1]


def openings(plate: HolePlate, measured: Measurements, spacing: float) -> Openings:
    """Gather what tells holes from lost data."""
    off = np.abs(plate.height) > 1.5 * plate.slab
    beams, outward = measured.beams, 0
    crossed, behind = None, 0.0
    if beams is not None and len(beams.ranges):
        outward = int(np.sign(np.median((beams.origins - plate.origin) @ plate.frame[2])))
        crossed, behind = _through(plate, beams)
    elif off.any():
        outward = _outer_side(plate, spacing)
    tree = cKDTree(plate.uv[off]) if off.any() else None
    reach = max(limits.BORE_BAND * spacing, 3 * plate.noise)
    return Openings(
        outward=outward,
        off=tree,
        heights=plate.height[off],
        crossed=crossed,
        behind=behind,
        reach=reach,
        is_solid=beams is None and _has_walls(plate, spacing),
    )


def _has_walls(plate: HolePlate, spacing: float) -> bool:
    """Whether points near and off the plate stand along most of its edges."""
    off = (np.abs(plate.height) > 1.5 * plate.slab) & (np.abs(plate.height) < limits.RIM_BAND * spacing)
    on = plate.uv[plate.is_on]
    if not off.any() or len(on) < 9:
        return False
    # at an edge all nearest points of the plate are on one side
    near = on[cKDTree(on).query(on, k=9)[1][:, 1:]]
    lopsided = np.linalg.norm(near.mean(axis=1) - on, axis=1) > 0.5 * spacing
    if not lopsided.any():
        return False
    far = cKDTree(plate.uv[off]).query(on[lopsided])[0]
    return bool((far < spacing).mean() > limits.WALLED_SHARE)


def _through(plate: HolePlate, beams: PixelBeams) -> tuple[cKDTree | None, float]:
    """Places where beams went through the plane and came back, and how many did of those that met nothing."""
    normal = plate.frame[2]
    falling = beams.directions @ normal
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = ((plate.origin - beams.origins) @ normal) / falling
    meets = np.isfinite(reach) & (reach > 0)
    places = plate.chart(beams.origins[meets] + reach[meets, None] * beams.directions[meets])[0]
    on = plate.uv[plate.is_on]
    inside = ((places > on.min(axis=0)) & (places < on.max(axis=0))).all(axis=1)
    ranges, reach, sine = beams.ranges[meets], reach[meets], np.abs(falling[meets])
    beyond = inside & np.isfinite(ranges) & ((ranges - reach) * sine > 2 * plate.slab)
    none = inside & ~np.isfinite(ranges)
    behind = float(beyond.sum() / max((beyond | none).sum(), 1))
    return (cKDTree(places[beyond]) if beyond.any() else None), behind


def _outer_side(plate: HolePlate, spacing: float) -> int:
    """On which side no solid is: from inside, lines meet surface an odd number of times."""
    on = np.flatnonzero(plate.is_on)
    places = plate.uv[on[:: max(1, len(on) // _N_RAYS)]]
    off = np.abs(plate.height) > 1.5 * plate.slab
    lists = cKDTree(plate.uv[off]).query_ball_point(places, limits.COVERED * spacing)
    votes = np.zeros((2, 2))
    for near_points in lists:
        heights = plate.height[off][near_points]
        for row, side in enumerate((1, -1)):
            along = np.sort(side * heights[side * heights > 0])
            layers = np.split(along, np.flatnonzero(np.diff(along) > 1.5 * spacing) + 1)
            steep = any(len(layer) and np.ptp(layer) > 2 * spacing for layer in layers)
            near = len(along) and along[0] < spacing
            if not steep and not near:
                votes[row, len(layers) % 2 if len(along) else 0] += 1
    odd = votes[:, 1] / np.maximum(votes.sum(axis=1), 1)
    if max(odd) < 0.6 or abs(odd[0] - odd[1]) < 0.3:
        return 0
    return -1 if odd[0] > odd[1] else 1
