# SPDX-License-Identifier: MIT
"""Parts of which one side was measured: a box, a box with a step, a rod, a block with a fillet."""

import numpy as np

from completion.parts.pipeline import divide_part, relate_part

NOISE = 2e-5
STEP = 0.0006
EYE = np.array([0.3, 0.35, 0.3])
BOX = np.array([0.06, 0.04, 0.03])


def grid(*lengths, step=STEP):
    """Middles of a grid over a rectangle or box."""
    axes = [np.arange(step / 2, length, step) for length in lengths]
    return np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, len(lengths))


def noisy(points, seed=0):
    return points + NOISE * np.random.default_rng(seed).normal(size=points.shape)


def divided(points):
    return relate_part(points, divide_part(points, noise_m=NOISE))


def box_faces(size=BOX):
    """The three faces of a box at 0 that face +x, +y and +z, one after the other."""
    faces = []
    for axis in range(3):
        a, b = (k for k in range(3) if k != axis)
        uv = grid(size[a], size[b])
        face = np.full((len(uv), 3), size[axis])
        face[:, [a, b]] = uv
        faces.append(face)
    return faces


def box_corner():
    return noisy(np.concatenate(box_faces()))


def stepped():
    """The box without its corner at +x +z: as seen from above and the side, it has no mirror along x."""
    x, y, z = box_faces()
    cut = 0.04, 0.015
    y = y[~((y[:, 0] > cut[0]) & (y[:, 2] > cut[1]))]
    top, floor = z[z[:, 0] <= cut[0]], z[z[:, 0] > cut[0]].copy()
    floor[:, 2] = cut[1]
    low, riser = x[x[:, 2] <= cut[1]], x[x[:, 2] > cut[1]].copy()
    riser[:, 0] = cut[0]
    return noisy(np.concatenate([y, top, floor, low, riser]))


def rod(radius=0.01, length=0.05):
    """A rod along x as seen from +y +z, with the end at +x: nearly half a turn."""
    uv = grid(length, 0.94 * np.pi * radius)
    angle = uv[:, 1] / radius + np.arctan2(EYE[2], EYE[1]) - 0.47 * np.pi
    wall = np.column_stack([uv[:, 0], radius * np.cos(angle), radius * np.sin(angle)])
    disc = grid(2 * radius, 2 * radius) - radius
    disc = disc[np.linalg.norm(disc, axis=1) < radius]
    return noisy(np.concatenate([wall, np.insert(disc, 0, length, axis=1)]))


def rounded(radius=0.006):
    """The box with a fillet along y between +x and +z."""
    x, y, z = box_faces()
    middle = BOX[[0, 2]] - radius
    x, z = x[x[:, 2] < middle[1]], z[z[:, 0] < middle[0]]
    corner = (y[:, 0] > middle[0]) & (y[:, 2] > middle[1])
    y = y[~corner | (np.linalg.norm(y[:, [0, 2]] - middle, axis=1) < radius)]
    uv = grid(radius * np.pi / 2, BOX[1])
    angle = uv[:, 0] / radius
    bend = np.column_stack([middle[0] + radius * np.cos(angle), uv[:, 1], middle[1] + radius * np.sin(angle)])
    return noisy(np.concatenate([x, y, z, bend]))


def rounded_end(radius=0.015, length=0.04, height=0.012):
    """A flat bar along x with a half-round end at +x as seen from +x +y +z: top, side, most of the end."""
    top = grid(length + radius, 2 * radius) - [0, radius]
    top = top[(top[:, 0] < length) | (np.hypot(top[:, 0] - length, top[:, 1]) < radius)]
    side = grid(length, height)
    uv = grid(0.8 * np.pi * radius, height)
    angle = np.pi / 2 - uv[:, 0] / radius
    end = np.column_stack([length + radius * np.cos(angle), radius * np.sin(angle), uv[:, 1]])
    flank = np.column_stack([side[:, 0], np.full(len(side), radius), side[:, 1]])
    return noisy(np.concatenate([np.insert(top, 2, height, axis=1), flank, end]))
