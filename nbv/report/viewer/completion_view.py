# SPDX-License-Identifier: MIT
"""3-D view of a completed model: what was measured, what was inferred and why, and how sure that is."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from completion.extension.patch import Patch, Provenance
from completion.result.completed_model import CompletedModel, TexturedMesh
from completion.texturing.chart_texture import Atlas
from nbv.report.pictures.camera import Camera
from nbv.report.pictures.picture import Picture
from nbv.report.pictures.surface_values import cut_finely
from nbv.report.viewer.block import Viewer
from nbv.report.viewer.layers import (
    Category,
    Classes,
    Layer,
    Numbers,
    confidence_channel,
    deviation_channel,
)
from nbv.report.viewer.markers import opening_lines, view_markers
from nbv.report.viewer.scan_channels import (
    INFERRED,
    MEASURED,
    provenance_categories,
    quality_channels,
    scan_sightings,
)
from scenes.checks import FloatArray
from scenes.mesh.labelled_mesh import Appearance
from scenes.run.mapping import trim
from scenes.scan.palette import surface_rgb
from scenes.scan.range_image import RangeImage

_PIECES = 40_000  # into which recognised surface is cut, about
_HIDES = 0.02  # share of another surface's inferred cells that an occluder hides
_GREY = 0.72
_NO_SURFACE = 0


@dataclass(frozen=True, slots=True, eq=False)
class _Pieces:
    """Small faces of one surface or of the remainder, world coordinates; `image` is -1 without a texture."""

    corners: FloatArray
    number: int
    is_inferred: bool
    provenance: NDArray[np.int64]
    sd: FloatArray
    confidence: FloatArray
    colour: NDArray[np.float32]
    uv: FloatArray
    image: int


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
    scans = completion.derived.scans
    atlas = completion.derived.atlas
    pieces = [*_surfaces(completion), _remainder(completion)]
    occluders = {0, *occluding(completion.patches)}
    measured = [p for p in pieces if not p.is_inferred]
    groups = (
        ("measured", "measured surfaces", [p for p in measured if p.number not in occluders]),
        ("occluders", "occluders, measured", [p for p in measured if p.number in occluders]),
        ("inferred", "hypothesised (inferred)", [p for p in pieces if p.is_inferred]),
    )
    outlines = [
        world.apply(hole.points) for surface in completion.derived.surfaces for hole in surface.openings
    ]
    names = _names(completion)
    most_sd = max((float(p.sd.max(initial=0)) for p in pieces), default=0.0)
    layers = [
        _layer(key, label, parts=parts, names=names, most_sd=most_sd, atlas=atlas, scans=scans)
        for key, label, parts in groups
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
    found: set[int] = set()
    for patch in patches:
        behind = patch.evidence.occluder[patch.hypothesised]
        share = np.bincount(behind[behind > 0]) / max(len(behind), 1)
        found.update(int(number) for number in np.flatnonzero(share >= _HIDES))
    return sorted(found)


def _surfaces(completion: CompletedModel) -> Iterator[_Pieces]:
    """Measured and inferred pieces of each surface, the latter by provenance."""
    total = sum(patch.observed_m2 + patch.hypothesised_m2 for patch in completion.patches)
    for part in completion.derived.textured:
        yield _pieces(completion, part, total / _PIECES)


def _pieces(completion: CompletedModel, part: TexturedMesh, limit_m2: float) -> _Pieces:
    """Cells of one surface, cut finely."""
    trim()
    patch, mesh = completion.patches[part.number - 1], part.mesh
    whole = np.concatenate([mesh.vertices, part.uv, mesh.cells], axis=1)[mesh.faces]
    parts = cut_finely(whole.reshape(-1, 3, 7), limit_m2)[0]
    middle = parts.mean(axis=1)
    top = np.array(patch.grid.shape) - 1
    row, column = np.clip(np.floor(middle[:, 5:]).astype(np.int64), 0, top).T
    n = len(parts)
    return _Pieces(
        corners=completion.world_from_reference.apply(parts[..., :3].reshape(-1, 3)).reshape(-1, 3, 3),
        number=part.number,
        is_inferred=part.provenance != Provenance.MEASURED,
        provenance=np.full(n, int(part.provenance)),
        sd=patch.stated.standard_deviation(middle[:, :3]) if n else np.zeros(0),
        confidence=patch.confidence[row, column],
        colour=np.full((n, 3, 3), 1.0 if part.page >= 0 else _GREY, np.float32),
        uv=parts[..., 3:5],
        image=part.page,
    )


def _remainder(completion: CompletedModel) -> _Pieces:
    """What was measured and belongs to no surface."""
    rest = completion.derived.thin_remainder
    faces = rest.faces
    n = len(faces)
    return _Pieces(
        corners=completion.world_from_reference.apply(rest.vertices)[faces],
        number=_NO_SURFACE,
        is_inferred=False,
        provenance=np.zeros(n, np.int64),
        sd=rest.sd[faces].mean(axis=1) if n else np.zeros(0),
        confidence=np.ones(n),
        colour=(rest.colour[faces] / 255.0).astype(np.float32),
        uv=np.zeros((n, 3, 2)),
        image=-1,
    )


def _layer(
    key: str,
    label: str,
    parts: Sequence[_Pieces],
    names: tuple[Category, ...],
    most_sd: float,
    atlas: Atlas,
    scans: Sequence[RangeImage],
) -> Layer:
    """Pieces as a layer with their values."""
    is_inferred = key == "inferred"
    corners = np.concatenate([np.zeros((0, 3, 3)), *(part.corners for part in parts)])
    n, sizes = len(corners), [len(part.corners) for part in parts]
    number = np.repeat([part.number for part in parts], sizes).astype(np.uint16)
    sd = np.concatenate([np.zeros(0), *(part.sd for part in parts)])
    provenance = np.concatenate([np.zeros(0, np.int64), *(part.provenance for part in parts)])
    channels: list[Classes | Numbers] = [
        Classes("state", "State", (MEASURED, INFERRED), np.full(n, int(is_inferred), np.uint16)),
        Classes("provenance", "Provenance", provenance_categories(), provenance.astype(np.uint16)),
        deviation_channel(1000 * sd, 1000 * most_sd),
    ]
    sightings = None
    if is_inferred:
        likely = np.concatenate([np.zeros(0), *(part.confidence for part in parts)])
        channels.append(confidence_channel(likely))
    else:
        sightings = scan_sightings(scans, corners)
        channels += quality_channels(sightings, len(scans))
    channels.append(Classes("surface", "Surface", names, number))
    image = np.repeat([part.image for part in parts], sizes).astype(np.int32)
    skin = Appearance(
        np.concatenate([np.zeros((0, 3, 3), np.float32), *(part.colour for part in parts)]),
        atlas.pages,
        image if len(atlas.pages) else None,
        np.concatenate([np.zeros((0, 3, 2)), *(part.uv for part in parts)]).astype(np.float32),
    )
    shown = (corners.reshape(-1, 3), np.arange(3 * n).reshape(-1, 3), INFERRED if is_inferred else MEASURED)
    return Layer(
        key, label, *shown, channels=tuple(channels), sightings=sightings, skin=skin, is_marked=is_inferred
    )


def _names(completion: CompletedModel) -> tuple[Category, ...]:
    """The surfaces by number, 0 for what belongs to none, in the colours of the tables."""
    kinds = [patch.source.fit.surface.kind for patch in completion.patches]
    named = (Category(f"{k} {kind}", surface_rgb(k)) for k, kind in enumerate(kinds, start=1))
    return Category("none", surface_rgb(0)), *named
