# SPDX-License-Identifier: MIT
"""The law that nothing is inferred where a beam went through, on many random scenes.

Run it with `python examples/check_free_space.py [COUNT] [FIRST_SEED]` (default: 500 scenes from seed 0, some
minutes). Each scene is completed from all its scans and from the first alone, and
`benchmarks.completion.cases.free_space` re-measures both with the beams of all scans. It prints the violating
scenes, the worst of them and totals, and exits with 1 where a noise-free scene violates, or where a scan more
made a violation larger.
"""

import sys
from dataclasses import dataclass

from benchmarks.cases.clutter import random_clutter
from benchmarks.metrics.free_space import Violation, violation_of
from completion import CompletionOptions, complete


@dataclass(frozen=True)
class Checked:
    """One scene: what the beams of all scans say of its completion from all of them, and from the first."""

    seed: int
    noise: str
    mode: str
    n_scans: int
    inferred_m2: float
    found: Violation
    found_alone: Violation

    @property
    def grew(self) -> bool:
        """Whether the scans after the first added violation."""
        return self.found.area_m2 > self.found_alone.area_m2

    def __str__(self) -> str:
        return (
            f"scene {self.seed} ({self.noise}, {self.mode}, {self.n_scans} scans): "
            f"{1e4 * self.found.area_m2:.2f} cm2 of {self.inferred_m2:.2f} m2 in free space, "
            f"{1e3 * self.found.deepest_m:.1f} mm beyond tolerance; "
            f"from the first scan alone {1e4 * self.found_alone.area_m2:.2f} cm2"
        )


def check(seed: int) -> Checked:
    """Complete the scene with this seed and re-measure it."""
    clutter = random_clutter(seed)
    options = CompletionOptions(mode=clutter.mode, texture=False)
    whole = complete(clutter.scans, options, rng=0)
    alone = complete(clutter.scans[:1], options, rng=0) if len(clutter.scans) > 1 else whole
    return Checked(
        seed,
        clutter.noise,
        clutter.mode,
        len(clutter.scans),
        whole.hypothesised_m2,
        violation_of(whole, clutter.scans, options, len(clutter.scans)),
        violation_of(alone, clutter.scans, options, 1),
    )


def main(count: int = 500, first: int = 0) -> int:
    """Check `count` scenes; return 1 where the law is broken."""
    checked = []
    for seed in range(first, first + count):
        checked.append(check(seed))
        if checked[-1].found.n_faces or checked[-1].grew:
            print(checked[-1], flush=True)
    grown = [scene for scene in checked if scene.grew]
    for name, scenes in (
        ("noise-free", [scene for scene in checked if scene.noise == "none"]),
        ("noisy", [scene for scene in checked if scene.noise != "none"]),
    ):
        bad = [scene for scene in scenes if scene.found.n_faces]
        area, whole = sum(s.found.area_m2 for s in scenes), sum(s.inferred_m2 for s in scenes)
        print(
            f"{name}: {len(bad)} of {len(scenes)} scenes violate, {area:.6f} of {whole:.1f} m2 "
            f"({1e6 * area / max(whole, 1e-9):.1f} ppm)"
        )
        if bad:
            print(f"worst: {max(bad, key=lambda scene: scene.found.area_m2)}")
    n_several = sum(scene.n_scans > 1 for scene in checked)
    print(f"more scans made the violation larger in {len(grown)} of {n_several} scenes with several")
    return int(bool(grown) or any(s.found.n_faces for s in checked if s.noise == "none"))


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:3])))
