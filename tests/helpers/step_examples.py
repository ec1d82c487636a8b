# SPDX-License-Identifier: MIT
"""Parts of exact surfaces with points on them, and STEP files read back."""

from pathlib import Path

import numpy as np
import pytest

from completion.export.step.kernel import kernel
from completion.export.step.regions import FittedRegion, part_regions
from scenes.surfaces.catalogue import Cone, Cylinder, Plane, Sphere, Torus

STEP_M = 1e-3
"""Distance between points."""


def needs_kernel():
    """Skip a module where the optional kernel is absent."""
    pytest.importorskip("OCP", reason='OCP is not installed: pip install "unseen[step]"')


def regions(faces, step=STEP_M, noise=0.0):
    """The regions of (surface, points) pairs."""
    points = np.concatenate([own for _, own in faces])
    region = np.repeat(np.arange(len(faces)), [len(own) for _, own in faces])
    fitted = [FittedRegion(k + 1, surface, 1e-5, k) for k, (surface, _) in enumerate(faces)]
    return part_regions(fitted, points, region, spacing_m=step, noise_m=noise)


def grid(width, height):
    """Middles (n, 2) of squares of a rectangle about its centre."""
    n, m = max(round(width / STEP_M), 2), max(round(height / STEP_M), 2)
    u, v = ((np.arange(k) + 0.5) / k - 0.5 for k in (n, m))
    return np.stack(np.meshgrid(width * u, height * v), axis=-1).reshape(-1, 2)


def box(size):
    """Six planes of a box about the origin."""
    faces = []
    for axis in range(3):
        others = [k for k in range(3) if k != axis]
        for side in (-1, 1):
            points = np.insert(grid(*(size[k] for k in others)), axis, side * size[axis] / 2, axis=1)
            normal = side * np.eye(3)[axis]
            faces.append((Plane(normal * size[axis] / 2, normal), points))
    return faces


def drilled(size, radius):
    """A box with a hole along z."""
    faces = [(s, p[np.hypot(p[:, 0], p[:, 1]) > radius] if abs(s.normal_direction[2]) > 0.5 else p)
             for s, p in box(size)]  # fmt: skip
    return [
        *faces,
        (
            Cylinder((0, 0, 0), (0, 0, 1), radius, concave=True),
            turned([(radius, -size[2] / 2), (radius, size[2] / 2)]),
        ),
    ]


def turned(line):
    """Points (n, 3) of what a line (k, 2) of radii and heights sweeps about z."""
    line = np.asarray(line, dtype=float)
    along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    n = max(round(along[-1] / STEP_M), 2)
    place = (np.arange(n) + 0.5) / n * along[-1]
    r, z = np.interp(place, along, line[:, 0]), np.interp(place, along, line[:, 1])
    rows = []
    for k, (radius, height) in enumerate(zip(r, z, strict=True)):
        m = max(round(2 * np.pi * radius / STEP_M), 3)
        angle = (np.arange(m) + 0.5 * (k % 2)) / m * 2 * np.pi
        rows.append(np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(m, height)]))
    return np.concatenate(rows)


def disc(radius, height, inner=0.0):
    """A plane disc, or ring, at a height, and its points."""
    return Plane((0, 0, height), (0, 0, np.sign(height) or 1)), turned([(inner, height), (radius, height)])


def rod(radius, length):
    """A cylinder with two ends."""
    side = turned([(radius, -length / 2), (radius, length / 2)])
    return [
        (Cylinder((0, 0, 0), (0, 0, 1), radius), side),
        disc(radius, length / 2),
        disc(radius, -length / 2),
    ]


def frustum(low, high, length):
    """A cone with two ends; `low` is the wider radius."""
    half = np.arctan((low - high) / length)
    middle = (low + high) / 2
    side = turned([(low, -length / 2), (high, length / 2)])
    cone = Cone((0, 0, 0), (0, 0, -1), middle, half)
    ends = [disc(low, -length / 2)] + ([disc(high, length / 2)] if high > 0 else [])
    return [(cone, side), *ends]


def bead(radius, tube, length):
    """A rod with a ring round its middle: half a torus outside the cylinder."""
    bend = np.linspace(-np.pi / 2, np.pi / 2, 41)
    ring = turned(np.column_stack([radius + tube * np.cos(bend), tube * np.sin(bend)]))
    torus = Torus((0, 0, 0), (0, 0, 1), radius, tube)
    cylinder = Cylinder((0, 0, 0), (0, 0, 1), radius)
    low = turned([(radius, -length / 2), (radius, -tube)])
    high = turned([(radius, tube), (radius, length / 2)])
    return [
        (torus, ring),
        (cylinder, low),
        (cylinder, high),
        disc(radius, length / 2),
        disc(radius, -length / 2),
    ]


def ball_ended(radius, length):
    """A rod whose upper end is half a ball, which touches it tangentially."""
    bend = np.linspace(0, np.pi / 2, 41)
    cap = turned(np.column_stack([radius * np.cos(bend), length / 2 + radius * np.sin(bend)]))
    return [*rod(radius, length)[::2], (Sphere((0, 0, length / 2), radius), cap)]


def read_back(data, folder):
    """The shape in a STEP file, millimetres."""
    file = Path(folder) / "read.step"
    file.write_bytes(data)
    modules = kernel()
    reader = modules.STEPControl.STEPControl_Reader()
    assert reader.ReadFile(str(file)) == modules.IFSelect.IFSelect_ReturnStatus.IFSelect_RetDone
    reader.TransferRoots()
    return reader.OneShape()
