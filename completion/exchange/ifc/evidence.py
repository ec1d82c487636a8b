# SPDX-License-Identifier: MIT
"""Evidence: what is known of an element, as the property set Unseen_Evidence, and its quantities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from completion.exchange.building.elements import Element
from completion.exchange.ifc.step_text import Ref, StepText, Typed
from scenes.checks import FloatArray

State = Literal["measured", "inferred", "partly"]
_RATIO = "IfcNormalisedRatioMeasure"
_ALL = 0.999  # share from which on something is called measured
MEASURES = {"Length": "IfcQuantityLength", "Area": "IfcQuantityArea", "Volume": "IfcQuantityVolume"}


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """What is known of an element.

    Attributes
    ----------
    surfaces : tuple of int
        Numbers of the surfaces that it consists of, as in completion.json.
    measured_share : float or None
        Of its area; None of what is no surface.
    sd_m : float or None
        Standard deviation of what it says most about: a thickness, a radius, or the place of a surface along
        its normal; None where it is not known.
    confidence : float or None
        Probability that it is there, by area; 1 where it was measured. None where nobody reckoned it.
    more : mapping
        Further properties: texts and numbers by name.
    """

    surfaces: tuple[int, ...]
    measured_share: float | None
    sd_m: float | None
    confidence: float | None
    more: Mapping[str, str | float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Quantity:
    """A length, an area or a volume: its name in the set of quantities, and its value in metres."""

    name: str
    measure: Literal["Length", "Area", "Volume"]
    value: float


def state_of(share: float) -> State:
    """Return what a measured share is called."""
    return "measured" if share >= _ALL else "inferred" if share <= 1 - _ALL else "partly"


def mean_confidence(element: Element) -> float:
    """Return the mean confidence of a surface's cells."""
    patch = element.patch
    known = patch.observed | patch.hypothesised
    return float(patch.confidence[known].mean()) if known.any() else 0.0


def deviation_at(element: Element, place: FloatArray) -> float | None:
    """Return a surface's standard deviation along its normal at a place (3,); None where it is not known."""
    sd = element.sd_m(place)
    return sd if np.isfinite(sd) else None


def property_set(file: StepText, key: str, known: Evidence) -> Ref:
    """Return the property set of what is known of an element."""
    values = [("Surfaces", Typed("IfcText", ", ".join(map(str, known.surfaces))))]
    if known.measured_share is not None:
        values.append(("State", Typed("IfcLabel", state_of(known.measured_share))))
        values.append(("MeasuredShare", Typed(_RATIO, _ratio(known.measured_share))))
    if known.confidence is not None:
        values.append(("Confidence", Typed(_RATIO, _ratio(known.confidence))))
    if known.sd_m is not None and np.isfinite(known.sd_m):
        values.append(("StandardDeviation_mm", Typed("IfcReal", 1e3 * known.sd_m)))
    for name, value in known.more.items():
        typed = Typed("IfcText", value) if isinstance(value, str) else Typed("IfcReal", float(value))
        values.append((name, typed))
    single = [file.add("IfcPropertySingleValue", [name, None, value, None]) for name, value in values]
    identifier = file.guid(f"{key} evidence")
    return file.add("IfcPropertySet", [identifier, None, "Unseen_Evidence", None, single])


def quantity_set(file: StepText, key: str, name: str, quantities: Sequence[Quantity]) -> Ref:
    """Return a set of quantities."""
    found = [
        file.add(MEASURES[one.measure], [one.name, None, None, one.value, None], alone=True)
        for one in quantities
    ]
    identifier = file.guid(f"{key} quantities")
    return file.add("IfcElementQuantity", [identifier, None, name, None, None, found])


def _ratio(share: float) -> float:
    return min(max(share, 0.0), 1.0)
