# SPDX-License-Identifier: MIT
"""House: a furnished flat by its seed, with the frames and panoramas that are taken of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from shapely.geometry.base import BaseGeometry

from benchmarks.completion.scenes.houses.furnishing import build_in, furnish
from benchmarks.completion.scenes.houses.furniture.fittings import MIRROR
from benchmarks.completion.scenes.houses.furniture.parts import scene_of
from benchmarks.completion.scenes.houses.joinery import fit_way, fit_window, keep_clear
from benchmarks.completion.scenes.houses.openings import Opening, Shaft, random_openings, random_skylights
from benchmarks.completion.scenes.houses.placing import Layout
from benchmarks.completion.scenes.houses.plan import Plan, random_plan
from benchmarks.completion.scenes.houses.walls import shell
from scenes.checks import BoolArray
from scenes.rays.raycast import RayCaster
from scenes.world.scene import Scene


@dataclass(frozen=True, eq=False)
class House:
    """A furnished flat of one to four rooms.

    Attributes
    ----------
    seed : int
        The same seed gives the same bytes.
    plan : Plan
        Its walls and rooms.
    openings : tuple of Opening
        Doors, windows and niches.
    density : float
        Of its furniture: 0 bare, 1 crammed.
    scene : Scene
        Everything, each part with its name; metres, z up, the floor at 0.
    standing : tuple of polygons
        For each room where a person can stand.
    """

    seed: int
    plan: Plan
    openings: tuple[Opening, ...]
    density: float
    scene: Scene
    standing: tuple[BaseGeometry, ...]

    @cached_property
    def caster(self) -> RayCaster:
        """The flat, to cast rays at."""
        return self.scene.ray_caster()

    @cached_property
    def mirrors(self) -> BoolArray:
        """Which surfaces (n_surfaces,) are mirrors."""
        return np.array([MIRROR in name.split(": ")[-1] for name in self.scene.surface_names])


def random_house(seed: int) -> House:
    """Return the flat with this seed: the same seed gives the same bytes.

    Walls are skew, thin and thick; ceilings slope, with skylights; doors are ajar; there are niches, stairs,
    columns and casings, and furniture from bare to crammed. Walls go through behind what stands before them,
    and the floor under it: that is what a completion has to find. Panes are left out: a camera looks through
    them, out to where nothing is in its range.
    """
    rng = np.random.default_rng([20266, seed])
    plan = random_plan(rng)
    openings = random_openings(plan, rng)
    density = float(np.clip(rng.beta(1.3, 1.1), 0.03, 1.0))
    layouts = [Layout(plan, room, number) for number, room in enumerate(plan.rooms)]
    for number, opening in enumerate(openings):
        _fit(number, plan, opening, layouts, rng)
    shafts: list[Shaft] = list(random_skylights(plan, rng))
    for layout in layouts:
        well = build_in(layout, rng)
        shafts += [] if well is None else [well]
        furnish(layout, rng, float(np.clip(density * rng.uniform(0.7, 1.3), 0, 1)))
    parts = shell(plan, openings, shafts, rng) + [part for layout in layouts for part in layout.parts]
    return House(
        seed=seed,
        plan=plan,
        openings=openings,
        density=density,
        scene=scene_of(f"house {seed}", parts),
        standing=tuple(layout.standing_room() for layout in layouts),
    )


def _fit(
    number: int, plan: Plan, opening: Opening, layouts: Sequence[Layout], rng: np.random.Generator
) -> None:
    """Fit an opening with what belongs to it, and keep furniture out of its way."""
    wall = plan.walls[opening.wall]
    fronts = {}
    for layout in layouts:
        for side in layout.room.sides:
            if side.wall == opening.wall and side.start <= opening.span[0] and opening.span[1] <= side.end:
                fronts[side.sign] = layout
    if opening.kind in ("window", "glazed door"):
        fit_window(number, wall, opening, fronts[opening.sign], rng)
    elif opening.kind == "niche":
        keep_clear(wall, opening, fronts[opening.sign])
    else:
        fit_way(number, wall, opening, fronts, rng)


def parts_named(house: House, word: str) -> BoolArray:
    """Tell which faces (m,) belong to parts with `word` in their name."""
    named = np.array([word in name for name in house.scene.surface_names])
    return np.asarray(named[house.scene.mesh.face_surface], dtype=np.bool_)
