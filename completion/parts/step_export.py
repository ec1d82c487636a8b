# SPDX-License-Identifier: MIT
"""A part as STEP: its surfaces where relations hold, and points on what was measured of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from completion.export.step.feature_tree import FaceGroup
from completion.export.step.kernel import kernel
from completion.export.step.pipeline import FILLED, StepModel, step_of
from completion.export.step.regions import FittedRegion, PartRegions, RegionMesh, part_regions
from completion.fitting.result import SurfaceFit
from completion.parts.backs.pipeline import PartBack
from completion.parts.closing import close_holes
from completion.parts.dimensions.pipeline import dimensions_of
from completion.parts.division.divided_part import DividedPart, RelatedPart, surface_points
from completion.parts.division.limits import ROUNDED_OFF
from completion.parts.part_features import PartFeature, features_of
from completion.parts.profiles.pipeline import profiles_of
from scenes.checks import FloatArray, IntArray
from scenes.mesh.merging import merge_vertices

_LEAST_SAMPLES = 30  # of a surface; where there are fewer, its triangles' middles are added
_MOST_ASKED = 500  # points of a region whose deviation is predicted


def step_model(
    part: DividedPart, name: str = "part", features: Sequence[PartFeature] = (), back: PartBack | None = None
) -> StepModel:
    """Return a part as STEP; see `step_of`.

    `features` (`features_of`) are in the names of faces, and a tree in a second file. Of a part scanned from
    one side `back` (`find_back`) adds inferred faces: they say so in name, layer and colour.

    Raises InputError: OCP is not installed, the part has no surface, or none can be trimmed.
    """
    return step_of(regions_of(part, back), name, [_group(feature) for feature in features])


def named_model(part: RelatedPart, name: str) -> StepModel:
    """Return a part as STEP with its features, by its dimensions and profiles; errors as of `step_model`."""
    kernel()
    profiles = () if part.relations is None else profiles_of(part)
    return step_model(part, name, features_of(part, dimensions_of(part, preferred=False), profiles))


def _group(feature: PartFeature) -> FaceGroup:
    parts = tuple(_group(member) for member in feature.members)
    return FaceGroup(feature.title, feature.name, feature.surfaces, parts)


def regions_of(part: DividedPart, back: PartBack | None = None) -> PartRegions:
    """Return the regions of a part, one a surface, with points of the scan, the mesh and the inferred sides.

    Holes of a mesh that lie on one surface are closed (`close_holes`).

    Raises InputError: the part has no surfaces.
    """
    points, label = surface_points(part)
    if part.faces is not None and part.triangle_surface is not None:
        few = np.bincount(label, minlength=max(part.labels, default=0) + 1) < _LEAST_SAMPLES
        small = np.flatnonzero(few[part.triangle_surface])
        more = part.points[part.faces[small]].mean(axis=1)
        points, label = np.concatenate([points, more]), np.append(label, part.triangle_surface[small])
    place = np.full(max((*part.labels, *label.tolist(), 0)) + 1, -1, dtype=np.int64)
    place[list(part.labels)] = np.arange(len(part.labels))
    region = place[np.maximum(label, 0)]
    if back is not None and back.places is not None:
        return _with_back(part, back, points, label)
    closed = close_holes(part) if part.is_model else None
    filled = set() if closed is None else set(closed.surface[closed.is_inferred].tolist())
    regions = [
        FittedRegion(
            number, fit.surface, _deviation(fit, points[region == k]), group, FILLED * (number in filled)
        )
        for k, (number, fit, group) in enumerate(zip(part.labels, part.fits, part.groups, strict=True))
    ]
    mesh = None
    if closed is not None:
        mesh = _region_mesh(closed.points, closed.faces, place[closed.surface])
    elif part.is_model and part.faces is not None and part.triangle_surface is not None:
        mesh = _region_mesh(part.points, part.faces, place[part.triangle_surface])
    return part_regions(regions, points, region, spacing_m=part.spacing_m, noise_m=part.noise_m, mesh=mesh)


def _with_back(part: DividedPart, back: PartBack, points: FloatArray, label: IntArray) -> PartRegions:
    """Regions of measured points (n, 3) with labels (n,), and of inferred ones."""
    places = back.places
    last = max((*part.labels, *(face.label for face in back.faces)))
    n_measured = np.bincount(np.maximum(label, 0), minlength=last + 1)
    if places is not None:
        points, label = np.concatenate([points, places.points]), np.concatenate([label, places.label])
    count = np.bincount(np.maximum(label, 0), minlength=last + 1)
    regions, why = list[FittedRegion](), dict[int, list[str]]()
    for face in back.faces:
        why.setdefault(face.label, []).append(f"inferred by {face.provenance}, p {face.probability:.2f}")
    for number, fit, group in zip(part.labels, part.fits, part.groups, strict=True):
        sd, share = _deviation(fit, points[label == number]), n_measured[number] / max(int(count[number]), 1)
        regions.append(
            FittedRegion(number, fit.surface, sd, group, ", ".join(why.get(number, [])), measured_share=share)
        )
    for face in {face.label: face for face in back.faces if face.is_new}.values():
        text = ", ".join(why[face.label])
        regions.append(FittedRegion(face.label, face.surface, face.sd_m, inferred=text, measured_share=0.0))
    place = np.full(len(count), -1, dtype=np.int64)
    place[[one.number for one in regions]] = np.arange(len(regions))
    region = place[np.maximum(label, 0)]
    return part_regions(regions, points, region, spacing_m=part.spacing_m, noise_m=part.noise_m)


def _region_mesh(points: FloatArray, faces: IntArray, region: IntArray) -> RegionMesh:
    """A model's triangles with vertices that neighbours share."""
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    vertices, number = merge_vertices(points, ROUNDED_OFF * size)
    corners = number[faces]
    kept = (corners != np.roll(corners, 1, axis=1)).all(axis=1)
    return RegionMesh(vertices, corners[kept], region[kept])


def _deviation(fit: SurfaceFit, points: FloatArray) -> float:
    """The usual standard deviation of a surface along its normal at points (n, 3), metres."""
    if not len(points):
        return 0.0
    sample = points[:: max(1, len(points) // _MOST_ASKED)]
    return float(np.median(fit.standard_deviation(sample)))


def outcome_lines(model: StepModel) -> Sequence[str]:
    """What became of a part as STEP, for people."""
    n_faces = sum(not face.reason for face in model.faces)
    what = f"{_count(model.n_solids, 'solid')}, {1e6 * model.volume_m3:.4g} cm3" if model.is_solid else "open"
    lines = [f"step       {_count(n_faces, 'face')} of {_count(len(model.faces), 'surface')}, {what}"]
    left = [face for face in model.faces if face.reason] if model.is_solid else []
    sentences = [f"surface {outcome.number} ({outcome.kind}) is {outcome.reason}" for outcome in left]
    filled = [face.number for face in model.faces if FILLED in face.inferred]
    if filled:
        numbers = ", ".join(map(str, filled))
        sentences.append(
            f"inferred: gaps in the mesh were closed on surface{'s' * (len(filled) > 1)} {numbers}"
        )
    return [*lines, *(f"           {text}" for text in (sentences if model.is_solid else [model.reason]))]


def _count(n: int, noun: str) -> str:
    return f"{n} {noun}" if n == 1 else f"{n} {noun}s"
