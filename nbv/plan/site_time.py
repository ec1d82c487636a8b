# SPDX-License-Identifier: MIT
"""Time on site: what the stations of a plan take, and where more of them pay little.

A station takes its scan, which the instrument's speed and angular step tell, and its set-up; between places
one walks. Scans of cameras from one place share its set-up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nbv.plan.tour import Tour
from nbv.run.plan_options import PaceOptions
from nbv.run.wording import count, duration
from nbv.scanning.sensor import Sensor, SphericalSensor, View
from nbv.visibility.limits import SAME_M
from scenes.checks import FloatArray, Value
from scenes.run.option import check_limits

COARSER = (8, 4, 2)
"""By how much a panorama's angular steps may be coarser than the profile's, coarsest first."""
_BEND = 0.02  # share of the area by which a curve must rise above its chord to have a knee


@dataclass(frozen=True, slots=True, kw_only=True)
class SitePace(PaceOptions):
    """How fast a crew works, and how much time there is.

    The defaults are ours, of a tripod that is carried by one person; measure your own.

    Parameters
    ----------
    budget_min : float, optional
        Minutes that there are for all stations and the way between them.
    set_up_min : float
        Minutes to set the instrument up at a place, level and start it.
    scan_min : float, optional
        Minutes of a scan at the profile's angular step; from the sensor's speed when not given.
    walk_m_s : float
        Speed of walking with the instrument, m/s.

    Raises
    ------
    InputError
        Times that are negative, or a speed or budget that is not positive.
    """

    def __post_init__(self) -> None:
        check_limits(self)

    @classmethod
    def of(cls, options: PaceOptions) -> SitePace:
        """Return the pace with the numbers of `options`."""
        return cls(**asdict(options))

    def scan_s(self, sensor: Sensor, of_profile: Sensor) -> float | None:
        """Seconds of a scan by a sensor that may have coarser steps than its profile; None if not known."""
        if self.scan_min is None:
            return sensor.scan_time_s
        pixels, whole = (int(np.prod(one.projection.shape)) for one in (sensor, of_profile))
        return 60 * self.scan_min * pixels / whole


USUAL_PACE = SitePace()
"""Of a tripod that one person carries, without a budget."""


@dataclass(frozen=True, slots=True)
class SiteTime(Value):
    """Seconds on site.

    Attributes
    ----------
    scans_s : tuple of float, or None
        Of each scan, in the order of the views; None where the sensor's speed is not known.
    places : int
        Where the instrument is set up.
    set_up_s : float
        At each place.
    walked_m, walk_s : float
        The tour, and how long it takes; legs without a way count by their straight line.
    """

    scans_s: tuple[float, ...] | None
    places: int
    set_up_s: float
    walked_m: float
    walk_s: float

    @property
    def total_s(self) -> float:
        """All of it; without the scans where these are not known."""
        return sum(self.scans_s or ()) + self.places * self.set_up_s + self.walk_s

    def describe(self) -> str:
        """Return the time in words.

        Examples
        --------
        >>> SiteTime((90.0, 90.0), 2, 180.0, 30.0, 30.0).describe()
        '10 min on site: 2 scans of 2 min, 2 set-ups of 3 min, 30 m walked'
        """
        set_ups = f"{count(self.places, 'set-up')} of {duration(self.set_up_s)}"
        set_up = f"{set_ups}, {self.walked_m:.0f} m walked"
        if self.scans_s is None:
            return f"{duration(self.total_s)} on site without the scans, whose speed is not known: {set_up}"
        least, most = duration(min(self.scans_s)), duration(max(self.scans_s))
        scans = f"{count(len(self.scans_s), 'scan')} of {most if least == most else f'{least} to {most}'}"
        return f"{duration(self.total_s)} on site: {scans}, {set_up}"

    def to_json(self) -> dict[str, Any]:
        """Return the entry of `plan.json`."""
        return {
            "total_s": self.total_s,
            "scans_s": None if self.scans_s is None else list(self.scans_s),
            "places": self.places,
            "set_up_s": self.set_up_s,
            "walked_m": self.walked_m,
            "walk_s": self.walk_s,
        }


def site_time(views: Sequence[View], tour: Tour, profile: Sensor, pace: SitePace) -> SiteTime | None:
    """Return what views along a tour take on site; None without views."""
    if not views:
        return None
    positions = np.array([view.world_from_sensor.translation for view in views])
    walked = 0.0
    for (a, b), leg in zip(zip(tour.order[:-1], tour.order[1:], strict=True), tour.legs, strict=True):
        straight = float(np.linalg.norm(positions[a] - positions[b]))
        walked += leg.length_m if np.isfinite(leg.length_m) else straight
    scans = [pace.scan_s(view.sensor, profile) for view in views]
    known = [scan for scan in scans if scan is not None]
    return SiteTime(
        scans_s=tuple(known) if len(known) == len(scans) else None,
        places=len(np.unique(places_of(positions))),
        set_up_s=60 * pace.set_up_min,
        walked_m=walked,
        walk_s=walked / pace.walk_m_s,
    )


def places_of(positions: FloatArray) -> NDArray[np.int64]:
    """Numbers (n,) from 0 of the places of positions (n, 3), alike where these are the same."""
    _, number = np.unique(np.rint(positions / SAME_M).astype(np.int64), axis=0, return_inverse=True)
    return np.asarray(number.reshape(-1), np.int64)


def knees(met: Sequence[float]) -> tuple[int, ...]:
    """Numbers of views, ascending, after which further ones add clearly less: one or two, or none.

    A knee is where the curve of what is met lies highest above the chord from its begin to its end (Satopaa,
    Albrecht, Irwin and Raghavan 2011, Finding a "kneedle" in a haystack); the second is that of the rest.

    Parameters
    ----------
    met : sequence of float
        Share met before the first view, and after each.

    Examples
    --------
    >>> knees([0, 0.3, 0.5, 0.6, 0.62, 0.64, 0.66])
    (2, 3)
    """
    found: list[int] = []
    start = 0
    for _ in range(2):
        curve = np.asarray(met, np.float64)[start:]
        if len(curve) < 4:
            break
        above = curve - np.linspace(curve[0], curve[-1], len(curve))
        at = int(np.argmax(above))
        if above[at] < _BEND:
            break
        start += at
        found.append(start)
    return tuple(found)


def curve_in_words(met: Sequence[float]) -> str:
    """Return where a curve bends, in words; nothing where it does not.

    Examples
    --------
    >>> curve_in_words([0, 0.5, 0.6, 0.62, 0.64, 0.66])
    '1 view reaches 50 %, 2 reach 60 %, all 5 reach 66 % of the area: after 2 each adds 2 % on average'
    """
    bends = knees(met)
    if not bends:
        return ""
    last, whole = bends[-1], len(met) - 1
    one = count(bends[0], "view reaches", "views reach")
    steps = ", ".join(
        [f"{one} {100 * met[bends[0]]:.0f} %", *(f"{k} reach {100 * met[k]:.0f} %" for k in bends[1:])]
    )
    each = 100 * (met[-1] - met[last]) / (whole - last)
    return (
        f"{steps}, all {whole} reach {100 * met[-1]:.0f} % of the area: after {last} each adds "
        f"{each:.2g} % on average"
    )


def coarser(sensor: Sensor, factor: int) -> Sensor | None:
    """Return a panorama with coarser angular steps; None for what has fixed pixels, or too few."""
    if not isinstance(sensor, SphericalSensor) or sensor.height // factor < 2:
        return None
    return replace(sensor, width=max(sensor.width // factor, 1), height=(sensor.height - 1) // factor + 1)


def site_time_from(content: dict[str, Any]) -> SiteTime:
    """Return the time on site of an entry of `plan.json`.

    Raises KeyError, TypeError or ValueError: another table.
    """
    scans = content["scans_s"]
    return SiteTime(
        scans_s=None if scans is None else tuple(float(scan) for scan in scans),
        places=int(content["places"]),
        **{name: float(content[name]) for name in ("set_up_s", "walked_m", "walk_s")},
    )
