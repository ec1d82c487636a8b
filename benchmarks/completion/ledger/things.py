# SPDX-License-Identifier: MIT
"""`python -m benchmarks.completion.ledger.things`: what is continued of figures, chairs and plants.

Each thing stands in a bare room of its own and is seen by three frames; each frame is completed alone. What
is inferred of surfaces that were measured on the thing is counted: in holes that they enclose, around round
limbs and pots between the ends of what was measured, and beyond, which should be nothing.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
import typer

from benchmarks.completion.ledger.sources import DATA
from benchmarks.completion.scenes.cases import hypothesis_of
from benchmarks.completion.scenes.houses.things import KINDS, Thing, random_thing, thing_of_file
from benchmarks.completion.scores.continued import Continued, continued_area
from completion import CompletionOptions, complete

OAK_CHAIR = DATA / "scenes" / "furniture" / "blendswap-cc-0" / "oakChair" / "oakChair.obj"
_N_OAK = 4


def continued_of(thing: Thing, options: CompletionOptions) -> list[Continued]:
    """Complete each frame of a thing alone; return what was continued of it, a frame each."""
    found = []
    for scan in thing.frames:
        completed = complete([scan], options, rng=0)
        found.append(continued_area(completed, hypothesis_of(completed, [scan]), [scan], thing.is_thing))
    return found


def things(
    n: Annotated[int, typer.Option("--things", min=1, help="How many, of all kinds by turns.")] = 24,
    first: Annotated[int, typer.Option("--first", min=0, help="Seed of the first.")] = 0,
) -> None:
    """Print a line a thing, and the sums by kind."""
    options = CompletionOptions(texture=False, registration_m=0.005)
    made = [random_thing(seed) for seed in range(first, first + n)]
    if OAK_CHAIR.exists():
        made += [
            thing_of_file(seed, "oak chair", OAK_CHAIR, up="y", unit_m=0.01)
            for seed in range(first, first + _N_OAK)
        ]
    totals = {kind: np.zeros(5) for kind in (*KINDS, "oak chair")}
    for thing in made:
        for number, one in enumerate(continued_of(thing, options)):
            totals[thing.kind] += [1, one.n_surfaces, one.enclosed_m2, one.turned_m2, one.beyond_m2]
            print(
                f"{thing.kind} {thing.seed}, frame {number}: {one.n_surfaces} surfaces, "
                f"enclosed {one.enclosed_m2:.3f} m2, backs {one.turned_m2:.3f} m2, "
                f"beyond {one.beyond_m2:.3f} m2",
                flush=True,
            )
    print("\n| | frames | surfaces | in enclosed holes m2 | on backs m2 | beyond m2 |")
    print("|---|---|---|---|---|---|")
    for kind, (frames, surfaces, *areas) in totals.items():
        enclosed, turned, beyond = (f"{area:.3f}" for area in areas)
        print(f"| {kind} | {frames:.0f} | {surfaces:.0f} | {enclosed} | {turned} | {beyond} |")


if __name__ == "__main__":
    typer.run(things)
