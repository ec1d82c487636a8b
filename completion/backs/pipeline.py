# SPDX-License-Identifier: MIT
"""Back sides: one thing in, its symmetries, the surface they imply, its closed shape, volume and depth out.

A symmetry is a virtual scan: where an isometry maps a thing into itself, each view of it is another view too,
whose surface is surface and whose free space is free space. What real beams passed is never asserted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from completion.backs.assertion import Asserted, assert_surface
from completion.backs.axes import find_axes, find_turns
from completion.backs.closing import ClosedShape, close
from completion.backs.intervals import Extents, VolumeInterval, extents_of, volume_interval
from completion.backs.limits import N_CARVED, N_ROUND, OFFERED
from completion.backs.mirrors import find_mirrors
from completion.backs.options import BackOptions
from completion.backs.probability import choose, elements_of, weigh
from completion.backs.symmetry import Symmetry, draw_sample
from completion.backs.views import Setting, ThingView, prepare_sight, scale_of
from scenes.checks import InputError, Value


@dataclass(frozen=True, slots=True, eq=False)
class Back(Value):
    """The unseen sides of a thing.

    Attributes
    ----------
    hypotheses : tuple of Symmetry
        All symmetries that were found, the most probable first, right or not.
    sure : tuple of Symmetry
        Those of at least `BackOptions.least` that agree with each other.
    asserted : Asserted
        Inferred surface: what these imply.
    chosen : tuple of Symmetry
        Those of probability 0.5 and more that shape the closed mesh.
    shape : ClosedShape
        The closed mesh; its faces of origin 3 to 6 are unknown surface, and those of 1 and 2 whose
        probability is below `least`.
    volume : VolumeInterval
    extents : Extents
    size_m : float
        Diagonal of the box of measured points, down to the support.
    """

    hypotheses: tuple[Symmetry, ...]
    sure: tuple[Symmetry, ...]
    asserted: Asserted
    chosen: tuple[Symmetry, ...]
    shape: ClosedShape
    volume: VolumeInterval
    extents: Extents
    size_m: float


def find_back(
    views: Sequence[ThingView],
    setting: Setting,
    options: BackOptions = BackOptions(),
    seed: int = 0,
) -> Back:
    """Infer the unseen sides of one thing from views of it.

    Parameters
    ----------
    views : sequence of ThingView
        In one frame whose z points up; more views replace inferred surface by measured one.
    setting : Setting
        What the thing stands on, the walls behind it, the range noise.
    options : BackOptions
        The least probability of what is asserted, and sizes of things.
    seed : int
        Of the points that are drawn; the same seed gives the same result.

    Raises
    ------
    InputError
        No views, or a thing larger or smaller than `options.size_m`.
    """
    if not views:
        raise InputError("no views of the thing")
    scale = scale_of(views, setting)
    low, high = options.size_m
    if not low <= scale.size <= high:
        raise InputError(f"the thing measures {scale.size:.3g} m, which is not within {low:g}..{high:g} m")
    rng = np.random.default_rng(seed)
    sights = [prepare_sight(view, scale) for view in views]
    sample = draw_sample(sights, scale, rng)
    mirrors = weigh(find_mirrors(sights, sample, setting, scale))
    axes = weigh(find_axes(sights, sample, setting, scale, rng=rng))
    turns = (
        []
        if any(one.probability >= OFFERED for one in axes)
        else weigh(find_turns(axes, mirrors, sights, sample, scale))
    )
    found = [*mirrors, *axes, *turns]
    hypotheses = sorted(found, key=lambda one: -one.probability)
    sure = choose(hypotheses, options.least)
    asserted = assert_surface(sights, elements_of(sure, N_ROUND), setting, scale, least=options.least)
    chosen = choose(hypotheses, OFFERED)
    shaping = elements_of(chosen, N_CARVED)
    offered = assert_surface(sights, shaping, setting, scale, least=0.0)
    shape = close(sights, shaping, offered.points, setting, scale=scale)
    volume = volume_interval(shape, chosen, views, sights, setting)
    extents = extents_of(sights, asserted.points, shape, chosen, setting=setting, scale=scale)
    return Back(
        hypotheses=tuple(hypotheses), sure=tuple(sure), asserted=asserted, chosen=tuple(chosen), shape=shape,
        volume=volume, extents=extents, size_m=scale.size,
    )  # fmt: skip
