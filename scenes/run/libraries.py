# SPDX-License-Identifier: MIT
"""Libraries that are optional, and the clouds and tables of theirs that values turn into."""

from __future__ import annotations

import importlib
import io
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.checks import FloatArray, InputError


def import_extra(module: str, extra: str) -> Any:
    """Import an optional dependency, or raise an InputError that names the cure."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise missing_extra(module, extra) from error


def missing_extra(module: str, extra: str) -> InputError:
    """Return the error of an optional dependency that is not there, with the cure."""
    return InputError(f'{module} is not installed; the cure: pip install "unseen[{extra}]"')


def table_of(rows: str | Sequence[Mapping[str, Any]]) -> Any:
    """Return the text of a CSV file, or rows by column, as a `pandas.DataFrame`.

    Raises
    ------
    InputError
        pandas is not installed.
    """
    pandas = import_extra("pandas", "pandas")
    return pandas.read_csv(io.StringIO(rows)) if isinstance(rows, str) else pandas.DataFrame(list(rows))


def open3d_cloud(
    points: FloatArray, colour: NDArray[Any] | None = None, normals: FloatArray | None = None
) -> Any:
    """Return points (n, 3), with sRGB in 0..1 (n, 3) and normals (n, 3), as an `open3d.geometry.PointCloud`.

    Raises
    ------
    InputError
        Open3D is not installed.
    """
    open3d = import_extra("open3d", "open3d")
    cloud = open3d.geometry.PointCloud()
    for name, rows in (("points", points), ("colors", colour), ("normals", normals)):
        if rows is not None:
            setattr(cloud, name, open3d.utility.Vector3dVector(np.array(rows, np.float64)))
    return cloud
