# SPDX-License-Identifier: MIT
"""Wide instances of the offline planner: cameras in a room, many poses and many samples, stage by stage.

Run it with `python -m benchmarks.wide [--samples N] [--target T] [--polish-steps N]`: the room with two
occluders, about 16,000 poses of a camera of 60 deg. Printed are CPU seconds of each stage, the views, the
certified bound, and the largest memory of the process.
"""

import argparse
import resource
import time

import numpy as np

from nbv.cover.instance import CoverInstance
from nbv.cover.pipeline import CoverOptions, find_cover
from nbv.scanning.sensors.sensor_profile import load_sensor
from nbv.visibility.requirement import Requirement
from nbv.visibility.samples import sample_surface
from nbv.visibility.standing.site import find_site
from nbv.visibility.standing.site_options import SiteOptions
from nbv.visibility.visibility import orient, visible_from_positions
from scenes.world.builtin import builtin_scene

_SPACING_M = 0.475  # between places: about 16,000 poses


def wide_instance(n_samples: int, target: float) -> CoverInstance:
    """Return which pose meets 60 deg of incidence on which of about so many samples."""
    scene, sensor = builtin_scene("two_occluders"), load_sensor("generic60")
    candidates = find_site(scene, SiteOptions(spacing_m=_SPACING_M)).candidates(sensor)
    samples = sample_surface(scene.mesh, float(np.sqrt(scene.mesh.face_areas().sum() / n_samples)))
    seen = visible_from_positions(
        scene.ray_caster(), candidates.positions, samples, Requirement().limits(sensor)
    )
    seen.data = np.ones(seen.nnz, np.int8)
    matrix = orient(seen, candidates.positions, candidates.rotations(), samples.points, sensor)
    return CoverInstance(matrix, samples.areas, target)


def main(arguments: list[str] | None = None) -> None:
    """Print the costs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=34_000)
    parser.add_argument("--target", type=float, default=0.99)
    parser.add_argument("--polish-steps", type=int, default=CoverOptions().polish_steps)
    asked = parser.parse_args(arguments)
    begin = time.process_time()
    instance = wide_instance(asked.samples, asked.target)
    m, n = instance.matrix.shape
    print(f"{m} poses, {n} samples, {instance.matrix.nnz:,} entries: {time.process_time() - begin:.1f} s")
    stages: dict[str, float] = {}
    last = ["reduction", time.process_time()]

    def note(stage: str, _done: int, _total: int) -> None:
        now = time.process_time()
        stages[last[0]] = stages.get(last[0], 0.0) + now - last[1]
        last[:] = stage, now

    cover = find_cover(instance, CoverOptions(polish_steps=asked.polish_steps), rng=0, progress=note)
    note("", 0, 0)
    spent = ", ".join(f"{stage} {seconds:.1f} s" for stage, seconds in stages.items())
    print(f"{len(cover.chosen)} views, at least {cover.bound.views}, {cover.steps} swaps: {spent}")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{time.process_time() - begin:.0f} CPU s in all, {peak:.0f} MB at most")


if __name__ == "__main__":
    main()
