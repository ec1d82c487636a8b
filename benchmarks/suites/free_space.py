# SPDX-License-Identifier: MIT
"""The law that nothing is inferred where a beam went through, on many random scenes.

Each scene is completed from all its scans and from the first alone; `benchmarks.metrics.free_space` measures
both again with the beams of all scans. The suite fails where a noise-free scene violates, or where a further
scan made a violation larger.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from benchmarks.cases.clutter import random_clutter
from benchmarks.metrics.free_space import Violation, violation_of
from benchmarks.run import suite
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


@suite("free-space", smallest="--scenes 2")
def free_space(scenes: int = 500, first: int = 0) -> Iterator[str]:
    """The law that nothing is inferred where a beam went through, on many random scenes.

    Raises AssertionError: it is broken.
    """
    checked = list[Checked]()
    for seed in range(first, first + scenes):
        checked.append(check(seed))
        if checked[-1].found.n_faces or checked[-1].grew:
            yield str(checked[-1])
    groups = {
        name: [one for one in checked if (one.noise == "none") == exact]
        for name, exact in (("noise-free", True), ("noisy", False))
    }
    for name, group in groups.items():
        bad = [one for one in group if one.found.n_faces]
        area, whole = sum(one.found.area_m2 for one in group), sum(one.inferred_m2 for one in group)
        yield (
            f"{name}: {len(bad)} of {len(group)} scenes violate, {area:.6f} of {whole:.1f} m2 "
            f"({1e6 * area / max(whole, 1e-9):.1f} ppm)"
        )
        if bad:
            yield f"worst: {max(bad, key=lambda one: one.found.area_m2)}"
    n_several, n_grown = sum(one.n_scans > 1 for one in checked), sum(one.grew for one in checked)
    yield f"more scans made the violation larger in {n_grown} of {n_several} scenes with several"
    if n_grown or any(one.found.n_faces for one in groups["noise-free"]):
        raise AssertionError("area was inferred where a beam went through")
