# SPDX-License-Identifier: MIT
"""Check of scans against a design, on one page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from completion.asbuilt.findings import LOA_BANDS_M, DesignCheck
from scenes.mesh.design import ElementMesh
from scenes.scan.range_image import RangeImage


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckOptions:
    """What is asked of a check.

    Attributes
    ----------
    tolerance_m : float
        T, metres.
    tolerances : mapping
        Tolerance by a pattern of "class name" as shells match files, "IfcDoor*"; the last that fits counts.
    registration : (m, deg)
        Standard deviation of each scan's pose.
    align : bool
        Whether the scans may move as a whole to fit the design; False: a control network holds.
    only, without : tuple of str
        Patterns of elements to check, and of elements that are no part of the design.
    false_alarms : float
        Expected wrong `deviates` a building.
    no_return_is_free : bool
        Whether a beam without return passed everything.
    loa_bands_m : mapping
        Names and upper ends of the bands.
    sigma_m : float, optional
        Range noise, where the scans do not tell it.
    """

    tolerance_m: float = 0.01
    tolerances: Mapping[str, float] = field(default_factory=dict)
    registration: tuple[float, float] = (0.002, 0.006)
    align: bool = True
    only: tuple[str, ...] = ()
    without: tuple[str, ...] = ()
    false_alarms: float = 0.05
    no_return_is_free: bool = False
    loa_bands_m: Mapping[str, float] = field(default_factory=lambda: LOA_BANDS_M)
    sigma_m: float | None = None


def check_against_design(
    design: ElementMesh,
    scans: Sequence[RangeImage],
    options: CheckOptions | None = None,
    *,
    n_threads: int | None = None,
) -> DesignCheck:
    """Check `scans` against `design`."""
    raise NotImplementedError
