# SPDX-License-Identifier: MIT
"""Check of scans against a design, on one page.

Faces of the design are planes and cylinders. Beams are cast through it: each ends on a face, on an element,
or on something else, and passes others or is stopped before them. What the beams of a face agree on is its
surface. One mixed model of all faces and poses then says how far each face is from its place, and how the
scans lie (`alignment`). From these, each element gets a verdict with an interval, a reason, and the share of
it that was measured. Nothing inferred enters a verdict.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from completion.asbuilt import limits
from completion.asbuilt.agreement import FaceBeams, FaceSurface, beams_on_faces, bend, find_surface
from completion.asbuilt.alignment import PoseErrors, align
from completion.asbuilt.beams import Evidence, Gates, Surfaces, trace
from completion.asbuilt.conclusion import all_pixels, conclude
from completion.asbuilt.deviation import Agreed, FaceStanding, Judged, is_shown, judge_faces
from completion.asbuilt.faces import DesignFaces, elements_of, find_faces, scale_of, twins_of
from completion.asbuilt.findings import LOA_BANDS_M, DesignCheck
from completion.asbuilt.measurements import Measurements
from completion.asbuilt.misfits import unlike_others, without_misfits
from completion.asbuilt.noise import fitted_sigma
from completion.asbuilt.samples import SurfaceSamples, exposed_share, sample_design
from completion.observe.observation import Observation, observe
from completion.observe.rays import rays_of
from scenes.checks import BoolArray, FloatArray, InputError, IntArray, Value
from scenes.mesh.design import ElementMesh
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.mesh.winding import turn_outside_out
from scenes.pose import Pose
from scenes.rays.raycast import RayCaster
from scenes.scan.range_image import RangeImage

_MOST_PLACED = 2  # times that scans are moved before all beams are looked at
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckOptions(Value):
    """What is asked of a check.

    Attributes
    ----------
    tolerance_m : float
        T, metres.
    tolerances : mapping
        Tolerance by a pattern of class or name as shells match files, "IfcDoor*"; the last that fits counts.
    registration : (m, deg), optional
        Standard deviation of each scan's pose; 2 mm and 0.006 deg in a building.
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
    registration: tuple[float, float] | None = None
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
    progress: Progress | None = None,
) -> DesignCheck:
    """Check scans against a design.

    Parameters
    ----------
    design : ElementMesh
        Elements in the frame of the scans' poses, metres.
    scans : sequence of RangeImage
        With poses that fit the design to a few centimetres.
    options : CheckOptions, optional
        Tolerances, errors of poses, what to check.
    n_threads : int, optional
        Threads; the result does not depend on it.
    progress : callable, optional
        Called with a stage, steps done and steps in all.

    Raises
    ------
    InputError
        No scan, no element left, a pattern that fits none, scans of which hardly a beam ends on the design.
    """
    options = options or CheckOptions()
    told = progress or _silent
    if not scans:
        raise InputError("no scan to check; name at least one")
    scans, doubts = _fitting(design, scans, options, n_threads)
    model = _Model.of(design, options, n_threads)
    observations = model.observe(scans, options, told)
    observations, moved = model.place(observations, options, told)
    every = all_pixels(observations)
    evidence = model.trace(observations, every, options, told)
    told("deviations", 0, 1)
    agreed = model.agree(observations, every, evidence, moved, with_far=True)
    left_out, said = unlike_others(agreed, len(model.faces), [scan.name for scan in scans])
    doubts = (*doubts, *said)
    if left_out.any():
        kept = [scan for scan, is_off in zip(scans, left_out, strict=True) if not is_off]
        again = check_against_design(design, kept, options, n_threads=n_threads, progress=progress)
        return replace(again, warnings=tuple(dict.fromkeys((*doubts, *again.warnings))))
    (judged, far), aligned = model.judge(agreed, evidence), agreed.aligned
    del agreed  # beams of faces, which nobody asks any more
    measured = Measurements(
        design=model.design,
        whole=model.whole,
        twins=model.twins,
        faces=model.faces,
        surfaces=model.surfaces,
        samples=model.samples,
        exposed=model.exposed,
        gates=model.gates,
        scale=model.scale,
        middle=model.middle,
        observations=tuple(observations),
        given=tuple(scans),
        evidence=tuple(evidence),
        aligned=aligned,
        judged=judged,
        far=far,
        chosen=tuple(model.chosen),
        warnings=(*doubts, *model.warnings),
    )
    return conclude(measured, options)


def _fitting(
    design: ElementMesh, scans: Sequence[RangeImage], options: CheckOptions, n_threads: int | None
) -> tuple[Sequence[RangeImage], tuple[str, ...]]:
    """The scans that lie on what is asked of a design, and what is to be said of others."""
    _matching(design, tuple(options.tolerances))  # each fits an element
    mesh = design.mesh.some(~_matching(design, options.without)[design.mesh.face_surface])
    return without_misfits(mesh, scans, design.name, n_threads) if len(mesh.faces) else (scans, ())


@dataclass(frozen=True, slots=True, eq=False)
class _Model:
    """A design prepared for checks, its middle at the origin."""

    design: ElementMesh
    whole: LabelledMesh
    twins: Mapping[int, int]
    faces: DesignFaces
    surfaces: Surfaces
    samples: SurfaceSamples
    exposed: FloatArray
    caster: RayCaster
    gates: Gates
    errors: PoseErrors
    scale: float
    middle: FloatArray
    chosen: tuple[int, ...]
    warnings: tuple[str, ...]
    n_threads: int | None

    @classmethod
    def of(cls, design: ElementMesh, options: CheckOptions, n_threads: int | None) -> _Model:
        left_out = _matching(design, options.without)
        mesh = design.mesh.some(~left_out[design.mesh.face_surface])
        if not len(mesh.faces):
            raise InputError(f"{design.name} has no element with a surface left to check")
        middle = mesh.bounds().mean(axis=0)
        turned = turn_outside_out(mesh.at(mesh.vertices - middle), mesh.face_surface.astype(np.int64))
        whole, scale = turned.mesh, scale_of(turned.mesh)
        twins = twins_of(whole, scale)
        is_once = ~np.isin(whole.face_surface, [*twins])
        mesh = whole.some(is_once)
        faces = find_faces(mesh, scale)
        is_part = _is_part(design) and len(faces) > 1
        if is_part:
            design = elements_of(design, mesh, faces)
            faces = replace(faces, element=np.arange(len(faces), dtype=np.int32))
            mesh, left_out = design.mesh, np.zeros(len(design.elements), np.bool_)
            whole = mesh
        surfaces = Surfaces.of(mesh, faces, turned.is_closed[is_once], is_part=is_part)
        shift, turn = options.registration or (2e-3 * scale, 0.006)
        pose = float(shift), float(np.radians(turn))
        common = (limits.FREE_M * scale, limits.FREE_RAD) if options.align else (0.0, 0.0)
        caster = RayCaster(mesh.vertices, mesh.faces, n_threads)
        samples = sample_design(mesh, surfaces, caster, scale)
        exposed = exposed_share(samples, surfaces, faces.area)
        chosen = _matching(design, options.only) if options.only else np.ones(len(design.elements), np.bool_)
        present = np.bincount(whole.face_surface, minlength=len(design.elements)) > 0
        counted = (
            (turned.n_surfaces, "elements with parts that were inside out, which were turned"),
            (len(twins), "elements with the same surface as another, which share what is found on it"),
        )
        return cls(
            design=ElementMesh(mesh, design.elements, design.name),
            whole=whole,
            twins=twins,
            faces=faces,
            surfaces=surfaces,
            samples=samples,
            exposed=exposed,
            caster=caster,
            gates=Gates.of(scale, pose),
            errors=PoseErrors(pose, common),
            scale=scale,
            middle=middle,
            chosen=tuple(np.flatnonzero(chosen & present & ~left_out).tolist()),
            warnings=tuple(f"{what}: {n} of {int(present.sum())}" for n, what in counted if n),
            n_threads=n_threads,
        )

    def observe(
        self, scans: Sequence[RangeImage], options: CheckOptions, told: Progress
    ) -> list[Observation]:
        """Prepare scans in the frame whose origin is the design's middle."""
        frame = Pose.from_parts(np.eye(3), self.middle)
        seen = []
        for number, scan in enumerate(scans):
            told("observe", number, len(scans))
            seen.append(observe(scan, frame, options.sigma_m))
        return seen

    def place(
        self, observations: Sequence[Observation], options: CheckOptions, told: Progress
    ) -> tuple[list[Observation], FloatArray]:
        """Move scans to where a subset of their beams fits the design best; once more where that was far.

        Return them with the motions (s + 1, 6) that were taken off.
        """
        placed, moved = list(observations), np.zeros((len(observations) + 1, 6))
        pixels = [_subset(seen, len(placed)) for seen in placed]
        for _ in range(_MOST_PLACED):
            # the first face only: while poses are off, a layer behind it would draw scans to itself
            first = replace(self, gates=self.gates._replace(nearer=0.0))
            evidence = first.trace(placed, pixels, options, told)
            agreed = self.agree(placed, pixels, evidence, moved, with_far=False)
            moved = moved + agreed.aligned.motion
            nearer = [
                _move(seen, agreed.aligned.motion[k], agreed.aligned.motion[-1])
                for k, seen in enumerate(placed)
            ]
            step = max(
                float(np.linalg.norm(b.scan.origin - a.scan.origin))
                for a, b in zip(placed, nearer, strict=True)
            )
            placed = nearer
            if step < limits.AGAIN_M * self.scale:
                break
        return placed, moved

    def trace(
        self,
        observations: Sequence[Observation],
        pixels: Sequence[IntArray],
        options: CheckOptions,
        told: Progress,
    ) -> list[Evidence]:
        """Cast the beams of all scans through the design."""
        found = []
        for number, (seen, flat) in enumerate(zip(observations, pixels, strict=True)):
            told("beams", number, len(observations))
            found.append(
                trace(
                    seen, flat, self.caster, self.surfaces, self.gates,
                    n_elements=len(self.design.elements),
                    no_return_is_free=options.no_return_is_free,
                    n_threads=self.n_threads,
                )
            )  # fmt: skip
        return found

    def agree(
        self,
        observations: Sequence[Observation],
        pixels: Sequence[IntArray],
        evidence: Sequence[Evidence],
        moved: FloatArray,
        *,
        with_far: bool,
    ) -> Agreed:
        """Find the surface of each face, then deviations of all faces and motions of all scans."""
        beams = beams_on_faces(
            observations, pixels, evidence, self.faces, scale=self.scale, with_far=with_far
        )
        origins = np.array([seen.scan.origin for seen in observations])
        away = np.linalg.norm(beams.points - origins[beams.scan], axis=1)
        registration = np.hypot(self.errors.scan[0], self.errors.scan[1] * away)
        parts = [part for part in beams.of_faces() if part.stop - part.start >= limits.FEWEST_BEAMS // 2]
        surfaces = self._surfaces(beams, parts, registration)
        beams = self._with_noise(beams, parts, surfaces, observations)
        surfaces = self._surfaces(beams, parts, registration)
        on, columns = np.zeros(len(beams.face), np.bool_), beams.columns.copy()
        for surface, part in zip(surfaces, parts, strict=True):
            on[part] = _shown(surface.is_core, beams.scan[part])
            if surface.is_bent:
                columns[part] = bend(columns[part], beams.uv[part])
        beams = replace(beams, columns=columns)
        aligned = align(
            beams, on, origins,
            speaks=self._speaks(surfaces, evidence), moved=moved, errors=self.errors,
            bias=np.where(_rounded(observations), 1.0, limits.BIAS_SHARE), scale=self.scale,
        )  # fmt: skip
        return Agreed(beams, tuple(surfaces), tuple(parts), aligned, origins)

    def _surfaces(
        self, beams: FaceBeams, parts: Sequence[slice], registration: FloatArray
    ) -> list[FaceSurface]:
        """Find the surface of each face."""
        return [
            find_surface(
                beams, part, registration[part],
                scale=self.scale, may_bend=self._may_bend(int(beams.face[part.start])),
            )
            for part in parts
        ]  # fmt: skip

    def _with_noise(
        self,
        beams: FaceBeams,
        parts: Sequence[slice],
        surfaces: Sequence[FaceSurface],
        observations: Sequence[Observation],
    ) -> FaceBeams:
        """The beams with the noise that the faces show, instrument by instrument."""
        on, residual = np.zeros(len(beams.face), np.bool_), np.zeros(len(beams.face))
        for surface, part in zip(surfaces, parts, strict=True):
            on[part], residual[part] = surface.is_on, surface.residual
        on &= beams.face < len(self.faces)
        kinds = [(seen.scan.sensor, seen.scan.projection.kind) for seen in observations]
        instrument = np.array([kinds.index(kind) for kind in kinds])[beams.scan]
        rays = beams.points - np.array([seen.scan.origin for seen in observations])[beams.scan]
        ranges = np.linalg.norm(rays, axis=1)
        cosine = np.abs(np.einsum("ij,ij->i", rays, beams.normal)) / np.maximum(ranges, 1e-12)
        sigma = fitted_sigma(residual, ranges, cosine, instrument, on)
        # what is rounded shows less noise than it has: all of a face may lie in one step
        least = np.where(_rounded(observations)[beams.scan], beams.sigma, 1e-4 * self.scale * cosine)
        return replace(beams, sigma=np.where(np.isfinite(sigma), np.maximum(sigma, least), beams.sigma))

    def _speaks(self, surfaces: Sequence[FaceSurface], evidence: Sequence[Evidence]) -> BoolArray:
        """Which faces (2 F,) are shown well enough to say something of the poses; far ones never are."""
        speaks, support = np.zeros(2 * len(self.faces), np.bool_), self._support(surfaces, evidence)
        for surface in surfaces:
            if surface.face < len(self.faces):
                at = float(support[surface.face]), float(self.exposed[surface.face])
                speaks[surface.face] = is_shown(surface, *at, self.scale)
        return speaks

    def _support(self, surfaces: Sequence[FaceSurface], evidence: Sequence[Evidence]) -> FloatArray:
        """Share (F,) of what beams could have met of each face that they met."""
        reach = np.sum([found.reach for found in evidence], axis=0)
        on = np.zeros(2 * len(self.faces))
        for surface in surfaces:
            on[surface.face] = surface.area_m2
        share: FloatArray = np.minimum(on[: len(self.faces)] / np.maximum(reach, 1e-12), 1.0)
        return share

    def _may_bend(self, face: int) -> bool:
        """Whether a face may be judged as bent: planes in their places."""
        return face < len(self.faces) and not self.faces.sign[face]

    def judge(
        self, agreed: Agreed, evidence: Sequence[Evidence]
    ) -> tuple[tuple[Judged, ...], tuple[Judged, ...]]:
        """Judge all faces, and what lies farther off and may be theirs."""
        support = self._support(agreed.surfaces, evidence)
        open_area = self.exposed * self.faces.area
        largest = np.zeros(len(self.design.elements))
        np.maximum.at(largest, self.faces.element, open_area)
        is_main = open_area >= limits.MAIN_SHARE * np.maximum(largest[self.faces.element], 1e-12)
        every = judge_faces(agreed, self.faces, FaceStanding(is_main, support, self.exposed), self.scale)
        return tuple(one for one in every if not one.is_far), tuple(one for one in every if one.is_far)


def _silent(stage: str, done: int, total: int) -> None:
    """Progress that nobody wants to see."""


def _matching(design: ElementMesh, patterns: Sequence[str]) -> BoolArray:
    """Which elements have a class, name or GlobalId that fits one of the patterns."""
    found = np.zeros(len(design.elements), np.bool_)
    for pattern in patterns:
        fits = np.array([element.is_like(pattern) for element in design.elements], np.bool_)
        if not fits.any():
            raise InputError(f"no element of {design.name} is like {pattern!r}; give a class or name")
        found |= fits
    return found


def _shown(is_on: BoolArray, scan: NDArray[np.int32]) -> BoolArray:
    """The beams (n,) on a face without those of scans of whose beams too few are on it."""
    n = int(scan.max()) + 1
    share = np.bincount(scan[is_on], minlength=n) / np.maximum(np.bincount(scan, minlength=n), 1)
    return np.asarray(is_on & (share >= limits.LEAST_SUPPORT)[scan])


def _rounded(observations: Sequence[Observation]) -> BoolArray:
    """The scans (s,) whose ranges come in steps that hide the noise: means of beams are no more exact."""
    return np.array([seen.noise.step_m > 0 for seen in observations], np.bool_)


def _is_part(design: ElementMesh) -> bool:
    """Whether a design is one body without anything said of it."""
    return len(design.elements) == 1 and not design.elements[0].ifc_class


def _subset(seen: Observation, n_scans: int) -> NDArray[np.int64]:
    """Flat pixels of a grid over a scan's image, so that all scans together have enough."""
    rows, columns = seen.scan.shape
    step = max(1, int(np.sqrt(rows * columns * n_scans / limits.SUBSET)))
    grid = np.arange(step // 2, rows, step)[:, None] * columns + np.arange(step // 2, columns, step)
    return np.asarray(grid.ravel(), dtype=np.int64)


def _move(seen: Observation, own: FloatArray, common: FloatArray) -> Observation:
    """A scan moved back by its own motion about its place, and by that of all about the design's middle."""
    from scipy.spatial.transform import Rotation

    pose = seen.scan.world_from_sensor
    turn, shift = Rotation.from_rotvec(-own[:3]).as_matrix(), -own[3:]
    rotation, place = turn @ pose.rotation, pose.translation + shift
    turn = Rotation.from_rotvec(-common[:3]).as_matrix()
    moved = Pose.from_parts(turn @ rotation, turn @ place - common[3:])
    scan = seen.scan.with_facts(world_from_sensor=moved)
    return replace(seen, scan=scan, rays=rays_of(scan))
