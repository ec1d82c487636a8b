# SPDX-License-Identifier: MIT
"""What flattening gives: heights or vertices, and the regions that stayed or went; and its options."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.checks import BoolArray, FloatArray, InputError, Value


class RegionKind(StrEnum):
    """What became of a region."""

    RELIEF = "relief"
    FLATTENED = "flattened"


@dataclass(frozen=True, slots=True)
class FlatRegion(Value):
    """A part of a plane that may be relief.

    Attributes
    ----------
    kind : RegionKind
        Relief that stayed, or what was flattened since a wall without relief may well show it.
    p : float
        How probably a wall of this size, with this ripple and without relief, shows such a region anywhere.
    evidence : float
        Against its being level with the plane, nats, less the price of its border.
    height_m, sd_m : float
        Its mean level over the plane, and the standard deviation of that.
    area_m2 : float
        Its area in the plane.
    is_cleared : bool
        Whether the ripple was taken from it too; else it is as it was measured.
    """

    kind: RegionKind
    p: float
    evidence: float
    height_m: float
    sd_m: float
    area_m2: float
    is_cleared: bool


@dataclass(frozen=True, slots=True, eq=False)
class FlatHeights:
    """Heights over a plane, flattened.

    Attributes
    ----------
    heights : (rows, columns) float
        Metres over the plane: 0 where it was flattened, NaN where nothing was known.
    label : (rows, columns) int
        0 for the plane, k for `regions[k - 1]` that stayed, -1 for what was not known.
    ripple : (rows, columns) float
        The ripple under plane and relief, without noise, gaps filled.
    regions : tuple of Region
        First what stayed, then what was flattened though it stood out most; by p.
    ripple_sd_m, noise_sd_m : float
        Sd of the ripple, of the noise of a cell.
    plane_m : float
        Mean of the heights that were flattened: by how much the plane given lies below them.
    reason : str
        Why nothing was done, where nothing was; else empty.
    """

    heights: FloatArray
    label: NDArray[np.int32]
    ripple: FloatArray
    regions: tuple[FlatRegion, ...]
    ripple_sd_m: float
    noise_sd_m: float
    plane_m: float
    reason: str = ""

    @property
    def kept(self) -> BoolArray:
        """Where relief stayed (rows, columns)."""
        return self.label > 0


@dataclass(frozen=True, slots=True, eq=False)
class FlatSurface(Value):
    """What became of one labelled plane of a mesh; as in `FlatHeights`.

    Attributes
    ----------
    n, n_relief : int
        Its vertices, and those of relief that stayed.
    rms_before_m, rms_after_m : float
        Distance of all its vertices from the plane, root mean square.
    ripple_before_m, ripple_after_m : float
        The same of those that are no relief.
    """

    label: int
    regions: tuple[FlatRegion, ...]
    ripple_sd_m: float
    noise_sd_m: float
    plane_m: float
    cell_m: float
    reason: str = ""
    n: int = 0
    n_relief: int = 0
    rms_before_m: float = 0.0
    rms_after_m: float = 0.0
    ripple_before_m: float = 0.0
    ripple_after_m: float = 0.0

    @property
    def is_flattened(self) -> bool:
        """Whether anything was done."""
        return not self.reason

    @property
    def doubt(self) -> str:
        """Why it is not to be trusted, where it is not; else empty."""
        if 2 * self.n_relief <= self.n:
            return ""
        share = f"{100 * self.n_relief / self.n:.0f} %"
        return f"{share} of its points stayed as relief, so that it may be the rest that is relief"

    def with_label(self, label: int) -> FlatSurface:
        """The same by another label."""
        return replace(self, label=label)

    def with_distances(self, before: FloatArray, after: FloatArray, is_relief: BoolArray) -> FlatSurface:
        """The same with what its vertices' distances (n,) from the plane were and are."""
        plain = ~is_relief
        return replace(
            self,
            n=len(before),
            n_relief=int(is_relief.sum()),
            rms_before_m=_rms(before),
            rms_after_m=_rms(after),
            ripple_before_m=_rms(before[plain]),
            ripple_after_m=_rms(after[plain]),
        )


@dataclass(frozen=True, slots=True, eq=False)
class FlattenedMesh:
    """A mesh with its planes flattened: same vertices and faces, in the same order.

    Attributes
    ----------
    vertices : (n, 3) float
        In the mesh's frame, metres.
    moved_m : (n,) float
        How far each vertex was moved.
    is_relief : (n,) bool
        Vertices of regions that stayed.
    is_held : (n,) bool
        Vertices that stayed since a face would have turned over or crossed another.
    surfaces : tuple of FlatSurface
        Of each label that is a plane.
    n_turned, n_crossing : int
        Faces that turned over, and that cross others they did not cross: counted once all is done, so that
        anything but 0 is a fault.
    """

    vertices: FloatArray
    moved_m: FloatArray
    is_relief: BoolArray
    is_held: BoolArray
    surfaces: tuple[FlatSurface, ...]
    n_turned: int
    n_crossing: int


def _rms(distance: FloatArray) -> float:
    """Root mean square, 0 of nothing."""
    return float(np.sqrt(np.mean(distance**2))) if len(distance) else 0.0


def flat_record(surface: FlatSurface) -> dict[str, Any]:
    """Return what became of a plane: metres, square metres, p of each region, most evident first."""
    regions = [(region.kind, _region_record(region)) for region in surface.regions]
    return {
        "is_flattened": surface.is_flattened,
        "reason": surface.reason or None,
        "cell_m": surface.cell_m,
        "ripple_sd_m": surface.ripple_sd_m,
        "noise_sd_m": surface.noise_sd_m,
        "points": surface.n,
        "relief_points": surface.n_relief,
        "rms_before_m": surface.rms_before_m,
        "rms_after_m": surface.rms_after_m,
        "ripple_before_m": surface.ripple_before_m,
        "ripple_after_m": surface.ripple_after_m,
        "relief": [record for kind, record in regions if kind is RegionKind.RELIEF],
        "flattened": [record for kind, record in regions if kind is RegionKind.FLATTENED],
    }


def _region_record(region: FlatRegion) -> dict[str, Any]:
    return {
        "p": region.p,
        "height_m": region.height_m,
        "sd_m": region.sd_m,
        "area_m2": region.area_m2,
        "is_cleared": region.is_cleared,
    }


@dataclass(frozen=True, slots=True, kw_only=True)
class FlatteningOptions(Value):
    """What is kept, and how finely a surface is looked at.

    Attributes
    ----------
    level : float
        Relief is kept where a wall without any would show such a region, anywhere on it, with at most this
        probability.
    cell_m : float or None
        Side of the cells of a mesh's planes, metres; None takes the spacing of the vertices.
    most_cells : int
        A plane of more cells than this gets larger ones.
    clears_relief : bool
        Whether the ripple is taken away from relief too, where the two part.
    rounding_m : float
        Difference of heights that rounding alone makes, metres: of a sensor whose ranges come in steps. What
        is no higher is no relief, however evident.
    """

    level: float = 0.01
    cell_m: float | None = None
    most_cells: int = 120_000
    clears_relief: bool = True
    rounding_m: float = 0.0

    def __post_init__(self) -> None:
        if not 0 < self.level < 1:
            raise InputError(f"the level is a probability between 0 and 1, not {self.level}")
        if self.cell_m is not None and not 0 < self.cell_m < float("inf"):
            raise InputError(f"the side of a cell is a length above 0, not {self.cell_m} m")
        if not 0 <= self.rounding_m < float("inf"):
            raise InputError(f"rounding makes heights differ by 0 m or more, not {self.rounding_m}")
        if self.most_cells < 1000:
            raise InputError(f"at least 1,000 cells are needed, not {self.most_cells}")
