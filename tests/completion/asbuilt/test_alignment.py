# SPDX-License-Identifier: MIT
"""Alignment: the dense solution, one moved wall that does not pull the poses, and far scans."""

from functools import cache

import numpy as np
import pytest

from completion.asbuilt import limits
from completion.asbuilt.agreement import N_SHARED, FaceBeams
from completion.asbuilt.alignment import PoseErrors, align
from completion.asbuilt.faces import N_COLUMNS, find_faces
from tests.completion.asbuilt.designs import boxes

SIGMA_M = 0.002
NEAR = PoseErrors((0.002, 1e-4), (0.05, 0.01))
ORIGINS = np.array([[-1.5, 0.3, -0.1], [1.2, -0.8, 0.2]])
SOLIDS = {  # a room and piers in it that are seen from within, its middle at the origin
    "floor": ((-3, -3, -1.5), (3, 3, -1.3)), "ceiling": ((-3, -3, 1.3), (3, 3, 1.5)),
    "west": ((-3.2, -3, -1.3), (-3, 3, 1.3)), "east": ((3, -3, -1.3), (3.2, 3, 1.3)),
    "south": ((-3, -3.2, -1.3), (3, -3, 1.3)), "north": ((-3, 3, -1.3), (3, 3.2, 1.3)),
    **{f"x {x}": ((x - 0.01, y, -1), (x + 0.01, y + 1, 1)) for x, y in ((2.2, 0.5), (-2.3, -1), (2.6, -2))},
    **{f"y {y}": ((x, y - 0.01, -1), (x + 1, y + 0.01, 1)) for x, y in ((0.2, 2.4), (-2, 2.5), (0, -2.2))},
}  # fmt: skip


@cache
def faces_within():
    """Faces of the room, and which of them look inwards."""
    faces = find_faces(boxes(SOLIDS).mesh, 1.0)
    return faces, np.flatnonzero(np.einsum("ij,ij->i", faces.centre, faces.normal) < 0)


def beams_of(offsets=None, motions=None, *, n=60, rng=0) -> FaceBeams:
    """Beams of both scans on all inner faces, `offsets` by face, `motions` (3, 6) of the scans."""
    faces, inner = faces_within()
    random, motions = np.random.default_rng(rng), np.zeros((3, 6)) if motions is None else motions
    rows = []
    for f in inner:
        for scan in range(2):
            uv = random.uniform(-0.9, 0.9, (n, 2))
            spread = uv * faces.half[f]
            points = faces.centre[f] + spread[:, :1] * faces.u[f] + spread[:, 1:] * faces.v[f]
            points = points + (offsets or {}).get(int(f), 0.0) * faces.normal[f]
            points = points + random.normal(0, SIGMA_M, (n, 1)) * faces.normal[f]
            own, common = motions[scan], motions[2]
            points = points + np.cross(own[:3], points - ORIGINS[scan]) + own[3:]
            points = points + np.cross(common[:3], points) + common[3:]
            rows.append((np.full(n, f, np.int32), np.full(n, scan, np.int32), points))
    face, scan, points = (np.concatenate(column) for column in zip(*rows, strict=True))
    at = faces.places(face, points)
    shared = np.random.default_rng(5).normal(0, 1e-4, (len(face), N_SHARED))
    return FaceBeams(
        face=face, scan=scan, points=points, distance=at.distance, normal=at.normal, columns=at.columns,
        uv=at.uv, sigma=np.full(len(face), SIGMA_M), area=np.full(len(face), 0.01), shared=shared,
    )  # fmt: skip


def aligned(beams, errors=NEAR, moved=None):
    return align(
        beams, np.ones(len(beams.face), bool), ORIGINS, speaks=np.ones(len(faces_within()[0]), bool),
        moved=np.zeros((3, 6)) if moved is None else moved, errors=errors,
        bias=np.full(2, limits.BIAS_SHARE), scale=1.0,
    )  # fmt: skip


def dense(beams, found, errors=NEAR):
    """Unknowns and their covariance by one least-squares problem with the priors that `found` ended with."""
    q, size = len(found.faces), 18 + N_SHARED
    rows, right = [], []
    for place, f in enumerate(found.faces):
        for scan in range(2):
            mine = np.flatnonzero((beams.face == f) & (beams.scan == scan))
            y, normal, points = beams.distance[mine], beams.normal[mine], beams.points[mine]
            weight = (
                1 / np.maximum(SIGMA_M, min(1.4826 * np.median(np.abs(y - np.median(y))), 3 * SIGMA_M)) ** 2
            )
            form = np.hypot(limits.FORM_M, limits.BIAS_SHARE * SIGMA_M)
            weight /= 1 + len(mine) * weight * form**2
            row = np.zeros((len(mine), q * N_COLUMNS + size))
            row[:, N_COLUMNS * place :][:, :N_COLUMNS] = beams.columns[mine]
            own = q * N_COLUMNS + 6 * scan
            row[:, own : own + 6] = np.column_stack([np.cross(points - ORIGINS[scan], normal), normal])
            row[:, q * N_COLUMNS + 12 :] = np.column_stack(
                [np.cross(points, normal), normal, beams.shared[mine]]
            )
            rows.append(row * np.sqrt(weight))
            right.append(y * np.sqrt(weight))
    sd = [*[errors.scan[1]] * 3, *[errors.scan[0]] * 3] * 2 + [
        *[errors.common[1]] * 3,
        *[errors.common[0]] * 3,
    ]
    precision = np.concatenate([np.repeat(found.prior, N_COLUMNS), 1 / np.square([*sd, *[1.0] * N_SHARED])])
    system = np.vstack([*rows, np.diag(np.sqrt(precision))])
    values = np.concatenate([*right, np.zeros(len(precision))])
    covariance = np.linalg.inv(system.T @ system)
    return covariance @ system.T @ values, covariance


def test_faces_eliminated_one_by_one_give_the_dense_solution() -> None:
    motions = np.zeros((3, 6))
    motions[0, 3:], motions[2] = [0.002, -0.001, 0.001], [0, 0, 1e-3, 0.004, -0.003, 0.002]
    _, inner = faces_within()
    beams = beams_of({int(inner[0]): 0.02, int(inner[3]): -0.004}, motions)
    found = aligned(beams)
    values, covariance = dense(beams, found)
    n = len(found.faces) * N_COLUMNS
    assert found.x.ravel() == pytest.approx(values[:n], abs=1e-9)
    assert found.motion.ravel() == pytest.approx(values[n : n + 18], abs=1e-9)
    scale = np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    assert found.covariance / scale[n:, n:] == pytest.approx(covariance[n:, n:] / scale[n:, n:], abs=1e-5)
    for a, b in ((0, 0), (0, 3), (2, 5)):
        part = covariance[5 * a : 5 * a + 5, 5 * b : 5 * b + 5]
        assert found.among(a, b) == pytest.approx(part, rel=1e-5, abs=1e-12)


def test_the_tested_face_has_no_prior_of_its_own() -> None:
    """Its deviation is that of a dense solve in which its own precision is nothing."""
    _, inner = faces_within()
    beams = beams_of({int(inner[2]): 0.003}, n=30)
    found = aligned(beams)
    place = int(np.searchsorted(found.faces, inner[2]))
    prior = found.prior.copy()
    prior[place] = 1e-3
    values, covariance = dense(beams, type("Free", (), {"faces": found.faces, "prior": prior}))
    own = slice(5 * place, 5 * place + 3)
    assert found.own_x[place, :3] == pytest.approx(values[own], abs=1e-6)
    assert found.own_covariance[place, :3, :3] == pytest.approx(covariance[own, own], rel=1e-3, abs=1e-12)


def test_one_wall_that_moved_does_not_pull_the_scans() -> None:
    """By 50 mm: least squares goes after it by a fifth of that, the mixed model by less than a millimetre."""
    _, inner = faces_within()
    (east,) = inner[faces_within()[0].centre[inner, 0] == 3]
    beams = beams_of({int(east): 0.05})
    found = aligned(beams)
    assert np.abs(found.motion[2, 3:]).max() < 0.001
    place = int(np.searchsorted(found.faces, east))
    assert found.own_x[place, 0] == pytest.approx(0.05, abs=0.0015)
    normal, points = beams.normal, beams.points
    rigid = np.column_stack([np.cross(points, normal), normal])
    plain = np.linalg.lstsq(rigid, beams.distance, rcond=None)[0]
    assert abs(plain[3]) > 0.009


@pytest.mark.parametrize("wrong", [[0.03, -0.02, 0.01, 0, 0, 0.002], [0, 0, -0.03, 1e-3, -1e-3, 0]])
def test_scans_off_by_three_centimetres_are_found(wrong) -> None:
    motions = np.zeros((3, 6))
    motions[2, 3:], motions[2, :3] = wrong[:3], wrong[3:]
    found = aligned(beams_of(motions=motions))
    assert found.motion[2, 3:] == pytest.approx(motions[2, 3:], abs=0.002)
    assert found.motion[2, :3] == pytest.approx(motions[2, :3], abs=3e-4)
    assert np.abs(found.own_x[:, 0]).max() < 0.003
    assert found.tau_m < 0.001


def test_fixed_scans_stay() -> None:
    """A control network holds: what all faces have alike is theirs."""
    motions = np.zeros((3, 6))
    motions[2, 5] = 0.01
    found = aligned(beams_of(motions=motions), PoseErrors((1e-4, 1e-5), (0.0, 0.0)))
    assert np.abs(found.motion[2]).max() < 1e-6
    faces, inner = faces_within()
    (floor,) = inner[faces.normal[inner, 2] > 0.9]
    assert found.own_x[np.searchsorted(found.faces, floor), 0] == pytest.approx(0.01, abs=0.001)


def test_what_was_taken_off_already_still_counts_against_the_prior() -> None:
    """Half of a motion taken off before: the sum of both is what one solve finds."""
    motions = np.zeros((3, 6))
    motions[0, 3:] = [0.006, 0.0, 0.0]
    at_once = aligned(beams_of(motions=motions))
    taken = np.zeros((3, 6))
    taken[0, 3] = 0.003
    rest = aligned(beams_of(motions=motions - taken), moved=taken)
    assert rest.motion[0, 3] + 0.003 == pytest.approx(at_once.motion[0, 3], abs=3e-4)


def test_intervals_hold_as_often_as_they_say() -> None:
    """Offsets of faces, most of less than 2 mm, in 20 draws of noise and of the scans' poses."""
    random, held, sizes = np.random.default_rng(7), [], []
    _, inner = faces_within()
    for draw in range(20):
        motions = np.zeros((3, 6))
        motions[:2, 3:], motions[:2, :3] = random.normal(0, 0.002, (2, 3)), random.normal(0, 1e-4, (2, 3))
        off = dict(zip(inner.tolist(), random.normal(0, 0.001, len(inner)), strict=True))
        found = aligned(beams_of(off, motions, n=40, rng=draw))
        sd = np.sqrt(found.own_covariance[:, 0, 0])
        truth = np.array([off[int(f)] for f in found.faces])
        held += (np.abs(found.own_x[:, 0] - truth) <= 1.96 * sd).tolist()
        sizes += sd.tolist()
    assert np.mean(held) > 0.93
    assert np.median(sizes) < 0.004
