# SPDX-License-Identifier: MIT
"""Generated rooms are reproducible and labelled rightly; baselines score as published."""

from functools import cache

import numpy as np
import pytest

from benchmarks.cases.rooms import BREAKS, Case, break_of, office_cases, random_case
from benchmarks.methods.baselines import BASELINES, baseline_hypothesis
from benchmarks.metrics.completion import score
from benchmarks.metrics.truth import Sight, TrueCells
from nbv.scanning.effects import NO_EFFECTS
from nbv.scanning.sensor import PinholeSensor, SphericalSensor, View
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Cylinder, Plane
from tests.helpers.evaluation_examples import plain_wall
from tests.helpers.long_cases import first_in_gate

SMALL = PinholeSensor(fov_deg=62.7, width=80, height=60)


def test_the_same_seed_gives_the_same_bytes() -> None:
    first, again, other = random_case(4), random_case(4), random_case(6)
    for name in ("vertices", "faces", "face_surface"):
        assert getattr(first.scene.mesh, name).tobytes() == getattr(again.scene.mesh, name).tobytes()
    for one, two in zip(first.views, again.views, strict=True):
        assert one.world_from_sensor.matrix.tobytes() == two.world_from_sensor.matrix.tobytes()
    assert first.scene.mesh.vertices.tobytes() != other.scene.mesh.vertices.tobytes()


def test_three_of_ten_rooms_break_the_prior_each_way_in_turn() -> None:
    for start in (0, 7, 40):
        assert sum(break_of(seed) is not None for seed in range(start, start + 10)) == 3
    kinds = [kind for seed in range(40) if (kind := break_of(seed))]
    assert [kinds.count(kind) for kind in BREAKS] == [3, 3, 3, 3]


@pytest.mark.parametrize("seed", range(10))
def test_faces_lie_on_their_true_surfaces_and_scanners_in_the_air(seed: int) -> None:
    case = random_case(seed)
    mesh = case.scene.mesh
    for index, surface in enumerate(case.scene.surfaces):
        corners = mesh.corners[mesh.face_surface == index]
        assert isinstance(surface, (Plane, Cylinder))
        assert np.abs(surface.distance(corners.reshape(-1, 3))).max() < 2e-12
    for opening in case.scene.openings:
        wall = case.scene.surfaces[opening.surface]
        assert wall is not None
        assert np.abs(wall.distance(opening.outline)).max() < 1e-9
    assert case.breaks_prior == (break_of(seed) is not None)
    caster = case.scene.ray_caster()
    for view in case.views:
        rays = np.random.default_rng(0).normal(size=(2000, 3))
        hits = caster.first_hit(view.world_from_sensor.translation[None], rays)
        facing = np.einsum("ij,ij->i", rays, mesh.face_normals()[hits.face])
        assert hits.hit.mean() > 0.999  # the room is closed, or its openings lead to `outside`
        assert (facing[hits.hit] < 0).mean() > 0.999  # and everything is seen from its front


@pytest.mark.parametrize("kind", first_in_gate(1, BREAKS))
def test_what_breaks_the_prior_is_hidden_and_not_where_it_seems(kind: str) -> None:
    case = random_case(0, breaks=kind)  # type: ignore[arg-type]
    (box,) = case.breaks
    small = Case(case.name, case.scene, (View(case.views[0].world_from_sensor, SMALL),), case.breaks)
    scans = small.scans(NO_EFFECTS, 0)
    assert scans[0].truth is not None
    seen = scans[0].points()[scans[0].valid]
    inner = (seen > box[0] + 0.05) & (seen < box[1] - 0.05)
    assert inner.all(axis=1).mean() < 0.002  # hardly a beam ends inside
    cells = small.cells(scans)
    hidden = sum(
        int((case.model.in_breaks(c.chart.grid.centres()) & (c.sight == Sight.HIDDEN).ravel()).sum())
        for c in cells
    )
    assert hidden > 100


def test_sensors_are_cameras_and_panoramas() -> None:
    sensors = [random_case(seed).views[0].sensor for seed in range(12)]
    assert {type(sensor) for sensor in sensors} == {PinholeSensor, SphericalSensor}


def test_baselines_of_a_wall_behind_a_board() -> None:
    wall = plain_wall()
    for baseline in BASELINES:
        found = baseline_hypothesis(baseline, wall.model, wall.cells, [wall.scan])
        tally = score(wall.model, wall.cells, [wall.scan], found).areas.pooled(surfaces=[0])
        assert tally.recall[1] > 0.99  # the shadow is inside every region
        if baseline.tests_rays:
            assert tally.claimed == pytest.approx(float(tally.hidden), rel=0.1)


@cache
def first_office() -> tuple[Case, tuple[RangeImage, ...], tuple[TrueCells, ...]]:
    (case,) = office_cases(1)
    scans = case.scans(NO_EFFECTS, 0)
    return case, scans, case.cells(scans)


@pytest.mark.long
@pytest.mark.parametrize(
    ("index", "recall", "precision"),
    [
        pytest.param(0, 0.747, 0.726, marks=pytest.mark.long),
        pytest.param(1, 0.747, 0.955, marks=pytest.mark.long),
        (2, 0.836, 0.934),
    ],
)
def test_baselines_score_as_published(index: int, recall: float, precision: float) -> None:
    """The published figures are those of ten frames; this is the first of them."""
    case, scans, cells = first_office()
    planes = [k for k, surface in enumerate(case.scene.surfaces) if isinstance(surface, Plane)]
    found = baseline_hypothesis(BASELINES[index], case.model, cells, scans)
    tally = score(case.model, cells, scans, found).areas.pooled([*planes, len(case.scene.surfaces)])
    assert tally.hidden == pytest.approx(6.65, abs=0.2)
    assert tally.recall[1] == pytest.approx(recall, abs=0.05)
    assert tally.precision[1] == pytest.approx(precision, abs=0.05)
