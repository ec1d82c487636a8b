# SPDX-License-Identifier: MIT
"""Colours of vertices by other writers: bytes, fractions, 16 bits, other names; splat models."""

import struct

import numpy as np
import pytest
import trimesh

from scenes import load_scene
from scenes.io.point_files import read_points

BOX = trimesh.creation.box([5, 4, 2.7])
COLOUR = (200, 100, 50)


def obj_of(colour, faces=True):
    lines = [f"v {x} {y} {z} {colour} " for x, y, z in BOX.vertices]
    return "\n".join([*lines, *(f"f {a} {b} {c}" for a, b, c in BOX.faces + 1), ""])


def ply_of(names, kind, colour, order="ascii", axes="xyz"):
    """Vertices alone, with a colour each."""
    properties = [*(("float", axis) for axis in axes), *((kind, name) for name in names)]
    head = f"ply\nformat {order} 1.0\nelement vertex 8\n" + "".join(
        f"property {kind} {name}\n" for kind, name in properties
    )
    if order == "ascii":
        rows = "".join(f"{x} {y} {z} {' '.join(map(str, colour))}\n" for x, y, z in BOX.vertices)
        return (head + "end_header\n" + rows).encode()
    letter = {"uchar": "B", "ushort": "H", "float": "f"}[kind]
    sign = ">" if "big" in order else "<"
    rows = b"".join(struct.pack(f"{sign}3f{len(names)}{letter}", *v, *colour) for v in BOX.vertices)
    return (head + "end_header\n").encode() + rows


@pytest.mark.parametrize("colour", ["200 100 50", "0.78431 0.39216 0.19608", "200.0\t 100 50"])
def test_colours_of_obj_vertices(tmp_path, colour):
    path = tmp_path / "box.obj"
    path.write_text(obj_of(colour))
    corners = load_scene(path).mesh.appearance.corner_colour.reshape(-1, 3)
    assert np.abs(corners * 255 - COLOUR).max() < 0.6


@pytest.mark.parametrize(
    "content",
    [
        ply_of(("diffuse_red", "diffuse_green", "diffuse_blue"), "uchar", COLOUR),
        ply_of(("r", "g", "b"), "uchar", COLOUR, "binary_big_endian"),
        ply_of(("red", "green", "blue"), "ushort", [257 * value for value in COLOUR], "binary_little_endian"),
        ply_of(("Red", "Green", "Blue"), "float", [value / 255 for value in COLOUR], axes="XYZ"),
        ply_of(("red", "green", "blue"), "float", COLOUR),
    ],
    ids=["diffuse", "letters", "16 bits", "fractions, capitals", "bytes as floats"],
)
def test_colours_of_ply_points(tmp_path, content):
    path = tmp_path / "box.ply"
    path.write_bytes(content)
    cloud = read_points(path)
    assert (cloud.colour == COLOUR).all()
    assert np.allclose(cloud.points, BOX.vertices)


def test_splat_models_are_told(tmp_path):
    path = tmp_path / "splats.ply"
    path.write_bytes(ply_of(("f_dc_0", "f_dc_1", "f_dc_2"), "float", [1.0, 0.0, -1.0]))
    cloud = read_points(path)
    assert (cloud.colour == np.rint(255 * (0.5 + 0.28209479 * np.array([1, 0, -1])))).all()
    assert any("centres of Gaussians" in warning for warning in cloud.warnings)
