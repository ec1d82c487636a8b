# SPDX-License-Identifier: MIT
"""Findings of a check against a design: the verdict on each element, its evidence, and what no element is.

Frames: the design's own, metres. Intervals hold with 95 %.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from scenes.checks import ArrayValue, FloatArray, Value
from scenes.mesh.design import Element, ElementMesh
from scenes.pose import Pose

Verdict = Literal["within", "deviates", "undecided", "missing", "hidden", "not seen", "not tested"]
VERDICTS: tuple[Verdict, ...] = (
    "within", "deviates", "undecided", "missing", "hidden", "not seen", "not tested"
)  # fmt: skip
"""`not tested`: material that beams pass (glass), and elements without any exposed face."""

Kind = Literal["", "offset", "tilt", "bow", "displaced", "thickness", "radius"]
"""How an element deviates; "" where it does not."""

SampleState = Literal["measured", "inferred", "unknown"]
SAMPLE_STATES: tuple[SampleState, ...] = ("measured", "inferred", "unknown")
SAMPLE_REASONS = (
    "",
    "hidden",
    "behind the design",
    "out of view",
    "out of range",
    "too oblique",
    "not met",
    "too noisy",
)
"""Why a sample was not measured, from the station that came nearest to it; "not met": beams passed it; "too
noisy": they tell nothing at their range."""

HALF_95 = 1.959964
"""Standard deviations of half a 95 % interval."""
_MOST_PLACES = 6  # behind the point
_ALONG_AXIS = 0.99995  # cosine: 0.6 deg

POINT_STATES = ("on a face", "on an element", "extra", "not compared")


@dataclass(frozen=True, slots=True, eq=False)
class Interval(Value):
    """A number with its 95 % interval, in metres or radians, and the direction that it is along."""

    value: float
    low: float
    high: float
    along: tuple[float, float, float] | None = None

    def texts(self, unit: float = 1e-3) -> tuple[str, str, str]:
        """Return value and ends in a unit (metres or radians), to two digits of the half-width.

        Examples
        --------
        >>> Interval(-0.0199, -0.0212, -0.0186).texts(), Interval(3e-4, 2.8e-4, 3.2e-4).texts()
        (('-19.9', '-21.2', '-18.6'), ('0.300', '0.280', '0.320'))
        """
        value, low, high = rounded((self.value, self.low, self.high), (self.high - self.low) / 2, unit)
        return value, low, high

    def sentence(self, unit: float = 1e-3, name: str = "mm") -> str:
        """Return it as a part of a sentence: value, unit, and both ends."""
        value, low, high = self.texts(unit)
        return f"{value} {name} (95 %: {low} to {high} {name})"

    def as_shift(self) -> tuple[Interval, str]:
        """Return a shift as a length, with the direction that it goes: "+z", or a unit vector."""
        sign = 1 if self.value >= 0 else -1
        low, high = sorted((sign * self.low, sign * self.high))
        x, y, z = way = [sign * part + 0.0 for part in self.along or (0.0, 0.0, 0.0)]
        axis = int(np.argmax(np.abs(way)))
        plain = ", ".join(f"{round(part, 2) + 0.0:.2f}" for part in way)
        named = (
            f"{'-' if way[axis] < 0 else '+'}{'xyz'[axis]}" if abs(way[axis]) > _ALONG_AXIS else f"({plain})"
        )
        return Interval(abs(self.value), low, high, (x, y, z)), named


def rounded(values: Sequence[float], half: float, unit: float = 1e-3) -> tuple[str, ...]:
    """Return values in a unit to two digits of the half-width of their interval, whole numbers at most."""
    places = 1 - int(np.floor(np.log10(half / unit))) if half > 0 else 1
    places = min(max(places, 0), _MOST_PLACES)
    return tuple(f"{round(value / unit, places) + 0.0:.{places}f}" for value in values)


@dataclass(frozen=True, slots=True)
class Hider(Value):
    """What hides an element: the name of an element or extra, from which stations, and how much of it."""

    by: str
    stations: tuple[str, ...]
    area_m2: float


@dataclass(frozen=True, slots=True)
class Shares(Value):
    """Shares of the exposed area of an element; they sum to 1."""

    measured: float
    inferred: float
    unknown: float


@dataclass(frozen=True, slots=True)
class BeamEvidence(Value):
    """Area of an element's silhouette by what beams did there, square metres, and the number of beams."""

    on_m2: float = 0.0
    through_m2: float = 0.0
    hidden_m2: float = 0.0
    n_beams: int = 0


@dataclass(frozen=True, slots=True)
class Inference(Value):
    """What a completion of the scans says of an element that is not measured; never part of a verdict.

    `share` of its unmeasured area is continued surface within the tolerance, with mean probability
    `probability`; `sentence` says so.
    """

    share: float
    probability: float
    sentence: str


@dataclass(frozen=True, slots=True, eq=False)
class FaceFinding(ArrayValue):
    """A plane or cylinder of an element, and how far what was measured is from it.

    Attributes
    ----------
    element : int
        Surface id in the design.
    kind : "plane" or "cylinder"
        Its shape.
    is_main : bool
        Whether it is among the largest faces of the element.
    centre, normal : (3,) float
        Its middle, and its outward normal there (of cylinders: the direction of the axis).
    area_m2, measured_m2 : float
        Its area, and how much of it beams measured.
    n_beams : int
        How many.
    support : float
        Share of what beams could have met that they met, 0 to 1.
    is_tested : bool
        Whether there is enough for a verdict.
    deviation : Interval, optional
        Of the corner that is farthest off, along `normal`; of cylinders: of the axis at its ends.
    offset, tilt, bow, radius : Interval, optional
        Offset of the middle, largest turn (radians), rise of the middle over its ends, change of the radius.
    rms_m : float
        Of beams about the fitted surface.
    place : (3,) float
        Where `offset` holds: the middle of what was measured of a plane, or along an axis.
    histogram : (40,) int
        Beams by deviation from the design, in 40 equal bins of `histogram_m`.
    histogram_m : (2,) float
        The first and the last edge.
    """

    element: int
    kind: Literal["plane", "cylinder"]
    is_main: bool
    centre: FloatArray
    normal: FloatArray
    area_m2: float
    measured_m2: float = 0.0
    n_beams: int = 0
    support: float = 0.0
    is_tested: bool = False
    deviation: Interval | None = None
    offset: Interval | None = None
    tilt: Interval | None = None
    bow: Interval | None = None
    radius: Interval | None = None
    rms_m: float = 0.0
    place: FloatArray = field(default_factory=lambda: np.zeros(3))
    histogram: NDArray[np.int64] = field(default_factory=lambda: np.zeros(40, np.int64))
    histogram_m: tuple[float, float] = (-0.05, 0.05)


@dataclass(frozen=True, slots=True, eq=False)
class ElementFinding(Value):
    """The verdict on one element of the design.

    Attributes
    ----------
    surface : int
        Its surface id in the design.
    element : Element
        What the file tells of it.
    verdict, kind
        What was found, and how it deviates.
    sentence : str
        The reason, in numbers.
    tolerance_m : float
        Its own.
    directions_measured : tuple of (3,)
        Unit normals of its tested main faces.
    offset, tilt, bow, thickness, radius : Interval, optional
        Of the face that decides; thickness: measured minus designed; radius: of pipes and columns.
    loa_represented, loa_measured : str
        Names of bands, "" where nothing was measured.
    share : Shares
        Of its exposed area.
    exposed_m2 : float
        That area.
    beams : BeamEvidence
        Beams at its body.
    hidden : tuple of Hider
        By what, largest first.
    not_seen : mapping
        Share of its exposed area by each reason of `SAMPLE_REASONS` that applies.
    same_as : str
        The element whose surface it has, too; "" for none. Both have the verdict on that.
    related_extra : str
        The extra that takes part in the verdict: the displaced element itself, the leaf of an open door.
    inference : Inference, optional
        What completion says.
    faces : tuple of FaceFinding
        Its planes and cylinders.
    """

    surface: int
    element: Element
    verdict: Verdict
    tolerance_m: float
    kind: Kind = ""
    sentence: str = ""
    directions_measured: tuple[tuple[float, float, float], ...] = ()
    offset: Interval | None = None
    tilt: Interval | None = None
    bow: Interval | None = None
    thickness: Interval | None = None
    radius: Interval | None = None
    loa_represented: str = ""
    loa_measured: str = ""
    share: Shares = Shares(0.0, 0.0, 1.0)
    exposed_m2: float = 0.0
    beams: BeamEvidence = BeamEvidence()
    hidden: tuple[Hider, ...] = ()
    not_seen: Mapping[str, float] = field(default_factory=dict)
    same_as: str = ""
    related_extra: str = ""
    inference: Inference | None = None
    faces: tuple[FaceFinding, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Extra(ArrayValue):
    """Measured surface of no element.

    `name` is "extra-12"; `box_m` (2, 3) smallest and largest coordinates; `points` (n, 3) middles of its
    cells of 5 cm; `near` the name of the element that it touches, "" for none; `hides` names of elements.
    """

    name: str
    box_m: FloatArray
    area_m2: float
    points: FloatArray
    stations: tuple[str, ...] = ()
    near: str = ""
    hides: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Alignment(ArrayValue):
    """Where scans lie in the design.

    Attributes
    ----------
    poses : tuple of Pose
        Corrected `world_from_sensor` of each scan, in the design's frame.
    shift_m, turn_deg : (3,) float
        Motion of all scans together that best fits the design; the turn as a rotation vector.
    shift_sd_m, turn_sd_deg : (3,) float
        Its standard deviation.
    station_shift_m : (s, 3) float
        Further motion of each scan.
    tau_m : float
        Typical deviation of faces from the design, as estimated.
    is_free : bool
        Whether the scans were moved as a whole (`align`).
    sentences : tuple of str
        What to know: moved by more than was stated, floors all high by the same.
    """

    poses: tuple[Pose, ...]
    shift_m: FloatArray
    turn_deg: FloatArray
    shift_sd_m: FloatArray
    turn_sd_deg: FloatArray
    station_shift_m: FloatArray
    tau_m: float
    is_free: bool = True
    sentences: tuple[str, ...] = ()

    @property
    def shift_text(self) -> str:
        """The shift of all scans with its 95 % interval: "(1.0 ± 1.1, 0.0 ± 1.1, -9.8 ± 1.2) mm"."""
        halves = (HALF_95 * self.shift_sd_m).tolist()
        parts = [" ± ".join(rounded((a, b), b)) for a, b in zip(self.shift_m.tolist(), halves, strict=True)]
        return f"({', '.join(parts)}) mm"


@dataclass(frozen=True, slots=True, eq=False)
class Samples(ArrayValue):
    """Samples every 10 cm on exposed faces of the design.

    Arrays of (n,): `points` and `normals` (n, 3); `element` surface id; `area_m2`; `state` index in
    `SAMPLE_STATES`; `reason` index in `SAMPLE_REASONS` (0 where measured); `blocker` what hides it: a surface
    id, -1 for nothing, -2 - k for extra number k.
    """

    points: FloatArray
    normals: FloatArray
    element: NDArray[np.int32]
    area_m2: FloatArray
    state: NDArray[np.int8]
    reason: NDArray[np.int8]
    blocker: NDArray[np.int32]


@dataclass(frozen=True, slots=True, eq=False)
class DeviationPoints(ArrayValue):
    """A thinned cloud of measured points, in the design's frame.

    `points` (n, 3); `element` (n,) surface id, -1 for none; `deviation_m` (n,) signed, NaN where there is
    none; `state` (n,) index in `POINT_STATES`.
    """

    points: FloatArray
    element: NDArray[np.int32]
    deviation_m: FloatArray
    state: NDArray[np.int8]


LOA_BANDS_M: Mapping[str, float] = {"LOA50": 0.001, "LOA40": 0.005, "LOA30": 0.015, "LOA20": 0.05}
"""Upper ends of the bands at 95 % (USIBD C120 v3.0, 2019, as printed by 3sixtyedge.ca); beyond: LOA10."""


@dataclass(frozen=True, slots=True, eq=False)
class DesignCheck(Value):
    """A design checked against scans.

    Attributes
    ----------
    design : ElementMesh
        As it was checked.
    scans : tuple of str
        Names of the scans.
    elements : tuple of ElementFinding
        One for each element of the design that was asked for, in the design's order.
    extra : tuple of Extra
        Largest first.
    alignment : Alignment
        Where the scans lie.
    faces_tested : int
        m.
    z : float
        Quantile that takes m tests into account.
    false_alarms_expected : float
        Wrong `deviates` a building.
    loa_bands_m : mapping
        Name of each band and its upper end.
    samples : Samples
        What the shares are made of.
    cloud : DeviationPoints
        The points.
    warnings : tuple of str
        What to know.
    """

    design: ElementMesh
    scans: tuple[str, ...]
    elements: tuple[ElementFinding, ...]
    extra: tuple[Extra, ...]
    alignment: Alignment
    faces_tested: int
    z: float
    false_alarms_expected: float
    loa_bands_m: Mapping[str, float]
    samples: Samples
    cloud: DeviationPoints
    warnings: tuple[str, ...] = ()
