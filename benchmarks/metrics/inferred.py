# SPDX-License-Identifier: MIT
"""Inferred area as arrays, whatever method made it: places evenly spread, areas by stratum, calibration."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from benchmarks.metrics.truth import SAME_WAY, Stratum, TrueChart
from completion.evidence.chart_grid import ChartGrid
from scenes.checks import BoolArray, FloatArray, InputError, check_faces, check_points, frozen_copy
from scenes.scan.range_image import RangeImage
from scenes.surfaces.surface import Opening


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """Inferred area as a triangle mesh, world coordinates.

    `vertices`, `faces` (n, 3) float, (m, 3) int: metres. Raises InputError: arrays for another number of
    faces, or a face that names no surface or no reason.
    """

    vertices: FloatArray
    faces: NDArray[np.int32]
    surface: NDArray[np.int32]  # (m,) int: Number of the inferred surface that each face belongs to, from 0
    sd: FloatArray  # (m,) float: Predicted standard deviation along the normal, metres
    confidence: FloatArray  # (m,) float: Predicted probability that there is such surface, 0..1
    # (k,) int: For each inferred surface the id of the true one that it continues, -1 for none
    true_surface: NDArray[np.int32]
    openings: tuple[Opening, ...] = ()  # openings that were found; they name inferred surfaces
    # (m,) int: Why each face is inferred: index into `reasons`; the first for all when not given
    reason: NDArray[np.int32] | None = None
    reasons: tuple[str, ...] = ("inferred",)  # what the reasons are called

    def __post_init__(self) -> None:
        vertices = check_points("vertices", self.vertices)
        object.__setattr__(self, "vertices", frozen_copy(vertices))
        object.__setattr__(self, "faces", frozen_copy(check_faces(self.faces, len(vertices))))
        if self.reason is None:
            object.__setattr__(self, "reason", np.zeros(len(self.faces), np.int32))
        kinds = {"surface": np.int32, "sd": np.float64, "confidence": np.float64, "reason": np.int32}
        for name, dtype in kinds.items():
            array = np.asarray(getattr(self, name), dtype=dtype)
            if array.shape != (len(self.faces),):
                raise InputError(f"expected {name} with shape ({len(self.faces)},), got {array.shape}")
            object.__setattr__(self, name, frozen_copy(array))
        object.__setattr__(self, "true_surface", frozen_copy(self.true_surface, np.int32))
        _check_names("surfaces", self.surface, len(self.true_surface))
        _check_names("reasons", self.face_reason, len(self.reasons))

    @property
    def face_reason(self) -> NDArray[np.int32]:
        """Why each face is inferred: index (m,) into `reasons`."""
        return np.zeros(len(self.faces), np.int32) if self.reason is None else self.reason


def _check_names(what: str, named: NDArray[np.int32], n: int) -> None:
    if len(named) and not 0 <= named.min() <= named.max() < n:
        raise InputError(f"faces name {what} {named.min()}..{named.max()} of {n}")


def mesh_of_cells(grid: ChartGrid, filled: BoolArray) -> tuple[FloatArray, NDArray[np.int32]]:
    """Return the cells of a chart as triangles: vertices (4 n, 3) and faces (2 n, 3)."""
    row, column = (index.astype(np.float64) for index in np.nonzero(filled))
    ring = [(row, column), (row, column + 1), (row + 1, column + 1), (row + 1, column)]
    corners = np.stack([grid.uv_of(r, c) for r, c in ring], axis=1)
    start = 4 * np.arange(len(row), dtype=np.int32)[:, None]
    faces = np.concatenate([start + [0, 1, 2], start + [0, 2, 3]])
    return grid.surface.from_uv(corners.reshape(-1, 2)), faces.astype(np.int32)


def hypothesis_of_mesh(
    mesh: tuple[FloatArray, NDArray[np.int64]], charts: Sequence[TrueChart], sd_m: float = 0.002,
    confidence: float = 0.9,
) -> Hypothesis:  # fmt: skip
    """Return a mesh, vertices (n, 3) in world coordinates and faces (m, 3), as inferred area.

    Each face belongs to the nearest true surface of its direction within 5 cm of its centroid, or to none.
    A method states no deviation and no confidence: both are constants.
    """
    vertices, faces = np.asarray(mesh[0], dtype=np.float64), np.asarray(mesh[1], dtype=np.int32)
    corners = vertices[faces].reshape(-1, 3, 3)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    apart = np.stack([chart.distances(corners.mean(axis=1), normals) for chart in charts])
    nearest = np.where(np.isfinite(apart.min(axis=0)), apart.argmin(axis=0), len(charts))
    return Hypothesis(
        vertices=vertices, faces=faces, surface=nearest.astype(np.int32), sd=np.full(len(faces), sd_m),
        confidence=np.full(len(faces), confidence),
        true_surface=np.array([*(chart.surface for chart in charts), -1], np.int32),
    )  # fmt: skip


def continued_surfaces(
    owners: Sequence[NDArray[np.int32]], scans: Sequence[RangeImage], n_inferred: int
) -> NDArray[np.int32]:
    """Return for each inferred surface the true one that most of its pixels lie on, -1 without pixels.

    `owners`: for each scan the number of the inferred surface of each pixel, from 1; 0 for none. `scans`:
    those without truth say nothing. `n_inferred`: how many surfaces were inferred.
    """
    result, most = np.full(n_inferred, -1, np.int32), np.zeros(n_inferred, np.int64)
    known = [
        (owner, scan.truth.surface)
        for owner, scan in zip(owners, scans, strict=True)
        if scan.truth is not None
    ]
    n_true = 1 + max((int(surface.max(initial=-1)) for _, surface in known), default=-1)
    count = np.zeros((n_inferred + 1, n_true + 1), np.int64)
    for owner, surface in known:
        np.add.at(count, (owner.ravel(), surface.ravel()), 1)
    if n_true:
        result, most = count[1:, :n_true].argmax(axis=1).astype(np.int32), count[1:, :n_true].max(axis=1)
    return np.where(most > 0, result, -1).astype(np.int32)


_MOST_PIECES = 64  # along an edge of a triangle that is cut up


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Places of inferred area.

    `points`, `normals` (n, 3) float: metres; unit normals. `sd`, `confidence` (n,) float: as predicted.
    """

    points: FloatArray
    normals: FloatArray
    # (n,) float: Square metres that each stands for; what lies in several layers is divided among them
    areas: FloatArray
    surface: NDArray[np.int32]  # (n,) int32: Number of the inferred surface
    sd: FloatArray
    confidence: FloatArray
    reason: NDArray[np.int32]  # (n,) int32: Why it is inferred, as in the hypothesis


def sample(hypothesis: Hypothesis, cell_m: float) -> Samples:
    """Sample inferred area, about once in every `cell_m` x `cell_m`, always at the same places.

    Faces are cut into pieces that fit a cell; of the pieces of one surface in one voxel of that size the
    means are taken. Where several surfaces lie within a cell of each other, and parallel, their area is
    divided among them, so that overlapping layers count once.
    """
    corners = hypothesis.vertices[hypothesis.faces]
    pieces, face = _cut_up(corners, cell_m)
    spans = np.cross(pieces[:, 1] - pieces[:, 0], pieces[:, 2] - pieces[:, 0])
    areas = np.linalg.norm(spans, axis=1) / 2
    kept = areas > 0
    pieces, face, areas, spans = pieces[kept], face[kept], areas[kept], spans[kept]
    centres = pieces.mean(axis=1)
    voxels = np.column_stack([hypothesis.surface[face], np.floor(centres / cell_m).astype(np.int64)])
    first, voxel = _same_rows(voxels)
    total = np.bincount(voxel, areas)

    def mean(values: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(voxel, values * areas) / total, dtype=np.float64)

    summed = np.stack([np.bincount(voxel, spans[:, i].copy()) for i in range(3)], axis=1).astype(np.float64)
    normals = summed / np.maximum(np.linalg.norm(summed, axis=1, keepdims=True), 1e-300)
    points = np.stack([mean(centres[:, i]) for i in range(3)], axis=1)
    surface = hypothesis.surface[face][first]
    layers = _layers(points, normals, surface, cell_m)
    confidence, sd = mean(hypothesis.confidence[face]), mean(hypothesis.sd[face])
    reason = hypothesis.face_reason[face][first]
    return Samples(
        points=points,
        normals=normals,
        areas=total / layers,
        surface=surface,
        sd=sd,
        confidence=confidence,
        reason=reason,
    )


def _same_rows(rows: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First index of each different row of integers, and for each row the number of those like it."""
    if not len(rows):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    key = np.zeros(len(rows), np.int64)
    for column in rows.T:
        key = key * (int(np.ptp(column)) + 1) + (column - column.min())
    _, first, number = np.unique(key, return_index=True, return_inverse=True)
    return first, number.reshape(-1)


def _cut_up(corners: FloatArray, cell_m: float) -> tuple[FloatArray, NDArray[np.int64]]:
    """Cut triangles (m, 3, 3) into similar ones with edges of at most a cell; and whose piece each is."""
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    n_pieces = np.clip(np.ceil(edges.max(axis=1, initial=0) / cell_m), 1, None).astype(np.int64)
    large = n_pieces > _MOST_PIECES
    if large.any():  # in two rounds, so that no lattice gets out of hand
        halves, of_half = _lattice(corners[large], _MOST_PIECES)
        pieces, of_piece = _cut_up(np.concatenate([corners[~large], halves]), cell_m)
        origin = np.concatenate([np.flatnonzero(~large), np.flatnonzero(large)[of_half]])
        return pieces, origin[of_piece]
    parts, owners = [np.zeros((0, 3, 3))], [np.zeros(0, np.int64)]
    for n in np.unique(n_pieces):
        chosen = np.flatnonzero(n_pieces == n)
        pieces, of_piece = _lattice(corners[chosen], int(n))
        parts.append(pieces)
        owners.append(chosen[of_piece])
    return np.concatenate(parts), np.concatenate(owners)


def _lattice(corners: FloatArray, n: int) -> tuple[FloatArray, NDArray[np.int64]]:
    """Cut each triangle into n^2 similar ones."""
    i, j = (index.ravel() for index in np.mgrid[:n, :n])
    up, down = i + j < n, i + j < n - 1
    weights = np.concatenate([
        np.stack([_weights(i[up] + a, j[up] + b, n) for a, b in ((0, 0), (1, 0), (0, 1))], axis=1),
        np.stack([_weights(i[down] + a, j[down] + b, n) for a, b in ((1, 1), (0, 1), (1, 0))], axis=1),
    ])  # fmt: skip
    pieces = np.einsum("pcw,mwx->mpcx", weights, corners).reshape(-1, 3, 3)
    return pieces, np.repeat(np.arange(len(corners)), n * n)


def _weights(i: NDArray[np.int64], j: NDArray[np.int64], n: int) -> FloatArray:
    return np.stack([n - i - j, i, j], axis=-1) / n


def _layers(points: FloatArray, normals: FloatArray, surface: NDArray[np.int32], cell_m: float) -> FloatArray:
    """How many surfaces lie parallel within a cell of each sample, its own counted."""
    layers = np.ones(len(points))
    members = [np.flatnonzero(surface == number) for number in np.unique(surface)]
    trees = [cKDTree(points[member]) for member in members]
    for one, mine in enumerate(members):
        for other, theirs in enumerate(members):
            if one == other or _cross(normals[mine], normals[theirs]):
                continue
            low, high = points[theirs].min(axis=0) - cell_m, points[theirs].max(axis=0) + cell_m
            asked = mine[((points[mine] >= low) & (points[mine] <= high)).all(axis=1)]
            near, index = trees[other].query(points[asked], distance_upper_bound=cell_m)
            met = np.flatnonzero(np.isfinite(near))
            cosine = np.einsum("ij,ij->i", normals[asked[met]], normals[theirs[index[met]]])
            layers[asked[met[np.abs(cosine) >= SAME_WAY]]] += 1
    return layers


def _cross(one: FloatArray, other: FloatArray) -> bool:
    """Tell whether both are flat and not parallel."""
    flat = all(bool((np.abs(normals @ normals[0]) > 1 - 1e-6).all()) for normals in (one, other))
    return flat and abs(float(one[0] @ other[0])) < SAME_WAY


TOLERANCES_M = (0.01, 0.02, 0.05)
HEADLINE = 1  # index of the tolerance that headline figures use
N_STRATA = max(Stratum) + 1


@dataclass(frozen=True, slots=True, eq=False)
class Tally:
    """Square metres."""

    hidden: FloatArray  # (...,) float: Reachable hidden area of the true surfaces
    found: FloatArray  # (..., 3) float: Of it, what was inferred within each of `TOLERANCES_M`
    # (...,) float: Inferred area that was hidden from the scans, or that they looked through
    claimed: FloatArray
    right: FloatArray  # (..., 3) float: Of it, what lies on a true surface within each of `TOLERANCES_M`

    @classmethod
    def zeros(cls, shape: tuple[int, ...]) -> Tally:
        """Return the empty tally."""
        n = len(TOLERANCES_M)
        return cls(np.zeros(shape), np.zeros((*shape, n)), np.zeros(shape), np.zeros((*shape, n)))

    def __add__(self, other: Tally) -> Tally:
        return Tally(
            self.hidden + other.hidden,
            self.found + other.found,
            self.claimed + other.claimed,
            self.right + other.right,
        )

    def pooled(self, surfaces: ArrayLike | None = None, strata: ArrayLike | None = None) -> Tally:
        """Return the sum over these rows (surfaces) and columns (strata), all of them when not given."""
        n_rows, n_columns = self.hidden.shape
        rows = np.arange(n_rows) if surfaces is None else np.atleast_1d(np.asarray(surfaces, dtype=np.int64))
        columns = np.arange(n_columns) if strata is None else np.atleast_1d(np.asarray(strata, np.int64))
        chosen = np.ix_(rows, columns)
        parts = (
            values[chosen].sum(axis=(0, 1)) for values in (self.hidden, self.found, self.claimed, self.right)
        )
        return Tally(*parts)

    @property
    def recall(self) -> FloatArray:
        """Share of the hidden area that was found, for each tolerance; NaN where nothing is hidden."""
        return _ratio(self.found, self.hidden[..., None])

    @property
    def precision(self) -> FloatArray:
        """Share of the claimed area that is right, for each tolerance; NaN where nothing was claimed."""
        return _ratio(self.right, self.claimed[..., None])

    @property
    def f1(self) -> FloatArray:
        """Harmonic mean of precision and recall."""
        return _ratio(2 * self.precision * self.recall, self.precision + self.recall)

    @property
    def iou(self) -> FloatArray:
        """Found area over hidden area and wrongly claimed area together; NaN where there is neither."""
        wrong = self.claimed[..., None] - self.right
        return _ratio(self.found, self.hidden[..., None] + wrong)


def total(tallies: Iterable[Tally], shape: tuple[int, ...] = ()) -> Tally:
    """Return the sum of tallies."""
    return sum(tallies, Tally.zeros(shape))


def _ratio(part: FloatArray, whole: FloatArray) -> FloatArray:
    whole = np.broadcast_to(whole, part.shape)
    ratio: FloatArray = np.divide(part, whole, out=np.full(part.shape, np.nan), where=whole > 0)
    return ratio


N_BINS = 10


@dataclass(frozen=True, slots=True, eq=False)
class Reliability:
    """Predicted confidence against what came true, weighted by area.

    `area`, `predicted`, `right` (..., 10) float: for each tenth of the confidence scale: square metres, and
    those times confidence and times truth.
    """

    area: FloatArray
    predicted: FloatArray
    right: FloatArray
    # (...,) float: Square metres times the squared difference between confidence and truth
    squared: FloatArray

    @classmethod
    def of(cls, confidence: FloatArray, right: BoolArray, areas: FloatArray) -> Reliability:
        """Return the reliability of n places with confidences (n,), which were right or not (n,)."""
        tenth = np.clip((confidence * N_BINS).astype(np.int64), 0, N_BINS - 1)

        def binned(weight: FloatArray) -> FloatArray:
            return np.asarray(np.bincount(tenth, weight, N_BINS), dtype=np.float64)

        return cls(
            binned(areas),
            binned(areas * confidence),
            binned(areas * right),
            np.asarray(np.sum(areas * np.square(confidence - right)), dtype=np.float64),
        )

    def __add__(self, other: Reliability) -> Reliability:
        return Reliability(
            self.area + other.area,
            self.predicted + other.predicted,
            self.right + other.right,
            self.squared + other.squared,
        )

    @property
    def brier(self) -> FloatArray:
        """Mean squared difference between confidence and truth, NaN without area (Brier 1950)."""
        return self._share(self.squared)

    @property
    def error(self) -> FloatArray:
        """Expected calibration error: mean |confidence - frequency| over the bins, NaN without area."""
        return self._share(np.abs(self.predicted - self.right).sum(axis=-1))

    def _share(self, part: FloatArray) -> FloatArray:
        area = self.area.sum(axis=-1)
        share: FloatArray = np.divide(part, area, out=np.full(np.shape(area), np.nan), where=area > 0)
        return share


def no_reliability() -> Reliability:
    """Return the reliability of nothing."""
    return Reliability(np.zeros(N_BINS), np.zeros(N_BINS), np.zeros(N_BINS), np.zeros(()))


@dataclass(frozen=True, slots=True)
class ReasonClaims:
    """What was inferred for one reason: how much, how much of it is right, and how sure it was.

    `claimed_m2`, `right_m2`: square metres.
    """

    reason: str  # its name
    claimed_m2: float
    right_m2: float
    predicted_m2: float  # claimed square metres times predicted confidence


@dataclass(frozen=True, slots=True)
class SurfaceErrors:
    """How one inferred surface's errors compare with what it predicted."""

    area_m2: float  # its claimed area
    sd_m: float  # median predicted standard deviation, metres
    within: float  # share of its area no farther than twice that from a true surface, whichever that is
    # share no farther than that from the unbounded surface that it continues; NaN if it continues none
    within_own: float


@dataclass(frozen=True, slots=True)
class DeviationBin:
    """Surfaces of similar predicted deviation: how many, the median and how much lies within two of it."""

    n_surfaces: int
    sd_m: float
    within: float
    within_own: float


def deviation_bins(surfaces: Iterable[SurfaceErrors], n_bins: int = 4) -> list[DeviationBin]:
    """Return surfaces in `n_bins` classes of predicted deviation, each surface counting once."""
    ordered = sorted(surfaces, key=lambda surface: surface.sd_m)
    chunks = [ordered[i * len(ordered) // n_bins : (i + 1) * len(ordered) // n_bins] for i in range(n_bins)]
    return [summary(chunk) for chunk in chunks if chunk]


def summary(surfaces: Iterable[SurfaceErrors]) -> DeviationBin:
    """Return the surfaces as one class; NaN where there are none."""
    rows = list(surfaces)
    own = [row.within_own for row in rows if np.isfinite(row.within_own)]
    if not rows:
        return DeviationBin(0, float("nan"), float("nan"), float("nan"))
    return DeviationBin(
        len(rows),
        float(np.median([row.sd_m for row in rows])),
        float(np.mean([row.within for row in rows])),
        float(np.mean(own)) if own else float("nan"),
    )


@dataclass(frozen=True, slots=True)
class PairCounts:
    """Pairs of parts, or things found: right, wrong and missed ones."""

    right: int = 0
    wrong: int = 0
    missed: int = 0

    def __add__(self, other: PairCounts) -> PairCounts:
        return PairCounts(self.right + other.right, self.wrong + other.wrong, self.missed + other.missed)

    @property
    def precision(self) -> float:
        """Share of what was found that is right, NaN where nothing was found."""
        found = self.right + self.wrong
        return self.right / found if found else float("nan")

    @property
    def recall(self) -> float:
        """Share of what there is that was found, NaN where there is nothing."""
        there = self.right + self.missed
        return self.right / there if there else float("nan")

    @property
    def f1(self) -> float:
        """Harmonic mean of precision and recall, NaN where there is and was found nothing."""
        weight = 2 * self.right + self.wrong + self.missed
        return 2 * self.right / weight if weight else float("nan")


def merge_counts(
    scans: Sequence[RangeImage],
    owners: Sequence[NDArray[np.int32]],
    scored: Sequence[bool],
    min_pixels: int = 200,
) -> PairCounts:
    """Count pairs of visible parts by whether they are one surface and were found to be one.

    A part is a connected piece of a true surface's pixels in one scan. Right pairs are of one true and one
    found surface, wrong ones of one found but two true surfaces, missed ones the other way round.
    `scans`: with truth. `owners`: number of the found surface of each pixel, from 1; 0 for none. `scored`:
    which true surfaces count. `min_pixels`: smaller parts do not count.
    """
    true, found = [], []
    for scan, owner in zip(scans, owners, strict=True):
        if scan.truth is None:
            continue
        for surface in np.unique(scan.truth.surface[scan.truth.surface >= 0]):
            if not scored[surface]:
                continue
            part, n_parts = ndimage.label(scan.truth.surface == surface, structure=np.ones((3, 3)))
            sizes = np.bincount(part.ravel(), minlength=n_parts + 1)
            for number in 1 + np.flatnonzero(sizes[1:] >= min_pixels):
                true.append(int(surface))
                found.append(int(np.bincount(owner[part == number]).argmax()))
    same_true = np.equal.outer(true, true)
    same_found = np.equal.outer(found, found) & (np.array(found, dtype=np.int64) > 0)[:, None]
    pair = np.triu(np.ones_like(same_true), 1).astype(np.bool_)
    return PairCounts(
        int((pair & same_true & same_found).sum()),
        int((pair & ~same_true & same_found).sum()),
        int((pair & same_true & ~same_found).sum()),
    )
