# SPDX-License-Identifier: MIT
"""3-D view of a completed model: what was measured, what was inferred and why, and how sure that is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from completion.extension.patch import Patch, Provenance
from completion.panels.sheet import spread_out
from completion.result.completed_model import CompletedModel, TexturedPart
from completion.texturing.chart_texture import Atlas
from nbv.report.pictures.camera import Camera
from nbv.report.pictures.picture import Picture
from nbv.report.pictures.surface_values import cut_finely
from nbv.report.viewer.block import Viewer
from nbv.report.viewer.layers import Category, Classes, Layer, Numbers, confidence_channel, deviation_channel
from nbv.report.viewer.markers import opening_lines, view_markers
from nbv.report.viewer.scan_channels import (
    INFERRED,
    MEASURED,
    provenance_categories,
    quality_channels,
    scan_sightings,
)
from nbv.scans.scan_map import with_known_noise
from scenes.checks import FloatArray
from scenes.mesh.labelled_mesh import Appearance
from scenes.run.mapping import trim
from scenes.scan.colour import surface_rgb
from scenes.scan.range_image import RangeImage

_PIECES = 40_000  # into which recognised surface is cut, about
_HIDES = 0.02  # share of another surface's inferred cells that an occluder hides
_GREY = 0.72
_NO_SURFACE = 0


@dataclass(frozen=True, slots=True, eq=False)
class _Pieces:
    """Small faces (m, 3) of one surface, of the remainder, or of many of these; world coordinates.

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
    def joined(cls, parts: Sequence[_Pieces]) -> _Pieces:
        """All of them, in their order."""
        starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
        faces = [part.faces + np.int32(start) for part, start in zip(parts, starts, strict=False)]
        rest = [name for name in cls.__slots__ if name != "faces"]
        return cls(
            faces=np.concatenate(faces), **{n: np.concatenate([getattr(p, n) for p in parts]) for n in rest}
        )


def completion_view(
    completion: CompletedModel,
    pictures: tuple[Picture, ...] = (),
    *,
    is_room: bool,
    camera: Camera | None = None,
) -> Viewer:
    """Return the view of a completed model, in the world coordinates of its scans.

    A room is looked into from outside; `camera` is where it is seen from at first.
    """
    world = completion.world_from_reference
    scans = [with_known_noise(scan) for scan in completion.scans]
    atlas = completion.atlas
    occluders = set(occluding(completion.patches))
    textured = completion.textured
    measured = [part for part in textured if part.provenance == Provenance.MEASURED]
    of = partial(_surfaces, completion)
    groups = (
        ("measured", "measured surfaces", of([p for p in measured if p.number not in occluders])),
        ("occluders", "occluders, measured", of([p for p in measured if p.number in occluders], rest=True)),
        (
            "inferred",
            "hypothesised (inferred)",
            of([part for part in textured if part.provenance != Provenance.MEASURED]),
        ),
    )
    outlines = [world.apply(hole.points) for surface in completion.surfaces for hole in surface.openings]
    names = _names(completion)
    most_sd = max(float(pieces.sd.max(initial=0)) for _, _, pieces in groups)
    layers = [
        _layer(key, label, pieces, names=names, most_sd=most_sd, atlas=atlas, scans=scans)
        for key, label, pieces in groups
    ]
    return Viewer(
        "The completed model.",
        tuple(layer for layer in layers if len(layer.faces)),
        mode="marked" if completion.textures else "state",
        markers=view_markers([s.world_from_sensor for s in scans], [s.projection for s in scans]),
        lines=opening_lines(outlines),
        is_room=is_room,
        pictures=pictures,
        camera=camera,
        one="scan",
    )


def occluding(patches: Sequence[Patch]) -> list[int]:
    """Numbers of the surfaces that hide a part of others."""
    numbers: set[int] = set()
    for patch in patches:
        behind = patch.evidence.occluder[patch.hypothesised]
        share = np.bincount(behind[behind > 0]) / max(len(behind), 1)
        numbers.update(int(number) for number in np.flatnonzero(share >= _HIDES))
        trim()
    return sorted(numbers)


def _surfaces(completion: CompletedModel, parts: Sequence[TexturedPart], *, rest: bool = False) -> _Pieces:
    """Pieces of surfaces, and of what belongs to none with the `rest`."""
    total = sum(patch.observed_m2 + patch.hypothesised_m2 for patch in completion.patches)
    surfaces = [_pieces(completion, part, total / _PIECES) for part in parts]
    return _Pieces.joined([_nothing(), *surfaces, *([_remainder(completion)] if rest else [])])


def _nothing() -> _Pieces:
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
        vertices=completion.world_from_reference.apply(parts[..., :3].reshape(-1, 3)),
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
    rest = completion.light_remainder
    faces = rest.faces
    n = len(faces)
    return _Pieces(
        vertices=completion.world_from_reference.apply(rest.vertices),
        faces=faces,
        number=np.full(n, _NO_SURFACE, np.uint16),
        provenance=np.zeros(n, np.uint16),
        sd=rest.sd[faces].mean(axis=1) if n else np.zeros(0),
        confidence=np.ones(n),
        colour=rest.colour[faces].astype(np.float32) / np.float32(255),
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
        Classes("state", "State", (MEASURED, INFERRED), np.full(n, int(is_inferred), np.uint16)),
        Classes("provenance", "Provenance", provenance_categories(), pieces.provenance),
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


def _names(completion: CompletedModel) -> tuple[Category, ...]:
    """The surfaces by number, 0 for what belongs to none, in the colours of the tables."""
    kinds = [patch.source.fit.surface.kind for patch in completion.patches]
    named = (Category(f"{k} {kind}", surface_rgb(k)) for k, kind in enumerate(kinds, start=1))
    return Category("none", surface_rgb(0)), *named
