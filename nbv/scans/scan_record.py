# SPDX-License-Identifier: MIT
"""Scan record: what each scan was predicted to bring, by an earlier plan and by the scans before, and did."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from nbv.online.limits import NEAR_M
from nbv.run.wording import letters, square_metres
from nbv.scans.scan_coverage import ScanCoverage
from nbv.visibility.limits import SAME_M
from scenes.checks import InputError
from scenes.io.checks.documents import read_json
from scenes.io.checks.guard import one_line
from scenes.pose import Pose

_CURE = "give the plan.json that `unseen plan --scans` wrote after fewer of these scans"


@dataclass(frozen=True, slots=True)
class StationPrediction:
    """Prediction of an earlier plan for a scan: which station it was, how far off it stands, and the gain."""

    station: int
    off_m: float
    predicted_gain_m2: float | None


@dataclass(frozen=True, slots=True)
class ScanRecord:
    """One scan of a record.

    Attributes
    ----------
    pose : Pose
        Where it was taken.
    prediction : StationPrediction or None
        What the plan before predicted; None where no plan is known that named a station within a metre.
    expected_m2, settled_m2 : float or None
        What the scans before said that it would settle from where it stood, as the planner counts gain, and
        how much of that it did settle; square metres, None where they knew nothing of that place.
    measured_m2, met_m2 : float
        Surface that no scan before had measured, or not as required; square metres.
    """

    pose: Pose
    prediction: StationPrediction | None
    expected_m2: float | None
    settled_m2: float | None
    measured_m2: float
    met_m2: float

    def to_json(self) -> dict[str, Any]:
        """Return the entry of `plan.json`."""
        record = {
            name: getattr(self, name) for name in ("expected_m2", "settled_m2", "measured_m2", "met_m2")
        }
        station_before = None if self.prediction is None else asdict(self.prediction)
        return {"world_from_sensor": self.pose.matrix.tolist(), "said": station_before, **record}


def record_scans(
    coverage: ScanCoverage, predictions: Sequence[StationPrediction | None] = ()
) -> tuple[ScanRecord, ...]:
    """Return the record of a coverage's scans; `predictions` are an earlier plan's, one a scan."""
    scans, growth, before = coverage.scan_map.scans, coverage.growth, (0.0, 0.0)
    records = []
    for number, (scan, area) in enumerate(zip(scans, growth, strict=True)):
        gain = coverage.scan_map.gains[number]
        records.append(
            ScanRecord(
                pose=scan.world_from_sensor,
                prediction=predictions[number] if number < len(predictions) else None,
                expected_m2=None if gain is None else gain.expected_m2,
                settled_m2=None if gain is None else gain.settled_m2,
                measured_m2=area.total_m2 - before[0],
                met_m2=area.met_m2 - before[1],
            )
        )
        before = (area.total_m2, area.met_m2)
    return tuple(records)


def last_scan_in_words(record: Sequence[ScanRecord]) -> list[str]:
    """Return a sentence on the predicted and the achieved gain of the last scan; nothing for a first scan."""
    if len(record) < 2:
        return []
    last = record[-1]
    name = letters(len(record) - 1)
    sentence = ""
    before = last.prediction
    if before is not None and before.predicted_gain_m2 is not None:
        sentence = (
            f"was station {before.station} of the plan before, {before.off_m:.2f} m off, which "
            f"predicted {square_metres(before.predicted_gain_m2)} m2; it "
        )
    brought = f"measured {square_metres(last.measured_m2)} m2 of surface for the first time"
    if last.expected_m2 is None or last.settled_m2 is None:
        return [f"scan {name} {sentence}stood where the earlier scans saw nothing; it {brought}"]
    return [
        f"scan {name} {sentence}achieved {square_metres(last.settled_m2)} m2 of the "
        f"{square_metres(last.expected_m2)} m2 gain predicted from its true position, and {brought}"
    ]


def read_predictions(path: Path, poses: Sequence[Pose]) -> tuple[StationPrediction | None, ...]:
    """Read what an earlier plan of next stations said of scans.

    Those that it knew keep what its own record says. Each other is the nearest of its stations that is left,
    in the scans' order, if that is within a metre.

    Parameters
    ----------
    path : Path
        Its plan.json.
    poses : sequence of Pose
        Of all scans, in order, in the scans' own world; the plan says how it turned that (`UprightScans`).

    Raises
    ------
    InputError
        No such file, not a plan of next stations, or none that knew any of these scans.
    """
    content = read_json(path, dict)
    try:
        scans_from_world = Pose(content.get("world_from_scans", np.eye(4))).inverse()
        known = [scans_from_world @ Pose(matrix) for matrix in content["resumed_from"]["world_from_sensor"]]
        record = [_read_prediction(entry["said"]) for entry in content["record"]]
        views = [scans_from_world @ Pose(view["world_from_sensor"]) for view in content["views"]]
        planned = [view.translation for view in views]
        gains = [view["predicted_gain_m2"] for view in content["views"]]
        if len(record) != len(known):
            raise InputError(f"its record has {len(record)} scans, and it was made after {len(known)}")
        gains = [None if gain is None else float(gain) for gain in gains]
    except KeyError as error:
        raise InputError(f"{path} is not a plan of next stations: it has no {error}; {_CURE}") from error
    except (InputError, TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{path} is not a plan of next stations: {one_line(str(error))}; {_CURE}") from error
    before = [_number_of(pose, known) for pose in poses]
    if all(number is None for number in before):
        raise InputError(f"{path} was made after other scans than these; {_CURE}")
    left, predictions = dict(enumerate(planned, start=1)), list[StationPrediction | None]()
    for pose, number in zip(poses, before, strict=True):
        if number is not None:
            predictions.append(record[number])
            continue
        away = {station: float(np.linalg.norm(place - pose.translation)) for station, place in left.items()}
        station = min(away, key=lambda number: away[number], default=0)
        if not station or away[station] > NEAR_M:
            predictions.append(None)
            continue
        del left[station]
        predictions.append(StationPrediction(station, away[station], gains[station - 1]))
    return tuple(predictions)


def _number_of(pose: Pose, among: Sequence[Pose]) -> int | None:
    """Number of the pose that is the same as this, None for none."""
    return next(
        (k for k, other_pose in enumerate(among) if np.allclose(other_pose.matrix, pose.matrix, atol=SAME_M)),
        None,
    )


def _read_prediction(entry: dict[str, Any] | None) -> StationPrediction | None:
    """Return what an entry of a record holds; errors are as of reading numbers."""
    if entry is None:
        return None
    gain = entry["predicted_gain_m2"]
    return StationPrediction(
        int(entry["station"]), float(entry["off_m"]), None if gain is None else float(gain)
    )
