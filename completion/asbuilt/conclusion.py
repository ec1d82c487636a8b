# SPDX-License-Identifier: MIT
"""Conclusion: from deviations, beams and samples to a verdict on each element, extras, shares and bands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from completion.asbuilt import limits
from completion.asbuilt.beams import NO_RETURN, NOT_USED
from completion.asbuilt.deviation import Judged
from completion.asbuilt.doors import leaf_of
from completion.asbuilt.extra import ExtraCells, find_cells, things_of
from completion.asbuilt.findings import (
    POINT_STATES,
    SAMPLE_REASONS,
    BeamEvidence,
    DesignCheck,
    DeviationPoints,
    ElementFinding,
    Extra,
    Samples,
    Shares,
)
from completion.asbuilt.measurements import Measurements
from completion.asbuilt.motions import alignment_of, moved_alike, moved_far
from completion.asbuilt.samples import SampleStates, judge_samples, samples_of
from completion.asbuilt.verdicts import ElementEvidence, decide, quantile, with_bands
from completion.observe.observation import Observation
from scenes.checks import FloatArray
from scenes.mesh.design import ElementMesh
from scenes.rays.raycast import RayCaster

_MOST_POINTS = 1_000_000  # of the thinned cloud
_MOST_PASSED = 200  # beams through a body that are looked at again
_RING_STEP = 0.05  # metres


class Asked(Protocol):
    """What of the options of a check this page reads."""

    @property
    def tolerance_m(self) -> float:
        """T, metres."""

    @property
    def tolerances(self) -> Mapping[str, float]:
        """By pattern."""

    @property
    def false_alarms(self) -> float:
        """Expected a building."""

    @property
    def align(self) -> bool:
        """Whether scans may move."""

    @property
    def loa_bands_m(self) -> Mapping[str, float]:
        """Upper ends."""


def all_pixels(observations: Sequence[Observation]) -> list[NDArray[np.int32]]:
    """Flat pixels (n,) of each scan, in memory once."""
    sizes = [seen.scan.ranges.size for seen in observations]
    longest = np.arange(max(sizes), dtype=np.int32)
    return [longest[:size] for size in sizes]


def conclude(known: Measurements, options: Asked) -> DesignCheck:
    """Return the findings on all elements."""
    cells = _cells(known)
    states = judge_samples(
        known.samples,
        known.observations,
        [found.label for found in known.evidence],
        cells,
        known.gates,
    )
    cloud = _cloud(known)
    tested = [one for one in known.judged if one.finding.is_tested]
    z = quantile(len(tested), options.false_alarms)
    rivals = _rivals(known, cloud)
    beams, judged, far = _beam_evidence(known), _by_element(known.judged), _by_element(known.far)
    findings = [
        decide(
            _evidence_of(
                known, k, states, faces=judged.get(of, ()), far=far.get(of, ()), beams=beams[of],
                rivals=rivals, tolerance_m=_tolerance(known.design, k, options),
            ),
            known.aligned, known.faces, z=z, scale=known.scale,
        )
        for k in known.chosen
        for of in [known.twins.get(k, k)]
    ]  # fmt: skip
    extra = things_of(cells, [seen.scan.name for seen in known.observations], known.design)
    findings = [with_bands(one, options.loa_bands_m) for one in findings]
    findings, extra = _with_doors(findings, extra, known)
    findings = [_with_twin(one, known) for one in findings]
    alignment = alignment_of(known, is_free=options.align)
    return DesignCheck(
        design=_moved_design(known),
        scans=tuple(scan.name for scan in known.given),
        elements=tuple(_shifted(one, known.middle) for one in findings),
        extra=tuple(
            replace(one, box_m=one.box_m + known.middle, points=one.points + known.middle) for one in extra
        ),
        alignment=alignment,
        faces_tested=len(tested),
        z=z,
        false_alarms_expected=options.false_alarms,
        loa_bands_m=dict(options.loa_bands_m),
        samples=_moved_samples(samples_of(known.samples, states), known.middle),
        cloud=replace(cloud, points=cloud.points + known.middle),
        warnings=(*known.warnings, *moved_alike(known, alignment), *moved_far(known), *_too_noisy(known)),
    )


def _too_noisy(known: Measurements) -> tuple[str, ...]:
    """Say if the noise of most beams is too large for the design."""
    label = np.concatenate([found.label for found in known.evidence])
    returned, unused = int((label != NO_RETURN).sum()), int((label == NOT_USED).sum())
    if unused <= returned / 2:
        return ()
    return (
        f"{unused / returned:.0%} of the beams were left out: their noise is beyond "
        f"{1000 * known.gates.most_sigma_m:.2g} mm, too much for a design of this size",
    )


def _moved_design(known: Measurements) -> ElementMesh:
    mesh = known.whole
    return replace(known.design, mesh=mesh.at(mesh.vertices + known.middle))


def _moved_samples(samples: Samples, middle: FloatArray) -> Samples:
    return replace(samples, points=samples.points + middle)


def _shifted(finding: ElementFinding, middle: FloatArray) -> ElementFinding:
    """The finding in the design's own frame."""
    faces = tuple(replace(one, centre=one.centre + middle, place=one.place + middle) for one in finding.faces)
    return replace(finding, faces=faces)


def _tolerance(design: ElementMesh, surface: int, options: Asked) -> float:
    element, tolerance = design.elements[surface], options.tolerance_m
    for pattern, value in options.tolerances.items():
        if element.is_like(pattern):
            tolerance = value
    return tolerance


def _cells(known: Measurements) -> ExtraCells:
    sigma = max(
        (float(seen.noise.sigma(np.array([3.0 * known.scale]))[0]) for seen in known.observations),
        default=0.0,
    )
    gate = limits.GATE_SIGMAS * float(np.hypot(sigma, known.gates.registration[0])) + known.gates.gate_m
    pixels = all_pixels(known.observations)
    return find_cells(
        known.observations, pixels, known.evidence, known.design, scale=known.scale, gate_m=gate
    )


def _cloud(known: Measurements) -> DeviationPoints:
    """Points of all scans, thinned evenly, with the distance of those on faces."""
    total = sum(seen.scan.ranges.size for seen in known.observations)
    step = max(1, -(-total // _MOST_POINTS))
    parts = []
    for seen, found in zip(known.observations, known.evidence, strict=True):
        flat = np.arange(step // 2, seen.scan.ranges.size, step)
        flat = flat[(found.label[flat] != NO_RETURN) & (found.label[flat] != NOT_USED)]
        points, face, label = seen.points_at(flat), found.face[flat], found.label[flat]
        distance, state = np.full(len(flat), np.nan), np.where(label >= 0, 1, 2).astype(np.int8)
        on = np.flatnonzero(face >= 0)
        distance[on] = known.faces.places(face[on], points[on]).distance
        state[on] = POINT_STATES.index("on a face")
        parts.append((points, np.maximum(label, -1), distance, state))
    points, label, distance, state = (np.concatenate(column) for column in zip(*parts, strict=True))
    return DeviationPoints(points, label.astype(np.int32), distance, state)


def _rivals(known: Measurements, cloud: DeviationPoints) -> dict[int, bool]:
    """Faces, by identity, whose large offset something else explains; whether it goes on beyond them."""
    asked = [
        one
        for one in (*known.judged, *known.far)
        if not known.faces.sign[one.face]
        and float(np.abs(one.delta).max()) > limits.RIVAL_M * known.scale
        and (one.is_far or one.finding.is_tested)
    ]
    if not asked:
        return {}
    off = ~(np.abs(cloud.deviation_m) <= limits.RIVAL_M * known.scale)  # what is in its place is no rival
    tree = cKDTree(cloud.points[off])
    goes_on = {id(one): _goes_on(one, known, tree) for one in asked}
    return {id(one): goes_on[id(one)] for one in asked if goes_on[id(one)] or _is_thing(one, known)}


def _is_thing(one: Judged, known: Measurements) -> bool:
    """Whether so little lies before a face that it may be a thing that stands there."""
    exposed = known.exposed[one.face] * known.faces.area[one.face]
    is_before = float(np.median(one.delta)) > 2 * limits.RIVAL_M * known.scale
    return not one.is_far and is_before and one.finding.measured_m2 < limits.BEFORE_SHARE * exposed


def _goes_on(one: Judged, known: Measurements, tree: cKDTree) -> bool:
    """Whether the same offset is measured in a ring around the outline of a face."""
    own = one.finding
    u, v, (hu, hv) = known.faces.u[one.face], known.faces.v[one.face], known.faces.half[one.face]
    ring, step = limits.RING_M * known.scale, _RING_STEP * known.scale
    along_u = np.arange(-hu - ring, hu + ring + step / 2, step)
    along_v = np.arange(-hv - ring, hv + ring + step / 2, step)
    grid = np.stack(np.meshgrid(along_u, along_v, indexing="ij"), axis=-1).reshape(-1, 2)
    outside = (np.abs(grid[:, 0]) > hu + step / 4) | (np.abs(grid[:, 1]) > hv + step / 4)
    grid = grid[outside]
    offset = float(np.median(one.delta))
    places = own.centre + grid[:, :1] * u + grid[:, 1:] * v + offset * own.normal
    gate = max(0.01 * known.scale, 3 * own.rms_m)
    near = tree.query_ball_point(places, 1.2 * step)
    found = [
        bool(len(k)) and bool((np.abs((tree.data[k] - place) @ own.normal) < gate).any())
        for k, place in zip(near, places, strict=True)
    ]
    return float(np.mean(found)) > limits.RING_SHARE


def _passed_bodies(known: Measurements) -> FloatArray:
    """Share (E,) of the beams through each element's body that pass it well inside its outline.

    A beam that clips an edge of a body that is where it should be passes it, too, if poses are off.
    """
    n = len(known.design.elements)
    share = np.ones(n)
    through = np.sum([found.through for found in known.evidence], axis=0)
    gate = limits.GATE_SIGMAS * known.gates.registration[0] + known.gates.gate_m
    for element in np.flatnonzero(through > limits.LEAST_THROUGH_M2 * known.scale**2):
        starts, ways = _through_beams(known, int(element))
        if not len(starts):
            continue
        body = known.design.mesh.some(known.surfaces.element == element)
        caster = RayCaster(body.vertices, body.faces, 1)
        side = np.cross(ways, np.where(np.abs(ways[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]]))
        side /= np.linalg.norm(side, axis=1, keepdims=True)
        up = np.cross(ways, side)
        inside = np.ones(len(ways), np.bool_)
        for shift in (side, -side, up, -up):
            inside &= caster.first_hit(starts + gate * shift, ways).hit
        share[element] = inside.mean()
    return share


def _through_beams(known: Measurements, element: int) -> tuple[FloatArray, FloatArray]:
    """Origins and rays (n, 3) of some beams that passed an element."""
    starts, ways = [np.zeros((0, 3))], [np.zeros((0, 3))]
    for seen, found in zip(known.observations, known.evidence, strict=True):
        flat = np.flatnonzero(found.passed == element)
        flat = flat[:: max(1, len(flat) // (_MOST_PASSED // 4))]
        ways.append(seen.rays_at(flat))
        starts.append(np.tile(seen.scan.origin, (len(flat), 1)))
    return np.concatenate(starts), np.concatenate(ways)


def _beam_evidence(known: Measurements) -> list[BeamEvidence]:
    """What all beams together say of each element."""
    names = "on", "through", "hidden", "n_beams"
    on, through, hidden, count = (
        np.sum([getattr(found, name) for found in known.evidence], axis=0) for name in names
    )
    columns = on, through * _passed_bodies(known), hidden, count
    return [BeamEvidence(*row) for row in zip(*(column.tolist() for column in columns), strict=True)]


def _by_element(judged: Sequence[Judged]) -> dict[int, list[Judged]]:
    """Faces by the surface id of their element."""
    found: dict[int, list[Judged]] = {}
    for one in judged:
        found.setdefault(one.finding.element, []).append(one)
    return found


def _evidence_of(
    known: Measurements,
    number: int,
    states: SampleStates,
    *,
    faces: Sequence[Judged],
    far: Sequence[Judged],
    beams: BeamEvidence,
    rivals: Mapping[int, bool],
    tolerance_m: float,
) -> ElementEvidence:
    """Gather what is known of one element."""
    element, surface = known.design.elements[number], known.twins.get(number, number)
    mine = known.samples.of_element(surface)
    area = known.samples.area_m2[mine]
    total = float(area.sum())
    reason = states.reason[mine]
    shares = {
        SAMPLE_REASONS[k]: float(area[reason == k].sum()) / total for k in np.unique(reason) if k and total
    }
    measured = float(area[reason == 0].sum()) / total if total else 0.0
    back_m, is_open = _back(known, surface)
    return ElementEvidence(
        surface=number,
        element=element,
        tolerance_m=tolerance_m,
        faces=tuple(faces),
        far=tuple(one for one in far if id(one) not in rivals),
        beams=beams,
        share=Shares(measured, 0.0, 1.0 - measured),
        exposed_m2=total,
        hidden=states.hiders.get(surface, ()),
        not_seen=shares,
        rivals={k: rivals[id(one)] for k, one in enumerate(faces) if id(one) in rivals},
        back_m=back_m,
        is_open=is_open,
        noise_m=_noise(states, mine, known.gates.most_sigma_m),
    )


def _noise(states: SampleStates, mine: NDArray[np.int64], most_m: float) -> tuple[float, float, float] | None:
    """Median standard deviation and range of beams too noisy to tell of an element, and the limit."""
    held = states.noise_m[mine][states.reason[mine] == SAMPLE_REASONS.index("too noisy")]
    if not len(held):
        return None
    sigma, away = np.median(held, axis=0).tolist()
    return sigma, away, most_m


def _back(known: Measurements, surface: int) -> tuple[float, bool]:
    """How far behind an element's largest face its back lies at least; whether it is an open body.

    What lies there may be off by as much as faces of this building are. It is endless without a back.
    """
    mine = np.flatnonzero((known.faces.element == surface) & (known.faces.sign == 0))
    if not len(mine):
        return np.inf, False
    normal = known.faces.normal[mine[np.argmax(known.faces.area[mine])]]
    mesh = known.design.mesh
    corners = mesh.vertices[mesh.faces[known.surfaces.element == surface]].reshape(-1, 3)
    deep = float(np.ptp(corners @ normal))
    if known.surfaces.is_sheet[known.surfaces.element == surface].any():
        return np.inf, deep > limits.COPLANAR_M * known.scale
    before = min((1 - limits.BODY_SHARE) * deep, limits.BACK_TAUS * known.aligned.tau_m)
    return max(deep - before, limits.RIVAL_M * known.scale), False


def _with_twin(finding: ElementFinding, known: Measurements) -> ElementFinding:
    """Say of an element with the surface of another that it has."""
    if finding.surface not in known.twins:
        return finding
    other = known.design.elements[known.twins[finding.surface]]
    name = other.name if other.name != finding.element.name else f"{other.name} {other.global_id}".strip()
    return replace(finding, same_as=name, sentence=f"lies on {name}: {finding.sentence}")


def _with_doors(
    findings: Sequence[ElementFinding], extra: Sequence[Extra], known: Measurements
) -> tuple[list[ElementFinding], tuple[Extra, ...]]:
    """Say of doors whose leaf stands open that they do, and of each extra which elements it hides."""
    told = []
    for finding in findings:
        if finding.verdict == "missing" and "door" in finding.element.ifc_class.lower():
            own = known.twins.get(finding.surface, finding.surface)
            leaf = leaf_of(known.faces, own, extra, known.scale)
            if leaf is not None:
                name, angle = leaf
                text = f"its leaf stands open by {np.degrees(angle):.0f} deg: it is {name}"
                finding = replace(finding, verdict="undecided", related_extra=name, sentence=text)
        told.append(finding)
    hides: dict[str, set[str]] = {one.name: set() for one in extra}
    for finding in told:
        for by in finding.hidden:
            hides[by.by].add(finding.element.name)
    return told, tuple(replace(one, hides=tuple(sorted(hides[one.name]))) for one in extra)
