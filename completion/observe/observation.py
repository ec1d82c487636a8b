# SPDX-License-Identifier: MIT
"""Observations: scans prepared for completion, sets of their pixels, and the key frames of a sequence."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from completion.observe.limits import FINER, NEW_SHARE
from completion.observe.mixed_pixels import NO_MIXED, MixedBeams, find_mixed
from completion.observe.range_noise import RangeNoise, estimate_noise
from completion.observe.rays import Noise, Rays, pick_points, pick_rays, rays_of
from completion.observe.shadow import NO_SHADOW, Shadow, find_shadow, shadow_of
from scenes.checks import BoolArray, FloatArray, IntArray, Value
from scenes.pose import Pose
from scenes.run.mapping import trim
from scenes.scan.projection import Projection, SphericalProjection
from scenes.scan.range_image import RangeImage


@dataclass(frozen=True, slots=True, eq=False)
class Observation(Value):
    """A scan in the frame that completion works in.

    Attributes
    ----------
    scan : RangeImage
        The scan, its pose relative to the working frame.
    noise : RangeNoise
        Its range noise.
    rays : Rays
        Its rays, for compiled loops.
    pose_error_m : float
        How far its pose may be off, metres; 0 of a single scan.
    shadow : Shadow
        Where a second device stands that must see a place too.
    mixed : MixedBeams
        Beams that are not in the scan any more, since each met two surfaces, and how far they got.
    """

    scan: RangeImage
    noise: RangeNoise
    rays: Rays
    pose_error_m: float = 0.0
    shadow: Shadow = NO_SHADOW
    mixed: MixedBeams = NO_MIXED

    @property
    def is_noisy(self) -> bool:
        """Whether the ranges carry noise at all."""
        return self.noise.is_known

    @property
    def valid(self) -> BoolArray:
        """Where something came back, (rows, columns)."""
        return self.scan.valid

    def points_at(self, pixels: IntArray) -> FloatArray:
        """Measured points (n, 3) of flat pixels (n,), metres; NaN where nothing came back."""
        out = np.empty((len(pixels), 3))
        pick_points(self.rays, self.scan.ranges, np.ascontiguousarray(pixels, dtype=np.int64), out)
        return out

    def rays_at(self, pixels: IntArray) -> FloatArray:
        """Unit viewing rays (n, 3) of flat pixels (n,)."""
        out = np.empty((len(pixels), 3))
        pick_rays(self.rays, np.ascontiguousarray(pixels, dtype=np.int64), out)
        return out

    def beam_ends(self) -> FloatArray:
        """How far beams got (rows, columns), metres: as measured, or before both surfaces; inf: unknown."""
        if not len(self.mixed.pixels):
            return self.scan.ranges
        ends = self.scan.ranges.copy()
        ends.ravel()[self.mixed.pixels] = self.mixed.passed
        ends.setflags(write=False)
        return ends

    def sigma_at(self, pixels: IntArray) -> FloatArray:
        """What ranges of flat pixels (n,) may stray by from a flat surface, metres; 0 for no return."""
        return self.noise.deviation(self.scan.ranges.ravel()[pixels])


def observe(
    scan: RangeImage,
    world_from_reference: Pose,
    sigma_m: float | None = None,
    projector_m: float | None = None,
) -> Observation:
    """Prepare `scan` in the frame that `world_from_reference` leads out of.

    Parameters
    ----------
    scan : RangeImage
        The scan as read.
    world_from_reference : Pose
        Motion out of the working frame; that of a scan at this very pose is its sensor frame, to the bit.
    sigma_m : float, optional
        Range noise in metres; when None, the scan's own `sigma_m` or, without one, an estimate from the
        scan: the roughness of small tiles, most of which are flat.
    projector_m : float, optional
        Where a triangulating camera's projector stands on its x axis, metres, to the right when positive; 0
        for none; when None, it is read off the scan (`find_shadow`).
    """
    pose, members = Pose.identity(), scan.world_from_sensor
    if not np.array_equal(members.matrix, world_from_reference.matrix):
        pose = world_from_reference.inverse() @ members
    moved = scan.with_facts(world_from_sensor=pose)
    known = scan.sigma_m if sigma_m is None else sigma_m
    noise = estimate_noise(moved) if known is None else RangeNoise(float(known), 0.0)
    hidden = 0.0 if noise.is_triangulated else noise.step_m  # whose bends hold it otherwise
    noise = replace(noise, common_m=max(scan.step_m, hidden) / np.sqrt(12))
    shadow = find_shadow(moved) if projector_m is None else shadow_of(projector_m)
    mixed = find_mixed(moved.ranges, noise.numbers())
    beams = MixedBeams.of(moved.ranges, mixed)
    if mixed.any():
        moved = _without(moved, mixed)
    return Observation(moved, noise, rays_of(moved), shadow=shadow, mixed=beams)


def _without(scan: RangeImage, mixed: BoolArray) -> RangeImage:
    """The scan without some pixels (rows, columns), and with a word about it."""
    share = int(np.count_nonzero(mixed)) / int(np.count_nonzero(scan.valid))
    text = (
        f"{share:.1%} of its ranges lie between two surfaces, since beams are wider than a pixel or the "
        "image was interpolated; they are left out"
    )
    ranges = np.where(mixed, np.inf, scan.ranges)
    return replace(scan, ranges=ranges, warnings=(*scan.warnings, text))


@dataclass(frozen=True, slots=True, eq=False)
class LabelledBeams:
    """Measured beams from one place, with the number, from 1, of the surface that each met; 0 for none."""

    rays: Rays  # of the scan
    noise: Noise  # of its ranges
    ranges: FloatArray  # (rows, columns) metres
    pixel: NDArray[np.int32]  # (n,) flat pixel of each
    label: NDArray[np.int32]  # (n,) surface of each

    @classmethod
    def of(cls, observation: Observation, label: NDArray[np.int32]) -> LabelledBeams:
        """All beams of a scan, from labels (rows, columns)."""
        return cls._of_pixels(observation, np.arange(label.size, dtype=np.int32), label.ravel())

    @classmethod
    def at(cls, observation: Observation, pixel: NDArray[np.int32]) -> LabelledBeams:
        """The beams of flat pixels (n,), all of one surface, the first."""
        return cls._of_pixels(observation, pixel, np.ones(len(pixel), np.int32))

    @classmethod
    def _of_pixels(
        cls, seen: Observation, pixel: NDArray[np.int32], label: NDArray[np.int32]
    ) -> LabelledBeams:
        return cls(seen.rays, seen.noise.numbers(), seen.scan.ranges, pixel, label)

    def subsample(self, step: int) -> LabelledBeams:
        """Every step-th beam."""
        return replace(self, pixel=self.pixel[::step], label=self.label[::step])

    def of_surfaces(self, numbers: NDArray[np.int64]) -> LabelledBeams:
        """Return all beams that met the surfaces of these numbers (k,), from 1."""
        chosen = np.flatnonzero(np.isin(self.label, numbers))
        return replace(self, pixel=self.pixel[chosen], label=self.label[chosen])


@dataclass(frozen=True, slots=True, eq=False)
class PixelSet(Value):
    """Some pixels of an image of `shape`, (rows, columns)."""

    flat: NDArray[np.int32]  # (n,) row * columns + column, ascending
    shape: tuple[int, int]

    @classmethod
    def of(cls, mask: BoolArray) -> PixelSet:
        """Return the pixels of a mask (rows, columns)."""
        return cls(np.flatnonzero(mask).astype(np.int32), (mask.shape[0], mask.shape[1]))

    @classmethod
    def by_label(cls, labels: NDArray[np.int32], n_labels: int) -> list[PixelSet]:
        """Return the pixels of each label 1..n_labels of an image (rows, columns), in one pass."""
        narrow = labels.ravel().astype(
            np.uint16 if n_labels < 2**16 else np.uint32
        )  # 16 bits sort in linear time
        order = np.argsort(narrow, kind="stable").astype(np.int32)
        ends = np.cumsum(np.bincount(narrow, minlength=n_labels + 1))
        shape = (labels.shape[0], labels.shape[1])
        return [cls(order[ends[k - 1] : ends[k]].copy(), shape) for k in range(1, n_labels + 1)]

    @classmethod
    def union(cls, sets: Sequence[PixelSet], shape: tuple[int, int]) -> PixelSet:
        """Return the pixels (n,) of all sets of one image, of whose pixels none is in two."""
        none = np.zeros(0, np.int32)
        return cls(np.sort(np.concatenate([none, *(pixel_set.flat for pixel_set in sets)])), shape)

    def __len__(self) -> int:
        """How many there are."""
        return len(self.flat)

    @property
    def mask(self) -> BoolArray:
        """Where they are, (rows, columns)."""
        mask = np.zeros(self.shape, dtype=np.bool_)
        mask.ravel()[self.flat] = True
        return mask

    def pick(self, image: NDArray[Any]) -> NDArray[Any]:
        """Return their values (n, ...) of an image (rows, columns, ...)."""
        return np.asarray(image.reshape(-1, *image.shape[2:])[self.flat])


@dataclass(frozen=True, slots=True, eq=False)
class ScanPixels(Value, Sequence[PixelSet]):
    """Some pixels in each of n scans, of which only those are kept that have any."""

    held: tuple[tuple[int, PixelSet], ...]  # by scan, ascending
    shapes: NDArray[np.int32]  # (n, 2) rows and columns of each scan

    @classmethod
    def of(cls, sets: Sequence[PixelSet]) -> ScanPixels:
        """Return the pixels of all scans, from those of each."""
        shapes = np.array([pixel_set.shape for pixel_set in sets], np.int32).reshape(-1, 2)
        return cls(tuple((scan, pixel_set) for scan, pixel_set in enumerate(sets) if len(pixel_set)), shapes)

    @property
    def n_pixels(self) -> int:
        """How many there are in all scans together."""
        return sum(len(pixel_set) for _, pixel_set in self.held)

    def __len__(self) -> int:
        """How many scans there are."""
        return len(self.shapes)

    @overload
    def __getitem__(self, scan: int) -> PixelSet: ...

    @overload
    def __getitem__(self, scan: slice) -> tuple[PixelSet, ...]: ...

    def __getitem__(self, scan: int | slice) -> PixelSet | tuple[PixelSet, ...]:
        """Return the pixels of a scan by its number, or of several."""
        if isinstance(scan, slice):
            return tuple(self[number] for number in range(len(self))[scan])
        number = range(len(self))[scan]
        place = bisect_left(self.held, number, key=lambda pair: pair[0])
        if place < len(self.held) and self.held[place][0] == number:
            return self.held[place][1]
        rows, columns = self.shapes[number].tolist()
        return PixelSet(np.zeros(0, np.int32), (rows, columns))


FEW = 64
"""Scans up to which each is a key frame."""

_ACROSS = 40  # pixels along the longer side of an image that are looked at, about
_CELLS_ACROSS = 16  # into which the view of the longer side is cut at the median range


def find_key_frames(observations: Sequence[Observation]) -> tuple[int, ...]:
    """Return the numbers, ascending, of the scans that show something new; all of them where they are few.

    Scans are taken in their order. One is a key frame if more than a fifth of what it measured is new: no key
    frame before it measured something in the same cell of space, from the same of six sides, and half as
    finely at least. Cells are as wide as a sixteenth of the view at the median range of all scans. With four
    fifths known, most of what is seen at all is in several key frames.
    """
    if len(observations) <= FEW:
        return tuple(range(len(observations)))
    pixels = [_some_pixels(seen) for seen in observations]
    far = np.concatenate([_ranges(seen, pixel) for seen, pixel in zip(observations, pixels, strict=True)])
    if not len(far):
        return tuple(range(len(observations)))
    angle = np.median([_view_angle(seen.scan.projection) for seen in observations])
    size, keys, finest = float(np.median(far) * angle / _CELLS_ACROSS), [], dict[tuple[int, ...], float]()
    for number, (seen, pixel) in enumerate(zip(observations, pixels, strict=True)):
        footprint = (_ranges(seen, pixel) * seen.scan.projection.pixel_angle).tolist()
        cells = list(map(tuple, _cells(seen, pixel, size).tolist()))
        known = [finest.get(cell, np.inf) for cell in cells]
        new = [width * FINER < before for width, before in zip(footprint, known, strict=True)]
        if sum(new) > NEW_SHARE * len(new):
            keys.append(number)
            for cell, width in zip(cells, footprint, strict=True):
                finest[cell] = min(finest.get(cell, np.inf), width)
    return tuple(keys)


def _view_angle(projection: Projection) -> float:
    """Angle across the longer side of an image, radians; a scanner's pixels may be far from square."""
    if isinstance(projection, SphericalProjection):
        return float(max(np.ptp(projection.azimuths), np.ptp(projection.elevations)))
    return max(projection.shape) * projection.pixel_angle


def _some_pixels(seen: Observation) -> IntArray:
    """Flat pixels (n,) that brought something back, evenly over the image."""
    trim()
    rows, columns = seen.scan.shape
    step = max(max(rows, columns) // _ACROSS, 1)
    flat = np.arange(step // 2, rows, step)[:, None] * columns + np.arange(step // 2, columns, step)
    return np.asarray(flat[np.isfinite(seen.scan.ranges.ravel()[flat])])


def _ranges(seen: Observation, subset: IntArray) -> FloatArray:
    trim()
    return np.asarray(seen.scan.ranges.ravel()[subset])


def _cells(seen: Observation, pixels: IntArray, size: float) -> NDArray[np.int64]:
    """The cell of each point (n, 4): where it is, and from which side it is seen."""
    rays = seen.rays_at(pixels)
    axis = np.argmax(np.abs(rays), axis=1)
    side = 2 * axis + (rays[np.arange(len(rays)), axis] > 0)
    place = np.floor(seen.points_at(pixels) / size)
    return np.concatenate([place, side[:, None]], axis=1).astype(np.int64)
