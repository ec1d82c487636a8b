# SPDX-License-Identifier: MIT
"""The floor plan that goes with a plan of a building: a generated flat, its rooms, stations and tour.

Run it with `python examples/plot_floor_plan.py [--docs FOLDER] [--seed N] [--spacing M]`: it writes
FOLDER/pictures/floor_plan.png (default: docs) and prints what the rules of thumb take beside the plan.
"""

import argparse
from pathlib import Path

from benchmarks.cases.houses.house import random_house
from nbv import load_sensor, plan_views, sample_surface
from nbv.plan.rules import compare_with_rules
from nbv.report.blocks.room_tables import rule_sentences, storey_plans
from nbv.visibility.site_options import SiteOptions

ROOT = Path(__file__).resolve().parents[1]
SEED = 3
DPI = 90


def main(arguments: list[str] | None = None) -> None:
    """Plan a flat, and draw the floor plan of its storey."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--docs", type=Path, default=ROOT / "docs")
    parser.add_argument("--seed", type=int, default=SEED, help="of the flat")
    parser.add_argument("--spacing", type=float, help="of the samples, metres")
    asked = parser.parse_args(arguments)
    scene = random_house(asked.seed).scene
    plan = plan_views(
        scene,
        load_sensor("panorama"),
        method="cover",
        target=0.95,
        site=SiteOptions(heights_m=(1.6,)),
        samples=sample_surface(scene.mesh, asked.spacing),
        rng=0,
    )
    (sheet,) = storey_plans(scene, plan)
    folder = asked.docs / "pictures"
    folder.mkdir(parents=True, exist_ok=True)
    sheet.sheet().savefig(folder / "floor_plan.png", dpi=DPI, metadata={"Software": None})
    bound = plan.lower_bound.describe() if plan.lower_bound else "no bound"
    print(f"floor_plan.png: {len(plan.views)} stations; {bound}")
    for sentence in rule_sentences(plan, compare_with_rules(scene.ray_caster(), plan)):
        print(sentence)


if __name__ == "__main__":
    main()
