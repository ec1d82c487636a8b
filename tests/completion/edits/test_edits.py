# SPDX-License-Identifier: MIT
"""A person's say: laws of every edit, files of edits, and what they refuse."""

import json
from dataclasses import replace

import numpy as np
import pytest
from shapely import Polygon, contains_xy

from completion import Anchor, Completion, Edit, Label, Provenance, complete, read_edits
from completion.edits.file import edit_record
from completion.observe.refitting import refit
from completion.result.labelled_points import mesh_area
from nbv.report.completion_report import edit_sections
from scenes.checks import InputError
from scenes.io.meshes.ply import read_mesh_ply
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Cylinder, Plane, surfaces_close
from tests.helpers.completion_examples import PLAIN, completed, example

CONSERVATIVE = replace(PLAIN, mode="conservative")
FLOOR, TALL_BOX_SIDE = (3.14, 0.95, 0.0), (4.0, 3.16, 1.5)


def edited(scan, *edits, **options) -> Completion:
    return complete(scan, replace(PLAIN, edits=edits, **options))


def surface_at(found: Completion, point) -> int:
    """Index of the surface that was measured nearest to a point."""
    here = found.world_from_reference.inverse().apply(np.asarray(point, float))
    away = [np.linalg.norm(p.source.points(found.observations) - here, axis=1).min() for p in found.patches]
    return int(np.argmin(away))


def patch_at(found: Completion, point):
    return found.patches[surface_at(found, point)]


def vertices_of(found: Completion, number: int):
    """Inferred vertices of a surface, world coordinates."""
    mesh = found.hypothesised
    return found.world_from_reference.apply(mesh.vertices[mesh.surface == number + 1])


def pane(*corners):
    """World points on the wall z = 3 m before the camera at the origin."""
    return np.array([[x, y, 3.0] for x, y in corners])


@pytest.fixture(scope="module")
def room() -> Completion:
    return completed("two_occluders", pixels=120)


@pytest.fixture(scope="module")
def wall_scan() -> RangeImage:
    """A wall behind a board, with a window to the left of it; x right, y down, z forward."""
    camera = PinholeProjection.from_fov(160, 120, 60)
    depth = np.full(camera.shape, 3.0)
    depth[20:60, 20:50] = 5.0
    depth[30:90, 80:110] = 2.0
    return RangeImage(depth / camera.directions()[..., 2], camera, Pose.identity(), sigma_m=0.0)


@pytest.fixture(scope="module")
def wall(wall_scan) -> Completion:
    return complete(wall_scan, PLAIN)


BEHIND_BOARD = pane((0.15, -0.3), (0.55, -0.3), (0.55, 0.3), (0.15, 0.3))
MEASURED = (0.0, 0.9, 3.0)


def test_without_edits_the_bytes_are_the_same(wall, wall_scan, tmp_path):
    wall.save(tmp_path / "plain")
    again = edited(wall_scan, *read_edits(tmp_path / "plain" / "completion.json"))
    again.save(tmp_path / "again")
    for name in ("completed.glb", "observed.ply", "hypothesised.ply", "completion.json"):
        assert (tmp_path / "plain" / name).read_bytes() == (tmp_path / "again" / name).read_bytes(), name


def test_a_rejected_surface_is_kept_as_measured_and_the_others_as_they_were(room):
    found = edited(example("two_occluders", pixels=120), Edit(action="reject", surfaces=(FLOOR,)))
    for before, after in zip(room.patches, found.patches, strict=True):
        np.testing.assert_array_equal(before.observed, after.observed)
        if "reject" in after.verdict.actions:
            assert before.hypothesised_m2 > 1
            assert not after.hypothesised.any()
        else:
            np.testing.assert_array_equal(before.hypothesised, after.hypothesised)


def test_only_the_outlined_part_is_rejected(wall, wall_scan):
    half = pane((0.33, -1), (2, -1), (2, 1), (0.33, 1))
    found = edited(wall_scan, Edit(action="reject", surfaces=(MEASURED,), outline=half))
    left = vertices_of(found, 0)
    cell = float(found.patches[0].grid.cell.max())
    assert left[:, 0].max() <= 0.33 + cell
    assert found.hypothesised_m2 == pytest.approx(wall.hypothesised_m2 / 2, rel=0.05)


def test_accepted_area_is_filled_whatever_its_confidence_and_never_where_beams_went():
    scan = example("two_occluders", pixels=120)
    nothing = np.add(TALL_BOX_SIDE, [(0, 0, 0), (0, 0.001, 0), (0, 0, 0.001)])  # on measured area
    same_chart = Edit(action="reject", surfaces=(TALL_BOX_SIDE,), outline=nothing)
    shy = edited(scan, same_chart, mode="conservative")
    found = edited(scan, Edit(action="accept", surfaces=(TALL_BOX_SIDE,)), mode="conservative")
    before, after = patch_at(shy, TALL_BOX_SIDE), patch_at(found, TALL_BOX_SIDE)
    assert after.hypothesised_m2 > before.hypothesised_m2 + 0.1
    assert (after.hypothesised >= before.hypothesised).all()
    assert not (after.hypothesised & ((after.evidence.labels == Label.FREE) | after.evidence.through)).any()
    assert found.free_space_violation_m2 == 0
    added = after.hypothesised & ~before.hypothesised
    assert (after.provenance[added] == Provenance.USER).mean() > 0.95
    (effect,) = (one.effect for one in found.surfaces if one.patch is after)
    assert effect.filled_m2 == pytest.approx(added.sum() * after.grid.cell_area, rel=0.05)
    low, high = after.limits.known_window()
    uv = after.grid.centres_uv()[added]
    assert ((uv >= low - after.grid.cell) & (uv <= high + after.grid.cell)).all()


@pytest.mark.parametrize("mode", ["conservative", "bold"])
def test_accepting_everything_never_fills_free_space(mode):
    scan = example("two_occluders", pixels=120)
    base = completed("two_occluders", pixels=120)
    edits = [
        Edit(action="accept", surfaces=(base.anchor(number),)) for number in range(1, len(base.patches) + 1)
    ]
    found = edited(scan, *edits, mode=mode)
    assert found.hypothesised_m2 > base.hypothesised_m2
    assert found.free_space_violation_m2 == 0


def test_what_beams_went_through_is_told_when_it_was_accepted(wall_scan):
    window = pane((-1.2, -0.8), (-0.7, -0.8), (-0.7, -0.1), (-1.2, -0.1))
    found = edited(wall_scan, Edit(action="accept", surfaces=(MEASURED,), outline=window))
    effect = found.surfaces[0].effect
    assert effect.filled_m2 == 0
    assert effect.vetoed_m2 == pytest.approx(0.35, rel=0.05)
    (section,) = edit_sections(found)
    texts = [cell.text for cell in section.blocks[0].rows[0]]
    assert texts[:3] == ["1", "accept", "0"]
    assert texts[3] == f"{effect.vetoed_m2:.3f}"


def test_without_edits_the_report_has_no_section_on_them(wall):
    assert edit_sections(wall) == ()


def test_later_words_prevail(wall, wall_scan):
    reject, accept = (Edit(action=word, surfaces=(MEASURED,)) for word in ("reject", "accept"))
    piece = Edit(action="accept", surfaces=(MEASURED,), outline=BEHIND_BOARD)
    assert edited(wall_scan, accept, reject).hypothesised_m2 == 0
    assert edited(wall_scan, reject, accept).hypothesised_m2 == pytest.approx(wall.hypothesised_m2)
    alone = edited(wall_scan, reject, piece)
    area = np.ptp(BEHIND_BOARD[:, 0]) * np.ptp(BEHIND_BOARD[:, 1])
    assert alone.hypothesised_m2 == pytest.approx(area, rel=0.05)


def test_a_split_surface_is_two_that_end_at_the_cut_and_merging_them_gives_the_whole_back(wall, wall_scan):
    line = pane((0.33, -1.0), (0.33, 1.0))
    split = Edit(action="split", surfaces=(MEASURED,), cut=line)
    found = edited(wall_scan, split)
    whole = wall.patches[surface_at(wall, MEASURED)]
    left, right = (surface_at(found, (x, 0.9, 3.0)) for x in (0.0, 1.0))
    parts = [found.patches[number].source for number in (left, right)]
    assert not (parts[0].pixels[0].mask & parts[1].pixels[0].mask).any()
    both = parts[0].pixels[0].mask | parts[1].pixels[0].mask
    np.testing.assert_array_equal(both, whole.source.pixels[0].mask)
    assert vertices_of(found, left)[:, 0].max() == pytest.approx(0.33, abs=1e-9)
    assert vertices_of(found, right)[:, 0].min() == pytest.approx(0.33, abs=1e-9)
    rim_cells = 3.9 / float(whole.grid.cell.max())  # around the board's shadow
    assert found.hypothesised_m2 == pytest.approx(
        wall.hypothesised_m2, abs=rim_cells * whole.grid.cell_area / 2
    )

    merge = Edit(action="merge", surfaces=((0.0, 0.9, 3.0), (1.0, 0.9, 3.0)))
    again = patch_at(edited(wall_scan, split, merge), MEASURED)
    np.testing.assert_array_equal(again.source.pixels[0].mask, whole.source.pixels[0].mask)
    assert again.verdict.ends == ()
    assert again.hypothesised_m2 == pytest.approx(whole.hypothesised_m2, rel=1e-3)
    assert set(np.unique(again.provenance)) <= {-1, Provenance.MEASURED, Provenance.INTERIOR, Provenance.USER}


def test_merged_surfaces_are_one_fit_to_both_masks(room):
    scan = example("two_occluders", pixels=120)
    one, other = room.patches[4], room.patches[8]
    merging = Edit(action="merge", surfaces=(room.anchor(5), room.anchor(9)))  # parallel, apart
    found = edited(scan, merging, relations=None)
    assert len(found.patches) == len(room.patches) - 1
    (joined,) = (patch for patch in found.patches if patch.verdict.is_joined)
    mask = one.source.pixels[0].mask | other.source.pixels[0].mask
    np.testing.assert_array_equal(joined.source.pixels[0].mask, mask)
    start = max(one.source, other.source, key=lambda source: source.n_pixels).fit.surface
    (oracle,) = refit([start], room.observations, [mask.astype(np.int32)], 0.001, n_rounds=2)
    assert surfaces_close(joined.source.fit.surface, oracle.surface, angle=1e-9, length=1e-9)
    assert joined.source.n_parts == one.source.n_parts + other.source.n_parts


def test_a_surface_ends_where_a_person_says(wall, wall_scan):
    plane = Plane((0.33, 0, 3), (1.0, 0.3, 0))  # slanting, and given from the wrong side
    found = edited(wall_scan, Edit(action="end", surfaces=(MEASURED,), cut=plane))
    inner = -plane.distance(vertices_of(found, 0))
    assert abs(inner.min()) < 1e-9
    assert found.hypothesised_m2 < 0.7 * wall.hypothesised_m2
    np.testing.assert_array_equal(found.patches[0].observed, wall.patches[0].observed)
    assert found.surfaces[0].effect.measured_m2 > 0.5
    at_end = [part for part in found.surfaces[0].boundary if part.provenance == "user"]
    assert at_end
    assert all(np.abs(plane.distance(part.points)).max() < 0.1 for part in at_end)


def test_a_surface_goes_on_to_the_end_that_a_person_sets(room):
    """The side of the tall box is not known to reach the floor; a person says that it goes on to z = 0.4."""
    end = Edit(action="end", surfaces=(TALL_BOX_SIDE,), cut=Plane((0, 0, 0.4), (0, 0, 1)))
    shy = completed("two_occluders", pixels=120, options=CONSERVATIVE)
    found = edited(example("two_occluders", pixels=120), end, mode="conservative")
    lowest = [vertices_of(one, surface_at(one, TALL_BOX_SIDE))[:, 2].min(initial=2.7) for one in (shy, found)]
    assert lowest[0] > 0.5
    assert lowest[1] >= 0.4 - 1e-9


def test_a_declared_opening_stays_empty_and_is_listed(wall, wall_scan):
    corners = pane((0.15, -0.25), (0.45, -0.2), (0.4, 0.3), (0.2, 0.1))
    found = edited(wall_scan, Edit(action="opening", surfaces=(MEASURED,), outline=corners))
    polygon = Polygon(corners[:, :2])
    mesh = found.hypothesised
    centres = found.world_from_reference.apply(mesh.vertices[mesh.faces].mean(axis=1))
    assert not contains_xy(polygon.buffer(-1e-9), centres[:, 0], centres[:, 1]).any()
    opening = found.surfaces[0].openings[0]
    assert opening.declared
    assert opening.area_m2 == pytest.approx(polygon.area, rel=1e-9)
    assert opening.seen_share == 0
    gap = wall.hypothesised_m2 - found.hypothesised_m2
    cell = float(found.patches[0].grid.cell.max())
    assert polygon.area - 1e-9 <= gap <= polygon.area + 8 * cell**2  # a cell at each corner at most
    assert "user" in {part.provenance for part in found.surfaces[0].boundary}


def test_a_declared_opening_replaces_the_one_that_was_found(wall, wall_scan):
    (window,) = wall.surfaces[0].openings
    outline = wall.world_from_reference.apply(window.points)
    found = edited(wall_scan, Edit(action="opening", surfaces=(MEASURED,), outline=outline))
    (again,) = found.surfaces[0].openings
    assert again.declared
    assert again.area_m2 == pytest.approx(window.area_m2)
    assert again.seen_share > 0.9


def test_openings_across_the_seam_of_a_cylinder():
    scan = example("two_cylinders", pixels=120)
    base = completed("two_cylinders", pixels=120)
    number, patch = next(
        (k, patch) for k, patch in enumerate(base.patches, 1) if isinstance(patch.grid.surface, Cylinder)
    )
    half, chart = patch.grid.surface.period / 2, patch.grid.surface
    middle = float(patch.grid.centres_uv()[..., 1].mean())
    uv = [
        [half - 0.05, middle],
        [half + 0.05, middle],
        [half + 0.05, middle + 0.2],
        [half - 0.05, middle + 0.2],
    ]
    outline = base.world_from_reference.apply(chart.from_uv(np.array(uv)))
    found = edited(scan, Edit(action="opening", surfaces=(base.anchor(number),), outline=outline))
    gap = base.hypothesised_m2 - found.hypothesised_m2
    assert 0.1 * 0.2 - 1e-4 <= gap <= 0.1 * 0.2 + 8 * patch.grid.cell_area  # a cell at each corner at most


def test_edits_move_with_the_world(wall_scan):
    motion = Pose.looking_at((50, -20, 7), (3, 4, 6))
    line, anchor = pane((0.33, -1.0), (0.33, 1.0)), np.array(MEASURED)
    here = edited(
        wall_scan,
        Edit(action="end", surfaces=(anchor,), cut=line),
        Edit(action="opening", surfaces=(anchor,), outline=BEHIND_BOARD),
    )
    there = edited(
        wall_scan.transform(motion),
        Edit(action="end", surfaces=(motion.apply(anchor),), cut=motion.apply(line)),
        Edit(action="opening", surfaces=(motion.apply(anchor),), outline=motion.apply(BEHIND_BOARD)),
    )
    assert there.hypothesised_m2 == pytest.approx(here.hypothesised_m2, rel=1e-6)


def test_completion_json_is_where_a_file_of_edits_starts(wall, wall_scan, tmp_path):
    wall.save(tmp_path)
    file = tmp_path / "completion.json"
    held = json.loads(file.read_text())
    plane = {"point": [0.33, 0, 3], "normal": [1, 0, 0]}
    held["edits"] = [
        {"do": "split", "surface": 1, "plane": plane, "note": "a door leaf"},
        {
            "do": "opening",
            "surface": [0.0, 0.9, 3.0],
            "outline": pane((0.1, 0), (0.2, 0), (0.2, 0.1)).tolist(),
        },
    ]
    file.write_text(json.dumps(held))
    found = edited(wall_scan, *read_edits(file))
    assert [patch.verdict.actions for patch in found.patches if patch.verdict.actions] == [
        ("split", "opening"), ("split",)
    ]  # fmt: skip
    found.save(tmp_path)
    held = json.loads(file.read_text())
    assert [edit["do"] for edit in held["edits"]] == ["split", "opening"]
    assert [surface["user"]["actions"] for surface in held["surfaces"]][:2] == [
        ["split", "opening"],
        ["split"],
    ]
    assert held["surfaces"][0]["openings"][0]["provenance"] == "user"
    held["edits"].append({"do": "reject", "surface": 2})  # numbered as in the edited model
    file.write_text(json.dumps(held))
    last = edited(wall_scan, *read_edits(file))
    assert last.patches[1].verdict.actions == ("split", "reject")
    assert last.patches[0].hypothesised_m2 == found.patches[0].hypothesised_m2
    assert last.patches[1].hypothesised_m2 == 0 < found.patches[1].hypothesised_m2


def test_files_name_what_a_person_said(wall_scan, tmp_path):
    found = edited(
        wall_scan,
        Edit(action="accept", surfaces=(MEASURED,), outline=BEHIND_BOARD),
        sigma_m=0.001,
        max_sd_m=0.02,
        mode="conservative",
    )
    found.save(tmp_path)
    mesh = read_mesh_ply(tmp_path / "hypothesised.ply")
    assert any("provenance 6 user" in comment for comment in mesh.comments)
    assert json.loads((tmp_path / "completion.json").read_text())["provenance"]["6"] == {"name": "user"}
    assert mesh_area(mesh.vertices, mesh.faces) == pytest.approx(found.hypothesised_m2, rel=1e-4)


def test_every_edit_survives_its_file(tmp_path):
    edits = [
        Edit(action="accept", surfaces=(Anchor(MEASURED, "plane"),), outline=BEHIND_BOARD),
        Edit(action="merge", surfaces=(MEASURED, FLOOR)),
        Edit(action="split", surfaces=(MEASURED,), cut=BEHIND_BOARD[:2]),
        Edit(action="end", surfaces=(MEASURED,), cut=Plane((1, 2, 3), (0, 0.6, 0.8))),
    ]
    file = tmp_path / "edits.json"
    file.write_text(json.dumps({"edits": [edit_record(edit) for edit in edits]}))
    assert [edit_record(edit) for edit in read_edits(file)] == [edit_record(edit) for edit in edits]


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (Edit(action="reject", surfaces=((9, 9, 9),)), r"reject\): the surface should be at .* away; was"),
        (Edit(action="reject", surfaces=(Anchor(MEASURED, "cylinder", "surface 1"),)), "surface 1 should "
         r"be at .* and be a cylinder, but there is a plane; was it meant for other scans"),
        (Edit(action="merge", surfaces=(MEASURED, (0.0, 0.95, 3.0))), "names are one surface already"),
        (Edit(action="split", surfaces=(MEASURED,), cut=Plane((9, 0, 0), (1, 0, 0))), "only 0 of .* pixels"),
        (Edit(action="split", surfaces=(MEASURED,), cut=[[0, 0, 3], [0, 0, 3.04]]), "line is perpendicular"),
        (Edit(action="end", surfaces=(MEASURED,), cut=[[0, 0, 3], [1, 0, 3.4]]), "point 2 lies 0.40 m off"),
        (Edit(action="opening", surfaces=(MEASURED,), outline=BEHIND_BOARD[[0, 2, 1, 3]]), "crosses itself"),
    ],
)  # fmt: skip
def test_edits_that_fit_nothing_are_refused(edit, words, wall_scan):
    with pytest.raises(InputError, match=words):
        edited(wall_scan, edit)


def test_a_part_that_determines_no_surface_is_refused():
    scan = example("two_occluders", pixels=120)
    base = completed("two_occluders", pixels=120)
    row = np.flatnonzero(base.patches[0].source.pixels[0].mask.any(axis=1))[-1]
    points = base.observations[0].scan.points()[row][base.patches[0].source.pixels[0].mask[row]]
    world = base.world_from_reference.apply(points)
    middle, normal = world.mean(axis=0), base.world_from_reference.apply(points - [0, 1e-4, 0])[0] - world[0]
    cut = Plane(middle, np.cross(np.cross(normal, world[-1] - world[0]), world[-1] - world[0]))
    with pytest.raises(InputError, match="pixels"):
        edited(scan, Edit(action="split", surfaces=(base.anchor(1),), cut=cut))


def test_no_surface_at_all_is_refused():
    camera = PinholeProjection(30, 20, 50, 50, 0, 0)
    empty = RangeImage(np.full((20, 30), np.inf), camera, Pose.identity())
    with pytest.raises(InputError, match="but there is none"):
        edited(empty, Edit(action="reject", surfaces=(MEASURED,)))


def test_anchors_of_surfaces_that_do_not_exist_are_refused(wall):
    with pytest.raises(InputError, match="there is no surface 7: there are"):
        wall.anchor(7)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"action": "delete", "surfaces": (MEASURED,)}, "do must be one of accept, reject, merge"),
        ({"action": "merge", "surfaces": (MEASURED,)}, "takes two surfaces or more, got 1"),
        ({"action": "reject", "surfaces": (MEASURED, FLOOR)}, "takes one surface, got 2"),
        ({"action": "end", "surfaces": (MEASURED,)}, "needs a plane, or a line"),
        ({"action": "reject", "surfaces": (MEASURED,), "cut": BEHIND_BOARD[:2]}, "has no use for a plane"),
        ({"action": "opening", "surfaces": (MEASURED,)}, "needs an outline"),
        ({"action": "split", "surfaces": (MEASURED,), "cut": BEHIND_BOARD[:2], "outline": BEHIND_BOARD},
         "has no use for an outline"),
        ({"action": "opening", "surfaces": (MEASURED,), "outline": BEHIND_BOARD[:2]}, "three points or more"),
        ({"action": "end", "surfaces": (MEASURED,), "cut": BEHIND_BOARD[[0, 0]]}, "two different points"),
    ],
)  # fmt: skip
def test_edits_that_say_too_little_or_too_much_are_refused(fields, words):
    with pytest.raises(InputError, match=words):
        Edit(**fields)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("nonsense", "is no valid JSON"),
        ("[]", "is JSON, but not an object"),
        ("{}", 'holds no list "edits"; write'),
        ('{"edits": [7]}', r'edit 1: needs a "do" of accept'),
        ('{"edits": [{"do": "paint"}]}', "edit 1: needs a .do. of .* not 'paint'"),
        ('{"edits": [{"do": "reject"}]}', 'edit 1: reject needs "surface"'),
        ('{"edits": [{"do": "reject", "surface": [0, 0, 1], "plane": 3}]}', "reject knows no 'plane', only"),
        ('{"edits": [{"do": "reject", "surface": 3}]}', "surface 3 is not among .* lists none; add"),
        ('{"edits": [{"do": "reject", "surface": 3}], "surfaces": [{"id": 1, "anchor": [0, 0, 1]}]}',
         "surface 3 is not among the surfaces of this file: it lists 1"),
        ('{"edits": [], "surfaces": 3}', 'its "surfaces" are no list'),
        ('{"edits": [], "surfaces": [{"id": 1}]}', '"surfaces" have no "id" and "anchor" each'),
        ('{"edits": [{"do": "reject", "surface": "floor"}]}', "expected coordinates .* got 'floor'"),
        ('{"edits": [{"do": "reject", "surface": [1, 2]}]}', r"edit 1.*with shape \(3,\), got \(2,\)"),
        ('{"edits": [{"do": "merge", "surfaces": 3}]}', '"surfaces" are a list'),
        ('{"edits": [{"do": "end", "surface": [0, 0, 1], "plane": [1, 2]}]}', "a plane is .*, got"),
        ('{"edits": [{"do": "end", "surface": [0, 0, 1], "line": [], "plane": {}}]}', "not both"),
        ('{"edits": [{"do": "end", "surface": [0, 0, 1], "plane": {"point": [0, 0, 0], "normal": [0, 0, 0]'
         "}}]}",
         "edit 1: normal has length 0"),
    ],
)  # fmt: skip
def test_files_that_say_nothing_clear_are_refused_by_name(text, words, tmp_path):
    file = tmp_path / "edits.json"
    file.write_text(text)
    with pytest.raises(InputError, match=words) as refusal:
        read_edits(file)
    assert str(refusal.value).startswith(str(file))
