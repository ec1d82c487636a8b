# SPDX-License-Identifier: MIT
"""glTF with normalised integers and instances: read at the size and in the number that the file means."""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from scenes.checks import InputError
from scenes.io.scene_files import load_scene
from tests.helpers.data_paths import data_path, requires_data

HALF = np.array([1.0, 0.5, 2.0])
CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * HALF
FACES = np.array([
    [1, 3, 0], [4, 1, 0], [0, 3, 2], [2, 4, 0], [1, 7, 3], [5, 1, 4],
    [5, 7, 1], [3, 7, 2], [6, 4, 2], [2, 7, 6], [6, 5, 4], [7, 5, 6],
])  # fmt: skip
COMPONENTS = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "f4": 5126}


class Glb:
    """A box of 2 x 1 x 4 in a GLB whose arrays and nodes are given."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []
        self.used: list[str] = []

    def array(self, values: NDArray[Any], kind: str, *, normalised: bool = False, stride: int = 0) -> int:
        """Add an accessor; return its number."""
        packed = np.ascontiguousarray(values, f"<{kind}")
        row = packed.reshape(len(packed), -1).view(np.uint8)
        if stride:
            row = np.pad(row, ((0, 0), (0, stride - row.shape[1])))
        self.data += bytes(-len(self.data) % 4)
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": row.size}
        self.data += row.tobytes()
        self.views.append(view | ({"byteStride": stride} if stride else {}))
        width = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}[packed[0].size]
        self.accessors.append(
            {
                "bufferView": len(self.views) - 1,
                "componentType": COMPONENTS[kind],
                "count": len(packed),
                "type": width,
                "normalized": normalised,
            }
        )
        return len(self.accessors) - 1

    def save(self, path: Path, attributes: dict[str, int], node: dict[str, Any]) -> Path:
        """Write the box with these attributes in one node."""
        indices = self.array(FACES.ravel(), "u2")
        content = {
            "asset": {"version": "2.0"},
            "extensionsUsed": self.used,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0} | node],
            "meshes": [{"primitives": [{"attributes": attributes, "indices": indices}]}],
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{"byteLength": len(self.data)}],
        }
        text = json.dumps(content).encode()
        text += b" " * (-len(text) % 4)
        binary = bytes(self.data) + bytes(-len(self.data) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text
        chunks += struct.pack("<I4s", len(binary), b"BIN\0") + binary
        path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
        return path


def extent(path: Path) -> NDArray[np.float64]:
    return np.asarray(np.ptp(load_scene(path, up="z").mesh.vertices, axis=0))


@requires_data
def test_normalised_positions_of_a_reported_file() -> None:
    path = data_path("reported/glb_quantized_normalized/g2b_quantized_normalized.glb")
    np.testing.assert_allclose(extent(path), [2, 1, 4], atol=1e-4)


@pytest.mark.parametrize(("kind", "stride"), [("i1", 4), ("i2", 8), ("u1", 4), ("u2", 8)])
def test_normalised_positions_are_fractions(tmp_path: Path, kind: str, stride: int) -> None:
    most = np.iinfo(kind).max
    fractions = CORNERS / 2 if kind[0] == "i" else CORNERS / 4 + 0.5
    glb = Glb()
    position = glb.array(np.rint(fractions * most), kind, normalised=True, stride=stride)
    scale = 2.0 if kind[0] == "i" else 4.0
    path = glb.save(tmp_path / "a.glb", {"POSITION": position}, {"scale": [scale] * 3})
    np.testing.assert_allclose(extent(path), [2, 1, 4], atol=scale / most)


def test_the_least_signed_integer_is_minus_one(tmp_path: Path) -> None:
    glb = Glb()
    position = glb.array(np.where(CORNERS < 0, -128, 127), "i1", normalised=True, stride=4)
    path = glb.save(tmp_path / "a.glb", {"POSITION": position}, {})
    np.testing.assert_allclose(load_scene(path).mesh.vertices.min(axis=0), -1.0)


def test_integers_that_are_not_normalised_stay(tmp_path: Path) -> None:
    glb = Glb()
    position = glb.array(CORNERS * 2, "i2", stride=8)
    path = glb.save(tmp_path / "a.glb", {"POSITION": position}, {"scale": [0.5] * 3})
    np.testing.assert_allclose(extent(path), [2, 1, 4])


@pytest.mark.parametrize("kind", ["u1", "u2"])
def test_normalised_colours(tmp_path: Path, kind: str) -> None:
    glb = Glb()
    colour = np.tile(np.array([1.0, 0.4, 0.0, 1.0]) * np.iinfo(kind).max, (8, 1))
    attributes = {"POSITION": glb.array(CORNERS, "f4"), "COLOR_0": glb.array(colour, kind, normalised=True)}
    appearance = load_scene(glb.save(tmp_path / "a.glb", attributes, {})).mesh.appearance
    assert appearance is not None
    seen = appearance.colour(np.array([0], np.int32), np.array([[1.0, 0.0, 0.0]]))
    np.testing.assert_allclose(seen[0], [1.0, 0.4, 0.0], atol=0.01)


@requires_data
def test_instances_of_a_reported_file() -> None:
    path = data_path("reported/glb_gpu_instancing/g3b_gpu_instancing_used.glb")
    np.testing.assert_allclose(extent(path), [22, 1, 4], atol=1e-6)
    assert len(load_scene(path).mesh.faces) == 36


def instanced(path: Path, arrays: dict[str, tuple[Any, str]], **node: Any) -> Path:
    glb = Glb()
    attributes = {
        name: glb.array(np.asarray(values), kind, normalised=kind != "f4")
        for name, (values, kind) in arrays.items()
    }
    extension = {"extensions": {"EXT_mesh_gpu_instancing": {"attributes": attributes}}}
    return glb.save(path, {"POSITION": glb.array(CORNERS, "f4")}, extension | node)


def test_instances_are_turned_and_scaled_within_their_node(tmp_path: Path) -> None:
    arrays: dict[str, tuple[Any, str]] = {
        "TRANSLATION": ([[0, 0, 0], [0, 10, 0]], "f4"),
        "ROTATION": ([[0, 0, 0, 127], [0, 0, 90, 90]], "i1"),
        "SCALE": ([[1, 1, 1], [2, 2, 2]], "f4"),
    }
    path = instanced(tmp_path / "a.glb", arrays, translation=[100, 0, 0], name="box")
    mesh = load_scene(path, up="z").mesh
    assert len(mesh.faces) == 24
    second = mesh.vertices[mesh.vertices[:, 1] > 5]
    np.testing.assert_allclose(second.min(axis=0), [99, 8, -4], atol=1e-5)
    np.testing.assert_allclose(second.max(axis=0), [101, 12, 4], atol=1e-5)


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({}, "node 0 has instances without attributes"),
        (
            {"TRANSLATION": ([[0, 0, 0]], "f4"), "SCALE": ([[1, 1, 1], [2, 2, 2]], "f4")},
            "instances of different number: 1 of TRANSLATION, 2 of SCALE",
        ),
        ({"ROTATION": ([[0, 0, 0]], "f4")}, "instances with 3 numbers of ROTATION; 4 are needed"),
    ],
)
def test_instances_that_lie_are_refused(tmp_path: Path, arrays: dict[str, Any], message: str) -> None:
    path = instanced(tmp_path / "a.glb", arrays)
    with pytest.raises(InputError, match=message) as caught:
        load_scene(path)
    assert str(path) in str(caught.value)


def test_a_texture_transform_is_named(tmp_path: Path) -> None:
    glb = Glb()
    glb.used.append("KHR_texture_transform")
    path = glb.save(tmp_path / "a.glb", {"POSITION": glb.array(CORNERS, "f4")}, {})
    assert "KHR_texture_transform is not applied" in " ".join(load_scene(path).warnings)
