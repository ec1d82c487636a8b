# SPDX-License-Identifier: MIT
"""Scores of hand-made completions whose answers are known."""

import numpy as np
import pytest

from benchmarks.metrics.completion import Score, score
from benchmarks.metrics.inferred import (
    HEADLINE,
    TOLERANCES_M,
    Hypothesis,
    PairCounts,
    Reliability,
    Tally,
    continued_surfaces,
    deviation_bins,
    merge_counts,
    no_reliability,
    sample,
    summary,
)
from benchmarks.metrics.other_scans import score_by_others
from benchmarks.metrics.truth import Sight, Stratum, TrueModel, sight_of, strata_of
from nbv.scanning.scanner import scan_scene
from scenes.checks import InputError
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage
from scenes.surfaces.surface import Opening
from tests.helpers.evaluation_examples import CAMERA, WALL_Y, Wall, hypothesis, plain_wall, wall_with_window

SHADOW_M2 = 0.8 * 0.6
CELL = 0.01


def scored(wall: Wall, found: Hypothesis) -> Score:
    return score(wall.model, wall.cells, [wall.scan], found)


def whole(result: Score) -> Tally:
    return result.areas.pooled()


def nothing() -> Hypothesis:
    return hypothesis(np.zeros((0, 3)), np.zeros((0, 3)))


def test_the_shadow_of_the_board_is_what_is_hidden() -> None:
    wall = plain_wall()
    area = wall.wall.reachable.sum() * CELL**2
    # Cells whose centre is in the shadow: its sides to within half a cell each.
    assert area == pytest.approx(SHADOW_M2, abs=2 * (0.8 + 0.6) * CELL / 2)
    assert (wall.wall.reachable == wall.wall.hidden).all()
    strata = strata_of(wall.wall)
    assert set(np.unique(strata)) == {-1, Stratum.INTERIOR}


def test_a_perfect_completion_scores_one() -> None:
    result = scored(plain_wall(), plain_wall().rectangle())
    tally = whole(result)
    for figure in (tally.recall, tally.precision, tally.f1, tally.iou):
        assert figure.tolist() == [1.0, 1.0, 1.0]
    assert tally.claimed == pytest.approx(SHADOW_M2, rel=0.06)  # rims within a pixel count as seen
    assert result.claims.violation_m2 == 0
    assert result.claims.squared_m4 == pytest.approx(0, abs=1e-12)
    # Its outline is nowhere the wall's: the wall goes on all around.
    assert len(result.findings.contour_m) == 0
    only = result.areas.pooled(surfaces=[0], strata=[Stratum.INTERIOR])
    assert only.hidden == tally.hidden
    assert only.claimed == pytest.approx(float(tally.claimed))


def test_nothing_inferred_finds_nothing_and_claims_nothing() -> None:
    tally = whole(scored(plain_wall(), nothing()))
    assert tally.recall.tolist() == [0, 0, 0]
    assert np.isnan(tally.precision).all()
    assert tally.iou.tolist() == [0, 0, 0]


@pytest.mark.parametrize("side", [-1, 1])
def test_three_centimetres_off_fails_at_two_and_passes_at_five(side: int) -> None:
    tally = whole(scored(plain_wall(), plain_wall().rectangle(offset=0.03 * side)))
    assert tally.recall.tolist() == [0, 0, 1]
    assert tally.precision.tolist() == [0, 0, 1]
    assert tally.iou[:2].tolist() == [0, 0]
    assert tally.iou[2] == 1


def test_a_wrong_normal_fails_however_near() -> None:
    thin = {"low": (-0.4, -0.08), "high": (0.4, 0.08)}  # 16 cm high: at 12 degrees within 17 mm
    straight, tilted = (
        whole(scored(plain_wall(), plain_wall().rectangle(**thin, tilt=np.radians(angle))))  # type: ignore[arg-type]
        for angle in (8.0, 12.0)
    )
    assert straight.precision[HEADLINE] == 1
    assert straight.recall[HEADLINE] > 0.2
    assert tilted.precision.tolist() == [0, 0, 0]
    assert tilted.recall.tolist() == [0, 0, 0]


def test_half_a_completion_finds_half_and_is_right() -> None:
    tally = whole(scored(plain_wall(), plain_wall().rectangle(high=(0.0, 0.3))))
    for tolerance, recall in zip(TOLERANCES_M, tally.recall, strict=True):
        assert recall == pytest.approx((0.4 + tolerance) / 0.8, abs=2 * CELL / 0.8)
    assert tally.precision.tolist() == [1, 1, 1]


def test_area_before_the_wall_is_in_free_space_and_wrong() -> None:
    flying = plain_wall().rectangle(low=(0.5, 0.5), high=(0.9, 0.9), offset=0.3)
    result = scored(plain_wall(), flying)
    assert result.claims.violation_m2 == pytest.approx(0.16, rel=1e-6)
    assert whole(result).claimed == pytest.approx(0.16, rel=1e-6)
    assert whole(result).precision.tolist() == [0, 0, 0]


def test_area_on_what_is_seen_or_out_of_view_is_not_scored() -> None:
    for low, high, name in (((0.5, 0.5), (0.9, 0.9), "seen_m2"), ((5.0, 5.0), (5.4, 5.4), "out_m2")):
        result = scored(plain_wall(), plain_wall().rectangle(low=low, high=high))
        assert whole(result).claimed == 0
        assert getattr(result.claims, name) == pytest.approx(0.16, rel=1e-6)


def test_area_that_continues_what_is_not_scored_is_not_scored() -> None:
    wall = wall_with_window()
    outside = wall.scene.surface_names.index("outside")
    plane = wall.rectangle(offset=-1.0)
    found = hypothesis(plane.vertices, plane.faces, true_surface=outside)
    result = scored(wall, found)
    assert whole(result).claimed == 0
    assert result.claims.unscored_m2 == pytest.approx(SHADOW_M2, rel=1e-6)


def test_overlapping_layers_count_once() -> None:
    once = plain_wall().rectangle()
    faces = np.concatenate([once.faces, once.faces + 4])
    vertices = np.concatenate([once.vertices, once.vertices - [0, 0.002, 0]])
    twice = Hypothesis(
        vertices, faces, np.array([0, 0, 1, 1], np.int32), np.full(4, 0.01), np.full(4, 0.9),
        np.zeros(2, np.int32),
    )  # fmt: skip
    assert sample(twice, CELL).areas.sum() == pytest.approx(sample(once, CELL).areas.sum(), rel=1e-6)
    assert whole(scored(plain_wall(), twice)).claimed == pytest.approx(
        float(whole(scored(plain_wall(), once)).claimed), rel=0.02
    )


def test_samples_keep_the_area_and_lie_on_the_mesh() -> None:
    found = plain_wall().rectangle(tilt=0.3)
    samples = sample(found, CELL)
    assert samples.areas.sum() == pytest.approx(SHADOW_M2, rel=1e-9)
    normal = np.cross(*(found.vertices[[1, 3]] - found.vertices[0]))
    normal /= np.linalg.norm(normal)
    np.testing.assert_allclose((samples.points - found.vertices[0]) @ normal, 0, atol=1e-12)
    np.testing.assert_allclose(np.abs(samples.normals @ normal), 1, atol=1e-12)
    large = hypothesis(found.vertices * 30, found.faces)  # more pieces than one lattice holds
    assert sample(large, 0.05).areas.sum() == pytest.approx(900 * SHADOW_M2, rel=1e-9)


def test_window_cut_by_the_board_is_of_stratum_six_and_so_is_what_fills_it() -> None:
    wall = wall_with_window()
    strata = strata_of(wall.wall)
    assert set(np.unique(strata)) == {-1, Stratum.OPENING}
    result = scored(wall, wall.rectangle())  # the whole shadow, the hidden corner of the window with it
    opening = result.areas.pooled(surfaces=[0], strata=[Stratum.OPENING])
    window_m2 = 0.2 * 0.4
    assert opening.hidden == pytest.approx(SHADOW_M2 - window_m2, rel=0.03)
    assert opening.recall.tolist() == [1, 1, 1]
    overlap = [0.2 * 0.4 - (0.2 - t) * (0.4 - t) for t in TOLERANCES_M]  # of the window, near its rim
    wrong = opening.claimed - opening.right
    assert wrong.tolist() == pytest.approx([window_m2 - near for near in overlap], abs=0.006)


def test_outline_and_corner_of_a_window_are_measured() -> None:
    wall = wall_with_window()
    exact = scored(wall, wall.of_cells(wall.wall.reachable))
    assert exact.findings.contour_m.max() == 0
    assert exact.findings.band_in_both[Stratum.OPENING] == exact.findings.band_in_either[Stratum.OPENING]
    assert exact.findings.corner_m.tolist() == pytest.approx([0], abs=CELL)  # the corner (0.2, -0.1)
    filled = scored(wall, wall.rectangle())
    assert filled.findings.contour_m.mean() > 0.05
    assert filled.findings.band_in_both[6] < 0.5 * filled.findings.band_in_either[6]
    assert filled.findings.corner_m.min() > 0.09


def test_an_outline_that_passes_a_corner_without_turning_misses_it() -> None:
    wall = wall_with_window()  # its hidden corner is (0.2, -0.1), one side goes up, one to the right
    uv = wall.wall.chart.grid.centres()[..., [0, 2]].reshape(*wall.wall.reachable.shape, 2)
    left, below = (uv[..., 0] < 0.2), (uv[..., 1] < -0.1)
    for filled, error in ((left | below, 0.0), (left, 0.03), (below, 0.03), (left & below, 0.03)):
        result = scored(wall, wall.of_cells(filled & (wall.wall.sight == Sight.HIDDEN)))
        assert result.findings.corner_m.tolist() == pytest.approx([error], abs=CELL)


def test_openings_are_matched_by_overlap() -> None:
    wall = wall_with_window()
    true = wall.scene.openings[0].outline
    base = wall.rectangle()

    def with_openings(*outlines: np.ndarray) -> Hypothesis:
        openings = tuple(Opening(0, outline) for outline in outlines)
        return Hypothesis(
            base.vertices, base.faces, base.surface, base.sd, base.confidence, base.true_surface, openings
        )

    exact = scored(wall, with_openings(true)).openings
    assert exact.counts == PairCounts(right=1)
    assert exact.edge_m.max() < 1e-9
    # Of the window's 2.4 m of edges the board hides 0.2 m below and 0.4 m on the left.
    assert len(exact.hidden_edge_m) / len(exact.edge_m) == pytest.approx(0.6 / 2.4, abs=0.03)
    moved = scored(wall, with_openings(true + [0.05, 0, 0], true + [1.5, 0, 0])).openings
    assert moved.counts == PairCounts(right=1, wrong=1)
    assert moved.edge_m.max() == pytest.approx(0.05, abs=1e-6)
    assert moved.hidden_edge_m.mean() == pytest.approx((0.4 * 0.05 + 0.05**2 / 2) / 0.6, rel=0.1)
    assert scored(wall, base).openings.counts == PairCounts(missed=1)
    half = true.copy()
    half[:, 0] = np.where(half[:, 0] < 0.5, half[:, 0], 0.45)  # less than half of it
    assert scored(wall, with_openings(half)).openings.counts == PairCounts(wrong=1, missed=1)
    aside = Wall((0.9, -0.1, 1.5, 0.5))  # half out of view: neither asked for nor wrong
    found = Hypothesis(
        base.vertices, base.faces, base.surface, base.sd, base.confidence, base.true_surface,
        (Opening(0, aside.scene.openings[0].outline * [0.8, 1, 1]),),
    )  # fmt: skip
    assert scored(aside, found).openings.counts == PairCounts()
    assert scored(aside, aside.rectangle()).openings.counts == PairCounts()


def test_deviations_are_compared_with_all_errors() -> None:
    for offset, sd, within, own in ((0.004, 0.003, 1, 1), (0.008, 0.003, 0, 0), (0.008, 0.0041, 1, 1)):
        (errors,) = scored(plain_wall(), plain_wall().rectangle(offset=offset, sd=sd)).claims.surfaces
        assert (errors.within, errors.within_own) == pytest.approx((within, own))
        assert errors.sd_m == pytest.approx(sd)
    wall = wall_with_window()
    (errors,) = scored(wall, wall.rectangle(sd=0.001)).claims.surfaces
    assert errors.within < 0.9  # the part in the window is nowhere near
    assert errors.within_own == pytest.approx(1)
    bins = deviation_bins([errors] * 9)
    assert [row.n_surfaces for row in bins] == [2, 2, 2, 3]
    assert summary([]).n_surfaces == 0


def test_confidence_of_known_calibration() -> None:
    rng = np.random.default_rng(0)
    n = 40_000
    told = rng.choice([0.15, 0.55, 0.95], n)
    honest = Reliability.of(told, rng.random(n) < told, np.ones(n))
    assert honest.error < 4 * 0.5 / np.sqrt(n / 3)
    assert honest.brier == pytest.approx(np.mean(told * (1 - told)), abs=0.01)
    boasting = Reliability.of(np.full(n, 0.95), rng.random(n) < 0.55, np.ones(n))
    assert boasting.error == pytest.approx(0.40, abs=4 * 0.5 / np.sqrt(n))
    assert boasting.brier == pytest.approx(0.4**2 + 0.55 * 0.45, abs=0.01)
    both = honest + boasting + no_reliability()
    assert both.area.sum() == 2 * n
    assert np.isnan(no_reliability().brier)
    assert np.isnan(no_reliability().error)


def test_confidence_of_a_half_right_completion() -> None:
    wall = wall_with_window()
    result = scored(wall, wall.rectangle(confidence=0.9))
    tally = whole(result)
    right = float(tally.right[HEADLINE] / tally.claimed)
    assert result.claims.reliability.error == pytest.approx(abs(0.9 - right), abs=1e-9)
    expected = right * 0.1**2 + (1 - right) * 0.9**2
    assert result.claims.reliability.brier == pytest.approx(expected, abs=1e-9)


def test_places_where_the_prior_breaks_are_tallied_apart() -> None:
    wall = plain_wall()
    boxes = np.array([[[-0.4, 1.9, -0.3], [0.0, 2.1, 0.3]]])
    model = TrueModel(wall.model.mesh, wall.model.surfaces, wall.model.scored, breaks=boxes)
    result = score(model, wall.cells, [wall.scan], wall.rectangle(confidence=0.7))
    assert result.in_breaks.hidden == pytest.approx(float(whole(result).hidden) / 2, rel=0.03)
    assert result.in_breaks.claimed == pytest.approx(float(whole(result).claimed) / 2, rel=0.03)
    assert result.in_breaks.iou.tolist() == pytest.approx([1, 1, 1])
    assert result.claims.in_breaks_reliability.error == pytest.approx(0.3)


def test_sight_needs_a_beam_to_call_a_place_free() -> None:
    wall = plain_wall()
    caster = wall.scene.ray_caster()
    points = np.array([[0.0, 1.5, 0.0], [0.5, 1.0, 0.0], [0.7, WALL_Y, 0.0], [0.7, 2.5, 0], [0, -1, 0]])
    seen = sight_of(points, [wall.scan], caster, 0.02, np.tile([0.0, -1.0, 0.0], (5, 1)))
    assert seen.sight.tolist() == [Sight.HIDDEN, Sight.FREE, Sight.VISIBLE, Sight.HIDDEN, Sight.OUT]
    surface = wall.scene.mesh.face_surface[seen.blocker[[0, 3]]]
    assert [wall.scene.surface_names[k] for k in surface] == ["board", "wall"]
    beside = np.array([[0.2003, 1.0, 0.0]])  # a third of a millimetre beside the board: no pixel looks there
    assert sight_of(beside, [wall.scan], caster, 0.001, np.array([[0.0, -1, 0]])).sight[0] == Sight.HIDDEN


def test_parts_joined_rightly_wrongly_and_not() -> None:
    wall = plain_wall()
    assert wall.scan.truth is not None
    true = wall.scan.truth.surface
    scan = RangeImage(
        wall.scan.ranges, wall.scan.projection, wall.scan.world_from_sensor, truth=wall.scan.truth
    )
    halves = np.where(np.arange(true.shape[1]) < 120, 1, 2) * np.ones(true.shape, np.int32)
    whole_wall = np.where(true == 0, 1, 2).astype(np.int32)
    # Two scans: the wall is one part in each, so is the board.
    scans, flags = [scan, scan], [True, True]
    assert merge_counts(scans, [whole_wall, whole_wall], flags) == PairCounts(right=2)
    assert merge_counts(scans, [whole_wall, whole_wall + 2], flags) == PairCounts(missed=2)
    joined = np.ones_like(whole_wall)
    assert merge_counts(scans, [joined, joined], flags) == PairCounts(right=2, wrong=4)
    assert merge_counts(scans, [joined, joined], [True, False]) == PairCounts(right=1)
    assert continued_surfaces([whole_wall], [scan], 3).tolist() == [0, 1, -1]
    assert continued_surfaces([halves.astype(np.int32)], [scan], 2).tolist() == [0, 0]
    assert PairCounts(3, 1, 2).f1 == pytest.approx(2 * 0.75 * 0.6 / 1.35)
    assert np.isnan(PairCounts().f1)


def test_arrays_that_do_not_fit_are_refused() -> None:
    wall = plain_wall()
    with pytest.raises(InputError, match="2 surfaces but 1 flags"):
        TrueModel(wall.model.mesh, wall.model.surfaces, (True,))
    good = wall.rectangle()
    with pytest.raises(InputError, match=r"expected sd with shape \(2,\), got \(3,\)"):
        Hypothesis(good.vertices, good.faces, good.surface, np.zeros(3), good.confidence, good.true_surface)
    with pytest.raises(InputError, match=r"faces name surfaces 4..4 of 1"):
        Hypothesis(good.vertices, good.faces, good.surface + 4, good.sd, good.confidence, good.true_surface)
    bare = RangeImage(wall.scan.ranges, wall.scan.projection, wall.scan.world_from_sensor, name="bare")
    with pytest.raises(InputError, match="scan 'bare' has no truth channels"):
        score(wall.model, wall.cells, [bare], good)


def test_another_scan_knows_what_one_could_not_see() -> None:
    wall = plain_wall()
    other = scan_scene(wall.scene, Pose.looking_at((1.2, 0, 0), (0, 2, 0)), CAMERA)
    # Counted: the shadow less 10 cm all around; all of it where it is 10 cm off the frame's own returns.
    cases = ((0.0, 1, 1, 0, 0.6 * 0.4), (0.1, 0, 0, 0, SHADOW_M2), (-0.1, np.nan, 0, 1, SHADOW_M2))
    for offset, precision, recall, unknown, area in cases:
        samples = sample(wall.rectangle(offset=offset), CELL)
        result = score_by_others([wall.scan], [other], samples)
        assert result.precision == pytest.approx(precision, abs=1e-9, nan_ok=True)
        assert result.recall == pytest.approx(recall, abs=1e-9)
        assert result.unknown_share == pytest.approx(unknown, abs=1e-9)
        counted = result.right_m2 + result.wrong_m2 + result.unknown_m2
        assert counted == pytest.approx(area, rel=0.15)
        # The wall lies where voxels meet: some places fall into two of them.
        assert 0.9 <= len(result.reference) / (0.6 * 0.4 / 0.02**2) <= 2
        for buffer in result.buffers:
            is_right = buffer.buffer_m > abs(offset)
            assert buffer.completeness == pytest.approx(float(is_right), abs=0.02)
            if is_right:
                assert buffer.correctness == 1
                assert buffer.accuracy_m == pytest.approx(abs(offset), abs=1e-6)
    blind = score_by_others([wall.scan], [wall.scan], sample(wall.rectangle(), CELL))
    assert all(np.isnan([b.completeness, b.correctness, b.accuracy_m]).all() for b in blind.buffers)
    assert len(blind.reference) == 0
    assert np.isnan(blind.recall)
    assert blind.unknown_share == 1
