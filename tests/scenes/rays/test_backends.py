# SPDX-License-Identifier: MIT
"""Two ways to Embree: the same hits, arithmetic as its oracle's, and what holds when one does not load."""

import logging
import multiprocessing
import pickle
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings

from scenes.checks import FloatArray, InputError, IntArray
from scenes.rays import embree_packets, embree_single, ray_kernels, raycast
from scenes.rays.embree_packets import (
    SPREAD,
    EmbreeError,
    PacketScene,
    _is_coherent,
    check_device,
    load_library,
)
from scenes.rays.local_mesh import LocalMesh
from scenes.rays.raycast import Backend, Hits, RayCaster
from tests.helpers import ray_oracle
from tests.helpers.strategies import law, seeds

BACKENDS: tuple[Backend, Backend] = ("packets", "embreex")
EDGE = 1e-4  # of a face: nearer to its border float32 may name the neighbour


def room_with_spheres() -> tuple[FloatArray, IntArray]:
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.6)
    room = trimesh.creation.box((8, 8, 3))
    places = [(-2, -2, -0.5), (2, -1, 0), (-1, 2, 0.5), (2, 2, -0.5)]
    mesh = trimesh.util.concatenate([room, *(ball.copy().apply_translation(place) for place in places)])
    return np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces)


MESH = room_with_spheres()
RNG = np.random.default_rng(0)
ORIGINS = RNG.uniform([-3.9, -3.9, 0.8], [3.9, 3.9, 1.4], (100_000, 3))
ALONG = RNG.normal(size=(100_000, 3))


def in_each_backend() -> tuple[RayCaster, RayCaster]:
    packets, single = (RayCaster(*MESH, backend=backend) for backend in BACKENDS)
    return packets, single


def assert_agree(first: Hits, second: Hits, most_disagreements: int) -> None:
    """Same face, same bytes; where faces differ both are met at their border, in the same place."""
    assert first.n_not_finite == second.n_not_finite
    n = first.face.size
    face, others = first.face.reshape(n), second.face.reshape(n)
    differ = face != others
    assert differ.sum() <= most_disagreements
    for hits in (first, second):
        assert (hits.barycentric.reshape(n, 3)[differ].min(axis=1) < EDGE).all()
    assert np.abs(first.ranges.reshape(n)[differ] - second.ranges.reshape(n)[differ]).max(initial=0) < 1e-5
    for name in ("ranges", "barycentric", "incidence_cosine"):
        ours, theirs = (
            getattr(hits, name).reshape(n, 3 if name == "barycentric" else 1) for hits in (first, second)
        )
        assert ours[~differ].tobytes() == theirs[~differ].tobytes()


def test_the_fastest_is_chosen_and_says_so() -> None:
    assert RayCaster(*MESH).backend == "packets"
    assert RayCaster(*MESH, backend="embreex").backend == "embreex"


def test_both_backends_hit_the_same() -> None:
    packets, single = in_each_backend()
    expected = single.first_hit(ORIGINS, ALONG)
    assert expected.hit.all()
    assert_agree(packets.first_hit(ORIGINS, ALONG), expected, 10)
    ends = ORIGINS + ALONG
    assert (packets.are_blocked(ORIGINS, ends) != single.are_blocked(ORIGINS, ends)).sum() <= 1


@pytest.mark.parametrize("backend", BACKENDS)
def test_coherence_changes_no_hit(backend: Backend) -> None:
    caster = RayCaster(*MESH, backend=backend)
    assert_agree(caster.first_hit(ORIGINS, ALONG, coherent=True), caster.first_hit(ORIGINS, ALONG), 10)
    assert_agree(caster.first_hit(ORIGINS, ALONG, coherent=False), caster.first_hit(ORIGINS, ALONG), 10)
    ends = ORIGINS[:1] + ALONG
    for coherent in (True, False):
        found = caster.are_blocked(ORIGINS[:1], ends, coherent=coherent)
        assert (found == caster.are_blocked(ORIGINS[:1], ends)).all()


def test_coherent_packets_are_told_by_their_rays() -> None:
    width, size = 16, 4.0

    def told(origins: FloatArray, directions: FloatArray) -> bool:
        packet = np.full((8, width), np.nan, np.float32)
        packet[:3, : len(origins)], packet[4:7, : len(directions)] = origins.T, directions.T
        return bool(_is_coherent(packet.reshape(-1), width, (SPREAD * size) ** 2))

    rng = np.random.default_rng(0)
    one, ahead = np.zeros((width, 3)), np.tile([0.0, 0.0, 1.0], (width, 1))
    turned = ahead.copy()
    for angle, is_coherent in ((0.9 * SPREAD, True), (1.1 * SPREAD, False)):
        turned[7] = [np.sin(angle), 0, np.cos(angle)]
        assert told(one, turned) == is_coherent
        assert told(one[:9], turned[:9]) == is_coherent  # lanes without a ray do not count
    moved = one.copy()
    for share, is_coherent in ((0.9, True), (1.1, False)):
        moved[5] = [0, share * SPREAD * size, 0]
        assert told(moved, ahead) == is_coherent
    assert not told(one, rng.normal(size=(width, 3)))


@pytest.mark.parametrize("n", [1, 2, 15, 16, 17, 31, 33, (1 << 15) + 1])
def test_packets_need_not_be_full(n: int) -> None:
    packets, single = in_each_backend()
    assert_agree(packets.first_hit(ORIGINS[:n], ALONG[:n]), single.first_hit(ORIGINS[:n], ALONG[:n]), 1)
    ends = ORIGINS[:n] + ALONG[:n]
    for begin, end in ((ORIGINS[:n], ends), (ORIGINS[:1], ends), (ends, ORIGINS[:1])):
        assert (packets.are_blocked(begin, end) == single.are_blocked(begin, end)).all()


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (7, 1), (3, 5), (4, 4), (5, 9), (70, 701), (0, 4), (4, 0)])
def test_an_image_is_its_rays_in_a_list(backend: Backend, shape: tuple[int, int]) -> None:
    n = shape[0] * shape[1]
    caster, along = RayCaster(*MESH, backend=backend), ALONG[:n].copy()
    along[::11] = np.nan
    image = caster.first_hit(ORIGINS[:1], along.reshape(*shape, 3))
    assert image.ranges.shape == image.face.shape == image.incidence_cosine.shape == image.hit.shape == shape
    assert image.barycentric.shape == (*shape, 3)
    assert_agree(image, caster.first_hit(ORIGINS[:1], along), 10)
    each = caster.first_hit(np.broadcast_to(ORIGINS[:1], (n, 3)).reshape(*shape, 3), along.reshape(*shape, 3))
    assert_agree(each, image, 0)


@pytest.mark.parametrize(("isa", "width"), [("avx2", 8), pytest.param("sse2", 4, marks=pytest.mark.long)])
def test_a_narrow_processor_gets_narrow_packets(isa: str, width: int) -> None:
    caster = RayCaster(*MESH)
    wide = caster.first_hit(ORIGINS, ALONG)
    caster._embree = PacketScene(caster._mesh, f"max_isa={isa}")
    assert caster._embree.width == width
    assert_agree(caster.first_hit(ORIGINS, ALONG), wide, 100)
    shape = (99, 101, 3)
    assert_agree(
        caster.first_hit(ORIGINS[:1], ALONG[:9999].reshape(shape)),
        caster.first_hit(ORIGINS[:1], ALONG[:9999]),
        5,
    )
    ends = ORIGINS + ALONG
    assert (caster.are_blocked(ORIGINS, ends) != RayCaster(*MESH).are_blocked(ORIGINS, ends)).sum() <= 1


def awkward_rays(rng: np.random.Generator, n: int) -> tuple[FloatArray, FloatArray]:
    origins, along = rng.normal(size=(2, n, 3))
    for vectors in (origins, along):
        bad = rng.integers(0, n, n // 5)
        vectors[bad, rng.integers(0, 3, n // 5)] = rng.choice(
            [np.nan, np.inf, -np.inf, 1e200, 3e38, 0.0], n // 5
        )
    along[rng.integers(0, n, n // 10)] = 0
    return origins, along


@settings(law, max_examples=20)
@given(seeds)
def test_only_usable_rays_reach_embree_each_as_it_would_alone(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, centre = 333, rng.normal(size=3)
    origins, along = awkward_rays(rng, n)
    with np.errstate(all="ignore"):
        for start in (origins, rng.normal(size=(1, 3))):
            rays = embree_single.usable_rays(start - centre, along)
            local = np.broadcast_to(start - centre, along.shape)
            alone = [ray_oracle.usable_ray(*ray) for ray in zip(local, along, strict=True)]
            assert rays.which.tolist() == [k for k, ray in enumerate(alone) if ray is not None]
            expected = zip(*(ray for ray in alone if ray is not None), strict=True)
            for ours, theirs in zip(rays[1:], expected, strict=True):
                assert ours.tobytes() == np.array(theirs).tobytes()


@settings(law, max_examples=20)
@given(seeds)
def test_planes_are_met_alike_whatever_the_face(seed: int) -> None:
    rng = np.random.default_rng(seed)
    faces = rng.integers(0, 20, (40, 3), np.int32)  # some without area
    mesh = LocalMesh(rng.normal(size=(20, 3)), faces, rng.normal(size=3))
    origins, along = rng.normal(size=(2, 300, 3))
    face = rng.integers(-1, 40, 300, np.int32)
    along[:40] = mesh.vertices[faces[face[:40], 1]] - mesh.vertices[faces[face[:40], 0]]  # in the plane, or 0
    along[(along == 0).all(axis=1)] = 1.0
    results = []
    for module in (ray_kernels, ray_oracle):
        out = np.full(300, 7.0), np.full((300, 3), 7.0), np.full(300, 7.0)
        module.meet(mesh, origins, along, face, out)
        results.append(out)
    for ours, theirs in zip(*results, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    ranges, weights, cosine = results[0]
    assert (ranges[face < 0] == np.inf).all()
    assert not weights[face < 0].any()
    assert (ranges[face >= 0] >= 0).all()
    np.testing.assert_allclose(weights[face >= 0].sum(axis=1), 1.0, atol=1e-15, rtol=0)
    assert ((cosine >= 0) & (cosine <= 1)).all()


@pytest.mark.parametrize("backend", BACKENDS)
def test_rays_that_are_not_finite_meet_nothing_on_any_backend(backend: Backend) -> None:
    caster = RayCaster(*MESH, n_threads=1, backend=backend)
    nowhere = np.full((100_000, 3), np.nan)
    hits = caster.first_hit(ORIGINS[:1], nowhere)
    assert caster.are_blocked(ORIGINS[:1], nowhere).all()
    assert hits.n_not_finite == 100_000
    assert not hits.hit.any()


@pytest.mark.parametrize("backend", BACKENDS)
def test_many_threads_may_use_one_caster(backend: Backend) -> None:
    alone = RayCaster(*MESH, n_threads=1, backend=backend).first_hit(ORIGINS, ALONG)
    caster = RayCaster(*MESH, n_threads=2, backend=backend)
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda _: caster.first_hit(ORIGINS, ALONG), range(6)))
    for hits in together:
        for name in ("ranges", "face", "barycentric", "incidence_cosine"):
            assert getattr(hits, name).tobytes() == getattr(alone, name).tobytes()


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("n_faces", [0, 1])
def test_the_smallest_meshes(backend: Backend, n_faces: int) -> None:
    caster = RayCaster(
        [[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.arange(3 * n_faces).reshape(-1, 3), backend=backend
    )
    assert caster.backend == backend
    hits = caster.first_hit([[0.2, 0.2, 1.0], [0.9, 0.9, 1.0]], [[0, 0, -1.0], [0, 0, -1]])
    assert hits.face.tolist() == [n_faces - 1, -1]
    assert hits.ranges.tolist() == [1.0 if n_faces else np.inf, np.inf]
    assert caster.are_blocked([[0.2, 0.2, 1.0]], [[0.2, 0.2, -1.0]]).tolist() == [bool(n_faces)]


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_mesh_given_may_change_afterwards(backend: Backend) -> None:
    vertices, faces = MESH[0].copy(), MESH[1].astype(np.int32)
    caster = RayCaster(vertices, faces, backend=backend)
    expected = caster.first_hit(ORIGINS, ALONG)
    vertices[:], faces[:] = 1e30, 1 << 30
    assert caster.first_hit(ORIGINS, ALONG).ranges.tobytes() == expected.ranges.tobytes()


def cast_from_files(folder: Path) -> bytes:
    arrays = (
        np.load(folder / f"{name}.npy", mmap_mode="r") for name in ("vertices", "faces", "origins", "along")
    )
    vertices, faces, origins, along = arrays
    assert isinstance(faces, np.memmap)
    return RayCaster(vertices, faces, n_threads=1).first_hit(origins, along).ranges.tobytes()


@pytest.mark.long
def test_another_process_builds_it_from_memory_mapped_arrays(tmp_path: Path) -> None:
    along = ALONG[:20_000]
    arrays = {"vertices": MESH[0], "faces": MESH[1], "origins": ORIGINS[:20_000], "along": along}
    for name, array in arrays.items():
        np.save(tmp_path / f"{name}.npy", array)
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        there = pool.apply(cast_from_files, (tmp_path,))
    assert there == RayCaster(*MESH).first_hit(ORIGINS[:20_000], along).ranges.tobytes()


def test_a_caster_is_not_pickled() -> None:
    with pytest.raises(TypeError, match="build one in each process, from its mesh"):
        pickle.dumps(RayCaster(*MESH))


def test_what_embree_holds_is_given_back() -> None:
    caster = RayCaster(*MESH)
    assert isinstance(caster._embree, PacketScene)
    release = caster._embree._release
    assert release.alive
    del caster
    assert not release.alive


@pytest.fixture
def forgetful(monkeypatch: pytest.MonkeyPatch) -> None:
    """Say again what was said before."""
    raycast._warn_once.cache_clear()


def without_library() -> None:
    raise OSError("no Embree 4 library beside embreex")


@pytest.mark.usefixtures("forgetful")
def test_without_the_library_embreex_serves(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(embree_packets, "load_library", without_library)
    with caplog.at_level(logging.WARNING):
        caster = RayCaster(*MESH)
        RayCaster(*MESH)
    assert caster.backend == "embreex"
    said = [record.getMessage() for record in caplog.records]
    assert said == [
        "no packets of rays (no Embree 4 library beside embreex): casting one by one through embreex"
    ]
    chosen = RayCaster(*MESH, backend="embreex").first_hit(ORIGINS, ALONG)
    assert_agree(caster.first_hit(ORIGINS, ALONG), chosen, 0)
    with pytest.raises(InputError, match="backend 'packets' does not load here: no Embree 4 library"):
        RayCaster(*MESH, backend="packets")


HINDRANCES = {
    "NUMBA_DISABLE_JIT": (
        "os.environ['NUMBA_DISABLE_JIT'] = '1'",
        "scenes.rays.raycast: no packets of rays (numba's compiler is switched off): "
        "casting one by one through embreex",
        "embreex",
    ),
    "nowhere to store": (
        "import numba.core.caching as c; c.CacheImpl._locator_classes = []",
        "scenes.run.stored_code: no folder for compiled code can be written: each run compiles anew",
        "packets",
    ),
}
HINDERED = """
import logging, os, sys
import numpy as np
logging.basicConfig(stream=sys.stdout, format="%(name)s: %(message)s")
from scenes.rays.raycast import RayCaster
rng = np.random.default_rng(0)
vertices, along = rng.normal(size=(300, 3)), rng.normal(size=(2000, 3))
along[5], along[6] = np.nan, 0
caster = RayCaster(vertices, np.arange(300).reshape(-1, 3))
hits = caster.first_hit(np.zeros((1, 3)), along.reshape(40, 50, 3))
print(caster.backend, hits.n_not_finite, hits.ranges.shape, caster.are_blocked(np.zeros((1, 3)), along).sum())
np.save(sys.argv[1], hits.ranges)
"""


@pytest.mark.parametrize(
    "name", ["NUMBA_DISABLE_JIT", pytest.param("nowhere to store", marks=pytest.mark.long)]
)
def test_a_hindered_compiler_changes_no_range(tmp_path: Path, name: str) -> None:
    hindrance, warning, backend = HINDRANCES[name]
    file = tmp_path / "ranges.npy"
    script = f"import os, sys; {hindrance}\n{HINDERED}"
    run = subprocess.run([sys.executable, "-c", script, file], capture_output=True, text=True, check=True)
    said, result = run.stdout.splitlines()
    assert said.startswith(warning)
    assert not run.stderr
    rng = np.random.default_rng(0)
    vertices, along = rng.normal(size=(300, 3)), rng.normal(size=(2000, 3))
    along[5], along[6] = np.nan, 0
    caster = RayCaster(vertices, np.arange(300).reshape(-1, 3), backend=backend)
    assert result == f"{backend} 2 (40, 50) {caster.are_blocked(np.zeros((1, 3)), along).sum()}"
    expected = caster.first_hit(np.zeros((1, 3)), along.reshape(40, 50, 3)).ranges
    assert np.load(file).tobytes() == expected.tobytes()


def test_embree_errors_are_told() -> None:
    library = load_library()
    library.rtcCommitScene(None)
    with pytest.raises(EmbreeError, match="Embree, building: an invalid argument"):
        check_device(library, None, "building")
    check_device(library, None, "building")  # reading it clears it


def test_unusable_choices_are_refused() -> None:
    with pytest.raises(InputError, match="expected backend 'packets' or 'embreex', got 'cuda'"):
        RayCaster(*MESH, backend="cuda")  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"the mesh spans 2e\+200 m; Embree's float32 ends at"):
        RayCaster([[-1e200, 0, 0], [1e200, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    with pytest.raises(InputError, match=r"origins of shape \(2, 3\) for directions of shape \(4, 5, 3\)"):
        RayCaster(*MESH).first_hit(np.zeros((2, 3)), np.zeros((4, 5, 3)))


HUGE = """
import resource
import numpy as np
from scenes.rays.raycast import RayCaster
side = 1582
z = 0.2 * np.sin(np.add.outer(0.37 * np.arange(side + 1), 0.11 * np.arange(side + 1)))
x, y = np.meshgrid(np.arange(side + 1.0), np.arange(side + 1.0))
vertices = np.stack([x, y, z], axis=-1).reshape(-1, 3)
corner = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).reshape(-1).astype(np.int32)
above = np.stack([corner, corner + side + 2, corner + side + 1], axis=1)
faces = np.concatenate([np.stack([corner, corner + 1, corner + side + 2], axis=1), above])
assert len(faces) > 5_000_000
rng = np.random.default_rng(0)
origins = np.append(rng.uniform(1, side - 1, (100_000, 2)), np.full((100_000, 1), 9.0), axis=1)
hits = RayCaster(vertices, faces).first_hit(origins, np.tile([0.0, 0, -1], (100_000, 1)))
assert hits.hit.all() and (abs(hits.ranges - 9) <= 0.2).all()
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


@pytest.mark.long
@pytest.mark.skipif(sys.platform != "linux", reason="ru_maxrss is in kilobytes on Linux alone")
def test_five_million_faces_fit_in_two_gigabytes() -> None:
    run = subprocess.run([sys.executable, "-c", HUGE], capture_output=True, text=True, check=True)
    assert int(run.stdout) * 1024 < 2e9
