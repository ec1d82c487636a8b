# SPDX-License-Identifier: MIT
"""Checks at the door, which return the checked array or raise with numbers, and frozen arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.card import Value as Value

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.integer[Any]]
BoolArray = NDArray[np.bool_]
ColourArray = NDArray[np.uint8]
MOST_M = 1e12
"""Coordinates beyond it are no places: no instrument reaches so far, and products of them overflow."""


class InputError(ValueError):
    """Unusable input: the message names the file or argument, the cause and, where there is one, the cure."""


def given_points(shape: object) -> Any:
    """Return the points (n, 3) of a cloud or mesh of Open3D, pyvista or trimesh; of others what was given."""
    for name in ("points", "vertices"):
        held = getattr(shape, name, None)
        if held is not None and not callable(held):
            return held
    return shape


def given_faces(shape: object) -> NDArray[Any] | None:
    """Return the faces (m, 3) of a mesh of trimesh, Open3D or pyvista; None for what is no mesh.

    Raises InputError: faces that are no triangles.
    """
    held = getattr(shape, "faces", getattr(shape, "triangles", None))
    faces = np.asarray(() if held is None or callable(held) else held)
    if faces.ndim == 1:  # of VTK: the number of corners before those of each face
        if len(faces) % 4 or (faces[::4] != 3).any():
            raise InputError(f"a {type(shape).__name__} has other faces than triangles; triangulate it")
        faces = faces.reshape(-1, 4)[:, 1:]
    return faces if len(faces) else None


def check_vectors(name: str, array: object) -> FloatArray:
    """Return `array`, or the points of a cloud of Open3D or pyvista, as float64 with shape (n, 3).

    Raises InputError: any other shape.
    """
    checked = np.asarray(given_points(array), dtype=np.float64)
    if checked.ndim != 2 or checked.shape[1] != 3:
        raise InputError(f"expected {name} with shape (n, 3), got {checked.shape}")
    return checked


def usable_rows(points: FloatArray) -> BoolArray:
    """Tell which of points (n, 3) are places: finite, and no coordinate beyond `MOST_M`."""
    return np.asarray((np.abs(points) <= MOST_M).all(axis=1), dtype=np.bool_)


def check_finite(name: str, array: FloatArray, cure: str = "drop those rows first") -> FloatArray:
    """Return `array`, of any shape, when all in it is finite; raise InputError with the count otherwise."""
    bad = ~np.isfinite(array).all(axis=tuple(range(1, array.ndim))) if array.ndim > 1 else ~np.isfinite(array)
    if bad.any():
        first = int(np.argmax(bad))
        raise InputError(
            f"{int(bad.sum())} of {len(array)} {name} are not finite (first at row {first}); {cure}"
        )
    return array


def check_points(name: str, array: object) -> FloatArray:
    """Return `array` as finite float64 points with shape (n, 3)."""
    return check_finite(name, check_vectors(name, array))


def check_places(name: str, array: object) -> FloatArray:
    """Return `array` as points (n, 3) of the world; raise InputError unless finite and within `MOST_M`."""
    checked = check_points(name, array)
    far = float(np.abs(checked).max(initial=0.0))
    if far > MOST_M:
        raise InputError(
            f"{name} reach {far:.3g} m from the origin; coordinates are to stay within {MOST_M:g} m"
        )
    return checked


def check_point(name: str, point: object) -> FloatArray:
    """Return `point` as finite float64 with shape (3,); raise InputError otherwise."""
    checked = np.asarray(point, dtype=np.float64)
    if checked.shape != (3,):
        raise InputError(f"expected {name} with shape (3,), got {checked.shape}")
    if not np.isfinite(checked).all():
        raise InputError(f"{name} is {checked.tolist()}; give finite coordinates")
    return checked


def check_coordinates(value: object) -> FloatArray:
    """Return what a document holds as coordinates as an array of any shape; raise InputError for text."""
    try:
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        text = value if isinstance(value, str) or not isinstance(value, Sequence) else list(value)
        raise InputError(f"expected coordinates such as [x, y, z], got {text!r}") from error


def check_direction(name: str, vector: object) -> FloatArray:
    """Return `vector` as a unit vector of shape (3,); raise InputError where it has no direction."""
    checked = np.asarray(vector, dtype=np.float64)
    if checked.shape != (3,):
        raise InputError(f"expected {name} with shape (3,), got {checked.shape}")
    length = float(np.linalg.norm(checked))
    if not np.isfinite(length) or length == 0.0:
        raise InputError(f"{name} has length {length}; give a finite vector other than zero")
    return checked / length


def check_directions(name: str, vectors: object, n: int) -> FloatArray:
    """Return `n` directions, or one for all, as unit vectors (n, 3).

    Raises InputError: another number of them, or one that has no direction.
    """
    given = np.atleast_2d(np.asarray(vectors, dtype=np.float64))
    if len(given) not in (1, n):
        raise InputError(f"expected {name} with shape (3,) or ({n}, 3), got {given.shape}")
    return np.broadcast_to([check_direction(name, vector) for vector in given], (n, 3))


def check_faces(array: object, n_vertices: int) -> NDArray[np.int32]:
    """Return `array` as (m, 3) int32 vertex indices below `n_vertices`; raise InputError otherwise."""
    checked = np.asarray(array)
    if checked.ndim != 2 or checked.shape[1] != 3:
        raise InputError(f"expected faces with shape (m, 3), got {checked.shape}")
    if not np.issubdtype(checked.dtype, np.integer):
        raise InputError(f"expected faces of integers, got {checked.dtype}")
    if checked.size and (checked.min() < 0 or checked.max() >= n_vertices):
        bad = ((checked < 0) | (checked >= n_vertices)).any(axis=1)
        first = int(np.argmax(bad))
        raise InputError(
            f"face {first} is {checked[first].tolist()}, but there are {n_vertices} vertices "
            f"({int(bad.sum())} such faces)"
        )
    return np.ascontiguousarray(checked, dtype=np.int32)


def check_number(name: str, value: float, least: float = 0.0, most: float = np.inf) -> float:
    """Return `value` as a finite float in `least`..`most`, both included; raise InputError otherwise."""
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{name} must be a number, got {value!r}") from error
    if not (np.isfinite(number) and least <= number <= most):
        bounds = f"{least:g} or more" if most == np.inf else f"between {least:g} and {most:g}"
        raise InputError(f"{name} must be {bounds}, got {value!r}")
    return number


def check_kind(name: str, value: object, kind: type | tuple[type, ...], cure: str) -> None:
    """Raise InputError unless `value` is of a kind; the message says what it is, and the cure."""
    if not isinstance(value, kind):
        kinds = " or ".join(wanted.__name__ for wanted in (kind if isinstance(kind, tuple) else (kind,)))
        what = f"an array of shape {value.shape}" if isinstance(value, np.ndarray) else type(value).__name__
        raise InputError(f"{name} must be {kinds}, got {what}; {cure}")


def check_rng(rng: np.random.Generator | int | None) -> np.random.Generator:
    """Return the generator of a seed, a generator itself, or one from the system's entropy for None.

    Raises
    ------
    InputError
        No whole number that is not negative, and no generator.
    """
    whole = isinstance(rng, int | np.integer) and not isinstance(rng, bool) and rng >= 0
    if not (rng is None or whole or isinstance(rng, np.random.Generator)):
        raise InputError(f"rng must be a whole number from 0, a numpy Generator or None, got {rng!r}")
    return np.random.default_rng(rng)


def check_options(options: object, **bounds: tuple[float, float]) -> None:
    """Raise InputError for a field of `options` outside its (least, most); fields that are None may be."""
    for field, (least, most) in bounds.items():
        value = getattr(options, field)
        if value is not None:
            check_number(field, value, least, most)


def read_only_view(array: NDArray[Any]) -> NDArray[Any]:
    """Return an array (n, ...) as one that cannot be written through: one type for compiled loops."""
    view = array.view()
    view.flags.writeable = False
    return view


def frozen_copy(array: Any, dtype: Any = None) -> Any:
    """Return a read-only copy of `array`, so that a value that holds it cannot change.

    An array that is read-only, as is the one whose memory it shows, is returned as it is.
    """
    if isinstance(array, np.ndarray) and (dtype is None or array.dtype == dtype):
        owner = array if array.base is None else array.base
        if isinstance(owner, np.ndarray) and not (array.flags.writeable or owner.flags.writeable):
            return array
    copy = np.array(array, dtype=dtype, copy=True)
    copy.setflags(write=False)
    return copy


def freeze_arrays(value: Any) -> None:
    """Make the arrays that a frozen dataclass holds read-only; called in its `__post_init__`.

    They are shown, not copied: whoever makes a value gives its arrays away. Values that are made of a user's
    arrays take a `frozen_copy` instead.
    """
    for field in fields(value):
        array = getattr(value, field.name)
        if isinstance(array, np.ndarray) and array.flags.writeable:
            shown = array.view()
            shown.setflags(write=False)
            object.__setattr__(value, field.name, shown)


class ArrayValue(Value):
    """A base of frozen dataclasses whose arrays become read-only when they are made."""

    __slots__ = ()

    def __post_init__(self) -> None:
        freeze_arrays(self)
