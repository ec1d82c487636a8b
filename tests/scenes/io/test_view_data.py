# SPDX-License-Identifier: MIT
"""Data of the 3-D view: what is packed comes out again, small, and the same bytes each time."""

import base64
import gzip
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nbv.report.viewer.encoding import Packer, by_appearance, countdown, decoded_header, encode_view
from nbv.report.viewer.layers import NOTHING, Category, Classes, Layer, Numbers
from scenes.checks import InputError
from scenes.mesh.labelled_mesh import Appearance
from scenes.mesh.mesh_parts import thin_mesh
from tests.helpers.view_examples import EVIL, UTM, known_view

GREY = Category("grey", (0.5, 0.5, 0.5))


def unpacked(data, entry):
    """The slow reference of what the page's script does."""
    n, columns, width = entry["n"], entry["columns"], entry["width"]
    size = n * columns * width
    planes = np.frombuffer(data, np.uint8, size, entry["at"]).reshape(columns, width, n)
    codes = sum(planes[:, b].astype(np.int64) << (8 * b) for b in range(width)).T
    if entry["index"]:
        found, following = [], 0
        for code in codes[:, 0].tolist():
            found.append(following - code)
            following += code == 0
        return np.array(found)
    return np.cumsum((codes >> 1) ^ -(codes & 1), axis=0)


def body_of(text):
    data = gzip.decompress(base64.b64decode(text))
    return data[4 + struct.unpack_from("<I", data)[0] :]


@given(st.lists(st.tuples(*[st.integers(-(2**29), 2**29)] * 2), max_size=40))
def test_what_is_packed_comes_out_again(rows):
    table = np.array(rows, np.int64).reshape(-1, 2)
    packer = Packer()
    packer.add(np.arange(5))
    entry = packer.add(table)
    assert (unpacked(packer.bytes(), entry) == table).all()


@given(st.lists(st.integers(0, 9), max_size=40))
def test_indices_come_out_again_in_the_order_of_their_appearance(values):
    index, old = by_appearance(np.array(values, np.int64))
    assert (old[index] == values).all()
    assert (np.diff(np.unique(index, return_index=True)[1]) > 0).all()
    packer = Packer()
    entry = packer.add(index, is_index=True)
    assert (unpacked(packer.bytes(), entry) == index).all()
    assert (countdown(index) >= 0).all()


def sheet(n=9, origin=UTM, **more):
    """A square metre of n x n vertices."""
    y, x = np.mgrid[:n, :n] / (n - 1)
    vertices = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3) + origin
    k = np.arange(n * n).reshape(n, n)
    a, b, c, d = (part.ravel() for part in (k[:-1, :-1], k[:-1, 1:], k[1:, 1:], k[1:, :-1]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return Layer("sheet", "", vertices, faces, GREY, **more)


def view_of(*layers):
    return type(known_view())("test", layers)


def corners_of(text):
    """Corners (m, 3, 3) of the first layer's faces, world."""
    header, body = decoded_header(text), body_of(text)
    entry = header["layers"][0]
    places = unpacked(body, entry["corners"])[unpacked(body, entry["index"])]
    return places.reshape(-1, 3, 3) * header["step"] + header["origin"], entry, body


@pytest.mark.parametrize("side", [1.0, 30.0, 2000.0])
def test_corners_at_utm_are_right_to_a_fraction_of_a_millimetre(side):
    layer = sheet()
    wide = Layer("sheet", "", (layer.vertices - UTM) * side + UTM, layer.faces, GREY)
    corners, *_ = corners_of(encode_view(view_of(wide)))
    wanted = wide.vertices[wide.faces]
    order, found = (np.lexsort(np.round(c.mean(axis=1) - UTM, 2).T) for c in (wanted, corners))
    gap = np.abs(wanted[order].mean(axis=1) - corners[found].mean(axis=1)).max()
    assert gap <= 0.5 * max(side / 65535, 0.00025 if side > 16.4 else 0) + 1e-9


def test_faces_keep_their_values_and_their_side():
    layer = sheet()
    m = len(layer.faces)
    values = layer.vertices[layer.faces].mean(axis=1)[:, 0] - UTM[0]
    marked = sheet(channels=(Numbers("x", "x", "m", values, 0, 1, 4),))
    corners, entry, body = corners_of(encode_view(view_of(marked)))
    channel = entry["channels"][0]
    found = channel["base"] + channel["scale"] * unpacked(body, channel["values"])[:, 0]
    assert len(found) == m
    assert found == pytest.approx(corners.mean(axis=1)[:, 0] - UTM[0], abs=1e-4)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (normals[:, 2] > 0).all()


def test_faces_that_share_a_place_share_its_values_and_neighbours_share_corners():
    place = (np.arange(128) // 4).astype(np.int64)
    layer = sheet(place=place, channels=(Classes("c", "c", (GREY,) * 40, place[::4].astype(np.uint16)),))
    _, entry, body = corners_of(encode_view(view_of(layer)))
    assert entry["corners"]["n"] == 81
    of_face = unpacked(body, entry["channels"][0]["values"])[unpacked(body, entry["place"]), 0]
    assert (np.bincount(of_face) == 4).all()


def test_colours_and_textures_part_corners_that_differ():
    colour = np.ones((128, 3, 3), np.float32)
    colour[:64] = 0.2
    image = np.full((8, 8, 3), 90, np.uint8)
    uv = np.random.default_rng(0).random((128, 3, 2)).astype(np.float32)
    plain = encode_view(view_of(sheet(skin=Appearance(colour))))
    _, entry, body = corners_of(plain)
    assert entry["corners"]["n"] > 81
    assert set(unpacked(body, entry["colours"])[:, 0]) == {51, 255}
    skin = Appearance(colour, (image, image), np.repeat([-1, 0, 1, 1], 32).astype(np.int32), uv)
    _, entry, body = corners_of(encode_view(view_of(sheet(skin=skin))))
    assert [one["faces"] for one in entry["images"]] == [32, 32, 64]
    assert entry["images"][0]["image"] is None
    at = entry["images"][1]["image"]["at"]
    assert body[at : at + 4] == b"RIFF"
    steps = unpacked(body, entry["uv"]) * entry["uv"]["scale"] + entry["uv"]["low"]
    assert np.sort(steps[:, 0])[-1] == pytest.approx(uv[..., 0].max(), abs=1e-4)


def test_large_images_are_made_smaller():
    image = np.random.default_rng(0).integers(0, 255, (2600, 2600, 3), dtype=np.uint8)
    one = np.zeros(128, np.int32)
    skin = Appearance(np.ones((128, 3, 3), np.float32), (image,), one, np.zeros((128, 3, 2), np.float32))
    assert len(encode_view(view_of(sheet(skin=skin)))) < 3e6


def test_a_view_is_the_same_bytes_again_and_holds_no_name_as_text():
    text = encode_view(known_view())
    assert text == encode_view(known_view())
    assert set(text) <= set("ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/=")
    assert decoded_header(text)["label"] == EVIL
    assert gzip.decompress(base64.b64decode(text))[:4] != b"\0\0\0\0"


def test_a_view_without_surface_can_be_packed():
    header = decoded_header(encode_view(view_of()))
    assert header["layers"] == []
    assert header["size"] == [0, 0, 0]


def test_a_hundred_thousand_faces_take_little():
    n = 224
    layer = sheet(n)
    noisy = layer.vertices + np.random.default_rng(0).normal(0, 0.002, layer.vertices.shape)
    assert len(encode_view(view_of(Layer("noisy", "", noisy, layer.faces, GREY)))) < 8 * len(layer.faces)


def test_channels_and_layers_that_do_not_fit_are_refused():
    three = np.zeros(3, np.uint16)
    with pytest.raises(InputError, match="3 values, but 2 views"):
        Classes("c", "c", (GREY,), three, np.zeros(2, np.int64))
    with pytest.raises(InputError, match="category 1 of 1"):
        Classes("c", "c", (GREY,), three + np.uint16(1))
    Classes("c", "c", (GREY,), np.full(3, NOTHING, np.uint16))
    with pytest.raises(InputError, match="a colour bar from 1 to 1"):
        Numbers("n", "n", "", np.zeros(3), 1, 1)
    with pytest.raises(InputError, match="3 values for 128 places"):
        sheet(channels=(Classes("c", "c", (GREY,), three),))
    with pytest.raises(InputError, match="colours of 3 faces for 128"):
        sheet(skin=Appearance(np.zeros((3, 3, 3), np.float32)))


def test_thinning_leaves_small_meshes_alone_and_keeps_the_area_of_large_ones():
    layer = sheet(40)
    vertices, faces, kept = thin_mesh(layer.vertices, layer.faces, 10_000)
    assert vertices is layer.vertices
    assert len(faces) == len(layer.faces)
    vertices, faces, kept = thin_mesh(layer.vertices, layer.faces, 600)
    assert 100 < len(faces) <= 600
    assert (vertices == layer.vertices[kept]).all()
    area = (
        np.linalg.norm(
            np.cross(*(vertices[faces[:, k]] - vertices[faces[:, 0]] for k in (1, 2))), axis=1
        ).sum()
        / 2
    )
    assert area == pytest.approx(1.0, abs=0.15)
