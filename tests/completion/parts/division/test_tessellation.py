# SPDX-License-Identifier: MIT
"""Tessellated models are divided exactly where the faces of their model are."""

from collections import Counter

import numpy as np
import pytest
import shapely
import trimesh
from scipy.spatial import Delaunay

from completion.parts.division import tessellation
from completion.parts.division.limits import MODEL_PRECISIONS
from completion.parts.division.meshes import segment_mesh
from completion.parts.division.patches import patches_of
from completion.parts.division.tessellation import divide_tessellated
from scenes.mesh.labelled_mesh import LabelledMesh

TOLERANCE_M = [2e-7]


def labelled(mesh) -> LabelledMesh:
    return LabelledMesh(np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int32))


def kinds(mesh) -> dict[str, int]:
    found = divide_tessellated(labelled(mesh), TOLERANCE_M)
    assert found is not None
    assert (found.labels > 0).all()
    return dict(Counter(surface.kind for surface in found.surfaces))


def plate(corner_m=0.01, quad_segs=6):
    """A plate of 100 x 60 x 8 mm with rounded corners and a bore."""
    outline = shapely.box(corner_m, corner_m, 0.1 - corner_m, 0.06 - corner_m).buffer(corner_m, quad_segs)
    bore = shapely.Point(0.05, 0.03).buffer(0.012, 12)
    flat = outline.difference(bore)
    pieces = shapely.get_parts(shapely.constrained_delaunay_triangles(flat))
    corners = np.array([shapely.get_coordinates(piece)[:3] for piece in pieces])
    vertices, faces = np.unique(corners.reshape(-1, 2), axis=0, return_inverse=True)
    return trimesh.creation.extrude_triangulation(vertices, faces.reshape(-1, 3), 0.008)


def arc(centre, radius, begin, end, n):
    angle = np.radians(np.linspace(begin, end, n))
    return np.column_stack([centre[0] + radius * np.cos(angle), centre[1] + radius * np.sin(angle)])


def shaft(n=8, sections=48):
    """A shaft: end, cylinder, fillet, shoulder, cylinder, ball end."""
    profile = np.vstack([
        [[0, 0], [0.01, 0], [0.01, 0.03]],
        arc((0.012, 0.03), 0.002, 180, 90, n)[1:],
        [[0.02, 0.032], [0.02, 0.06]],
        arc((0.0, 0.06), 0.02, 0, 90, 2 * n)[1:-1],
        [[0, 0.08]],
    ])  # fmt: skip
    return trimesh.creation.revolve(profile, sections=sections)


@pytest.mark.parametrize("sections", [12, 24, 96])
def test_a_prism_of_many_sides_is_a_cylinder(sections):
    assert kinds(trimesh.creation.cylinder(0.02, 0.08, sections=sections)) == {"cylinder": 1, "plane": 2}


def test_a_prism_of_eight_sides_is_one():
    assert kinds(trimesh.creation.cylinder(0.02, 0.08, sections=8)) == {"plane": 10}


def test_rounded_corners_end_where_the_sides_begin():
    mesh = plate()
    found = divide_tessellated(labelled(mesh), TOLERANCE_M)
    assert found is not None
    assert Counter(surface.kind for surface in found.surfaces) == {"plane": 6, "cylinder": 5}
    radii = sorted(surface.radius for surface in found.surfaces if surface.kind == "cylinder")
    assert radii == pytest.approx([0.01] * 4 + [0.012], abs=1e-8)
    area = mesh.area_faces
    sides = [area[found.labels == k + 1].sum() for k, one in enumerate(found.surfaces) if one.kind == "plane"]
    assert sorted(sides)[:4] == pytest.approx([0.04 * 0.008] * 2 + [0.08 * 0.008] * 2)


@pytest.mark.parametrize(("n", "sections"), [(4, 24), (8, 48)])
def test_fillets_are_tori_and_balls_spheres(n, sections):
    found = kinds(shaft(n, sections))
    assert found == {"plane": 2, "cylinder": 2, "torus": 1, "sphere": 1}


def test_a_chamfer_is_a_cone():
    profile = [[0, 0], [0.009, 0], [0.01, 0.001], [0.01, 0.03], [0, 0.03]]
    assert kinds(trimesh.creation.revolve(np.array(profile), sections=40)) == {
        "plane": 2, "cone": 1, "cylinder": 1
    }  # fmt: skip


def test_vertices_within_sides_change_nothing():
    mesh = plate()
    longest = trimesh.remesh.subdivide_to_size(mesh.vertices, mesh.faces, 0.02)
    finer = trimesh.Trimesh(*longest)
    assert kinds(finer) == kinds(mesh)


def test_a_turned_model_is_divided_alike():
    mesh, other = shaft(), shaft()
    turn = trimesh.transformations.rotation_matrix(1.0, [0.2, 0.5, 0.9])
    turn[:3, 3] = 0.3, -0.2, 0.1
    other.apply_transform(turn)
    labels = [divide_tessellated(labelled(one), TOLERANCE_M).labels for one in (mesh, other)]
    pairs = {tuple(pair) for pair in np.column_stack(labels).tolist()}
    assert len(pairs) == len(np.unique(labels[0])) == len(np.unique(labels[1]))


def test_free_form_has_no_surface_and_is_told():
    u, v = np.meshgrid(np.linspace(0, 1, 5), np.linspace(0, 1, 5), indexing="ij")
    top = np.stack([0.05 * u, 0.05 * v, 0.02 + 0.004 * np.sin(4 * u) * np.cos(5 * v)], -1).reshape(-1, 3)
    corner = (np.arange(4)[:, None] * 5 + np.arange(4)).ravel()
    faces = np.vstack([np.column_stack([corner, corner + 5, corner + 1]),
                       np.column_stack([corner + 1, corner + 5, corner + 6])])  # fmt: skip
    wavy = trimesh.Trimesh(top, faces)
    box = trimesh.creation.box((0.05, 0.05, 0.02), trimesh.transformations.translation_matrix([0.2, 0, 0]))
    found = segment_mesh(labelled(trimesh.util.concatenate([wavy, box])))
    assert found.is_model
    assert [fit.surface.kind for fit in found.fits] == ["plane"] * 6
    share = wavy.area / (wavy.area + box.area)
    assert found.warnings == (
        f"{100 * share:.1f} % of the model's area is on no plane, cylinder, cone, sphere or torus",
    )


def test_a_noisy_mesh_is_no_model():
    mesh = plate()
    finer = trimesh.Trimesh(*trimesh.remesh.subdivide_to_size(mesh.vertices, mesh.faces, 0.004))
    finer.vertices += np.random.default_rng(0).normal(size=finer.vertices.shape) * 2e-5
    assert divide_tessellated(labelled(finer), TOLERANCE_M) is None


def test_noise_within_a_loose_precision_is_told_by_the_tightest(monkeypatch):
    """A mesh of uneven triangles with noise of 1e-4 of its size, which surfaces explain to 6e-4."""
    tried = list[float]()
    monkeypatch.setattr(
        tessellation, "patches_of", lambda *given: tried.append(given[1]) or patches_of(*given)
    )
    rng = np.random.default_rng(2)
    flat = rng.uniform(0, 1, (4000, 2)) * [0.05, 0.03]
    radius = 0.02 + rng.normal(0, 6e-6, len(flat))
    points = np.column_stack(
        [radius * np.cos(flat[:, 0] / 0.02), radius * np.sin(flat[:, 0] / 0.02), flat[:, 1]]
    )
    mesh = trimesh.Trimesh(points, Delaunay(flat).simplices, process=False)
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    assert divide_tessellated(labelled(mesh), [share * size for share in MODEL_PRECISIONS]) is None
    assert tried == [MODEL_PRECISIONS[0] * size]


def extruded(outline: np.ndarray, height_m: float):
    """A prism over a convex outline."""
    pieces = shapely.get_parts(shapely.constrained_delaunay_triangles(shapely.Polygon(outline)))
    corners = np.array([shapely.get_coordinates(piece)[:3] for piece in pieces])
    vertices, faces = np.unique(corners.reshape(-1, 2), axis=0, return_inverse=True)
    return trimesh.creation.extrude_triangulation(vertices, faces.reshape(-1, 3), height_m)


@pytest.mark.parametrize(("sections", "depth_m"), [(24, 5e-4), (24, 1e-3), (72, 1e-3), (144, 3e-3)])
def test_a_flat_on_a_shaft_is_a_plane(sections, depth_m):
    half = np.degrees(np.arccos(1 - depth_m / 0.01))
    angles = np.linspace(0, 360, sections, endpoint=False) + 0.5
    angles = np.concatenate([[half], angles[(angles > half) & (angles < 360 - half)], [360 - half]])
    turned = np.radians(angles)
    shaft_mesh = extruded(0.01 * np.column_stack([np.cos(turned), np.sin(turned)]), 0.03)
    assert kinds(shaft_mesh) == {"cylinder": 1, "plane": 3}


@pytest.mark.parametrize("count", [16, 32])
def test_balls_of_meridians_are_whole(count):
    assert kinds(trimesh.creation.capsule(0.03, 0.01, count=[count, count])) == {"sphere": 2, "cylinder": 1}


def test_corners_that_are_less_exact_are_divided_at_their_own_precision():
    mesh = labelled(plate())
    size = float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))
    column = np.unique(mesh.vertices[:, :2].round(9), axis=0, return_inverse=True)[1].reshape(-1)
    off = np.random.default_rng(0).normal(0, 3e-5 * size, (column.max() + 1, 2))[column]
    moved = mesh.vertices + np.column_stack([off, np.zeros(len(off))])
    tolerances = [share * size for share in (2e-6, 2e-5, 2e-4)]
    found = divide_tessellated(LabelledMesh(moved, mesh.faces), tolerances)
    assert found is not None
    assert found.tolerance_m == tolerances[2]
    assert Counter(surface.kind for surface in found.surfaces) == {"plane": 6, "cylinder": 5}


def test_lone_triangles_are_no_model():
    corners = np.random.default_rng(0).normal(size=(300, 3))
    soup = LabelledMesh(corners, np.arange(300, dtype=np.int32).reshape(-1, 3))
    assert divide_tessellated(soup, [1e-6, 1e-5, 1e-4]) is None
