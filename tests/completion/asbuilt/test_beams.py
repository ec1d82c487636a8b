# SPDX-License-Identifier: MIT
"""Beams through a design: where each ended, what it passed, and that areas are those of the room."""

import numpy as np
import pytest

from completion.asbuilt.beams import EXTRA, NO_RETURN, NOT_USED, Gates, Surfaces, trace
from completion.asbuilt.faces import find_faces
from completion.observe.observation import observe
from scenes.mesh.design import ElementMesh
from scenes.mesh.winding import turn_outside_out
from scenes.pose import Pose
from scenes.rays.raycast import RayCaster
from tests.completion.asbuilt.designs import boxes, scanned

ROOM = {
    "floor": ((-0.2, -0.2, -0.2), (4.2, 5.2, 0)),
    "ceiling": ((-0.2, -0.2, 2.5), (4.2, 5.2, 2.7)),
    "west": ((-0.2, 0, 0), (0, 5, 2.5)),
    "east": ((4, 0, 0), (4.2, 5, 2.5)),
    "south": ((-0.2, -0.2, 0), (4.2, 0, 2.5)),
    "north": ((-0.2, 5, 0), (4.2, 5.2, 2.5)),
}
PANEL = {"panel": ((2.5, 1.5, 0.5), (2.55, 3.5, 2.0))}
EYE = (1.5, 2.5, 1.2)
POSES = (0.002, 1e-4)


def traced(design: ElementMesh, scan, *, n_threads=1, is_free=False):
    """Evidence of a scan, and the faces."""
    turned = turn_outside_out(design.mesh, design.mesh.face_surface)
    faces = find_faces(turned.mesh, 1.0)
    seen = observe(scan, Pose.identity())
    found = trace(
        seen, np.arange(scan.ranges.size), RayCaster(turned.mesh.vertices, turned.mesh.faces, 1),
        Surfaces.of(turned.mesh, faces, turned.is_closed), Gates.of(1.0, POSES),
        n_elements=len(design.elements), no_return_is_free=is_free, n_threads=n_threads,
    )  # fmt: skip
    return found, faces


def labels(design, *names):
    return [[one.name for one in design.elements].index(name) for name in names]


def test_beams_of_a_room_as_designed_end_on_its_faces() -> None:
    room = boxes(ROOM)
    found, faces = traced(room, scanned(room, EYE))
    assert (found.face >= 0).all()
    assert (faces.element[found.face] == found.label).all()
    assert (found.passed == -1).all()
    assert found.through.sum() == found.hidden.sum() == 0


def test_areas_are_those_of_the_sphere_and_of_the_wall() -> None:
    """Of a panorama from -60 to 85 degrees, and of a wall that is seen whole."""
    room = boxes(ROOM)
    scan = scanned(room, EYE)
    found, faces = traced(room, scan)
    solid = found.area / scan.ranges.ravel() ** 2
    step = np.radians(145) / scan.shape[0]
    covered = 2 * np.pi * (np.sin(np.radians(85) + step / 2) - np.sin(np.radians(-60) - step / 2))
    assert solid.sum() == pytest.approx(covered, rel=0.01)
    (east,) = labels(room, "east")
    inner = np.flatnonzero((faces.element == east) & (faces.normal[:, 0] < -0.9))[0]
    assert found.reach[inner] == pytest.approx(5 * 2.5, rel=0.02)
    on = found.face == inner
    rays = (scan.points().reshape(-1, 3)[on] - EYE) / scan.ranges.ravel()[on, None]
    assert (found.area[on] / rays[:, 0]).sum() == pytest.approx(5 * 2.5, rel=0.02)


@pytest.mark.parametrize("how", ["stands", "missing", "hidden"])
def test_beams_end_on_a_panel_or_pass_it_or_stop_before_it(how: str) -> None:
    design = boxes(ROOM | PANEL)
    panel, *behind = labels(design, "panel", "east", "floor", "ceiling")
    crate = [((2.0, 1.4, 0.4), (2.2, 3.6, 2.1))] if how == "hidden" else []
    found, _ = traced(design, scanned(design if how == "stands" else boxes(ROOM), EYE, extras=crate))
    area = 2.0 * 1.5
    if how == "stands":
        assert (found.label == panel).sum() > 1000
        assert found.through[panel] == found.hidden[panel] == 0
        assert (found.passed == -1).all()
    elif how == "missing":
        assert found.through[panel] == pytest.approx(area, rel=0.03)
        assert found.on[panel] == found.hidden[panel] == 0
        assert set(found.label[found.passed == panel]) <= set(behind)
        assert (found.face[found.passed == panel] >= 0).all()
    else:
        assert found.hidden[panel] == pytest.approx(area, rel=0.03)
        assert found.on[panel] == found.through[panel] == 0
        assert (found.label == EXTRA).sum() > 1000


@pytest.mark.parametrize(("off_m", "is_on"), [(0.03, True), (0.14, True), (-0.14, True), (0.2, False)])
def test_a_wall_that_moved_has_its_beams_as_far_as_faces_reach(off_m: float, is_on: bool) -> None:
    """Within 15 cm beams belong to the face; farther off they may be of a displaced element."""
    design = boxes(ROOM)
    built = boxes(ROOM | {"east": ((4 - off_m, 0, 0), (4.2 - off_m, 5, 2.5))})
    found, faces = traced(design, scanned(built, EYE))
    (east,) = labels(design, "east")
    own = np.flatnonzero((faces.element == east) & (faces.normal[:, 0] < -0.9))[0]
    n, n_far = (found.face == own).sum(), (found.face == -2 - own).sum()
    assert (n > 3000) == is_on
    assert (n_far > 3000) != is_on


def test_beams_without_return_pass_only_where_that_is_asked_for() -> None:
    design = boxes(ROOM | PANEL)
    (panel,) = labels(design, "panel")
    open_ = boxes({name: box for name, box in ROOM.items() if name != "east"})
    scan = scanned(open_, EYE)
    found, _ = traced(design, scan)
    lost = ~np.isfinite(scan.ranges.ravel())
    assert lost.sum() > 3000
    assert (found.label[lost] == NO_RETURN).all()
    assert 0 < found.through[panel] < 1.5  # floor and ceiling behind it
    assert traced(design, scan, is_free=True)[0].through[panel] == pytest.approx(3.0, rel=0.03)


def test_beams_too_noisy_to_tell_are_not_used() -> None:
    room = boxes(ROOM)
    scan = scanned(room, EYE)
    found, _ = traced(room, scan.with_facts(sigma_m=0.031))
    assert (found.label == NOT_USED).all()
    assert found.reach.sum() == 0


def test_threads_change_nothing() -> None:
    design = boxes(ROOM | PANEL)
    scan = scanned(boxes(ROOM), EYE, n_pixels=150_000, sigma_m=0.002, rng=1)
    one, two = (traced(design, scan, n_threads=n)[0] for n in (1, 2))
    assert all(a.tobytes() == b.tobytes() for a, b in zip(one, two, strict=True))


def test_a_turned_world_gives_the_turned_evidence() -> None:
    """A design that lies elsewhere, seen from the same place in it."""
    design, scan = boxes(ROOM | PANEL), scanned(boxes(ROOM), EYE)
    move = Pose.looking_at((30, -20, 5), (31, -18, 5.5))
    there = ElementMesh(design.mesh.transform(move), design.elements, "there")
    here = traced(design, scan)[0]
    moved = traced(there, scan.with_facts(world_from_sensor=move @ scan.world_from_sensor))[0]
    for name in ("on", "through", "hidden"):
        assert getattr(moved, name) == pytest.approx(getattr(here, name), rel=1e-3, abs=0.02)
    assert (moved.label == here.label).mean() > 0.999
