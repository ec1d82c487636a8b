# SPDX-License-Identifier: MIT
"""All returns of beams: counts, ranges and shares by closed form, a hedge against fine sampling, laws."""

from dataclasses import replace

import numpy as np
import pytest

from nbv.scanning import echoes as module
from nbv.scanning.beam import Dropout, Footprint, Intensity
from nbv.scanning.effects import Effects, PointingNoise
from nbv.scanning.noise_models import ConstantNoise
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor
from scenes.checks import InputError
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.world.scene import Scene
from tests.helpers.sheet_scenes import EAST, before_wall, sheets

NEAR, FAR = 2.0, 3.0
BEAM = Footprint(divergence_rad=0.006, exit_diameter_m=0.004, returns="all")
RADIUS = float(BEAM.diameter_m(np.array(NEAR))) / 2
AXIS = PinholeSensor(fov_deg=1e-5, width=40, height=40)  # 1600 beams along x, each turned in its own way
IMAGE = PinholeSensor(fov_deg=22, width=90, height=90)


def plates(offset: float, colours=(1.0, 1.0)):
    """A plate up to `offset` of the beam's radius beside its axis, and one behind it."""
    return sheets((NEAR, -5, offset * RADIUS, -5, 5), (FAR, -20, 20, -20, 20), colours=colours)


def scan(scene, footprint=BEAM, sensor=AXIS, seed=0, effects=Effects(), **options):  # noqa: B008  # is frozen
    return scan_scene(scene, EAST, sensor, effects=replace(effects, footprint=footprint), rng=seed, **options)


def segment(offset):
    """Share of a disc's area on this side of a chord at `offset` radii from its middle."""
    d = np.clip(offset, -1, 1)
    return 1 - (np.arccos(d) - d * np.sqrt(1 - d**2)) / np.pi


def near_share(scanned, n_rays):
    """Share of each beam's rays that make an echo of the near plate."""
    return np.where(scanned.ranges < 2.5, scanned.truth.n_rays, 0) / n_rays


@pytest.mark.parametrize("n_rays", [16, 64, 196])
@pytest.mark.parametrize("offset", [-0.7, -0.4, 0.0, 0.25, 0.6, 0.85])
def test_an_edge_parts_a_beam_as_the_segment_of_its_circle(offset, n_rays):
    """To half the width of a ring of rays, which is what they resolve."""
    scanned = scan(plates(offset), replace(BEAM, n_rays=n_rays))
    half, share = 0.5 / np.sqrt(n_rays / 4), near_share(scanned, n_rays).mean()
    assert segment(offset - half) - 1e-9 <= share <= segment(offset + half) + 1e-9
    assert abs(share - segment(offset)) < {16: 0.1, 64: 0.03, 196: 0.01}[n_rays]
    echoes = scanned.echoes
    assert (echoes.n_rays + scanned.truth.n_rays.reshape(-1)[echoes.pixel] == n_rays).all()


def test_the_share_of_a_beam_at_any_edge_is_right_on_average_and_deviates_as_stated():
    offsets = np.linspace(-0.99, 0.99, 67)
    off = [near_share(scan(plates(d), seed=k), 16) - segment(d) for k, d in enumerate(offsets)]
    assert np.mean(off) == pytest.approx(0, abs=0.003)
    assert np.std(off) == pytest.approx(0.033, abs=0.003)


def test_two_plates_give_two_returns_with_the_light_of_their_parts():
    scanned = scan(plates(0.0, (0.8, 0.4)), effects=Effects(intensity=Intensity(reference_range_m=NEAR)))
    echoes = scanned.echoes
    assert np.array_equal(echoes.pixel, np.arange(1600))
    assert (echoes.number == 2).all()
    assert (echoes.count == 2).all()
    assert np.abs(scanned.ranges - NEAR).max() < 2e-5  # the beam's own curvature
    assert np.abs(echoes.ranges - FAR).max() < 2e-5
    white = [((c + 0.055) / 1.055) ** 2.4 for c in (0.8, 0.4)]  # sRGB
    share = scanned.truth.n_rays.reshape(-1) / 16
    assert scanned.intensity.reshape(-1) == pytest.approx(white[0] * share, rel=1e-4)
    assert echoes.intensity == pytest.approx(white[1] * (NEAR / FAR) ** 2 * (1 - share), rel=1e-4)


def test_returns_within_the_range_resolution_are_one_mixed_pixel():
    merged = scan(plates(0.2), replace(BEAM, range_resolution_m=1.5))
    mean = scan(plates(0.2), replace(BEAM, returns="mean"))
    assert len(merged.echoes) == 0
    assert np.array_equal(merged.ranges, mean.ranges)


def test_first_strongest_and_last_are_among_all():
    scene = sheets(
        (2.0, -1, 0.02, -1, 0.01), (2.6, -1, 0.1, -0.1, 1), (3.2, -9, 9, -9, 9), colours=(0.2, 0.6, 0.9)
    )
    wide = replace(BEAM, divergence_rad=0.05)
    everything = scan(scene, wide, IMAGE)
    for returns in ("first", "last", "strongest"):
        one = scan(scene, wide, IMAGE, returns=returns)
        best = everything.ranges.reshape(-1).copy()
        light, echoes = everything.intensity.reshape(-1).copy(), everything.echoes
        for pixel, reach, power in zip(echoes.pixel, echoes.ranges, echoes.intensity, strict=True):
            if returns == "last" or (returns == "strongest" and power > light[pixel]):
                best[pixel], light[pixel] = reach, power
        same = one.ranges.reshape(-1) == best
        assert same.mean() > (0.999 if returns == "strongest" else 1 - 1e-12)  # a tie of light
    assert everything.echoes.number.max() == 3


def hedge() -> Scene:
    """1500 triangular leaves of random place and way within a box 2 m deep, with nothing behind."""
    rng = np.random.default_rng(5)
    middle = rng.uniform((2.5, -1, -1), (4.5, 1, 1), (1500, 3))
    corners = (middle[:, None] + 0.06 * rng.standard_normal((1500, 3, 3)) / np.sqrt(3)).reshape(-1, 3)
    mesh = LabelledMesh(corners, np.arange(4500).reshape(-1, 3), np.zeros(1500, np.int32))
    return Scene(mesh, (None,), ("leaves",), "hedge", "object")


def slow_returns(ranges, resolution):
    """Ranges and numbers of rays of the returns of one beam, near to far."""
    hit = np.sort(ranges[np.isfinite(ranges)])
    parts = np.split(hit, np.flatnonzero(np.diff(hit) > resolution) + 1)
    return [(part.mean(), len(part)) for part in parts if len(part)]


def finely(scene, sensor, footprint, n_rays=4096):
    """Returns of each beam by a sunflower of rays, near to far."""
    radius = np.sqrt((np.arange(n_rays) + 0.5) / n_rays)[:, None]
    angle = np.pi * (3 - np.sqrt(5)) * np.arange(n_rays)[:, None]
    caster, found = scene.ray_caster(), []
    for along in EAST.rotate(sensor.projection.directions().reshape(-1, 3)):
        across = np.cross(along, (0.0, 0.0, 1.0))
        across /= np.linalg.norm(across)
        offset = radius * (np.cos(angle) * across + np.sin(angle) * np.cross(along, across))
        spread = np.tan(footprint.divergence_rad / 2)
        hits = caster.first_hit(footprint.exit_diameter_m / 2 * offset, along + spread * offset)
        found.append(slow_returns(hits.ranges, footprint.range_resolution_m))
    return found


def test_a_hedge_returns_as_fine_sampling_says():
    """Of n rays one meets a return that takes share s of a beam with a chance of 1 - (1 - s)^n to n s."""
    scene, sensor = hedge(), PinholeSensor(fov_deg=24, width=14, height=14)
    beam = replace(BEAM, divergence_rad=0.02, range_resolution_m=0.05)
    fine = finely(scene, sensor, beam)
    found = np.array([r for returns in fine for r, _ in returns])
    share = np.array([n / 4096 for returns in fine for _, n in returns])
    depths = np.linspace(2.4, 4.8, 25)
    for n_rays in (16, 64, 196):
        scanned = scan(scene, replace(beam, n_rays=n_rays), sensor)
        number = np.bincount(scanned.echoes.pixel, minlength=196) + scanned.valid.reshape(-1)
        assert (1 - (1 - share) ** n_rays).sum() <= number.sum() <= np.minimum(1, n_rays * share).sum()
        ranges = np.concatenate([scanned.ranges[scanned.valid], scanned.echoes.ranges])
        rays = np.concatenate([scanned.truth.n_rays[scanned.valid], scanned.echoes.n_rays]) / n_rays
        off = [rays[ranges < depth].sum() - share[found < depth].sum() for depth in depths]
        assert np.abs(off).max() / 196 < 3 * 0.5 / np.sqrt(n_rays * 196)
    large = np.array([sum(n >= 4096 / 196 for _, n in returns) for returns in fine])
    curves = [np.cumsum(np.bincount(n, minlength=20)) / 196 for n in (number, large)]
    assert np.abs(curves[0] - curves[1]).max() < 1.36 * np.sqrt(2 / 196)  # Kolmogorov and Smirnov, 5 %


def test_echoes_are_the_same_on_any_number_of_threads_and_in_any_blocks(monkeypatch):
    effects = Effects(dropout=Dropout(specular_loss=0.3), noise=ConstantNoise(constant_m=0.004))
    first = scan(before_wall(), sensor=IMAGE, effects=effects, n_threads=1)
    again = [scan(before_wall(), sensor=IMAGE, effects=effects, n_threads=2)]
    monkeypatch.setattr(module, "_RAYS", 480)
    again.append(scan(before_wall(), sensor=IMAGE, effects=effects))
    for other in again:
        assert other.ranges.tobytes() == first.ranges.tobytes()
        for name in ("pixel", "ranges", "intensity", "n_rays"):
            assert getattr(other.echoes, name).tobytes() == getattr(first.echoes, name).tobytes()


def test_each_echo_has_its_own_noise_and_the_image_that_of_first_returns():
    noisy = Effects(noise=ConstantNoise(constant_m=0.01))
    scanned = scan(plates(0.0), effects=noisy)
    first = scan(plates(0.0), replace(BEAM, returns="first"), effects=noisy)
    assert scanned.ranges.tobytes() == first.ranges.tobytes()
    errors = np.array([scanned.ranges.reshape(-1) - NEAR, scanned.echoes.ranges - FAR])
    assert errors.std(axis=1) == pytest.approx(0.01, rel=4 / np.sqrt(2 * 1600))
    assert abs(np.corrcoef(errors)[0, 1]) < 4 / np.sqrt(1600)


@pytest.mark.parametrize(
    ("colours", "sensor", "effects"),
    [
        ((0.02, 0.9), AXIS, Effects(dropout=Dropout(min_intensity=0.5))),
        ((0.5, 0.5), replace(AXIS, min_range_m=2.5), Effects(noise=ConstantNoise(constant_m=1e-3))),
    ],
)
def test_the_image_has_the_first_return_that_was_received(colours, sensor, effects):
    scanned = scan(plates(0.0, colours), sensor=sensor, effects=effects)
    assert len(scanned.echoes) == 0
    assert np.abs(scanned.ranges - FAR).max() < 6e-3
    assert scanned.truth.n_rays.mean() == pytest.approx(8, abs=0.1)


def test_further_returns_out_of_range_are_none():
    scanned = scan(plates(0.0), sensor=replace(AXIS, max_range_m=2.5))
    assert len(scanned.echoes) == 0
    assert np.abs(scanned.ranges - NEAR).max() < 2e-5


def test_all_returns_of_a_beam_lie_on_one_line_at_their_depths():
    wide, camera = replace(BEAM, divergence_rad=0.03), replace(AXIS, fov_deg=20)
    scanned = scan(plates(0.0), wide, camera, effects=Effects(pointing=PointingNoise(sd_px=3)))
    points, first = scanned.echo_points(), scanned.points().reshape(-1, 3)[scanned.echoes.pixel]
    assert len(points)
    assert np.linalg.norm(np.cross(points, first), axis=1).max() < 1e-9
    assert np.linalg.norm(points, axis=1) == pytest.approx(scanned.echoes.ranges)
    assert points[:, 0] == pytest.approx(FAR, abs=2e-3)  # a camera errs in its image plane


@pytest.mark.parametrize(
    ("footprint", "returns", "message"),
    [
        (None, "all", "all returns are those of a beam with width"),
        (replace(BEAM, returns="mean"), "last", "last returns: a phase scanner makes one range"),
    ],
)
def test_returns_that_an_instrument_does_not_tell_apart_are_refused(footprint, returns, message):
    with pytest.raises(InputError, match=message):
        scan(plates(0.0), footprint, returns=returns)


def test_other_numbers_of_rays_are_refused():
    with pytest.raises(InputError, match="n_rays must be one of 4, 16, 36, 64, 100, 144, 196, got 17"):
        Footprint(divergence_rad=0.001, n_rays=17)
