# SPDX-License-Identifier: MIT
"""Record: what became of a plane that was flattened, as files hold it."""

from __future__ import annotations

from typing import Any

from completion.flattening.flat import FlatSurface, Region, RegionKind


def flat_record(one: FlatSurface) -> dict[str, Any]:
    """Return what became of a plane: metres, square metres, p of each region, most evident first."""
    regions = [(region.kind, _region_record(region)) for region in one.regions]
    return {
        "is_flattened": one.is_flattened,
        "reason": one.reason or None,
        "cell_m": one.cell_m,
        "ripple_sd_m": one.ripple_sd_m,
        "noise_sd_m": one.noise_sd_m,
        "points": one.n,
        "relief_points": one.n_relief,
        "rms_before_m": one.rms_before_m,
        "rms_after_m": one.rms_after_m,
        "ripple_before_m": one.ripple_before_m,
        "ripple_after_m": one.ripple_after_m,
        "relief": [record for kind, record in regions if kind is RegionKind.RELIEF],
        "flattened": [record for kind, record in regions if kind is RegionKind.FLATTENED],
    }


def _region_record(region: Region) -> dict[str, Any]:
    return {
        "p": region.p,
        "height_m": region.height_m,
        "sd_m": region.sd_m,
        "area_m2": region.area_m2,
        "is_cleared": region.is_cleared,
    }
