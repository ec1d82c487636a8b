# SPDX-License-Identifier: MIT
"""Packing: what is unpacked is what was packed, bit by bit; nothing else can be built."""

import io
import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays, scalar_dtypes
from scipy.sparse import csr_array

from completion.extension.patch import Provenance
from scenes.pose import Pose
from scenes.run.journal import PackingError, pack, unpack
from scenes.surfaces.plane import Plane

NUMBERS = st.floats() | st.integers() | st.booleans() | st.none() | st.text()
KINDS = scalar_dtypes().filter(lambda kind: kind.kind in "biufcSU")
ARRAYS = arrays(KINDS, array_shapes(min_dims=0, min_side=0))
OURS = [Pose.identity(), Plane(np.zeros(3), np.array([0.0, 0.6, 0.8])), *Provenance]
VALUES = st.recursive(
    NUMBERS | ARRAYS | st.sampled_from(OURS),
    lambda inner: st.lists(inner) | st.tuples(inner, inner) | st.dictionaries(st.text(), inner),
    max_leaves=10,
)


def packed(value):
    stream = io.BytesIO()
    pack(value, stream)
    return stream.getvalue()


def unpacked(data):
    return unpack(io.BytesIO(data))


@given(VALUES)
@settings(max_examples=40, deadline=None)
def test_what_is_unpacked_packs_to_the_same_bytes(value):
    data = packed(value)
    assert packed(unpacked(data)) == data


@given(st.integers(0, 2**32 - 1), st.integers(0, 500), st.integers(0, 255))
@settings(max_examples=40, deadline=None)
def test_damage_is_an_error_or_does_no_harm(seed, place, byte):
    rng = np.random.default_rng(seed)
    value = {"a": rng.normal(size=20), "b": (Provenance(1), "text", None)}
    whole = packed(value)
    data = bytearray(whole)
    data[place % len(data)] = byte
    try:
        found = unpacked(bytes(data))
    except PackingError:
        return
    assert packed(found) == whole


def test_arrays_keep_kind_order_and_whether_they_may_be_written():
    fixed = np.asfortranarray(np.arange(6, dtype=np.int16).reshape(2, 3))
    fixed.setflags(write=False)
    large, none = np.arange(10_000.0), np.zeros((0, 3), np.int32)
    first, second, scalar, *others = unpacked(
        packed((fixed, np.zeros(2, np.float32), np.float32(0.1), large, none))
    )
    assert (first.dtype, first.flags.f_contiguous, first.flags.writeable) == (np.int16, True, False)
    assert second.flags.writeable
    np.testing.assert_array_equal(others[0], large)
    assert (others[1].shape, others[1].dtype) == ((0, 3), np.int32)
    assert scalar == np.float32(0.1)
    assert isinstance(scalar, np.float32)


def test_sparse_matrices_come_back_with_their_shape():
    matrix = csr_array(([0.5, 0.25], [1, 3], [0, 2, 2]), shape=(2, 7))
    found = unpacked(packed(matrix))
    assert found.shape == (2, 7)
    assert (found != matrix).nnz == 0


@pytest.mark.parametrize("value", [object(), Path("a"), {1: lambda: 0}, np.array([object()]), 1 + 2j])
def test_what_has_no_form_is_refused(value):
    with pytest.raises(PackingError, match="cannot be packed"):
        packed(value)


def archive(structure: object) -> bytes:
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as held:
        held.writestr("small", bytes(8))
        held.writestr("structure", json.dumps(structure))
    return data.getvalue()


@pytest.mark.parametrize(
    "structure",
    [
        ["class", "subprocess:Popen", ["args", "true"]],
        ["class", "scenes.pose:Pose", ["somewhere", 1]],
        ["class", "scenes.pose:Pose.identity"],
        ["class", "scenes.nowhere:Pose"],
        ["class", "scenes.run.atomic:Path"],
        ["class", "scenes.checks:InputError"],
        ["enum", "scenes.pose:Pose", "a"],
        ["eval", "1"],
        ["array", True, 7],
        ["array", True, 0, "<f8", 2],
        ["array", True, -8, "<f8", 1],
        ["array", True, 0, "O", 1],
        [],
    ],
)
def test_only_values_of_this_project_are_built(structure):
    with pytest.raises(PackingError):
        unpacked(archive(structure))
