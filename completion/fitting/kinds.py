# SPDX-License-Identifier: MIT
"""Kinds of surfaces that can be fitted: how many points and parameters each takes, and what can be given."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """What fits need to know of a kind of surface.

    Attributes
    ----------
    title : str
        The kind with its article, for messages.
    least_points : int
        Points that determine one, with a covariance where there is one.
    n_parameters : int
        Parameters of its chart.
    minimal : (int, int)
        Oriented points in a minimal set, and how many sets are drawn for a consensus.
    radius : int, optional
        Place of the radius that can be given among the parameters.
    axis : tuple of int
        Places of the tilts of the axis, or normal, that can be given.
    """

    title: str
    least_points: int
    n_parameters: int
    minimal: tuple[int, int]
    radius: int | None = None
    axis: tuple[int, ...] = ()


KINDS: Mapping[str, Kind] = {
    "plane": Kind(title="a plane", least_points=3, n_parameters=3, minimal=(1, 200), axis=(1, 2)),
    "sphere": Kind(title="a sphere", least_points=4, n_parameters=4, minimal=(2, 400), radius=3),
    "cylinder": Kind(
        title="a cylinder", least_points=6, n_parameters=5, minimal=(2, 600), radius=4, axis=(2, 3)
    ),
    "cone": Kind(title="a cone", least_points=6, n_parameters=6, minimal=(3, 1500), axis=(2, 3)),
    "elliptic-cylinder": Kind(
        title="an elliptic cylinder", least_points=7, n_parameters=7, minimal=(7, 1500), axis=(2, 3)
    ),
    "torus": Kind(title="a torus", least_points=7, n_parameters=7, minimal=(4, 1500), radius=5, axis=(2, 3)),
}
"""By name, in the order in which a fit of unknown shape tries them."""
