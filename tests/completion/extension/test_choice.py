# SPDX-License-Identifier: MIT
import json
from dataclasses import replace

import numpy as np
import pytest

from completion import CompletionOptions, complete
from completion.edits.edit import Anchor, Edit
from completion.extension.claims import Choice, is_chosen
from completion.observe.user_options import KINDS
from completion.result.record import polygons_record
from scenes.checks import InputError
from scenes.surfaces.catalogue import Cylinder, Plane, Sphere
from tests.helpers.completion_examples import completed, example

FLOOR, WALL, CEILING = (Plane((0, 0, 0), normal) for normal in ((0, 0, 1), (1, 0, 0), (0, 0.1, -1)))
BALL = Sphere((0, 0, 0), 1.0)
PIPE, VAULT = (Cylinder((0, 0, 0), (1, 0, 0), 0.1, None, concave) for concave in (False, True))


@pytest.mark.parametrize(
    ("surface", "role", "kinds"),
    [
        (FLOOR, "floor", {"floors", "planes"}),
        (FLOOR, "", {"planes"}),
        (WALL, "wall", {"walls", "planes"}),
        (CEILING, "ceiling", {"ceilings", "planes"}),
        (PIPE, "", {"pipes", "cylinders"}),
        (VAULT, "", {"cylinders"}),
        (BALL, "", set()),
    ],
)
def test_kinds_are_roles_and_shapes(surface, role, kinds):
    assert {kind for kind in KINDS if is_chosen(surface, (kind,), role)} == kinds
    assert is_chosen(surface, ())


def test_unknown_kinds_are_refused_by_name():
    with pytest.raises(InputError, match=r"only must be some of walls, floors, .* got 'doors'"):
        CompletionOptions(only=("walls", "doors"))


def test_what_is_left_out_is_measured_and_bounds_the_rest():
    every = completed("two_occluders", "gaussian-2mm", pixels=96)
    scan = example("two_occluders", "gaussian-2mm", pixels=96)
    walls = complete(scan, CompletionOptions(texture=False, only=("walls", "floors")))
    roles = [surface["role"] for surface in polygons_record(walls)["surfaces"]]
    assert set(roles) <= {"wall", "floor"}
    assert walls.choice.n_left_out == len(every.patches) - len(walls.patches) > 0
    kept = [patch for patch in every.patches if patch.limits.role in {"wall", "floor"}]
    area = {round(patch.observed_m2, 9): patch.hypothesised_m2 for patch in kept}
    assert all(area[round(patch.observed_m2, 9)] == patch.hypothesised_m2 for patch in walls.patches)
    owner, before = walls.owners[0], every.owners[0]
    assert set(np.unique(owner)) == set(range(len(walls.patches) + 1))
    assert np.count_nonzero(owner) < np.count_nonzero(before)
    assert before[owner > 0].min() > 0
    rest, less = (done.remainder.points for done in (walls, every))
    assert len(rest.faces) > len(less.faces)
    occluders = np.concatenate([patch.evidence.occluder.ravel() for patch in walls.patches])
    assert occluders.max() <= len(walls.patches)


@pytest.mark.long
def test_small_surfaces_are_left_out_unless_a_person_names_them(tmp_path):
    every = completed("two_occluders", "gaussian-2mm", pixels=96)
    scan = example("two_occluders", "gaussian-2mm", pixels=96)
    least = float(np.median([patch.observed_m2 for patch in every.patches]))
    large = complete(scan, CompletionOptions(texture=False, min_area_m2=least))
    assert min(patch.observed_m2 for patch in large.patches) >= least
    assert large.choice.n_left_out == sum(patch.observed_m2 < least for patch in every.patches)
    large.save(tmp_path)
    record = json.loads((tmp_path / "completion.json").read_text())
    assert record["choice"] == {"only": [], "min_area_m2": least, "n_left_out": large.choice.n_left_out}
    assert record["flatness_m"] == large.flatness_m == 0.001
    number = int(np.argmin([patch.observed_m2 for patch in every.patches]))
    edit = Edit(action="reject", surfaces=(Anchor(every.anchor(number + 1)),))
    named = complete(scan, CompletionOptions(texture=False, min_area_m2=least, edits=(edit,)))
    assert len(named.patches) == len(large.patches) + 1


def test_small_planes_stay_as_measured_where_nobody_asks_for_them():
    """By what all surfaces measured; walls and floors, cylinders, and what is asked for are kept."""
    patches = completed("two_occluders", "gaussian-2mm", pixels=96).patches
    whole = sum(patch.observed_m2 for patch in patches)
    usual = Choice.of((), None, patches)
    assert usual.min_area_m2 == pytest.approx(min(0.002 * whole, 0.05))
    assert not usual.is_stated
    wall = next(patch for patch in patches if patch.limits.role)
    other = replace(wall, limits=replace(wall.limits, role=""))
    pipe = replace(other, grid=replace(other.grid, surface=PIPE))
    for least, kept in ((2 * wall.observed_m2, (True, False, True)), (wall.observed_m2, (True, True, True))):
        choice = Choice((), least, is_stated=False)
        assert tuple(choice.keeps(patch) for patch in (wall, other, pipe)) == kept
    assert not Choice.of((), 2 * wall.observed_m2, patches).keeps(wall)
    assert all(Choice.of((), 0.0, patches).keeps(patch) for patch in patches)


def test_nothing_may_be_left():
    scan = example("two_occluders", "gaussian-2mm", pixels=96)
    none = complete(scan, CompletionOptions(texture=False, min_area_m2=1e6))
    assert none.patches == ()
    assert none.hypothesised_m2 == 0
    assert not none.owners[0].any()
