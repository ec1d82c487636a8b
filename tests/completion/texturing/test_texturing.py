# SPDX-License-Identifier: MIT
"""Texturing of completed surfaces: texel size, samples, shadows, materials, a cylinder's seam, atlas."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from completion import Completion, CompletionOptions, TexturingOptions, complete
from completion.result.meshes import model_parts
from completion.texturing.chart_texture import make_atlas, spread_colour
from completion.texturing.material import MeasuredColour, cast_shadows, same_material
from completion.texturing.pipeline import choose_samples, choose_search, distance_to
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor
from scenes.checks import InputError
from scenes.io.meshes.glb_writer import glb_of
from scenes.io.scene_files import load_scene
from scenes.pose import Pose
from scenes.world.builtin import Finish, SceneBuilder, brick
from tests.helpers.long_cases import first_in_gate
from texture.quality import PATCH, list_patches

GLASS, SHADE, BOARD = (0.35, 0.50, 0.62), 0.45, (0.85, 0.80, 0.62)
SENSOR = PinholeSensor(fov_deg=60, width=300, height=240)
OPTIONS = CompletionOptions(texturing=TexturingOptions(window=11, max_samples=8000))


@cache
def wall(board_x: float) -> Completion:
    """A brick wall, partly in a shadow, with a pane of glass in its plane, and a board before it."""
    build = SceneBuilder("wall", "object")
    lit = brick()
    dark = Finish(tuple(SHADE * np.array(lit.tint)), lit.image, lit.size_m)
    patches = {"glass": ((0.5, 0.8, 1.3, 1.7), Finish(GLASS)), "shadow": ((1.9, 0.2, 2.8, 1.9), dark)}
    holes = [hole for hole, _ in patches.values()]
    build.add_panel("wall", (-1.5, 1.2, 0), (3, 0, 0), (0, 0, 2.2), lit, holes, are_openings=False)
    for name, ((left, low, right, high), finish) in patches.items():
        build.add_rectangle(name, (left - 1.5, 1.2, low), (right - left, 0, 0), (0, 0, high - low), finish)
    build.add_box("board", (board_x, 0.5, 0.3), (board_x + 0.45, 0.54, 1.6), Finish(BOARD))
    view = Pose.looking_at((0, -2.0, 1.2), (0, 1.2, 1.1))
    return complete(scan_scene(build.finish(), view, SENSOR, rng=0), OPTIONS, rng=0)


def synthesised(completion: Completion) -> NDArray[np.float64]:
    """Colours (n, 3), 0..1, of the wall's synthesised texels."""
    texture = completion.textures[0]
    assert texture is not None
    assert texture.n_synthesised > 3000
    return texture.image[texture.synthesised] / 255


def is_glass(colour: NDArray[np.float64]) -> NDArray[np.bool_]:
    return np.asarray(colour[:, 2] > colour[:, 0])  # bricks are red


@pytest.mark.parametrize("board_x", first_in_gate(1, [-0.25, -0.7]))
def test_no_glass_in_the_fill_of_a_wall_with_a_window(board_x):
    completion = wall(board_x)
    texture = completion.textures[0]
    assert is_glass(texture.image[texture.measured] / 255).mean() > 0.02  # the pane was measured all the same
    assert is_glass(synthesised(completion)).mean() < 0.002


def test_what_is_hidden_in_the_light_is_not_sampled_from_a_shadow():
    texture = wall(-0.25).textures[0]
    brightness = texture.image.mean(axis=2)
    columns = np.nonzero(texture.synthesised)[1]
    lit = texture.measured & ~is_glass(texture.image.reshape(-1, 3) / 255).reshape(texture.measured.shape)
    lit[:, columns.max() :] = False  # the shadow lies to the right
    made, seen = (brightness[texels] for texels in (texture.synthesised, lit))
    assert abs(made.mean() - seen.mean()) < 0.15 * seen.mean()
    assert np.quantile(made, 0.02) > 0.6 * np.quantile(seen, 0.02)


def test_what_is_hidden_in_a_shadow_stays_in_it():
    texture = wall(0.5).textures[0]
    brightness = texture.image.mean(axis=2)
    rows, columns = np.nonzero(texture.synthesised)
    low, high = np.quantile(rows, [0.3, 0.7]).astype(int)
    made = np.median(brightness[low:high, columns.min() : columns.max()])
    beside = np.median(brightness[low:high, columns.max() + 2 : columns.max() + 9])  # in the shadow
    assert beside < 0.5 * np.median(brightness[texture.measured])
    assert made == pytest.approx(beside, rel=0.35)


def test_measured_texels_have_the_surface_s_own_colour_up_to_the_rim():
    texture = wall(-0.25).textures[0]
    board = np.abs(texture.image / 255 - BOARD).max(axis=2) < 0.1
    assert not board.any()


def test_texels_are_as_large_as_the_pixels():
    build = SceneBuilder("wall", "object")
    build.add_rectangle("wall", (-3, 2, -2), (6, 0, 0), (0, 0, 4), brick())
    view = Pose.looking_at((0, 0, 0), (0, 2, 0))
    for width in (120, 240):
        scan = scan_scene(build.finish(), view, PinholeSensor(fov_deg=40, width=width, height=width), rng=0)
        texture = complete(scan, OPTIONS, rng=0).textures[0]
        pixel = 2 * scan.projection.pixel_angle
        assert texture.grid.cell == pytest.approx([pixel, pixel], rel=0.05)
        few = replace(OPTIONS, texturing=TexturingOptions(max_texels=1000))
        rows, columns = complete(scan, few, rng=0).textures[0].grid.shape
        assert 900 < rows * columns <= 1000


@cache
def pipe() -> Completion:
    """A brick pipe, seen from one side: the angle at which its chart closes is hidden."""
    build = SceneBuilder("pipe", "object")
    build.add_cylinder("pipe", (0, 0.4, 0), (0, 0, 2.0), 0.35, brick(2.0))
    view = Pose.looking_at((0.2, -2.4, 1.5), (0, 0.3, 0.9))
    scan = scan_scene(build.finish(), view, PinholeSensor(fov_deg=50, width=180, height=180), rng=0)
    return complete(scan, OPTIONS, rng=0)


def column_seams(image: NDArray[np.uint8], within: NDArray[np.bool_]) -> NDArray[np.float64]:
    """For each column how far patches across its left edge are from the nearest ones in the measured part."""
    pixels = image.astype(np.float64)
    width = within.shape[1]
    around = np.concatenate([pixels[:, -PATCH:], pixels, pixels[:, :PATCH]], axis=1)
    inside = np.concatenate([within[:, -PATCH:], within, within[:, :PATCH]], axis=1)
    known = list_patches(pixels, ~within)[::5]
    seams = np.full(width, np.nan)
    for column in range(width):
        at = np.zeros_like(inside)
        at[::PATCH, column + PATCH] = True
        patches = list_patches(around, inside, at=at)
        if len(patches) > 10:
            squares = (known**2).sum(axis=1) - 2 * patches @ known.T + (patches**2).sum(axis=1)[:, None]
            seams[column] = np.sqrt(np.maximum(squares.min(axis=1), 0) / known.shape[1]).mean()
    return seams


@pytest.mark.long
def test_no_seam_where_a_pipe_s_chart_closes():
    completion = pipe()
    (number,) = (k for k, patch in enumerate(completion.patches) if patch.grid.wraps)
    texture = completion.textures[number]
    assert texture.grid.wraps
    assert texture.synthesised[:, [0, -1]].mean() > 0.9
    seams = column_seams(texture.image, texture.synthesised)
    elsewhere = np.delete(seams, [*range(4), *range(len(seams) - 3, len(seams))])
    elsewhere = elsewhere[np.isfinite(elsewhere)]
    assert len(elsewhere) > 30
    most = elsewhere.mean() + 3 * elsewhere.std()
    assert seams[0] < most
    torn = texture.image.copy()
    torn[:, :40] = np.roll(torn[:, :40], 10, axis=0)
    assert column_seams(torn, texture.synthesised)[0] > most
    shifted = np.roll(texture.image, 9, axis=0)  # as if the two ends of the chart knew nothing of each other
    half = texture.image.shape[1] // 2
    torn = np.concatenate([texture.image[:, :half], shifted[:, half:]], axis=1)
    assert column_seams(torn, texture.synthesised)[0] > elsewhere.mean() + 3 * elsewhere.std()


def test_the_atlas_shows_each_texture_where_its_coordinates_say():
    completion = wall(-0.25)
    textures = [*completion.textures, None, *pipe().textures]
    atlas = make_atlas(textures)
    assert len(atlas.pages) == 1
    rng = np.random.default_rng(0)
    for number, texture in enumerate(textures):
        if texture is None:
            assert atlas.page[number] == -1
            assert not atlas.coordinates(number, np.ones((2, 2))).any()
            continue
        index = rng.integers(0, texture.grid.shape, (200, 2))
        uv = texture.grid.uv_of(*(index.T + 0.5))
        at = atlas.coordinates(number, uv)
        page = atlas.pages[atlas.page[number]]
        row, column = (1 - at[:, 1]) * page.shape[0], at[:, 0] * page.shape[1]
        np.testing.assert_allclose([row % 1, column % 1], 0.5, atol=1e-6)  # at texels' centres
        np.testing.assert_array_equal(page[row.astype(int), column.astype(int)], texture.image[*index.T])
        np.testing.assert_array_equal(texture.colour_at(uv), texture.image[*index.T])


def test_large_textures_go_to_several_pages(monkeypatch):
    monkeypatch.setattr("completion.texturing.chart_texture._PAGE_TEXELS", 45_000)
    textures = [texture for texture in (*wall(-0.25).textures, *pipe().textures) if texture is not None]
    atlas = make_atlas(textures)
    assert len(atlas.pages) == len(set(atlas.page.tolist())) > 1
    assert make_atlas([]).pages == ()


def test_the_model_holds_each_page_once():
    completion = wall(-0.25)
    glb = glb_of(model_parts(completion))
    assert glb.count(b"\x89PNG") == 1
    scene = trimesh.load_scene(trimesh.util.wrap_as_stream(glb), file_type="glb")
    names = {name.split()[0] for name in scene.geometry}
    assert names >= {"observed", "hypothesised"}


def test_the_saved_model_looks_like_the_scan_from_where_it_was_taken(tmp_path):
    completion = wall(-0.25)
    completion.save(tmp_path)
    (seen,) = (observation.scan for observation in completion.observations)
    model = load_scene(tmp_path / "completed.glb", up="y")
    again = scan_scene(model, completion.world_from_reference, SENSOR, rng=0)
    both = seen.valid & again.valid
    assert both.sum() > 0.95 * seen.valid.sum()
    difference = np.abs(again.colour - seen.colour).max(axis=2)[both]
    assert np.median(difference) < 0.02
    assert np.quantile(difference, 0.9) < 0.15  # mortar, half a texel away


def flat(shape: tuple[int, int], colour: tuple[int, int, int], seed: int = 0) -> NDArray[np.uint8]:
    noise = np.random.default_rng(seed).normal(0, 6, (*shape, 1))
    return np.clip(np.array(colour) + noise, 0, 255).astype(np.uint8)


def test_shadows_are_found_with_their_depth_and_another_colour_is_none():
    image = flat((120, 160), (180, 160, 140))
    own = np.ones(image.shape[:2], dtype=np.bool_)
    own[50:70, 40:60] = False
    shadowed = image.copy()
    shadowed[:, 100:] = shadowed[:, 100:] * 0.4
    gain = cast_shadows(shadowed, own, wraps=False)
    assert (gain[:, :96] == 1).all()
    np.testing.assert_allclose(gain[:, 104:], 0.4, rtol=0.05)
    door = image.copy()
    door[:, 100:] = flat((120, 60), (20, 40, 120))
    assert (cast_shadows(door, own, wraps=False) == 1).all()
    assert (cast_shadows(shadowed, np.zeros_like(own), wraps=False) == 1).all()  # too little to go by


def test_the_material_that_surrounds_the_hidden_part_is_sampled():
    image = flat((120, 160), (180, 160, 140))
    image[:, 80:] = flat((120, 80), (90, 130, 160))
    wanted = np.zeros(image.shape[:2], dtype=np.bool_)
    wanted[40:80, 30:65] = True
    found = same_material(image, ~wanted, distance_to(wanted, wraps=False), wraps=False)
    assert found[:, :78].mean() > 0.99
    assert found[:, 82:].mean() < 0.01
    other = np.roll(wanted, 70, axis=1)  # now among the other one
    found = same_material(image, ~other, distance_to(other, wraps=False), wraps=False)
    assert found[:, 82:].mean() > 0.99
    assert found[:, :78].mean() < 0.01


def test_samples_are_pure_fine_and_near():
    image = flat((100, 100), (150, 150, 150))
    wanted = np.zeros((100, 100), dtype=np.bool_)
    wanted[40:60, 40:60] = True
    image[36:40, 40:60] = (250, 20, 20)  # the occluder's colour at the rim
    fine = ~wanted
    fine[:, 80:] = False
    measured = MeasuredColour(image, ~wanted, ~wanted, fine)
    distance = distance_to(wanted, wraps=False)
    everything = np.ones_like(wanted)
    samples, context = choose_samples(measured, everything, distance, False, 10**6)
    assert not samples[36:40, 42:58].any()
    assert not context[36:40, 42:58].any()
    assert not samples[:, 80:].any()
    assert context[:, 85:].all()
    assert samples.sum() > 0.9 * (fine.sum() - 80)
    few, _ = choose_samples(measured, everything, distance, False, 600)
    assert 600 <= few.sum() <= 600 + 48**2  # whole blocks
    assert (samples | ~few).all()
    assert distance[few].min() == distance[samples].min()


def test_colour_spreads_by_two_texels_and_around_a_cylinder():
    image, known = np.zeros((9, 12, 3), np.uint8), np.zeros((9, 12), dtype=np.bool_)
    image[4, 0], known[4, 0] = 200, True
    plain, closed = (spread_colour(image, known, wraps) for wraps in (False, True))
    assert (plain[4, :3] == 200).all()
    assert (plain[4, -2:] != 200).all()
    assert (closed[4, [-2, -1, 0, 1, 2]] == 200).all()
    assert (closed[4, 3:-2] != 200).all()


@pytest.mark.long
def test_the_search_follows_from_how_much_is_hidden_and_a_budget_coarsens_nothing():
    completion = wall(-0.25)
    scans, n_hidden = [seen.scan for seen in completion.observations], completion.textures[0].n_synthesised
    few, many = TexturingOptions(exact_texels=n_hidden), TexturingOptions(exact_texels=n_hidden - 1)
    assert choose_search(few, completion.patches, completion.observations).search == "exact"
    assert choose_search(many, completion.patches, completion.observations).search == "budget"
    assert choose_search(replace(few, search="budget"), (), ()).search == "budget"
    quick = replace(OPTIONS, texturing=replace(many, window=5, max_comparisons=1))
    texture = complete(scans, quick, rng=0).textures[0]
    assert texture.search == "budget"
    assert texture.synthesised_m == pytest.approx(np.sqrt(texture.grid.cell_area))
    assert is_glass(synthesised(completion)).mean() < 0.1
    with pytest.raises(InputError, match="search must be auto, exact or budget"):
        TexturingOptions(search="quick")


def test_too_little_of_a_surface_is_still_textured():
    completion = wall(-0.25)
    for budget in (1, 20_000):
        few = replace(OPTIONS, texturing=TexturingOptions(window=5, max_comparisons=budget, min_samples=1))
        texture = complete([seen.scan for seen in completion.observations], few, rng=0).textures[0]
        assert texture.synthesised_m > 1.5 * np.sqrt(texture.grid.cell_area)
        assert is_glass(synthesised(completion)).mean() < 0.1
    nothing = np.zeros((20, 20), dtype=np.bool_)
    known = nothing.copy()
    known[3, 4] = True
    image = np.full((20, 20, 3), 90, np.uint8)
    samples, context = choose_samples(
        MeasuredColour(image, known, nothing, nothing), ~nothing, distance_to(~known, wraps=False), False, 100
    )
    assert (samples == known).all()
    assert (context == known).all()
