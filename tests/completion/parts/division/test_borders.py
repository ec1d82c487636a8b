# SPDX-License-Identifier: MIT
"""Faces that meet smoothly: their fits leave out the points that may be on either."""

import numpy as np

from completion.parts.division.borders import fits_inside
from completion.parts.division.faces import fit_labels
from completion.parts.division.neighbourhoods import look_around
from scenes.surfaces.catalogue import Cylinder, Plane

R, SIGMA = 0.005, 1e-4  # m


def filleted(seed, n=3_000):
    """A floor and a wall with a fillet between them: points with noise, and the nearest of the three."""
    rng = np.random.default_rng(seed)
    side, width = rng.uniform(R, 4 * R, n), rng.uniform(0, 0.05, (3, n))
    turn, none = rng.uniform(np.pi, 1.5 * np.pi, n // 2), np.zeros(n)
    arc = np.column_stack([R + R * np.cos(turn), width[2, : n // 2], R + R * np.sin(turn)])
    points = np.concatenate([
        np.column_stack([side, width[0], none]), np.column_stack([none, width[1], side]), arc
    ])  # fmt: skip
    points += rng.normal(0, SIGMA, points.shape)
    surfaces = [Plane((0, 0, 0), (0, 0, 1)), Plane((0, 0, 0), (1, 0, 0)), Cylinder((R, 0, R), (0, 1, 0), R)]
    off = np.abs([surface.distance(points) for surface in surfaces])
    away = points[:, [0, 2]].max(axis=1) > 1.5 * R
    off[2, away] = np.inf
    labels = np.where(off[2] < 2 * SIGMA, 3, off.argmin(axis=0) + 1)  # what both explain is the smaller one's
    return points, surfaces, labels


def errors(fits):
    fit = fits[2]
    deviation = float(np.sqrt(fit.parameter_covariances()["radius"][0, 0]))
    return fit.surface.radius - R, deviation


def test_a_fillet_keeps_its_radius_where_points_are_given_to_it():
    before, after = [], []
    for seed in range(3):
        points, surfaces, labels = filleted(seed)
        about, every = look_around(points, noise_m=SIGMA), np.arange(len(points))
        fits, labels = fit_labels(points, surfaces, labels, SIGMA)
        before.append(errors(fits))
        after.append(errors(fits_inside(about, points, fits, labels, every)))
    z = [np.array([error / deviation for error, deviation in pairs]) for pairs in (before, after)]
    assert abs(z[0].mean()) > 2  # or there is nothing to mend
    assert abs(z[1].mean()) < 2 * 2 / np.sqrt(len(z[1]))
    assert np.abs(z[1]).max() < 3.5


def test_faces_on_one_surface_keep_their_fits():
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(0, 1, (2_000, 2)), rng.normal(0, 1e-3, 2_000)])
    labels = np.where(points[:, 0] < 0.5, 1, 2)
    about = look_around(points, noise_m=1e-3)
    fits, labels = fit_labels(points, [Plane((0, 0, 0), (0, 0, 1))] * 2, labels, 1e-3)
    again = fits_inside(about, points, fits, labels, np.arange(len(points)))
    assert [fit is other for fit, other in zip(fits, again, strict=True)] == [True, True]
