# SPDX-License-Identifier: MIT
"""3-D views of a completed model, and of scans without one.

The model shows what was measured, what was inferred and why, and how sure that is; scans alone show what they
measured, what was inferred, and where the unknown begins. Of each face: which scans see it,
at which incidence.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from completion.export.panels.sheet import spread_out
from completion.extension.patch import Patch, Provenance
from completion.result.completed_model import CompletedModel, TexturedPart
from completion.result.labelled_points import PROVENANCE_NAMES
from completion.texturing.chart_texture import Atlas
from nbv.coverage.coverage import VisibilityHistory
from nbv.coverage.measurement import measured_samples
from nbv.report.figures import picture
from nbv.report.figures.completion_shots import is_single_camera
from nbv.report.figures.picture import Camera, Picture, aside_cameras
from nbv.report.figures.surface_values import cut_finely
from nbv.report.viewer.layers import (
    Category,
    Classes,
    Layer,
    Numbers,
    Sightings,
    Viewer,
    confidence_channel,
    count_channel,
    deviation_channel,
    incidence_channel,
)
from nbv.report.viewer.markers import given_markers, look_of_scan, opening_lines, view_markers, zone_lines
from nbv.report.viewer.scene_view import PALE
from nbv.report.viewer.things_layer import things_layer
from nbv.report.viewer.unknown_layer import INFERRED, MEASURED, STATES, unknown_layer
from nbv.run.plain_words import WHY_INFERRED
from nbv.scanning.sensor import Sensor
from nbv.scans.scan_coverage import ScanCoverage
from nbv.scans.scan_map import with_known_noise
from nbv.scans.state_mesh import FRONTIER, SEEN_WORSE, SHADOW, StateMesh
from nbv.scans.state_mesh import INFERRED as STATE_INFERRED
from nbv.scans.state_mesh import STATES as SCAN_STATES
from nbv.visibility.samples import SurfaceSamples
from nbv.visibility.zones import EVERYWHERE, Zones
from scenes.checks import FloatArray
from scenes.mesh.labelled_mesh import Appearance
from scenes.mesh.mesh_parts import thin_mesh
from scenes.pose import Pose
from scenes.run.mapping import trim
from scenes.scan.colour import surface_rgb
from scenes.scan.range_image import RangeImage

_BLOCK = 1 << 16  # faces whose sightings are found together
_PROVENANCE_COLOURS = (0, 1, 14, 5, 3, 13, 6, 10, 9)  # of `Provenance`, numbers in the palette of surfaces


def provenance_categories() -> tuple[Category, ...]:
    """How a place came to be in the model, each with its colour."""
    colours = (picture.MEASURED, *(surface_rgb(k) for k in _PROVENANCE_COLOURS[1:]))
    return tuple(
        Category(WHY_INFERRED[PROVENANCE_NAMES[str(why.value)]], colours[int(why)]) for why in Provenance
    )


def scan_sightings(scans: Sequence[RangeImage], vertices: FloatArray, faces: NDArray[Any]) -> Sightings:
    """Which scans measured the middles of faces (m, 3), and at which incidence.

    Faces of the vertices (n, 3) are asked for a block at a time.
    """
    known = [with_known_noise(scan) for scan in scans]
    blocks = [faces[start : start + _BLOCK] for start in range(0, len(faces), _BLOCK)]
    sightings = [_sightings_of(known, vertices[block]) for block in blocks]
    counts = [np.diff(sightings.start) for sightings in sightings]
    return Sightings(
        np.concatenate([[0], np.cumsum(np.concatenate([np.zeros(0, np.int64), *counts]))]),
        np.concatenate([np.zeros(0, np.int64), *(sightings.view for sightings in sightings)]),
        np.concatenate([np.zeros(0), *(sightings.incidence_deg for sightings in sightings)]),
    )


def _sightings_of(scans: Sequence[RangeImage], corners: FloatArray) -> Sightings:
    """Which scans measured the middles of faces (m, 3, 3)."""
    a, b, c = np.moveaxis(corners, 1, 0)
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1)
    unit = np.divide(normals, length[:, None], out=np.zeros_like(normals), where=length[:, None] > 0)
    zero = np.zeros(len(corners), np.int32)
    samples = SurfaceSamples(corners.mean(axis=1), unit, length / 2, zero, zero)
    numbered = []
    for number, scan in enumerate(scans, start=1):
        numbered.append((number, *measured_samples(scan, samples)))
        trim()
    seen = VisibilityHistory.of(numbered, np.zeros(len(corners), np.int64), ())
    return Sightings(seen.start, seen.view, np.degrees(np.arccos(np.clip(seen.cosine, 0, 1))))


def quality_channels(sightings: Sightings, n_scans: int) -> tuple[Numbers, Numbers]:
    """Best incidence and number of scans of each place."""
    counts = np.diff(sightings.start)
    best = np.full(len(counts), np.inf)
    np.minimum.at(best, np.repeat(np.arange(len(counts)), counts), sightings.incidence_deg)
    angle, many = np.where(counts > 0, best, np.nan), np.where(counts > 0, counts, np.nan)
    absent = "not at the middle of a pixel"
    counted = count_channel("Scans that see it", many, max(n_scans, 2), absent)
    return incidence_channel(angle, absent), counted


_PIECES = 40_000  # into which recognised surface is cut, about
_HIDES = 0.02  # share of another surface's inferred cells that an occluder hides
_GREY = 0.72
_NO_SURFACE = 0


@dataclass(frozen=True, slots=True, eq=False)
class _Pieces:
    """Small faces (m, 3) of one surface, of the remainder, or of many of these; coordinates of drawings.

    Of each face: the surface's `number`, `provenance`, `sd` in metres, `confidence`, `colour` (m, 3, 3) and
    `uv` (m, 3, 2) of its corners, and `image`, which is -1 without a texture.
    """

    vertices: FloatArray
    faces: NDArray[np.int32]
    number: NDArray[np.uint16]
    provenance: NDArray[np.uint16]
    sd: FloatArray
    confidence: FloatArray
    colour: NDArray[np.float32]
    uv: NDArray[np.float32]
    image: NDArray[np.int32]

    @classmethod
    def join(cls, parts: Sequence[_Pieces]) -> _Pieces:
        """All of them, in their order."""
        starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
        faces = [part.faces + np.int32(start) for part, start in zip(parts, starts, strict=False)]
        fields = [name for name in cls.__slots__ if name != "faces"]
        return cls(
            faces=np.concatenate(faces), **{n: np.concatenate([getattr(p, n) for p in parts]) for n in fields}
        )


def completion_view(
    completion: CompletedModel,
    pictures: tuple[Picture, ...] = (),
    *,
    is_room: bool,
    camera: Camera | None = None,
) -> Viewer:
    """Return the view of a completed model, z up.

    A room is looked into from outside; `camera` is where it is seen from at first.
    """
    world = completion.drawing_from_reference
    scans = [with_known_noise(scan) for scan in completion.drawn_scans]
    atlas = completion.atlas
    occluders = set(find_occluders(completion.patches))
    textured = completion.textured
    measured = [part for part in textured if part.provenance == Provenance.MEASURED]
    of = partial(_surfaces, completion)
    groups = (
        ("measured", "measured surfaces", of([p for p in measured if p.number not in occluders])),
        (
            "occluders",
            "occluders, measured",
            of([p for p in measured if p.number in occluders], with_remainder=True),
        ),
        (
            "inferred",
            "inferred",
            of([part for part in textured if part.provenance != Provenance.MEASURED]),
        ),
    )
    outlines = [world.apply(hole.points) for surface in completion.surfaces for hole in surface.openings]
    names = surface_names(completion)
    most_sd = max(float(pieces.sd.max(initial=0)) for _, _, pieces in groups)
    layers = [
        _layer(key, label, pieces, names=names, most_sd=most_sd, atlas=atlas, scans=scans)
        for key, label, pieces in groups
    ]
    layers += [unknown_layer(completion, names), things_layer(completion, names)]
    return Viewer(
        "The completed model.",
        tuple(layer for layer in layers if len(layer.faces)),
        mode="marked" if completion.textures else "state",
        markers=view_markers([s.world_from_sensor for s in scans], [s.projection for s in scans]),
        lines=opening_lines(outlines),
        is_room=is_room,
        pictures=pictures,
        camera=camera,
        noun="scan",
    )


def find_occluders(patches: Sequence[Patch]) -> list[int]:
    """Numbers of the surfaces that hide a part of others."""
    numbers: set[int] = set()
    for patch in patches:
        behind = patch.evidence.occluder[patch.hypothesised]
        share = np.bincount(behind[behind > 0]) / max(len(behind), 1)
        numbers.update(int(number) for number in np.flatnonzero(share >= _HIDES))
        trim()
    return sorted(numbers)


def _surfaces(
    completion: CompletedModel, parts: Sequence[TexturedPart], *, with_remainder: bool = False
) -> _Pieces:
    """Pieces of surfaces, and of what belongs to none with the `rest`."""
    total = sum(patch.observed_m2 + patch.hypothesised_m2 for patch in completion.patches)
    surfaces = [_pieces(completion, part, total / _PIECES) for part in parts]
    return _Pieces.join([_no_faces(), *surfaces, *([_remainder(completion)] if with_remainder else [])])


def _no_faces() -> _Pieces:
    """No face at all."""
    none, many, real = np.zeros(0, np.uint16), np.zeros((0, 3)), np.zeros(0)
    corners = np.zeros((0, 3, 3), np.float32)
    image = none.astype(np.int32)
    return _Pieces(
        vertices=many,
        faces=many.astype(np.int32),
        number=none,
        provenance=none,
        sd=real,
        confidence=real,
        colour=corners,
        uv=corners[..., :2],
        image=image,
    )


def _pieces(completion: CompletedModel, part: TexturedPart, limit_m2: float) -> _Pieces:
    """Cells of one surface, cut finely."""
    trim()
    patch, mesh = completion.patches[part.number - 1], part.part
    cells = (mesh.uv - patch.grid.corner)[:, ::-1] / patch.grid.cell[::-1]
    whole = np.concatenate([mesh.vertices, part.uv, cells], axis=1)[mesh.faces]
    parts = cut_finely(whole.reshape(-1, 3, 7), limit_m2)[0]
    middle = parts.mean(axis=1)
    top = np.array(patch.grid.shape) - 1
    row, column = np.clip(np.floor(middle[:, 5:]).astype(np.int64), 0, top).T
    n = len(parts)
    return _Pieces(
        vertices=completion.drawing_from_reference.apply(parts[..., :3].reshape(-1, 3)),
        faces=np.arange(3 * n, dtype=np.int32).reshape(-1, 3),
        number=np.full(n, part.number, np.uint16),
        provenance=np.full(n, int(part.provenance), np.uint16),
        sd=patch.stated.standard_deviation(middle[:, :3]) if n else np.zeros(0),
        confidence=spread_out(patch.confidence, patch.provenance >= 0)[row, column],
        colour=np.broadcast_to(np.float32(1.0 if part.page >= 0 else _GREY), (n, 3, 3)),
        uv=parts[..., 3:5].astype(np.float32),
        image=np.full(n, part.page, np.int32),
    )


def _remainder(completion: CompletedModel) -> _Pieces:
    """What was measured and belongs to no surface."""
    remainder = completion.light_remainder
    faces = remainder.faces
    n = len(faces)
    return _Pieces(
        vertices=completion.drawing_from_reference.apply(remainder.vertices),
        faces=faces,
        number=np.full(n, _NO_SURFACE, np.uint16),
        provenance=np.zeros(n, np.uint16),
        sd=remainder.sd[faces].mean(axis=1) if n else np.zeros(0),
        confidence=np.ones(n),
        colour=remainder.colour[faces].astype(np.float32) / np.float32(255),
        uv=np.broadcast_to(np.float32(0), (n, 3, 2)),
        image=np.full(n, -1, np.int32),
    )


def _layer(
    key: str,
    label: str,
    pieces: _Pieces,
    *,
    names: tuple[Category, ...],
    most_sd: float,
    atlas: Atlas,
    scans: Sequence[RangeImage],
) -> Layer:
    """Pieces as a layer with their values."""
    is_inferred, n = key == "inferred", len(pieces.faces)
    channels: list[Classes | Numbers] = [
        Classes("state", "State", STATES, np.full(n, int(is_inferred), np.uint16)),
        Classes("provenance", "Why it is there", provenance_categories(), pieces.provenance),
        deviation_channel(1000 * pieces.sd, 1000 * most_sd),
    ]
    sightings = None
    if is_inferred:
        channels.append(confidence_channel(pieces.confidence))
    else:
        sightings = scan_sightings(scans, pieces.vertices, pieces.faces)
        channels += quality_channels(sightings, len(scans))
    channels.append(Classes("surface", "Surface", names, pieces.number))
    pages = (atlas.pages, pieces.image, pieces.uv) if len(atlas.pages) else ()
    return Layer(
        key,
        label,
        pieces.vertices,
        pieces.faces,
        INFERRED if is_inferred else MEASURED,
        channels=tuple(channels),
        sightings=sightings,
        skin=Appearance(pieces.colour, *pages),
        is_marked=is_inferred,
    )


def surface_names(completion: CompletedModel) -> tuple[Category, ...]:
    """The surfaces by number, 0 for what belongs to none, in the colours of the tables."""
    kinds = [patch.source.fit.surface.kind for patch in completion.patches]
    named = (Category(f"{k} {kind}", surface_rgb(k)) for k, kind in enumerate(kinds, start=1))
    return Category("none", surface_rgb(0)), *named


_CATEGORIES = (
    Category(SCAN_STATES[0], picture.MEASURED),
    Category(SCAN_STATES[1], picture.MODELLED, "dotted"),
    INFERRED,
    Category(SCAN_STATES[SHADOW], picture.UNKNOWN, "hatched"),
    Category(SCAN_STATES[FRONTIER], PALE),
)
_MOST_FACES = 600_000  # that were measured; edges of the unknown have as many voxels' faces as they have


def state_view(
    coverage: ScanCoverage,
    state: StateMesh,
    pictures: tuple[Picture, ...],
    *,
    poses: Sequence[Pose] = (),
    sensor: Sensor | None = None,
    zones: Zones = EVERYWHERE,
) -> Viewer:
    """Return the view of what scans say of a place, with the next stations and the sensor there."""
    scans = coverage.scan_map.scans
    looks = [look_of_scan(scan, sensor) for scan in scans]
    given = given_markers([scan.world_from_sensor for scan in scans], looks, are_steps=not poses)
    following = view_markers(poses, [sensor] * len(poses)) if sensor is not None else ()
    layers = (_measured_layer(coverage, state), _inferred_layer(coverage, state), *_state_edges(state))
    single = is_single_camera(list(scans))
    return Viewer(
        "What the scans measured, and where the unknown begins.",
        tuple(layer for layer in layers if len(layer.faces)),
        markers=(*given, *following),
        lines=zone_lines(zones),
        is_room=coverage.scan_map.mode == "room" and not single,
        pictures=pictures,
        camera=aside_cameras(scans[0])[0] if single else None,
        noun="view" if poses else "scan",
    )


def _measured_layer(coverage: ScanCoverage, state: StateMesh) -> Layer:
    """What was measured, as required or worse."""
    faces = _faces(state, state.mesh.face_surface <= SEEN_WORSE)
    vertices, faces, kept = thin_mesh(state.mesh.vertices, faces, _MOST_FACES)
    scans = coverage.scan_map.scans
    value = state.state[kept][faces].max(axis=1, initial=0).astype(np.uint16)
    sightings = scan_sightings(scans, vertices, faces)
    channels = (_states(value), *quality_channels(sightings, len(scans)))
    has_colour = any(scan.colour is not None for scan in scans)
    skin = Appearance((state.colour[kept][faces] / 255.0).astype(np.float32)) if has_colour else None
    shown = (vertices, faces, _CATEGORIES[0])
    return Layer("measured", "measured", *shown, channels=channels, sightings=sightings, skin=skin)


def _inferred_layer(coverage: ScanCoverage, state: StateMesh) -> Layer:
    """What completion inferred, with its provenance and standard deviation."""
    faces = _faces(state, state.mesh.face_surface == STATE_INFERRED)
    model = coverage.completion
    channels: tuple[Classes | Numbers, ...] = (_states(np.full(len(faces), STATE_INFERRED, np.uint16)),)
    if model is not None and len(faces):
        points = model.hypothesised
        sd = 1000 * points.sd[points.faces].mean(axis=1)
        likely = points.confidence[points.faces].min(axis=1)
        why = points.provenance[points.faces].max(axis=1).astype(np.uint16)
        channels += (
            Classes("provenance", "Why it is there", provenance_categories(), why),
            deviation_channel(sd, float(sd.max())),
            confidence_channel(likely),
        )
    named = ("inferred", "inferred")
    return Layer(*named, state.mesh.vertices, faces, INFERRED, channels=channels)


def _state_edges(state: StateMesh) -> tuple[Layer, ...]:
    """Where the unknown begins: edges of shadows; the frontier, which hides much, is not shown at first."""
    layers = []
    for key, label, value in (
        ("unseen", "unknown: edges of shadows", SHADOW),
        ("frontier", "unknown: frontier", FRONTIER),
    ):
        faces = _faces(state, state.mesh.face_surface == value)
        drawn = (state.mesh.vertices, faces, _CATEGORIES[value])
        channels = (_states(np.full(len(faces), value, np.uint16)),)
        layers.append(Layer(key, label, *drawn, channels=channels, shown=value == SHADOW))
    return tuple(layers)


def _states(values: NDArray[np.uint16]) -> Classes:
    return Classes("state", "State", _CATEGORIES, values)


def _faces(state: StateMesh, chosen: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Faces turned so that they are counter-clockwise seen from the side to which they look."""
    index = np.flatnonzero(chosen)
    faces = state.mesh.faces[index].astype(np.int64)
    turned = np.einsum("ij,ij->i", _normals(state.mesh.vertices, faces), state.front[index]) < 0
    faces[turned] = faces[turned][:, ::-1]
    return faces


def _normals(vertices: FloatArray, faces: NDArray[np.int64]) -> FloatArray:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normals: FloatArray = np.cross(b - a, c - a)
    return normals
