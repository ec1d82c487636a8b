# SPDX-License-Identifier: MIT
"""Range noise: how a sensor's error grows with the range, read off the roughness of a scan's flat tiles."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.optimize import nnls
from scipy.special import gammaincinv

from completion.observe.limits import FACING_COSINE, FEWEST_TILES
from completion.observe.rays import Noise, Rays, deviations, rays_of
from completion.observe.tiles import cut_tiles
from scenes.checks import FloatArray, Value, read_only_view
from scenes.scan.range_image import RangeImage

_WINDOW = 9
_N_RANGE_BINS = 12  # of a triangulating camera's tiles, as many in each
_CAMERA_TILE = 7
_SCANNER_TILE = 3  # pixels of a laser scanner may be decimetres apart: larger tiles are flat nowhere
_PER_OCTAVE = 2  # range bins of a laser scanner
_ENOUGH = 1 << 20  # pixels that tell the noise of a scan
_MICRON = 1e-6
_ROUNDING = 1e-16  # m2: what files' own digits leave


@dataclass(frozen=True, slots=True, eq=False)
class RangeNoise(Value):
    """Standard deviation of the range: sqrt(constant^2 + (linear r)^2 + (quadratic r^2)^2), metres.

    A laser scanner measures time or phase, whose error hardly depends on the range: constant, with a slope
    where echoes grow weak. A triangulating camera's error grows with the square of the distance (Khoshelham &
    Elberink 2012). One of the two growing terms is 0.
    """

    constant_m: float
    quadratic_per_m: float
    linear: float = 0.0
    step_m: float = (
        0.0  # between the values that ranges take, at the median range, where that hides the noise
    )
    farthest_m: float = 0.0  # range up to which it was read off a scan; 0 where it was given
    common_m: float = 0.0  # of all points of a plane alike: coordinates rounded in the file

    @property
    def is_known(self) -> bool:
        """Whether there is any noise."""
        return max(self.constant_m, self.quadratic_per_m, self.linear) > 0

    @property
    def is_triangulated(self) -> bool:
        """Whether a scan showed that its noise is that of a disparity: far away that is most of it."""
        return self.window_pixels(self.farthest_m) > 1

    def sigma(self, ranges: FloatArray) -> FloatArray:
        """Standard deviation (n,) of single ranges (n,), metres."""
        near = np.hypot(self.constant_m, self.linear * np.asarray(ranges))
        return np.asarray(np.hypot(near, self.quadratic_per_m * np.square(ranges)))

    def bias(self, ranges: FloatArray) -> FloatArray:
        """Common error (n,) of neighbouring ranges (n,) to a flat wall, metres.

        Triangulating cameras bend flat walls by as much as their noise or twice as much, since both come
        from errors of the disparity: on walls before five such cameras, means over blocks of 10 x 10 pixels
        scatter by 1.1 to 2 standard deviations of the noise. Coordinates that a file rounds to steps move
        a plane along an axis by up to half a step as a whole (Widrow & Kollar 2008: a step over sqrt(12)).
        """
        bend = 2.0 * self.quadratic_per_m * np.square(ranges)
        return np.asarray(np.hypot(bend, self.common_m), dtype=np.float64)

    def window_pixels(self, reach: float) -> int:
        """Pixels along the side of the window whose average a range at this distance is; 1 for a single ray.

        Cameras whose error grows with the square of the distance find a disparity by matching windows, about
        9 pixels wide (Konolige & Mihelich 2011): on tables before four such cameras the residuals'
        autocorrelation falls in a line to nothing at 8 to 9 pixels.
        """
        return _WINDOW if self.quadratic_per_m * reach**2 > self.constant_m else 1

    def deviation(self, ranges: FloatArray) -> FloatArray:
        """Expected error (n,) of single ranges (n,) to a flat wall, metres: noise and typical bias.

        0 where nothing came back.
        """
        return deviations(self.numbers(), ranges)

    def numbers(self, bulge: float = 0.0) -> Noise:
        """Return the expected error of single ranges to a flat wall for compiled loops: noise, typical bias.

        And `bulge` times the range, by which what is not quite flat strays.
        """
        return Noise(self.constant_m, float(np.hypot(bulge, self.linear)), self.quadratic_per_m)


def estimate_noise(scan: RangeImage) -> RangeNoise:
    """Estimate the range noise from the roughness of a scan's tiles, by the law of its kind of sensor.

    Tiles that hold an edge are rougher than the noise, so each range bin takes the lower quartile, corrected
    to the mean of flat tiles. Depths that come in steps add a twelfth of the step's square, which tiles
    inside one step cannot show; the small tiles of a scanner are taken to show it where they are rougher.

    A pinhole camera is taken to triangulate: variances are fitted by a constant and a fourth-power term. A
    spherical scan is a laser scanner's: tiles of 3 x 3 pixels that face the scanner tell the deviation of
    each half octave of range, and the law is the one with a constant and a linear term that is nearest to
    their logarithms, by absolute differences: a bin whose surfaces are rough, as trees are, does not decide.
    A growth by some factor counts like one bin that is off by as much, since bins differ by how dark their
    surfaces are, too.
    """
    return _camera_noise(scan) if scan.projection.kind == "pinhole" else _scanner_noise(scan)


def _camera_noise(scan: RangeImage) -> RangeNoise:
    tiles = cut_tiles(scan.ranges, rays_of(scan), Noise(1.0, 0.0, 0.0), 0.0, _CAMERA_TILE)
    usable = np.isfinite(tiles.misfit)
    if usable.sum() * _CAMERA_TILE**2 < 100:
        return RangeNoise(0.0, 0.0)
    ranges, square = np.linalg.norm(tiles.centre[usable], axis=-1), tiles.misfit[usable]
    edges = np.quantile(ranges, np.linspace(0, 1, _N_RANGE_BINS + 1))
    which = np.clip(np.searchsorted(edges, ranges, side="right") - 1, 0, _N_RANGE_BINS - 1)
    bins = [b for b in range(_N_RANGE_BINS) if (which == b).sum() >= 5]
    if not bins:
        return RangeNoise(0.0, 0.0)
    middle = np.array([np.median(ranges[which == b]) for b in bins])
    rough = np.array([_quartile(square[which == b], _CAMERA_TILE) for b in bins])
    step, seen = (step[bins] for step in _steps(scan, edges, 0.0, _MICRON))
    variance = rough + step**2 / 12
    weight = 1.0 / np.maximum(variance, _ROUNDING)  # relative errors: near bins count as much as far ones
    basis = np.stack([np.ones_like(middle), middle**4], axis=1)
    terms, _ = nnls(basis * weight[:, None], variance * weight)
    # Steps that hide the noise are those, too, that the way from counts to ranges made unequal.
    constant, quadratic = (float(np.sqrt(term)) for term in terms)
    return RangeNoise(constant, quadratic, step_m=_hiding_step(seen, rough), farthest_m=float(middle.max()))


def _scanner_noise(scan: RangeImage) -> RangeNoise:
    ranges, cosine, square = _small_tiles(scan)
    if len(ranges) < FEWEST_TILES:
        return RangeNoise(0.0, 0.0)
    octave = np.floor(_PER_OCTAVE * np.log2(ranges)).astype(np.int64)
    for facing in (cosine >= FACING_COSINE, np.ones(len(ranges), np.bool_)):
        numbers, count = np.unique(octave[facing], return_counts=True)
        bins = [facing & (octave == number) for number in numbers[count >= FEWEST_TILES]]
        if bins:
            break
    else:  # no bin has enough tiles: all are one
        bins = [np.ones(len(ranges), np.bool_)]
    middle = np.array([np.median(ranges[in_bin]) for in_bin in bins])
    rough = np.array([_quartile(square[in_bin], _SCANNER_TILE) for in_bin in bins])
    edges = np.exp2(
        (octave[[int(np.flatnonzero(in_bin)[0]) for in_bin in bins]][:, None] + [0, 1]) / _PER_OCTAVE
    )
    step = np.array([_steps(scan, edge, 0.0)[0][0] for edge in edges])
    variance = np.maximum(rough, step**2 / 12)
    if np.median(variance) <= _ROUNDING:
        return RangeNoise(0.0, 0.0)
    far = float(np.quantile(scan.ranges[scan.valid], 0.99))
    constant, linear = _slow_law(middle, np.maximum(variance, _ROUNDING), far)
    return RangeNoise(constant, 0.0, linear, _hiding_step(step, rough))


def _small_tiles(scan: RangeImage) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Range, cosine of incidence and variance along the ray (n,) of full tiles; of large scans of some."""
    bands = np.arange(scan.shape[0] // _SCANNER_TILE)[:: -(-scan.ranges.size // _ENOUGH)]
    rows = (bands[:, None] * _SCANNER_TILE + np.arange(_SCANNER_TILE)).ravel()
    tiles = cut_tiles(
        scan.ranges[rows], _of_rows(rays_of(scan), rows), Noise(1.0, 0.0, 0.0), 0.0, _SCANNER_TILE
    )
    full = np.isfinite(tiles.misfit) & (tiles.count == _SCANNER_TILE**2)
    centre, plane = tiles.centre[full], tiles.plane[full]
    ranges = np.linalg.norm(centre, axis=1)
    cosine = np.abs(np.einsum("ij,ij->i", plane, centre)) / np.linalg.norm(plane, axis=1) / ranges
    return ranges, cosine, tiles.misfit[full]


def _of_rows(rays: Rays, rows: np.ndarray) -> Rays:
    points = rays.points[rows] if rays.points.shape[0] else rays.points
    return rays._replace(scale=rays.scale[rows], down=rays.down[rows], points=read_only_view(points))


def _quartile(variance: FloatArray, side: int) -> float:
    """Mean variance of flat tiles, from the lower quartile of all (chi square)."""
    freedom = side**2 - 3  # of a plane in a tile
    return float(np.quantile(variance, 0.25) * freedom / (2 * gammaincinv(freedom / 2, 0.25)))


def _slow_law(ranges: FloatArray, variance: FloatArray, far: float) -> tuple[float, float]:
    """Constant and linear term nearest to the variances (n,) at `ranges` (n,), growth up to `far` counted.

    The best of the laws that are exact at one bin or at two.
    """
    square = np.square(ranges)
    laws = [(variance_at, 0.0) for variance_at in variance]
    for i, j in combinations(range(len(ranges)), 2):
        slope = (variance[j] - variance[i]) / (square[j] - square[i])
        if slope > 0:
            laws.append((max(variance[i] - slope * square[i], 0.0), slope))
    laws_fitted = np.array(laws)
    model = np.log(laws_fitted[:, :1] + laws_fitted[:, 1:] * square)
    ends = np.square([ranges.min(), max(far, ranges.max())])
    growth = np.diff(np.log(laws_fitted[:, :1] + laws_fitted[:, 1:] * ends), axis=1)[:, 0]
    best = laws_fitted[np.argmin(np.abs(model - np.log(variance)).sum(axis=1) + growth)]
    return float(np.sqrt(best[0])), float(np.sqrt(best[1]))


def depth_step(scan: RangeImage, near_m: float, far_m: float) -> float:
    """Typical step of the depths that a scan has in an interval of ranges, metres.

    It is 0 where hardly any comes twice. Depths are along the optical axis of a camera, of other sensors
    along the ray.
    """
    edges = np.array([0.0, near_m, max(np.nextafter(far_m, np.inf), near_m), np.inf])
    return float(_steps(scan, edges, _MICRON)[0][1])


def _hiding_step(step: FloatArray, rough: FloatArray) -> float:
    """Typical of steps (n,) that are most of the roughness (n,) of most bins, 0 where they are not."""
    return float(np.median(step)) if np.median(step**2 / 12 - rough / 2) > 0 else 0.0


def _steps(scan: RangeImage, edges: FloatArray, *equal_m: float) -> list[FloatArray]:
    """Typical steps of the depths whose ranges lie between consecutive edges; of large scans, of some rows.

    Depths are equal that are so to `equal_m`, metres: for each of these, the steps (n,) of all bins.
    """
    stretch = slice(None, None, -(-scan.ranges.size // _ENOUGH))
    valid = scan.valid[stretch]
    ranges = scan.ranges[stretch][valid]
    pinhole = scan.projection.kind == "pinhole"
    depth = scan.points_in_sensor()[stretch][valid][:, 2] if pinhole else ranges
    which = np.clip(np.searchsorted(edges, ranges, side="right") - 1, 0, len(edges) - 2)
    bins = [np.sort(depth[which == b]) for b in range(len(edges) - 1)]
    return [
        np.array([_quantisation_step(ranges_of_bin, equal) for ranges_of_bin in bins]) for equal in equal_m
    ]


def _quantisation_step(depth: FloatArray, equal_m: float) -> float:
    """Typical distance between the values that ascending depths (n,) take, 0 where hardly any comes twice.

    Depths are equal that are so to `equal_m`, metres.
    """
    depth = np.rint(depth / equal_m) * equal_m if equal_m else depth
    first = np.flatnonzero(np.diff(depth, prepend=np.nan) != 0)
    if len(first) < 2 or len(depth) < 4 * len(first):
        return 0.0
    count = np.diff(first, append=len(depth))
    common = depth[first[count >= np.median(count) / 4]]
    return float(np.median(np.diff(common))) if len(common) > 1 else 0.0
