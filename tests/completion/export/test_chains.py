# SPDX-License-Identifier: MIT
"""STEP of tessellated models: coarse chords give the exact solid, and what is missing is told by place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from completion.export.step import pipeline
from completion.export.step.chains import directed_edges
from completion.export.step.faces import area_of
from completion.export.step.folds import FoldFinder
from completion.export.step.kernel import kernel_surface
from completion.export.step.pipeline import step_of
from completion.export.step.regions import FittedRegion, PartRegions, RegionMesh, part_regions
from completion.parts.part import Part
from completion.parts.pipeline import model_part
from completion.parts.step_export import regions_of, step_model
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.surfaces.catalogue import Cylinder, Plane, Sphere
from tests.helpers.step_examples import needs_kernel

needs_kernel()


def modelled(mesh: trimesh.Trimesh) -> Part:
    """The part of a closed mesh, its triangles each with corners of its own, as in STL."""
    points = np.asarray(mesh.triangles).reshape(-1, 3)
    faces = np.arange(len(points), dtype=np.int32).reshape(-1, 3)
    return model_part(LabelledMesh(points, faces, np.zeros(len(faces), np.int32)), relations=None)


@pytest.fixture(scope="module")
def ring() -> Part:
    return modelled(trimesh.creation.annulus(r_min=0.006, r_max=0.01, height=0.008, sections=24))


def test_chords_become_the_exact_solid(ring: Part) -> None:
    model = step_model(ring)
    assert model.is_solid, model.reason
    assert model.is_valid
    assert [face.kind for face in model.faces].count("cylinder") == 2
    assert model.volume_m3 == pytest.approx(np.pi * (0.01**2 - 0.006**2) * 0.008, rel=1e-6)
    assert model.gap_m < 1e-8


@pytest.fixture(scope="module")
def capsule() -> PartRegions:
    """A cylinder between two half balls, in chords of 15 degrees."""
    radius, high = 0.006, 0.02
    mesh = trimesh.creation.capsule(height=high, radius=radius, count=[24, 24])
    level = mesh.vertices[:, 2].reshape(-1)[mesh.faces]
    low, top = level.min(axis=1), level.max(axis=1)
    begin = mesh.vertices[:, 2].min() + radius
    region = np.where(low >= begin + high - 1e-9, 2, np.where(top <= begin + 1e-9, 1, 0))
    up = (0.0, 0.0, 1.0)
    surfaces = [
        Cylinder((0, 0, begin), up, radius),
        *(Sphere((0, 0, z), radius) for z in (begin, begin + high)),
    ]
    weights = np.array([[a, b, 8 - a - b] for a in range(9) for b in range(9 - a)]) / 8
    points = np.einsum("kc,mcx->mkx", weights, mesh.triangles).reshape(-1, 3)
    held = RegionMesh(np.asarray(mesh.vertices), np.asarray(mesh.faces, dtype=np.int64), region)
    fitted = [FittedRegion(k + 1, surface, 1e-6, k) for k, surface in enumerate(surfaces)]
    return part_regions(fitted, points, np.repeat(region, len(weights)), spacing_m=1e-3, mesh=held)


def test_surfaces_that_touch_meet_in_their_tangent_circles(capsule: PartRegions) -> None:
    model = step_of(capsule)
    assert model.is_solid, model.reason
    assert model.volume_m3 == pytest.approx(np.pi * 0.006**2 * 0.02 + 4 / 3 * np.pi * 0.006**3, rel=1e-7)


def test_what_is_on_no_surface_leaves_its_neighbours_open(capsule: PartRegions) -> None:
    lost = np.where(capsule.mesh.region == 2, -1, capsule.mesh.region)
    fewer = part_regions(
        capsule.regions[:2], capsule.points[capsule.region < 2], capsule.region[capsule.region < 2],
        spacing_m=1e-3, mesh=capsule.mesh._replace(region=lost),
    )  # fmt: skip
    model = step_of(fewer)
    assert not model.is_solid
    assert model.record()["open_faces"] == [1]
    assert 1e-6 * area_of(model.shape) == pytest.approx(2 * np.pi * 0.006 * 0.026, rel=1e-4)


def test_a_missing_face_is_told_by_place(ring: Part) -> None:
    top = next(k for k, fit in enumerate(ring.fits, 1) if fit.surface.kind == "plane")
    kept = ring.triangle_surface != top
    height = ring.fits[top - 1].surface.point[2] * 1e3
    part = replace(ring, faces=ring.faces[kept], triangle_surface=ring.triangle_surface[kept])
    fewer = [k for k in range(len(ring.labels)) if k != top - 1]
    picked = {name: tuple(getattr(part, name)[k] for k in fewer) for name in ("labels", "fits", "groups")}
    model = step_model(replace(part, measured=picked["fits"], **picked))
    assert not model.is_solid
    assert model.n_solids == 0
    assert "ends where the measurement does" in model.reason or "end where the measurement" in model.reason
    assert f"{height:.4g}) mm" in model.reason
    assert sum(face.is_open for face in model.faces) == 2


def test_a_solid_of_another_volume_than_the_triangles_is_none(
    ring: Part, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = pipeline.sewn

    def swollen(*given):
        whole = plain(*given)
        return replace(whole, volume_mm3=1.1 * whole.volume_mm3)

    monkeypatch.setattr(pipeline, "sewn", swollen)
    model = step_of(regions_of(ring))
    assert not model.is_solid
    assert "1.769 cm3, but its triangles enclose 1.59 cm3" in model.reason


def test_vertices_that_rounding_parts_are_one(ring: Part) -> None:
    rng = np.random.default_rng(0)
    apart = replace(ring, points=ring.points + 1e-12 * rng.normal(size=ring.points.shape))
    mesh = regions_of(apart).mesh
    assert mesh is not None
    edges = directed_edges(mesh)
    assert edges is not None
    assert (edges.twin >= 0).all()


def test_triangles_that_turn_both_ways_have_no_order() -> None:
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=np.float64)
    faces, region = np.array([[0, 1, 2], [0, 2, 3]]), np.array([0, 1])
    edges = directed_edges(RegionMesh(square, faces, region))
    assert edges is not None
    assert edges.is_border.all()
    assert sorted(edges.beside.tolist()) == [-1, -1, -1, -1, 0, 1]
    assert directed_edges(RegionMesh(square, np.array([[0, 1, 2], [0, 3, 2]]), region)) is None


def test_a_cylinder_along_a_plane_meets_it_in_two_lines() -> None:
    along = np.array([-3.66770975e-07, -0.98480824, 0.173645418])
    rod = Cylinder((4.82793426, 13.661773, -2.40896663), along / np.linalg.norm(along), 2.125)
    flat = Plane((4.82793505, 15.65526979, -0.27141412), (-1.0, 3.75559933e-07, 1.77576722e-08))
    finder = FoldFinder([rod, flat], [kernel_surface(rod), kernel_surface(flat)], 0.1, 0.0)
    assert {type(line).__name__ for line in finder.conics((0, 1))} == {"Geom_Line"}
