# SPDX-License-Identifier: MIT
"""Cards of completions and fits: what a notebook shows of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from scenes.card.card import INFERRED, MEASURED, Card, Share
from scenes.scan.thumbnail import thumbnails

if TYPE_CHECKING:
    from completion.fitting.result import SurfaceFit
    from completion.result.completed_model import CompletedModel

_MOST_SURFACES = 6  # that are listed


def card_of_completion(completion: CompletedModel) -> Card:
    """Return measured and inferred area, the largest surfaces, and the first scan's ranges."""
    observed, inferred = completion.observed_m2, completion.hypothesised_m2
    n_scans, whole = len(completion.observations), max(observed + inferred, 1e-12)
    more = f" (+{100 * inferred / observed:.1f} %)" if observed > 0 else ""
    figures = [
        ("measured", f"{observed:.2f} m\u00b2 on {len(completion.patches)} surfaces"),
        ("inferred", f"{inferred:.2f} m\u00b2{more}, mode {completion.mode}"),
        ("inferred where a beam went through", f"{completion.free_space_violation_m2:.3f} m\u00b2"),
    ]
    figures += [
        (
            f"surface {number}",
            f"{patch.grid.surface.kind}, {_areas(patch.observed_m2, patch.hypothesised_m2)}",
        )
        for number, patch in enumerate(completion.patches[:_MOST_SURFACES], start=1)
    ]
    rest = len(completion.patches) - _MOST_SURFACES
    first = [seen.scan for seen in completion.observations[:1]]
    return Card(
        "Completion",
        first[0].name if n_scans == 1 else f"{n_scans} scans",
        figures,
        bar=(Share("measured", observed / whole, MEASURED), Share("inferred", inferred / whole, INFERRED)),
        pictures=[
            picture for scan in first for picture in thumbnails(scan.ranges, scan.colour, scan.projection)[:1]
        ],
        note=f"and {rest} more" if rest > 0 else "",
    )


def card_of_fit(fit: SurfaceFit) -> Card:
    """Return parameters with their standard deviations, residuals and how the fit was made."""
    surface = type(fit.surface).__name__.lower()
    figures = [
        (f"{name}, {_unit(name)}" if _unit(name) else name, _number(value))
        for name, value in fit.parameters().items()
    ]
    figures += [
        (f"sd of {name}", f"{_number(value)} {'deg' if name.endswith('_deg') else _deviation_unit(name)}")
        for name, value in fit.parameter_deviations().items()
    ]
    figures += [("residual, rms", f"{1000 * fit.rms:.3g} mm"), ("points", str(fit.n))]
    note = "" if fit.converged else "The last steps still moved the surface: take it with care."
    return Card("Surface fit", f"{surface}, {fit.metric}", figures, note=note)


def _areas(observed: float, inferred: float) -> str:
    return f"{observed:.2f} m\u00b2" + (f" + {inferred:.2f} m\u00b2 inferred" if inferred > 0 else "")


def _unit(name: str) -> str:
    """Unit of a parameter by its name; directions and truth values have none."""
    if name in ("point", "centre", "apex") or name.endswith("radius"):
        return "m"
    return "deg" if name.endswith("_deg") else ""


def _deviation_unit(name: str) -> str:
    """Unit of a parameter's deviation: directions deviate by angles."""
    return "rad" if name in ("normal", "direction", "zero_direction") else "m"


def _number(value: object) -> str:
    """Return a number or a vector with six digits."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return ", ".join(f"{number:.6g}" for number in np.atleast_1d(np.asarray(value, dtype=np.float64)))
