# SPDX-License-Identifier: MIT
"""Features on one page: from scans, points or a mesh to objects fitted whole, with what speaks for each."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from completion.merging.merged_surface import number_pixels
from completion.merging.pipeline import merge
from completion.observe.key_frames import find_key_frames
from completion.observe.observation import observe
from completion.observe.tolerance import EvidenceOptions
from completion.segmentation.pipeline import segment
from completion.segmentation.regions import SegmentationOptions
from completion.segmentation.relief import typical_relief
from completion.templates.openings.scene import find_openings
from completion.templates.template import Given, TemplateFit, best_first
from scenes.run.journal import NO_JOURNAL, Journal
from scenes.run.steps import Progress, Steps
from scenes.scan.range_image import RangeImage

OPENINGS = ("doorway", "window", "niche")


def find_features(
    scans: Sequence[RangeImage],
    kinds: Sequence[str],
    *,
    given: Given | None = None,
    sigma_m: float | None = None,
    n_threads: int | None = None,
    progress: Progress | None = None,
    journal: Journal = NO_JOURNAL,
) -> list[TemplateFit]:
    """Find features."""
    world_from_reference = scans[0].world_from_sensor
    with Steps.over([scan.ranges.size for scan in scans], n_threads, progress, journal) as steps:
        # 1. Observe: points, rays and noise of each scan, in the sensor frame of the first.
        observations = steps.each(
            "noise and normals",
            lambda scan: observe(scan, world_from_reference, sigma_m),
            scans,
            remember=False,
        )
        keys = find_key_frames(observations)

        # 2. Surfaces: planes and cylinders, joined across what stood before them.
        segmentation = SegmentationOptions()
        regions = steps.each("segment", lambda seen: segment(seen, segmentation), observations)
        tolerance = EvidenceOptions().tolerance(flatness_m=typical_relief(regions), registration_m=0.0)
        surfaces = steps.one(
            "merge", lambda: merge(observations, regions, tolerance, keys=keys, spill=steps.spill)
        )
        owners = [number_pixels(surfaces, number, one) for number, one in enumerate(observations)]

        # 3. Openings: in every upright plane, by the beams that go through it or stop.
        up = world_from_reference.matrix[2, :3]

        def each(work: Callable[[int], list[TemplateFit]], numbers: Iterable[int]) -> list[list[TemplateFit]]:
            return steps.each("openings", work, numbers)

        found = find_openings(surfaces, observations, owners, up, given=given, each=each)
    return best_first([fit for fit in found if fit.kind in kinds])
