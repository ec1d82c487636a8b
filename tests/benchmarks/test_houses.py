# SPDX-License-Identifier: MIT
"""Generated flats: the same by seed, closed and oriented, plausible, and seen as by a person."""

import hashlib

import numpy as np
import pytest
import shapely

from benchmarks.cases.frames import HELD_OUT_HOUSES, HOUSES, REAL, Flat
from benchmarks.cases.houses.furnishing import AMIDST, AMIDST_BY_USE, AT_WALLS, USES
from benchmarks.cases.houses.house import (
    FARTHEST_M,
    NEAREST_M,
    House,
    frames,
    random_house,
    station,
    without_mirrors,
)
from benchmarks.cases.houses.plan import random_plan
from benchmarks.cases.houses.solids import volume
from benchmarks.metrics.other_scans import is_there
from benchmarks.suites.ledger import chosen

SEEDS = (0, 6, 14, 21)  # four rooms, slopes with a skylight, crammed, stairs


@pytest.fixture(scope="module", params=SEEDS)
def house(request) -> House:
    return random_house(request.param)


@pytest.fixture(scope="module")
def taken(house):
    return frames(house, 5, 160)


def digest(house: House) -> str:
    found = hashlib.sha256(" ".join(house.scene.surface_names).encode())
    for array in (house.scene.mesh.vertices, house.scene.mesh.faces, house.scene.mesh.face_surface):
        found.update(np.ascontiguousarray(array).tobytes())
    for scan in frames(house, 2, 64):
        found.update(scan.ranges.tobytes())
    return found.hexdigest()


@pytest.mark.long
def test_a_seed_gives_the_same_bytes_and_others_give_others() -> None:
    assert digest(random_house(1)) == digest(random_house(1)) != digest(random_house(2))


@pytest.mark.long
@pytest.mark.parametrize("name", sorted({*AT_WALLS, *AMIDST}))
def test_pieces_are_closed_and_seen_from_outside(name: str) -> None:
    for seed in range(6):
        piece = {**AT_WALLS, **AMIDST}[name](np.random.default_rng(seed))
        for part in piece.parts:
            assert volume(part.corners - part.corners.mean(axis=(0, 1))) > 0, part.name
        assert piece.bounds[0, 2] > -0.02, "it would go into the floor if it were not lifted"
        assert np.ptp(piece.bounds, axis=0).max() < 3.6


def test_rooms_furnish_with_what_there_is() -> None:
    assert {name for names in USES.values() for name in names} <= set(AT_WALLS)
    assert {name for names in AMIDST_BY_USE.values() for name in names} <= set(AMIDST)


def test_rooms_have_the_sizes_that_are_promised() -> None:
    for seed in range(40):
        for room in random_plan(np.random.default_rng(seed)).rooms:
            ring = np.asarray(room.floor.minimum_rotated_rectangle.exterior.coords)
            sides = np.linalg.norm(np.diff(ring, axis=0), axis=1)
            assert 1.8 <= sides.min() <= sides.max() <= 8.0
            assert 2.2 <= room.ceilings[0, 2] <= 3.5


@pytest.mark.long
def test_no_face_is_seen_from_behind(house, taken) -> None:
    normals = house.scene.mesh.face_normals()
    for scan in taken:
        rays = scan.world_from_sensor.rotate(scan.projection.directions()).reshape(-1, 3)
        face = scan.truth.face.ravel()
        met = face >= 0
        towards = np.einsum("ij,ij->i", rays[met], normals[face[met]])
        assert (towards > 1e-6).mean() < 1e-3


@pytest.mark.long
def test_floor_is_below_and_walls_are_behind_all_that_stands_in_a_room(house) -> None:
    """From below, and from the middle of the walls, nothing is met before the room's own faces."""
    rng = np.random.default_rng(0)
    for room in house.plan.rooms:
        low, high = np.array(room.floor.bounds).reshape(2, 2)
        at = rng.uniform(low, high, (400, 2))
        at = at[shapely.contains(room.floor.buffer(-0.02), shapely.points(at))]
        starts = np.column_stack([at, np.full(len(at), -0.5)])
        hits = house.caster.first_hit(starts, np.tile([0, 0, 1.0], (len(at), 1)))
        assert np.allclose(hits.ranges, 0.5)
        for side in room.sides:
            wall = house.plan.walls[side.wall]
            s = rng.uniform(side.start + 0.05, side.end - 0.05, 60)
            z = rng.uniform(0.02, 0.8, 60)
            holes = [one for one in house.openings if one.wall == side.wall]
            clear = np.array(
                [not any(a - 0.02 < x < b + 0.02 for a, b in (h.span for h in holes)) for x in s]
            )
            if not clear.any():
                continue
            middle = wall.place(s[clear], z[clear], 0.0)
            out = np.tile([*(side.sign * wall.normal), 0.0], (len(middle), 1))
            away = house.caster.first_hit(middle, out).ranges
            assert np.allclose(away, wall.thickness / 2, atol=1e-6)
            assert is_there(middle + out * wall.thickness / 2, out, house.caster).all()


def pieces(house: House) -> dict[str, np.ndarray]:
    """Corners (m, 3, 3) by piece."""
    names = house.scene.surface_names
    mesh, found = house.scene.mesh, {}
    for number, name in enumerate(names):
        if name.startswith("room") and ": " in name:
            found.setdefault(name.split(": ")[0], []).append(number)
    return {name: mesh.corners[np.isin(mesh.face_surface, own)] for name, own in found.items()}


@pytest.mark.long
def test_furniture_stays_in_its_room(house) -> None:
    for name, corners in pieces(house).items():
        room, places = house.plan.rooms[int(name.split()[1])], corners.reshape(-1, 3)
        assert shapely.distance(room.floor, shapely.points(places[:, :2])).max() < 0.012, name
        assert places[:, 2].min() > -0.002, name
        if "stairs" not in name:
            assert (places[:, 2] - room.height(places[:, :2])).max() < 0.01, name


def winding(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """How often triangles wind about points: 1 inside, 0 outside (Van Oosterom & Strackee 1983)."""
    a, b, c = (corners[None, :, k] - points[:, None] for k in range(3))
    la, lb, lc = (np.linalg.norm(v, axis=2) for v in (a, b, c))
    dot = lambda u, v: np.einsum("pfi,pfi->pf", u, v)  # noqa: E731
    angle = np.arctan2(
        dot(a, np.cross(b, c)), la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb
    )
    return angle.sum(axis=1) / (2 * np.pi)


@pytest.mark.long
def test_pieces_do_not_stand_in_each_other(house) -> None:
    solid = {name: corners for name, corners in pieces(house).items() if len(corners) < 3000}
    bounds = {
        n: np.stack([c.reshape(-1, 3).min(axis=0), c.reshape(-1, 3).max(axis=0)]) for n, c in solid.items()
    }
    for one, corners in solid.items():
        for other in solid:
            low, high = bounds[other]
            if one == other or (bounds[one][0] >= high).any() or (low >= bounds[one][1]).any():
                continue
            at = corners.mean(axis=1)
            at = at[((at > low + 0.005) & (at < high - 0.005)).all(axis=1)][:200]
            if len(at):
                assert (winding(at, solid[other]) > 0.5).sum() <= 6, (one, other)


@pytest.mark.long
def test_frames_see_surface_within_reach_from_where_a_person_stands(house, taken) -> None:
    assert len(taken) == 5
    for scan in taken:
        assert scan.valid.mean() > 0.6
        known = scan.ranges[scan.valid]
        assert NEAREST_M <= known.min() <= known.max() <= FARTHEST_M
        assert 1.2 <= scan.origin[2] <= 1.7
        assert any(area.buffer(0.01).contains(shapely.Point(scan.origin[:2])) for area in house.standing)
    looks = [scan.world_from_sensor.rotation[:, 2] for scan in taken]
    assert max(abs(look[2]) for look in looks) > 0.1, "not only straight ahead"


@pytest.mark.long
def test_a_station_sees_all_around_with_its_noise(house) -> None:
    scan = station(house, width=240)
    assert 0.002 <= scan.sigma_m <= 0.005
    error = scan.range_error()[scan.valid]
    assert np.std(error) == pytest.approx(scan.sigma_m, rel=0.1)
    assert scan.valid.mean() > 0.75


@pytest.mark.long
def test_nothing_comes_back_from_mirrors() -> None:
    house = random_house(1)
    scan = frames(house, 1, 64)[0]
    assert without_mirrors(scan, np.zeros(len(house.mirrors), np.bool_)) is scan
    seen = int(scan.truth.surface[scan.valid][0])
    lost = without_mirrors(scan, np.arange(len(house.mirrors)) == seen)
    assert not lost.valid[scan.truth.surface == seen].any()
    assert np.array_equal(lost.ranges[scan.truth.surface != seen], scan.ranges[scan.truth.surface != seen])


def test_the_ledger_takes_houses_by_kind_and_by_name() -> None:
    assert chosen(["houses"]) == list(HOUSES)
    assert chosen(["held-out-houses"]) == list(HELD_OUT_HOUSES)
    assert chosen(["house 3"]) == [Flat(3)]
    assert chosen(["real"]) == list(REAL)
    assert not {one.seed for one in HOUSES} & {one.seed for one in HELD_OUT_HOUSES}
