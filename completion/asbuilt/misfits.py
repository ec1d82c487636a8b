# SPDX-License-Identifier: MIT
"""Misfits: scans that do not lie on the design, and the shift that would bring them there, by some beams.

A beam whose ray meets the design ends on its first surface, before it or behind it. Of a scan at its place,
many end on it, whatever stands before the rest, and few behind it, be they walls or floors. At another place
it is the other way round, unless a shift brings them back: each beam says of the shift what the normal of its
surface tells, and three of them give it (consensus: Fischler & Bolles 1981).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from completion.asbuilt import limits
from completion.asbuilt.deviation import Agreed
from completion.asbuilt.faces import scale_of
from completion.observe.rays import pick_rays, rays_of
from scenes.checks import BoolArray, FloatArray, InputError
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.rays.raycast import RayCaster
from scenes.scan.range_image import RangeImage

_N_BEAMS, _N_TRIPLES, _ROUNDS = 3000, 1000, 4
_RIDGE = 0.01  # keeps triples of nearly one plane from large shifts along it
_COARSE, _GRID, _SPARSE = (
    3.0,
    (21, 21, 9),
    15,
)  # times the gate between shifts first tried, and one beam in so many
_FEWEST = 30  # beams of which anything is said
_TELLING = 0.05  # of those beams: as many as show an element
_LEVEL = 0.7  # cosine with the vertical of floors and ceilings
_UNITS = {"mm": 0.001, "cm": 0.01, "in": 0.0254, "ft": 0.3048}  # metres
_OTHER_SIZE = 20.0  # ratio of extents from which on a unit is the likely cause


class _Met(NamedTuple):
    """Beams (n,) that meet the design somewhere: normal (n, 3), element, and how far beyond they end."""

    normal: FloatArray
    element: NDArray[np.int32]
    off: FloatArray  # metres, along the normal but positive behind the surface; -inf for no surface

    def on(self, gate: float) -> BoolArray:
        """Which end on it."""
        return np.asarray(np.abs(self.off) <= gate)

    def shares(self, gate: float) -> tuple[float, float]:
        """Share of beams on the design: of those that meet it, and of those that reach as far.

        The latter is the less of those of upright and of level surfaces.
        """
        on, met, reach = self.on(gate), np.isfinite(self.off), self.off >= -gate
        upright = np.abs(self.normal[:, 2]) <= _LEVEL
        least = max(_FEWEST, 2 * _TELLING * met.sum())
        reached = [
            _share(on, reach & group) for group in (upright, ~upright) if (reach & group).sum() >= least
        ]
        return _share(on, met), min([1.0, *reached])

    def elements(self, chosen: BoolArray, least: float) -> frozenset[int]:
        """Those of at least so many chosen beams."""
        element, count = np.unique(self.element[chosen], return_counts=True)
        return frozenset(element[count >= least].tolist())


def _share(on: BoolArray, of: BoolArray) -> float:
    return float((on & of).sum() / max(of.sum(), 1))


class _Fit(NamedTuple):
    """How a scan lies on the design: how many rays meet it, shares of them, and the box (2, 3) of its points.

    `share` and `reached` are `_Met.shares`; `beyond` is the share that ends behind the design, and `is_wide`
    whether it looked all round, so that no thing and no gap can be all that it saw. After the best `shift`
    (3,), metres, `moved` end on it. Of the beams that notice that shift, `notice` are the shares on it before
    and after, the latter on elements `shown`; `seen` are the elements that beams end on as it is. `is_sure`:
    the shift is the scan's, not that of an element.
    """

    name: str
    n_met: int
    share: float
    reached: float
    beyond: float
    is_wide: bool
    moved: float
    shift: FloatArray
    notice: tuple[float, float]
    shown: frozenset[int]
    seen: frozenset[int]
    box: FloatArray
    is_sure: bool = False

    @property
    def is_elsewhere(self) -> bool:
        """Whether it fits where a shift brings it, and not where it is."""
        before, after = self.notice
        is_noticed = self.is_sure and before < limits.FITS_NOTICED[0] and after > limits.FITS_NOTICED[1]
        return is_noticed and self.beyond > limits.FITS_BEYOND and self.moved > limits.FITS_MOVED

    def beside(self, others: Sequence[_Fit]) -> _Fit:
        """The same, sure where a shift brings it to several elements, or to one that others see there."""
        seen = frozenset[int]().union(*(fit.seen for fit in others if fit is not self))
        return self._replace(is_sure=len(self.shown) > 1 or bool(self.shown & seen))

    @property
    def is_on(self) -> bool:
        """Whether it lies on the design."""
        fits = self.share > limits.FITS_SHARE and self.reached > limits.FITS_REACHED
        return self.n_met >= _FEWEST and fits and not self.is_elsewhere

    def sentence(self, gate: float) -> str:
        """Say how it lies."""
        told = f"{self.share:.0%} of its beams towards the design end within {100 * gate:.3g} cm of it"
        if self.is_elsewhere:
            return f"{told}, {self.moved:.0%} if it is moved by ({_metres(self.shift)}) m"
        return f"{told}, and {self.reached:.0%} of those that reach its upright or its level surfaces"


def without_misfits(
    mesh: LabelledMesh, scans: Sequence[RangeImage], name: str, n_threads: int | None = None
) -> tuple[tuple[RangeImage, ...], tuple[str, ...]]:
    """Return the scans that lie on the mesh of a design, called `name`, and a sentence on each other one.

    Scans of which hardly a ray meets the design stay: they say next to nothing.

    Raises
    ------
    InputError
        No scan lies on it: how far they are off, and the likely cause.
    """
    middle, gate = mesh.bounds().mean(axis=0), limits.FITS_M * scale_of(mesh)
    look = mesh.appearance
    if look is not None and look.opacity is not None and (look.opacity >= limits.SEE_THROUGH).any():
        mesh = mesh.some(look.opacity >= limits.SEE_THROUGH)
    local = mesh.at(mesh.vertices - middle)
    caster = RayCaster(local.vertices, local.faces, n_threads)
    beams = [_Beams(scan, local, caster, middle) for scan in scans]
    fits = [one.fit(gate) for one in beams]
    fits = [fit.beside(fits) for fit in fits]
    if not any(len(fit.box) for fit in fits):
        raise InputError(f"no beam of {', '.join(fit.name for fit in fits)} has a return; nothing to check")
    lead, unit = f"{name}: the scans do not fit the design", _other_unit(mesh, beams, fits, gate)
    if unit or not any(fit.is_on for fit in fits):
        raise InputError(f"{lead}: {unit or _cause(mesh, fits, gate)}")
    kept, told = list[RangeImage](), list[str]()
    for scan, fit in zip(scans, fits, strict=True):
        sentence = f"the design: {fit.sentence(gate)}"
        if fit.n_met < _FEWEST:
            told.append(f"{fit.name} tells next to nothing: only {fit.n_met} of its beams meet the design")
        elif fit.is_wide and not fit.is_on:
            told.append(f"{fit.name} was left out, since it does not fit {sentence}")
            continue
        elif fit.reached < limits.FITS_UNLIKE:
            told.append(f"{fit.name} hardly fits {sentence}; unless much is not built, its pose is wrong")
        kept.append(scan)
    return tuple(kept), tuple(told)


def agreeing(mesh: LabelledMesh, scans: Sequence[RangeImage], n_threads: int | None = None) -> float:
    """Return the mean share of the scans' beams that end on the mesh of a design, or near it."""
    middle, gate = mesh.bounds().mean(axis=0), limits.FITS_M * scale_of(mesh)
    local = mesh.at(mesh.vertices - middle)
    caster = RayCaster(local.vertices, local.faces, n_threads)
    beams = [_Beams(scan, local, caster, middle) for scan in scans]
    shares = [float(one.scaled(1.0).on(gate).mean()) for one in beams if len(one.ranges)]
    return float(np.mean(shares)) if shares else 0.0


def unlike_others(agreed: Agreed, n_faces: int, names: Sequence[str]) -> tuple[BoolArray, tuple[str, ...]]:
    """Return which scans (s,) to leave out: few of their beams near faces lie on what all show; and why.

    `names` are those of the scans; sentences on doubtful ones, too.
    """
    on, near = np.zeros(len(names)), np.zeros(len(names))
    for surface, part in zip(agreed.surfaces, agreed.parts, strict=True):
        if surface.face < n_faces:
            scan = agreed.beams.scan[part]
            on += np.bincount(scan[surface.is_on], minlength=len(names))
            near += np.bincount(scan, minlength=len(names))
    share = on / np.maximum(near, 1)
    asked = near >= limits.FEWEST_BEAMS
    usual = float(np.median(share[asked])) if asked.any() else 0.0
    out, doubtful = (asked & (share < least * usual) for least in limits.UNLIKE)
    told = tuple(
        f"{names[k]} {'was left out, since it does not fit' if out[k] else 'hardly fits'} the design and the "
        f"other scans: {share[k]:.0%} of its beams near faces of the design lie on the surfaces that all "
        f"show, {usual:.0%} of the usual scan's; mend its pose"
        for k in np.flatnonzero(doubtful).tolist()
    )
    return out, told


class _Beams:
    """Some beams of a scan, evenly, about the middle of a design."""

    def __init__(self, scan: RangeImage, mesh: LabelledMesh, caster: RayCaster, middle: FloatArray) -> None:
        pixels = np.flatnonzero(scan.valid)
        n = min(len(pixels), _N_BEAMS)
        pixels = pixels[((np.arange(n) + 0.5) * len(pixels) / max(n, 1)).astype(np.int64)]
        self.ways, self.ranges = np.empty((n, 3)), scan.ranges.ravel()[pixels].astype(np.float64)
        pick_rays(rays_of(scan), pixels, self.ways)
        points = scan.origin + self.ranges[:, None] * self.ways
        self.box = np.array([points.min(axis=0), points.max(axis=0)]) if n else np.zeros((0, 3))
        self.start, self.middle, self.name = scan.origin - middle, middle, scan.name
        self.caster, self.mesh, self.normals = caster, mesh, mesh.face_normals()
        self.is_wide = scan.projection.kind == "spherical"

    def cast(self, shift: FloatArray) -> _Met:
        """Cast them from a shifted place."""
        return self._cast((self.start + shift)[None], self.ways, self.ranges)

    def scaled(self, factor: float) -> _Met:
        """Cast them as if all lengths of the scan were larger by a factor."""
        start = factor * (self.start + self.middle) - self.middle
        return self._cast(start[None], self.ways, factor * self.ranges)

    def _cast(self, start: FloatArray, ways: FloatArray, ranges: FloatArray) -> _Met:
        hits = self.caster.first_hit(start, ways)
        normal = self.normals[hits.face]
        along = np.abs(np.einsum("ij,ij->i", normal, ways))
        off = np.where(hits.hit, (ranges - np.where(hits.hit, hits.ranges, 0.0)) * along, -np.inf)
        return _Met(normal, self.mesh.face_surface[hits.face], off)

    def fit(self, gate: float) -> _Fit:
        """Say how the scan lies, and where it would lie better."""
        first = best = met = self.cast(np.zeros(3))
        shift, rng = np.zeros(3), np.random.default_rng(0)
        n_met = int(np.isfinite(first.off).sum())
        beyond = _share(first.off > gate, np.isfinite(first.off))
        may_move = beyond > limits.FITS_BEYOND  # a scan of which less ends behind the design is not elsewhere
        far_off = may_move and first.shares(gate)[0] < limits.FITS_NOTICED[1]
        total = self._start(gate) if far_off else shift
        met = self.cast(total) if far_off else met
        for _ in range(_ROUNDS if may_move else 0):
            total = total + self._step(met, gate, rng)
            met = self.cast(total)
            if np.isfinite(met.off).sum() >= n_met / 2 and met.shares(gate)[0] > best.shares(gate)[0]:
                best, shift = met, total
        noticed = np.abs(best.normal @ shift) > limits.FITS_SHIFT * gate
        noticed &= best.on(gate) | first.on(gate)
        shares = (_share(first.on(gate), noticed), _share(best.on(gate), noticed))
        shown = best.elements(
            noticed & best.on(gate), max(_FEWEST, _TELLING * n_met, _TELLING * noticed.sum())
        )
        share, reached = first.shares(gate)
        return _Fit(
            name=self.name,
            n_met=n_met,
            share=share,
            reached=reached,
            beyond=beyond,
            is_wide=self.is_wide,
            moved=best.shares(gate)[0],
            shift=shift,
            notice=shares,
            shown=shown,
            seen=first.elements(first.on(gate), _FEWEST),
            box=self.box,
        )

    def _start(self, gate: float) -> FloatArray:
        """The shift (3,) of a grid after which most of some beams end near the design."""
        ways, ranges = self.ways[::_SPARSE], self.ranges[::_SPARSE]
        grid = _COARSE * gate * (np.array([*np.ndindex(*_GRID)]) - np.array(_GRID) // 2)
        grid = grid[np.argsort(np.linalg.norm(grid, axis=1), kind="stable")]
        near = list[int]()
        for some in np.array_split(grid, _GRID[2]):
            start = np.repeat(self.start + some, len(ways), axis=0)
            met = self._cast(start, np.tile(ways, (len(some), 1)), np.tile(ranges, len(some)))
            near += met.on(_COARSE * gate).reshape(len(some), -1).sum(axis=1).tolist()
        return np.asarray(grid[int(np.argmax(near))])

    def _step(self, met: _Met, gate: float, rng: np.random.Generator) -> FloatArray:
        """The shift (3,) that brings most beams onto the surfaces that they met."""
        known = np.isfinite(met.off)
        if known.sum() < _FEWEST:
            return np.zeros(3)
        facing = np.sign(np.einsum("ij,ij->i", met.normal[known], self.ways[known]))
        normal, off = met.normal[known] * facing[:, None], met.off[known]
        three = rng.integers(0, len(off), (_N_TRIPLES, 3))
        a, b = normal[three], -off[three]
        square = np.einsum("kij,kil->kjl", a, a) + _RIDGE * np.eye(3)
        tried = np.linalg.solve(square, np.einsum("kij,ki->kj", a, b)[..., None])[..., 0]
        near = np.abs(tried @ normal.T + off) <= gate
        k = int(near.sum(axis=1).argmax())
        own = normal[near[k]]
        return np.asarray(np.linalg.solve(own.T @ own + _RIDGE * np.eye(3), -own.T @ off[near[k]]))


def _boxes(mesh: LabelledMesh, fits: Sequence[_Fit]) -> tuple[FloatArray, FloatArray]:
    """The box of the design and that of all points."""
    boxes = np.array([fit.box for fit in fits if len(fit.box)])
    return mesh.bounds(), np.array([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])


def _spans(boxes: tuple[FloatArray, FloatArray]) -> tuple[float, float]:
    """Diagonals of two boxes (2, 3)."""
    ours, theirs = (float(np.linalg.norm(box[1] - box[0])) for box in boxes)
    return ours, theirs


def _other_unit(mesh: LabelledMesh, beams: Sequence[_Beams], fits: Sequence[_Fit], gate: float) -> str:
    """Say that scans fit a design if its unit or theirs is another one; "" if that helps none."""
    cures = {1.0: ""}
    for unit, metres in _UNITS.items():
        cures |= {1 / metres: f"--design-units {unit}", metres: f"--units {unit} --design-units m"}
    design, measured = _spans(_boxes(mesh, fits))
    likely = [k for k in cures if 1 / _OTHER_SIZE < k * measured / design < _OTHER_SIZE or k == 1]
    n = sum(len(one.ranges) for one in beams)
    shares = {k: sum(int(one.scaled(k).on(k * gate).sum()) for one in beams) / n for k in likely}
    best = max(shares, key=lambda k: shares[k])
    if shares[best] < limits.FITS_UNIT + shares[1.0]:
        return ""
    return (
        f"{shares[1.0]:.0%} of their beams end within {100 * gate:.3g} cm of it, {shares[best]:.0%} with "
        f"{cures[best]}; give that"
    )


def _cause(mesh: LabelledMesh, fits: Sequence[_Fit], gate: float) -> str:
    """Say why no scan lies on the design, and the cure."""
    ours, theirs = _boxes(mesh, fits)
    spans = _spans((ours, theirs))
    apart = float(np.linalg.norm(np.maximum(0, np.maximum(ours[0] - theirs[1], theirs[0] - ours[1]))))
    if max(spans) > _OTHER_SIZE * min(spans) and apart < 10 * max(spans):
        return (
            f"it spans {spans[0]:.3g} m, what they measured {spans[1]:.3g} m; give --design-units or --units"
        )
    if apart > max(spans):
        return (
            f"it lies about ({_metres(ours.mean(axis=0))}) m, what they measured about "
            f"({_metres(theirs.mean(axis=0))}) m, {apart:.0f} m apart; give both in one frame, or --register"
        )
    best = max(fits, key=lambda fit: (fit.share, fit.moved))
    return (
        f"{best.name}: {best.sentence(gate)}; give --poses in the design's frame, --register to place the "
        "scans, --units, or --without what is not built yet"
    )


def _metres(place: FloatArray) -> str:
    return ", ".join(f"{x + 0.0:.2f}" for x in np.round(place, 2))
