# SPDX-License-Identifier: MIT
"""Verdicts: what faces, beams and samples together say of each element."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri

from completion.asbuilt import limits
from completion.asbuilt.alignment import Aligned
from completion.asbuilt.deviation import Judged, thickness_of
from completion.asbuilt.faces import DesignFaces
from completion.asbuilt.findings import (
    HALF_95,
    BeamEvidence,
    ElementFinding,
    Hider,
    Interval,
    Kind,
    Shares,
)
from scenes.mesh.design import Element

_ALIKE = 0.9  # cosine between normals of faces that look the same way, or away from each other
_OPEN = "its body in the design is not closed: what lies before it may be the side that the design lacks"
_OPPOSITE = -0.999  # cosine between normals of two sides of one body


@dataclass(frozen=True, slots=True, eq=False)
class ElementEvidence:
    """All that is known of an element before its verdict.

    `faces` that were judged, `far` those that lie farther off and like it (a displaced element), `beams`,
    `share` and `hidden` by samples, `not_seen` shares by reason, `rivals` places in `faces` of those whose
    deviation something else explains, and whether that goes on beyond them, `back_m` how far behind its place
    a surface is the back of its body, `is_open` whether that lacks sides, `noise_m` standard deviation and
    range of beams too noisy to tell of it, and up to where beams do.
    """

    surface: int
    element: Element
    tolerance_m: float
    faces: tuple[Judged, ...]
    far: tuple[Judged, ...]
    beams: BeamEvidence
    share: Shares
    exposed_m2: float
    hidden: tuple[Hider, ...]
    not_seen: dict[str, float]
    rivals: Mapping[int, bool]
    back_m: float
    is_open: bool = False
    noise_m: tuple[float, float, float] | None = None


def quantile(n_tested: int, false_alarms: float) -> float:
    """Number of standard deviations beyond which n tested faces deviate by chance `false_alarms` times."""
    return float(max(ndtri(1 - false_alarms / (2 * max(n_tested, 1))), HALF_95))


def decide(
    known: ElementEvidence, aligned: Aligned, faces: DesignFaces, *, z: float, scale: float
) -> ElementFinding:
    """Return the verdict on one element."""
    tested = [k for k, one in enumerate(known.faces) if one.finding.is_tested]
    main = [k for k in tested if known.faces[k].finding.is_main]
    finding = ElementFinding(
        surface=known.surface,
        element=known.element,
        verdict="undecided",
        tolerance_m=known.tolerance_m,
        directions_measured=tuple(_way(known.faces[k]) for k in main),
        share=known.share,
        exposed_m2=known.exposed_m2,
        beams=known.beams,
        hidden=known.hidden,
        not_seen=known.not_seen,
        faces=tuple(
            replace(one.finding, is_tested=one.finding.is_tested and k not in known.rivals)
            for k, one in enumerate(known.faces)
        ),
    )
    gone = _is_gone(known, tested, scale)
    moved = _displaced(known, faces, scale) if gone or not main else None
    if moved is not None:
        return replace(finding, sentence=_OPEN) if known.is_open else _displaced_finding(finding, moved)
    if gone:
        return replace(finding, verdict="missing", sentence=_gone_sentence(known))
    shown = [k for k in main if _is_sure(known, k, tested)]
    sides = [k for k in shown if k not in known.rivals]
    finding = _with_numbers(finding, known, main or tested, sides, aligned=aligned, faces=faces)
    deviating = [k for k in shown if known.faces[k].deviates(known.tolerance_m, z)]
    rivalled = [k for k in deviating if k in known.rivals]
    sure = [k for k in deviating if k not in known.rivals]
    thick = finding.thickness
    is_thick = thick is not None and _beyond(thick, known.tolerance_m, z)
    if sure or is_thick:
        return _deviating(finding, known, sure, is_thick)
    measured = sum(known.faces[k].finding.measured_m2 for k in tested)
    is_hidden = known.beams.hidden_m2 > max(measured, known.beams.on_m2, known.beams.through_m2)
    if rivalled:
        if is_hidden or any(known.rivals[k] for k in rivalled):
            return _hidden_finding(finding, known)
        return replace(finding, sentence=_before_sentence(known, rivalled))
    within = [k for k in tested if known.faces[k].is_within(known.tolerance_m)]
    share = sum(known.faces[k].finding.measured_m2 for k in within) / max(measured, 1e-12)
    passed = known.beams.through_m2 <= limits.MOST_THROUGH * (known.beams.through_m2 + measured)
    if share >= limits.WITHIN_SHARE and set(within) & set(main) and passed:
        return replace(finding, verdict="within", sentence=_within_sentence(known, finding))
    if is_hidden and known.share.measured < limits.HIDDEN_SHARE:
        return _hidden_finding(finding, known)
    noisy, hidden = (known.not_seen.get(reason, 0.0) for reason in ("too noisy", "hidden"))
    is_noisy = noisy >= hidden and noisy * known.exposed_m2 > limits.LEAST_MEASURED_M2 * scale**2
    if known.noise_m is not None and is_noisy and not tested:
        sigma, away, most = known.noise_m
        text = f"too noisy: sigma {_mm(sigma)} at {away:.2g} m, where {_mm(most)} is the most that tells "
        return replace(finding, sentence=f"{text}anything of this design; tolerance {_mm(known.tolerance_m)}")
    is_met = known.beams.on_m2 > limits.LEAST_MEASURED_M2 * scale**2
    if tested or is_met or known.share.measured > limits.HIDDEN_SHARE:
        return replace(finding, sentence=_undecided_sentence(known, tested, main))
    if known.hidden and hidden >= max(known.not_seen.values(), default=0.0):
        return _hidden_finding(finding, known)
    return replace(finding, verdict="not seen", sentence=_unseen_sentence(known))


def with_bands(finding: ElementFinding, bands: Mapping[str, float]) -> ElementFinding:
    """Name the bands of an element's represented and measured accuracy, by its worst tested face."""
    tested = [one.deviation for one in finding.faces if one.is_tested and one.deviation is not None]
    if not tested:
        return finding
    half = max((one.high - one.low) / 2 for one in tested)
    reach = max(max(abs(one.low), abs(one.high)) for one in tested)
    return replace(finding, loa_measured=_band(half, bands), loa_represented=_band(reach, bands))


def _band(value: float, bands: Mapping[str, float]) -> str:
    """The narrowest band that holds a value; "beyond" and the widest's name where none does."""
    held = sorted(bands.items(), key=lambda item: item[1])
    return next((name for name, top in held if value <= top), "beyond " + held[-1][0] if held else "")


def _is_gone(known: ElementEvidence, tested: Sequence[int], scale: float) -> bool:
    """Whether beams went through the whole of its body, or its surface lies where its back should be."""
    beams = known.beams
    measured = sum(
        one.finding.measured_m2
        for k, one in enumerate(known.faces)
        if _is_in_place(known, k) or (k in tested and k not in known.rivals and _stands(known, k))
    )
    stays = beams.on_m2 + measured
    is_through = (
        known.share.measured <= limits.HIDDEN_SHARE
        and beams.through_m2 > limits.LEAST_THROUGH_M2 * scale**2
        and beams.n_beams >= limits.FEWEST_BEAMS // 2
        and beams.through_m2 > limits.THROUGH_OF_SEEN * (beams.through_m2 + stays)
        and beams.through_m2 > limits.THROUGH_OF_ALL * (beams.through_m2 + stays + beams.hidden_m2)
    )
    back = [k for k in tested if known.faces[k].finding.is_main and not _stands(known, k)]
    standing = [k for k in tested if known.faces[k].finding.is_main and _stands(known, k)]
    return is_through or bool(back and not standing)


def _stands(known: ElementEvidence, k: int) -> bool:
    """Whether a face is before the other side of its body."""
    return not float(np.median(known.faces[k].delta)) < -known.back_m


def _is_in_place(known: ElementEvidence, k: int) -> bool:
    """Whether most of what is measured of a face is within the tolerance."""
    return float(np.median(np.abs(known.faces[k].delta))) <= known.tolerance_m


def _is_sure(known: ElementEvidence, k: int, tested: Sequence[int]) -> bool:
    """Whether a face is shown so well that a number of it may be called a deviation."""
    one = known.faces[k]
    along = one.finding.normal
    alike = [known.faces[j].finding for j in tested if abs(known.faces[j].finding.normal @ along) > _ALIKE]
    measured = sum(face.measured_m2 for face in alike)
    tilt = one.finding.tilt
    return (
        (tilt is None or np.cos(tilt.value) > _ALIKE)  # what looks another way is another surface
        and one.finding.support >= limits.SURE_SUPPORT
        and one.is_flat_enough
        and one.finding.measured_m2 >= limits.LEAST_PART * measured
    )


def _beyond(number: Interval, tolerance_m: float, z: float) -> bool:
    sd = (number.high - number.low) / (2 * HALF_95)
    return abs(number.value) - z * sd > tolerance_m


def _displaced(known: ElementEvidence, faces: DesignFaces, scale: float) -> Judged | None:
    """The far face that is like a main one of an element that is not in its place.

    It is as wide, high and level; or it has the element's thickness with one that looks the other way.
    """
    if "door" in known.element.ifc_class.lower():  # whose leaves turn
        return None
    level = [
        one
        for one in known.far
        if one.finding.is_main
        and not faces.sign[one.face]
        and one.is_flat_enough
        and one.finding.measured_m2 >= limits.LEAST_MEASURED_M2 * scale**2
        and (np.abs(one.delta - one.delta[-1]) <= limits.START_M * scale).all()
    ]
    like = [
        one
        for one in level
        if any(_are_opposite(one, b, faces) and _moved_alike(one, b, scale) for b in level)
        or (
            one.finding.measured_m2 >= limits.LIKE_AREA * one.finding.area_m2
            and (np.ptp(one.columns[:, 1:3], axis=0) >= 2 * limits.LIKE_EXTENT).all()
        )
    ]
    return max(like, key=lambda one: one.finding.measured_m2) if like else None


def _moved_alike(a: Judged, b: Judged, scale: float) -> bool:
    """Whether two faces that look away from each other went the same way."""
    return bool(abs(a.delta[-1] + b.delta[-1]) <= limits.GATE_M * scale)


def _hidden_finding(finding: ElementFinding, known: ElementEvidence) -> ElementFinding:
    """The verdict on an element before which something lies: the side that an open body lacks, maybe."""
    if known.is_open and not known.hidden:
        return replace(finding, sentence=_OPEN)
    named = [f"{one.by} ({one.area_m2:.1f} m2)" for one in known.hidden[:2]]
    text = "hidden by " + (" and ".join(named) if named else "what was measured before it")
    return replace(finding, verdict="hidden", sentence=f"{text}; {_OPEN}" if known.is_open else text)


def _displaced_finding(finding: ElementFinding, moved: Judged) -> ElementFinding:
    offset = moved.finding.offset
    text = "nothing of it is measured in its place, and a surface like its own lies beside it"
    if offset is not None:
        shift, way = offset.as_shift()
        text += f", {shift.sentence()} off along {way} of the design"
    return replace(finding, verdict="deviates", kind="displaced", offset=offset, sentence=text)


def _with_numbers(
    finding: ElementFinding,
    known: ElementEvidence,
    chosen: Sequence[int],
    sides: Sequence[int],
    *,
    aligned: Aligned,
    faces: DesignFaces,
) -> ElementFinding:
    """Add the numbers of the chosen face that is farthest off, and the thickness between sides."""
    if not chosen:
        return finding
    worst = max(chosen, key=lambda k: _reach(known.faces[k]))
    face = known.faces[worst].finding
    bows = [known.faces[k].finding.bow for k in chosen]
    bent = [one for one in bows if one is not None]
    thick = [
        one
        for a in sides
        for b in sides
        if a < b and _are_opposite(known.faces[a], known.faces[b], faces)
        for one in [thickness_of(known.faces[a], known.faces[b], aligned, faces)]
        if one is not None
    ]
    return replace(
        finding,
        offset=face.offset,
        tilt=face.tilt,
        bow=max(bent, key=lambda one: abs(one.value)) if bent else None,
        radius=face.radius,
        thickness=max(thick, key=lambda one: abs(one.value)) if thick else None,
    )


def _are_opposite(a: Judged, b: Judged, faces: DesignFaces) -> bool:
    fa, fb = a.face, b.face
    is_flat = faces.sign[fa] == faces.sign[fb] == 0
    gap = float((faces.centre[fa] - faces.centre[fb]) @ faces.normal[fa])
    return bool(is_flat and gap > 0 and faces.normal[fa] @ faces.normal[fb] < _OPPOSITE)


def _reach(one: Judged) -> float:
    return float((np.abs(one.delta) + HALF_95 * one.sd).max())


def _deviating(
    finding: ElementFinding, known: ElementEvidence, sure: Sequence[int], is_thick: bool
) -> ElementFinding:
    """The verdict on an element that deviates, with its kind: what most of the deviation is made of."""
    if not sure:
        return replace(
            finding, verdict="deviates", kind="thickness", sentence=_kind_sentence(finding, "thickness")
        )
    face = known.faces[max(sure, key=lambda k: _reach(known.faces[k]))]
    kind = _kind(face, known.tolerance_m)
    if is_thick and kind == "offset" and len(sure) == 1:
        kind = "thickness"
    own = face.finding
    finding = replace(
        finding,
        verdict="deviates",
        kind=kind,
        offset=own.offset,
        tilt=own.tilt,
        bow=own.bow,
        radius=own.radius,
    )
    return replace(finding, sentence=_kind_sentence(finding, kind))


def _kind(face: Judged, tolerance_m: float) -> Kind:
    own = face.finding
    if own.radius is not None and abs(own.radius.value) > abs(own.offset.value if own.offset else 0.0):
        return "radius"
    around = face.delta[:8]
    if own.bow is not None and abs(own.bow.value) > max(
        tolerance_m, np.ptp(around) / 2, abs(float(around.mean()))
    ):
        return "bow"
    middle = abs(own.offset.value) if own.offset is not None else 0.0
    return "tilt" if np.ptp(face.delta) / 2 > middle else "offset"


def _kind_sentence(finding: ElementFinding, kind: Kind) -> str:
    number = {"thickness": finding.thickness, "bow": finding.bow, "radius": finding.radius}.get(
        kind, finding.offset
    )
    if kind == "tilt" and finding.tilt is not None:
        return f"it is turned by {finding.tilt.sentence(np.pi / 180, 'deg')}"
    if number is None:
        return ""
    what = {
        "thickness": "its thickness differs",
        "bow": "its middle bows",
        "radius": "its radius differs",
    }.get(kind, "it is off")
    return f"{what} by {number.sentence()}, beyond {_mm(finding.tolerance_m)}"


def _within_sentence(known: ElementEvidence, finding: ElementFinding) -> str:
    sides = len(finding.directions_measured)
    reach = max(_reach(one) for one in known.faces if one.finding.is_tested and one.finding.is_main)
    return (
        f"{sides} main {'face' if sides == 1 else 'faces'} measured: no corner of them is farther than "
        f"{_mm(reach)} from its place"
    )


def _undecided_sentence(known: ElementEvidence, tested: Sequence[int], main: Sequence[int]) -> str:
    if not tested:
        return f"{known.share.measured:.0%} of it is measured, but no face has enough beams for a number"
    if not main:
        return "only smaller faces of it are measured"
    if known.beams.through_m2 > limits.LEAST_THROUGH_M2:
        return f"its faces are measured, but beams passed {known.beams.through_m2:.2f} m2 of its body"
    k = max(tested, key=lambda k: _reach(known.faces[k]))
    worst, limit = known.faces[k].finding, _mm(known.tolerance_m)
    if worst.deviation is None:
        return ""
    half = (worst.deviation.high - worst.deviation.low) / 2
    text, doubt = f"a corner is off by {worst.deviation.sentence()}", _doubt(known, k, tested)
    if doubt and abs(worst.deviation.value) - half > known.tolerance_m:
        return f"{text}, but {doubt}"
    is_loose = half > max(known.tolerance_m, worst.rms_m)  # not by noise
    why = ": hardly any other surface holds the scans this way" if is_loose else ""
    return f"{text}, neither surely within nor surely beyond {limit}{why}"


def _doubt(known: ElementEvidence, k: int, tested: Sequence[int]) -> str:
    """Why a number of a face is no deviation of its element; "" where it is."""
    one = known.faces[k]
    reasons = (
        (not one.finding.is_main, "of one of its smaller faces"),
        (
            one.finding.support < limits.SURE_SUPPORT,
            f"beams met only {one.finding.support:.0%} of what they could of that face",
        ),
        (not one.is_flat_enough, f"what was measured there is not flat: rms {_mm(one.finding.rms_m)}"),
        (not _is_sure(known, k, tested), "that face is a small part of what was measured that way"),
    )
    return next((text for holds, text in reasons if holds), "")


def _gone_sentence(known: ElementEvidence) -> str:
    beams = known.beams
    return (
        f"beams passed {beams.through_m2:.2f} m2 of its body and ended on {beams.on_m2:.2f} m2 of it"
        if beams.through_m2
        else "what is measured lies where its back should be"
    )


def _before_sentence(known: ElementEvidence, rivalled: Sequence[int]) -> str:
    worst = max((known.faces[k] for k in rivalled), key=_reach)
    share = worst.finding.measured_m2 / max(worst.finding.area_m2, 1e-12)
    return (
        f"what lies {_mm(float(np.median(worst.delta)))} before {share:.0%} of its face may be a thing that "
        "stands there: the rest of the face is not measured"
    )


def _unseen_sentence(known: ElementEvidence) -> str:
    if not known.not_seen:
        return "nothing of it is exposed"
    reason = max(known.not_seen, key=lambda name: known.not_seen[name])
    return f"no scan looked: {known.not_seen[reason]:.0%} of its exposed surface is {reason}"


def _mm(metres: float) -> str:
    value = 1000 * metres
    if abs(value) >= 1000:
        return f"{value / 1000:.2f} m"
    return f"{value:.1f} mm" if abs(value) >= 1 or not value else f"{value:.3f} mm"


def _way(one: Judged) -> tuple[float, float, float]:
    x, y, z = one.finding.normal.tolist()
    return x, y, z
