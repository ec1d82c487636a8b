# SPDX-License-Identifier: MIT
"""Checks return the checked array, or say in numbers what was wrong."""

import numpy as np
import pytest

from scenes.checks import (
    InputError,
    check_direction,
    check_faces,
    check_finite,
    check_number,
    check_point,
    check_points,
    check_vectors,
    frozen_copy,
)


def test_input_error_is_a_value_error() -> None:
    assert issubclass(InputError, ValueError)


def test_vectors_become_float64_rows() -> None:
    checked = check_vectors("points", [[1, 2, 3]])
    assert checked.dtype == np.float64
    assert checked.tolist() == [[1.0, 2.0, 3.0]]


@pytest.mark.parametrize("shape", [(), (3,), (2, 2), (3, 4), (1, 2, 3)])
def test_vectors_of_another_shape_are_refused_with_that_shape(shape: tuple[int, ...]) -> None:
    with pytest.raises(InputError) as error:
        check_vectors("points", np.zeros(shape))
    assert str(error.value) == f"expected points with shape (n, 3), got {shape}"


def test_rows_that_are_not_finite_are_counted_and_the_first_is_named() -> None:
    points = np.zeros((900, 3))
    points[[4, 9, 9, 30], [0, 1, 2, 2]] = [np.nan, np.inf, np.nan, -np.inf]
    with pytest.raises(
        InputError, match=r"^3 of 900 points are not finite \(first at row 4\); drop those rows"
    ):
        check_points("points", points)
    with pytest.raises(InputError, match=r"clean the file first$"):
        check_finite("points", points, "clean the file first")


def test_finite_arrays_of_any_dimension_pass() -> None:
    for shape in [(4,), (4, 3), (4, 2, 3), (0,), (0, 3)]:
        assert check_finite("numbers", np.ones(shape)).shape == shape
    with pytest.raises(InputError, match=r"1 of 2 weights are not finite \(first at row 1\)"):
        check_finite("weights", np.array([1.0, np.nan]))


def test_no_points_are_points() -> None:
    assert check_points("points", np.zeros((0, 3))).shape == (0, 3)


def test_a_point_has_three_finite_coordinates() -> None:
    assert check_point("eye", (1, 2, 3)).tolist() == [1.0, 2.0, 3.0]
    with pytest.raises(InputError, match=r"expected eye with shape \(3,\), got \(2,\)"):
        check_point("eye", (1, 2))
    with pytest.raises(InputError, match=r"eye is \[1.0, nan, 3.0\]; give finite coordinates"):
        check_point("eye", (1, np.nan, 3))


def test_a_direction_comes_back_with_unit_length() -> None:
    assert np.allclose(check_direction("up", (0, 3, 4)), [0, 0.6, 0.8], atol=1e-15, rtol=0)


@pytest.mark.parametrize(
    ("vector", "message"),
    [
        ((0, 0, 0), "up has length 0.0; give a finite vector other than zero"),
        ((0, np.nan, 0), "up has length nan"),
        ((0, np.inf, 0), "up has length inf"),
        ((0, 1), r"expected up with shape \(3,\), got \(2,\)"),
        ([[0, 0, 1]], r"expected up with shape \(3,\), got \(1, 3\)"),
    ],
)
def test_what_is_no_direction_is_refused(vector: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        check_direction("up", vector)


def test_faces_become_contiguous_int32() -> None:
    faces = check_faces(np.array([[0, 1, 2, 9]], np.uint64)[:, :3], 3)
    assert faces.dtype == np.int32
    assert faces.flags.c_contiguous
    assert check_faces(np.zeros((0, 3), int), 0).shape == (0, 3)


@pytest.mark.parametrize("bad", [3, -1, 2**31, 2**40])
def test_a_face_that_names_no_vertex_is_named(bad: int) -> None:
    faces = np.array([[0, 1, 2], [0, 1, bad], [bad, 1, 2]])
    expected = rf"^face 1 is \[0, 1, {bad}\], but there are 3 vertices \(2 such faces\)$"
    with pytest.raises(InputError, match=expected):
        check_faces(faces, 3)


def test_faces_of_another_shape_or_type_are_refused() -> None:
    with pytest.raises(InputError, match=r"expected faces with shape \(m, 3\), got \(2, 4\)"):
        check_faces(np.zeros((2, 4), int), 3)
    with pytest.raises(InputError, match="expected faces of integers, got float64"):
        check_faces(np.zeros((2, 3)), 3)


def test_a_frozen_copy_is_neither_shared_nor_writable() -> None:
    original = np.zeros(3)
    copy = frozen_copy(original, np.float32)
    original[0] = 1
    assert copy.tolist() == [0, 0, 0]
    assert copy.dtype == np.float32
    with pytest.raises(ValueError, match="read-only"):
        copy[0] = 1


@pytest.mark.parametrize("bad", [np.nan, np.inf, -0.1, 1.1, "much"])
def test_numbers_outside_their_bounds_are_refused_with_them(bad: object) -> None:
    assert check_number("share", 0.25, 0.0, 1.0) == 0.25
    what = "a number, got 'much'" if bad == "much" else f"between 0 and 1, got {bad}"
    with pytest.raises(InputError, match=f"share must be {what}"):
        check_number("share", bad, 0.0, 1.0)  # type: ignore[arg-type]


def test_a_frozen_copy_is_read_only_and_shares_only_what_cannot_change() -> None:
    array = np.arange(6.0)
    copy = frozen_copy(array)
    assert not np.shares_memory(copy, array)
    assert not copy.flags.writeable
    assert frozen_copy(copy) is copy
    assert np.shares_memory(frozen_copy(copy.reshape(2, 3)), copy)
    assert frozen_copy(copy, np.float32).dtype == np.float32
    window = array.reshape(2, 3)
    window.setflags(write=False)  # but its memory is still open to `array`
    assert not np.shares_memory(frozen_copy(window), array)
