# SPDX-License-Identifier: MIT
"""Valid files of meshes, images and what unseen itself reads and writes; the same bytes each time."""

from __future__ import annotations

import io
import json

import numpy as np
from PIL import Image

from nbv.scanning.sensor_profile import load_sensor
from scenes.io.meshes.glb_writer import glb_of
from scenes.io.meshes.obj import write_obj
from scenes.io.meshes.off import write_off
from scenes.io.meshes.ply_writer import write_mesh_ply
from scenes.io.meshes.stl import write_stl
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.mesh.mesh_parts import MeshPart
from tests.helpers.ifc_files import MAP, Box, ifc_text
from tests.robustness.fuzzing.case import Case
from tests.robustness.fuzzing.seeds_of_scans import POSES, made, world_points

_VERTICES = np.array([[x, y, z] for x in (0, 1.0) for y in (0, 2.0) for z in (0, 1.5)])
_FACES = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6]])
_PIXELS = np.arange(4 * 6 * 3, dtype=np.uint8).reshape(4, 6, 3) * 3


def _parts() -> list[MeshPart]:
    """A textured part and a coloured one."""
    uv = np.linspace(0, 1, 16, dtype=np.float32).reshape(8, 2)
    colour = np.tile(np.uint8([200, 10, 30]), (8, 1))
    return [
        MeshPart("wall", _VERTICES, _FACES, 0, None, _PIXELS, uv),
        MeshPart("box", _VERTICES + 3, _FACES, 1, colour),
    ]


def glb_files() -> list[Case]:
    """A textured and a coloured mesh in binary glTF, and one of one face."""
    return [
        Case({"m.glb": glb_of(_parts())}, "m.glb"),
        Case({"m.glb": glb_of([MeshPart("one", _VERTICES[:3], _FACES[:1] * 0 + [0, 1, 2], 0)])}, "m.glb"),
    ]


def gltf_files() -> list[Case]:
    """The same as JSON with buffer and image beside it, and with both inside."""
    import base64

    data = glb_of(_parts())
    size = int.from_bytes(data[12:16], "little")
    content, binary = json.loads(data[20 : 20 + size]), data[28 + size :]
    inside = json.loads(json.dumps(content))
    content["buffers"][0]["uri"] = "b.bin"
    inside["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64.b64encode(binary).decode()
    sparse = json.loads(json.dumps(content))
    sparse["nodes"].append({"children": [0], "scale": [1, 2, 3], "rotation": [0, 0, 0, 1], "name": "turned"})
    content["images"] = [{"uri": "t.png"}]
    beside = {"b.bin": binary, "t.png": png_of(_PIXELS)}
    return [
        Case({"m.gltf": json.dumps(content).encode(), **beside}, "m.gltf"),
        Case({"m.gltf": json.dumps(inside).encode()}, "m.gltf"),
        Case({"m.gltf": json.dumps(sparse).encode(), "b.bin": binary}, "m.gltf"),
    ]


def obj_files() -> list[Case]:
    """Objects with materials and a texture, with quads, negative indices and normals."""
    corners = "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 1 1 0 0 0 1\nv 0 1 0 1 1 1\n"
    text = corners + "vn 0 0 1\nf 1//1 2//1 3//1 4//1\nf -4 -3 -2\n"
    return [
        made(lambda folder: write_obj(_parts(), folder / "m.obj"), "m.obj"),
        Case({"m.obj": text.encode()}, "m.obj"),
    ]


def ply_binary_files() -> list[Case]:
    """Ours with colours and a provenance, and a mesh of either byte order with quads."""
    colour = {name: np.full(8, k, np.uint8) for k, name in enumerate(("red", "green", "blue"))}
    faces = {order: _quads(order) for order in "<>"}
    return [
        made(
            lambda folder: write_mesh_ply(folder / "m.ply", _VERTICES, _FACES, colour, ["a comment"]), "m.ply"
        ),
        *(Case({"m.ply": data}, "m.ply") for data in faces.values()),
    ]


def _quads(order: str) -> bytes:
    name = "little" if order == "<" else "big"
    head = (
        f"ply\nformat binary_{name}_endian 1.0\nelement vertex 8\nproperty float x\nproperty float y\n"
        "property float z\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n"
    )
    table = np.zeros(2, [("n", "u1"), ("corners", f"{order}i4", (4,))])
    table["n"], table["corners"] = 4, [[0, 1, 3, 2], [4, 6, 7, 5]]
    return head.encode() + _VERTICES.astype(f"{order}f4").tobytes() + table.tobytes()


def ply_text_files() -> list[Case]:
    """A mesh with quads, colours and texture coordinates, as text."""
    rows = [
        " ".join(map(repr, row)) + f" {10 * k} 20 30 0.5 0.25" for k, row in enumerate(_VERTICES.tolist())
    ]
    head = (
        "ply\nformat ascii 1.0\ncomment made by hand\nelement vertex 8\nproperty float x\nproperty float y\n"
        "property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nproperty float s\n"
        "property float t\nelement face 3\nproperty list uchar int vertex_indices\nend_header\n"
    )
    text = head + "\n".join([*rows, "4 0 1 3 2", "3 0 4 5", "3 0 5 1"]) + "\n"
    return [Case({"m.ply": text.encode()}, "m.ply")]


def stl_binary_files() -> list[Case]:
    """Triangles near the origin, and far away about an origin of their own."""
    meshes = [LabelledMesh(_VERTICES + shift, _FACES) for shift in (0.0, 4e5)]
    return [made(lambda folder, mesh=mesh: write_stl(mesh, folder / "m.stl"), "m.stl") for mesh in meshes]


def stl_text_files() -> list[Case]:
    """Triangles as text."""
    facet = "facet normal 0 0 1\nouter loop\n{}endloop\nendfacet\n"
    facets = [
        facet.format("".join(f"vertex {' '.join(map(repr, corner))}\n" for corner in corners))
        for corners in _VERTICES[_FACES].tolist()
    ]
    return [Case({"m.stl": ("solid m\n" + "".join(facets) + "endsolid m\n").encode()}, "m.stl")]


def off_files() -> list[Case]:
    """Plain, with colours, with normals."""
    colour = np.tile(np.uint8([1, 2, 3]), (8, 1))
    text = "NOFF\n3 1 0\n0 0 0 0 0 1\n1 0 0 0 0 1\n0 1 0 0 0 1\n3 0 1 2 0.5 0.5 0.5\n"
    return [
        made(lambda folder: write_off(folder / "m.off", _VERTICES, _FACES), "m.off"),
        made(lambda folder: write_off(folder / "m.off", _VERTICES, _FACES, colour), "m.off"),
        Case({"m.off": text.encode()}, "m.off"),
    ]


def ifc_files() -> list[Case]:
    """Walls with an opening, a type and a map; solids of other kinds in feet."""
    walls = [Box(opening=(1, 0, 1, 2), type_name="W", colour=(0.8, 0.1, 0.1)), Box(body="mapped")]
    solids = [Box("IFCCOLUMN", body=body) for body in ("brep", "inside out", "open")]
    texts = (ifc_text(walls, conversion=MAP), ifc_text(solids, unit="ft", schema="IFC2X3"))
    return [Case({"m.ifc": text.encode()}, "m.ifc") for text in texts]


def mesh_files() -> list[Case]:
    """A mesh in every format."""
    makers = (
        glb_files,
        gltf_files,
        obj_files,
        ply_binary_files,
        ply_text_files,
        stl_binary_files,
        stl_text_files,
    )
    return [case for maker in (*makers, off_files) for case in maker()]


def png_of(pixels: np.ndarray) -> bytes:
    """Return an image as PNG."""
    return _image(pixels, "PNG")


def _image(pixels: np.ndarray, form: str) -> bytes:
    data = io.BytesIO()
    Image.fromarray(pixels).save(data, form)
    return data.getvalue()


def depth_images() -> list[Case]:
    """16-bit counts as PNG, PGM and TIFF, and 32-bit reals."""
    counts = (np.arange(12 * 14, dtype=np.uint16) * 50).reshape(12, 14)
    forms = {"d.png": "PNG", "d.tif": "TIFF", "d.pgm": "PPM"}
    cases = [Case({name: _image(counts, form)}, name) for name, form in forms.items()]
    return [*cases, Case({"d.tif": _image(counts.astype(np.float32) / 1000, "TIFF")}, "d.tif")]


def colour_images() -> list[Case]:
    """Colour images in every format, with and without a palette and alpha."""
    forms = {
        "c.png": "PNG",
        "c.jpg": "JPEG",
        "c.tif": "TIFF",
        "c.bmp": "BMP",
        "c.webp": "WEBP",
        "c.ppm": "PPM",
    }
    cases = [Case({name: _image(_PIXELS, form)}, name) for name, form in forms.items()]
    for mode in ("P", "LA", "RGBA", "1"):
        data = io.BytesIO()
        Image.fromarray(_PIXELS).convert(mode).save(data, "PNG")
        cases.append(Case({"c.png": data.getvalue()}, "c.png"))
    return cases


def sensor_files() -> list[Case]:
    """Profiles of every kind of sensor, as they are shipped."""
    from importlib import resources

    from nbv.scanning.sensor_profile import sensor_names

    texts = [
        (resources.files("nbv.scanning") / "sensors" / f"{name}.toml").read_bytes() for name in sensor_names()
    ]
    return [Case({"s.toml": text}, "s.toml") for text in texts]


def study_files() -> list[Case]:
    """A study with everything in it."""
    text = """title = "Small"
description = "a study"
seeds = 2
results = "csv"

[sampling]
spacing_m = 0.5
subdivisions = 0

[[scenes]]
scene = "builtin:two_occluders"

[[scenes]]
scene = "room.glb"
up = "y"
units = "mm"
mode = "room"

[[sensors]]
sensor = "tiny.toml"
noise = "none"

[[requirements]]
max_incidence_deg = 75
max_range_m = 8.0
min_density_per_m2 = 100
max_sd_m = 0.01
k = 2

[[planners]]
method = "greedy"
target = 0.9

[[planners]]
method = "cover"
overlap = 0.3
polish_steps = 10
views = 5
"""
    return [Case({"study.toml": text.encode()}, "study.toml")]


def _plan() -> dict[str, object]:
    views = [
        {"world_from_sensor": pose.matrix.tolist(), "gain_m2": 1.5, "met_fraction": 0.4} for pose in POSES
    ]
    return {
        "method": "cover",
        "sensor": load_sensor("generic60").to_json(),
        "requirement": {"max_incidence_deg": 60.0, "max_range_m": None, "k": 1, "target": 0.99},
        "seed": 0,
        "n_candidates": 100,
        "views": views,
        "coverage": {"total_m2": 40.0, "met": 0.5, "reachable": 0.9, "unreachable": 0.1, "inferred": 0.0},
        "lower_bound": {"views": 2, "kind": "dual"},
        "stopped_because": "target met",
        "inference": [],
        "resumed_from": {"scans": 1, "met": 0.2, "world_from_sensor": [POSES[0].matrix.tolist()]},
        "region": [[0.0, 0.0, 0.0], [5.0, 5.0, 3.0]],
        "keep_out": [[[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]],
    }


def plan_files() -> list[Case]:
    """A plan."""
    return [Case({"plan.json": json.dumps(_plan()).encode()}, "plan.json")]


def edit_files() -> list[Case]:
    """Edits of every kind, and the surfaces that they name."""
    box = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0]]
    plane = {"point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}
    edits = [
        {"do": "reject", "surface": 3, "outline": box, "note": "no"},
        {"do": "accept", "surface": [1.0, 2.0, 3.0]},
        {"do": "merge", "surfaces": [3, 7]},
        {"do": "split", "surface": 7, "line": box[:2]},
        {"do": "end", "surface": {"point": [0.0, 1.0, 2.0], "kind": "plane"}, "plane": plane},
        {"do": "opening", "surface": 3, "outline": box},
    ]
    surfaces = [{"id": k, "anchor": [1.0, 2.0, float(k)], "kind": "plane"} for k in (3, 7)]
    return [Case({"e.json": json.dumps({"edits": edits, "surfaces": surfaces}).encode()}, "e.json")]


def candidate_files() -> list[Case]:
    """Positions and directions, with patches and an aperture, and each position's own directions."""
    points, data, own = world_points()[:20], io.BytesIO(), io.BytesIO()
    unit = np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0, -1.0]])
    np.savez(
        data,
        positions=points[:5],
        directions=unit,
        patch_points=points,
        patch_normals=np.ones((20, 3)),
        half_angle_deg=30.0,
    )
    np.savez(own, positions=points[:5], directions=np.broadcast_to(unit, (5, 3, 3)))
    return [Case({"c.npz": file.getvalue()}, "c.npz") for file in (data, own)]


def record_files() -> list[Case]:
    """What unseen writes as JSON, CSV and HTML, as far as `unseen info` reads it."""
    coverage = {
        "total_m2": 1.0, "met": 0.5, "reachable": 0.9, "unreachable": 0.1, "inferred": 0.0,
        "unreachable_because": {"range": 0.1}, "surfaces": [], "requirement": {},
    }  # fmt: skip
    completion = {
        "mode": "standard", "n_scans": 1, "surfaces": [{"kind": "plane", "openings": []}], "observed_m2": 1.0,
        "hypothesised_m2": 0.5, "free_space_violation_m2": 0.0, "edits": [],
    }  # fmt: skip
    manifest = {
        "command": "plan", "versions": {"unseen": "0.1.0"}, "seed": 0, "inputs": [{"input": "a"}],
        "outputs": [{"name": "plan.json", "bytes": 3}], "times": {"finished": "x", "seconds": 1.0},
    }  # fmt: skip
    camera = {"width": 14, "height": 12, "fx": 1.0, "fy": 1.0, "cx": 1.0, "cy": 1.0}
    records = {
        "coverage": coverage,
        "completion": completion,
        "manifest": manifest,
        "camera": camera,
        "plan": _plan(),
    }
    beside = {**manifest, "outputs": [{"name": f"{name}.json", "bytes": 3} for name in records]}
    cases = [
        Case(
            {"manifest.json": json.dumps(beside).encode(), f"{name}.json": json.dumps(held).encode()},
            f"{name}.json",
        )
        for name, held in records.items()
    ]
    page = b"<!doctype html><html><head><title>unseen plan</title></head><body></body></html>"
    return [
        *cases,
        Case({"r.html": page}, "r.html"),
        Case({"c.csv": b"id,name,area_m2\n1,wall,2\n"}, "c.csv"),
    ]
