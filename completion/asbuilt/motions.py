# SPDX-License-Identifier: MIT
"""Motions: how the scans were moved to fit the design, together and one by one, and what to say of that."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from completion.asbuilt import limits
from completion.asbuilt.findings import HALF_95, Alignment
from completion.asbuilt.measurements import Measurements
from scenes.pose import Pose


def alignment_of(known: Measurements, *, is_free: bool) -> Alignment:
    """Return how the scans were moved in all, in the design's frame; `is_free`: whether they might be."""
    frame = Pose.from_parts(np.eye(3), known.middle)
    poses = tuple(frame @ seen.scan.world_from_sensor for seen in known.observations)
    shifts = np.array([
        new.translation - old.world_from_sensor.translation
        for new, old in zip(poses, known.given, strict=True)
    ])  # fmt: skip
    common = np.median(shifts, axis=0)
    size = len(known.observations) * 6
    sd = np.sqrt(np.maximum(np.diag(known.aligned.covariance)[size : size + 6], 0.0))
    turns = np.array([
        Rotation.from_matrix(new.rotation @ old.world_from_sensor.rotation.T).as_rotvec()
        for new, old in zip(poses, known.given, strict=True)
    ])  # fmt: skip
    aligned = Alignment(
        poses=poses,
        shift_m=common,
        turn_deg=np.degrees(np.median(turns, axis=0)),
        shift_sd_m=sd[3:],
        turn_sd_deg=np.degrees(sd[:3]),
        station_shift_m=shifts - common,
        tau_m=known.aligned.tau_m,
        is_free=is_free,
    )
    return replace(aligned, sentences=(_alignment_sentence(aligned),))


def _alignment_sentence(aligned: Alignment) -> str:
    if not aligned.is_free:
        return "the scans stay where their control network has them"
    return (
        f"all scans together were moved by {aligned.shift_text} to fit the design; what all of the building "
        "has alike, as floors that are all as much too high, is in these numbers and in no element's"
    )


def moved_alike(known: Measurements, alignment: Alignment) -> tuple[str, ...]:
    """Return a sentence if all scans were moved by more than their poses are stated to be off."""
    stated_m, stated_rad = known.gates.registration
    most_m = max(limits.MOVED_SIGMAS * stated_m, limits.AGAIN_M * known.scale)
    most_deg = float(np.degrees(limits.MOVED_SIGMAS * stated_rad))
    shift, turn = (float(np.linalg.norm(way)) for way in (alignment.shift_m, alignment.turn_deg))
    shift_sd, turn_sd = (float(sd.max()) for sd in (alignment.shift_sd_m, alignment.turn_sd_deg))
    if shift - HALF_95 * shift_sd <= most_m and turn - HALF_95 * turn_sd <= most_deg:
        return ()
    n = len(known.given)
    who = f"all {n} scans were moved alike" if n > 1 else f"{known.given[0].name} was moved"
    return (
        f"{who} by {alignment.shift_text} and turned by {turn:.2g} deg to fit the design, beyond the "
        f"{1000 * most_m:.3g} mm and {most_deg:.2g} deg that their poses may be off: the survey's origin is "
        "wrong, or the building stands elsewhere than the design; no element's deviation holds this",
    )


def moved_far(known: Measurements) -> tuple[str, ...]:
    """Return a sentence on each scan that was moved, beside the others, by more than its pose may be off."""
    stated = known.gates.registration[0]
    own = np.array([
        new.scan.origin - (old.origin - known.middle)
        for new, old in zip(known.observations, known.given, strict=True)
    ])  # fmt: skip
    far = np.linalg.norm(own - np.median(own, axis=0), axis=1)
    return tuple(
        f"{scan.name} was moved by {1000 * distance:.0f} mm beside the other scans to fit the design; its "
        f"pose is stated to be off by {1000 * stated:.3g} mm: mend the registration, or give --registration"
        for scan, distance in zip(known.given, far, strict=True)
        if len(known.given) > 1 and distance > max(limits.MOVED_SIGMAS * stated, limits.AGAIN_M * known.scale)
    )
