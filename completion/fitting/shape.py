# SPDX-License-Identifier: MIT
"""Shapes: their names, and what a fit needs to know of each kind of surface.

Nothing slow is imported: the command line shows the names.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from completion.fitting.chart import Chart
    from scenes.checks import FloatArray
    from scenes.surfaces.catalogue import Surface

Shape = Literal["auto", "plane", "sphere", "cylinder", "elliptic-cylinder", "cone", "torus"]
Metric = Literal["euclidean", "taubin", "algebraic"]


@dataclass(frozen=True, slots=True, kw_only=True)
class KindGeometry:
    """Geometry of a kind of surface.

    Attributes
    ----------
    chart : callable
        The chart at a surface, relative to a centre (3,) in units of a scale.
    starts : callable
        Charts to polish from, of points (n, 3) near the unit ball and of so many axes.
    through : callable
        The surface through oriented points (k, 3), (k, 3); None where they are degenerate.
    parameters : callable
        The parameters of a surface by name, in the order that files use.
    jacobians : callable
        Derivatives of its natural parameters by those of its chart, each (3, k) or (1, k).
    radii : callable
        Its radii, metres; a fit with one within the noise is refused.
    """

    chart: Callable[[Any, FloatArray, float], Chart]
    starts: Callable[[FloatArray, int], list[Chart]]
    through: Callable[[FloatArray, FloatArray], Surface | None]
    parameters: Callable[[Any], dict[str, object]]
    jacobians: Callable[[Any], dict[str, FloatArray]]
    radii: Callable[[Any], tuple[float, ...]]


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
    is_quadric : bool
        Whether the closed forms of the other metrics can fit it.
    geometry : KindGeometry
        Its chart, starts, minimal sets and parameters.
    """

    title: str
    least_points: int
    n_parameters: int
    minimal: tuple[int, int]
    radius: int | None = None
    axis: tuple[int, ...] = ()
    is_quadric: bool = True
    geometry: KindGeometry
