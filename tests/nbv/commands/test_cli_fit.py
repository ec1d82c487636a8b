# SPDX-License-Identifier: MIT
"""`unseen fit`: the contract of its JSON, every shape and metric, units, files, and failures in one line."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from nbv.cli import app
from tests.helpers.data_paths import data_path, requires_data
from tests.helpers.long_cases import first_in_gate

SIGMA = 0.001
N = 3000
KEYS = ["shape", "parameters", "standard_deviation", "rms", "n"]


def run(*arguments):
    return CliRunner().invoke(app, ["fit", *(str(argument) for argument in arguments)])


def fitted(*arguments):
    result = run(*arguments)
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def cloud(shape):
    """Points of a known surface in an oblique pose, with noise along the normal."""
    rng = np.random.default_rng(3)
    angle, height = rng.uniform(-1.2, 1.2, N), rng.uniform(-1, 1, N)
    noise = rng.normal(0, SIGMA, N)
    level = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(N)])
    if shape == "plane":
        points = np.column_stack([angle, height, noise])
    elif shape == "sphere":
        slope = np.sqrt(1 - height**2)
        points = (0.6 + noise)[:, None] * np.column_stack([slope * level[:, 0], slope * level[:, 1], height])
    elif shape == "torus":
        tube = rng.uniform(-2, 1, N)
        reach = 0.6 + (0.2 + noise) * np.cos(tube)
        points = np.column_stack([level[:, :2] * reach[:, None], (0.2 + noise) * np.sin(tube)])
    elif shape == "elliptic-cylinder":
        angle = rng.uniform(-np.pi, np.pi, N)
        normal = np.column_stack([np.cos(angle) / 0.6, np.sin(angle) / 0.4])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        section = np.column_stack([0.6 * np.cos(angle), 0.4 * np.sin(angle)]) + noise[:, None] * normal
        points = np.column_stack([section, height])
    else:
        tilt = np.radians(15) if shape == "cone" else 0.0
        radius = 0.6 + np.tan(tilt) * height + noise * np.cos(tilt)
        points = level * radius[:, None]
        points[:, 2] = height - noise * np.sin(tilt)
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    return points @ turn.T + [1.0, -2.0, 0.5]


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("clouds")
    shapes = ("plane", "sphere", "cylinder", "elliptic-cylinder", "cone", "torus")
    for shape in shapes:
        np.savetxt(folder / f"{shape}.xyz", cloud(shape), fmt="%.9f")
    return {shape: folder / f"{shape}.xyz" for shape in shapes}


EXPECTED = {
    "plane": ["point", "normal"],
    "sphere": ["centre", "radius"],
    "cylinder": ["point", "direction", "radius"],
    "cone": ["point", "direction", "radius", "half_angle_deg"],
    "torus": ["centre", "direction", "radius", "tube_radius"],
}


@pytest.mark.parametrize("shape", first_in_gate(3, EXPECTED))
@pytest.mark.parametrize("asked", ["same", "auto"])
def test_the_contract_of_the_json(files, shape, asked):
    held = fitted(files[shape], "--shape", shape if asked == "same" else "auto")
    assert list(held)[:5] == KEYS
    assert held["shape"] == shape
    assert [name for name in held["parameters"] if name in EXPECTED[shape]] == EXPECTED[shape]
    assert held["n"] == N
    assert held["rms"] == pytest.approx(SIGMA, rel=4 / np.sqrt(2 * N))
    deviation = held["standard_deviation"]
    assert all(0 < value < 0.1 for value in deviation.values()), deviation
    if "radius" in held["parameters"] and shape != "cone":
        assert abs(held["parameters"]["radius"] - 0.6) < 4 * deviation["radius"] + SIGMA**2
    if shape == "cone":
        assert abs(held["parameters"]["half_angle_deg"] - 15) < 4 * deviation["half_angle_deg"]


@pytest.mark.long
def test_evidence_is_told_and_undecidable_is_an_answer(files, tmp_path):
    evidence = fitted(files["sphere"])["evidence"]
    assert evidence["sphere"] == 1
    assert all(ratio > 20 for shape, ratio in evidence.items() if shape != "sphere")
    assert fitted(files["sphere"], "--shape", "sphere")["evidence"] is None
    patch = np.random.default_rng(4).uniform(-1, 1, (12, 3)) * [1, 1, 0.05]
    np.savetxt(tmp_path / "few.xyz", patch)
    result = run(tmp_path / "few.xyz")
    assert result.exit_code == 1
    assert "undecidable" in result.stderr
    assert "name the shape" in result.stderr


def test_correlated_residuals_are_told_apart_from_independent_ones(files, tmp_path):
    independent = fitted(files["cylinder"], "--shape", "cylinder")
    assert 1 <= independent["inflation"] < 2
    points = np.loadtxt(files["cylinder"])
    waves = 3 * SIGMA * np.sin(9 * points @ [1.0, 0.7, 0.4])[:, None]
    away = points - points.mean(axis=0)
    np.savetxt(tmp_path / "wavy.xyz", points + waves * away / np.linalg.norm(away, axis=1, keepdims=True))
    held = fitted(tmp_path / "wavy.xyz", "--shape", "cylinder")
    assert held["inflation"] > 5
    ratio = held["standard_deviation_correlated"]["radius"] / held["standard_deviation"]["radius"]
    assert ratio == pytest.approx(np.sqrt(held["inflation"]))


def test_elliptic_cylinder(files):
    held = fitted(files["elliptic-cylinder"], "--shape", "elliptic-cylinder")
    assert held["shape"] == "elliptic-cylinder"
    np.testing.assert_allclose(
        [held["parameters"][f"{name}_radius"] for name in ("greater", "smaller")],
        [0.6, 0.4],
        atol=6 * SIGMA / np.sqrt(N / 10),
    )


def test_given_values_are_held_and_told(files):
    free = fitted(files["cylinder"], "--shape", "cylinder")
    axis = ",".join(f"{number:.17g}" for number in free["parameters"]["direction"])
    held = fitted(files["cylinder"], "--shape", "cylinder", "--radius", 0.6, "--axis", axis)
    assert held["parameters"]["radius"] == 0.6
    assert held["parameters"]["direction"] == free["parameters"]["direction"]
    assert held["held"] == ["direction", "radius"]
    assert free["held"] == []
    assert (held["standard_deviation"]["radius"], held["standard_deviation"]["direction"]) == (0, 0)
    assert 0 < held["standard_deviation"]["point"] < free["standard_deviation"]["point"]
    assert held["options"]["radius"] == 0.6


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--shape", "auto", "--radius", 1], "name it in place of auto"),
        (["--shape", "plane", "--radius", 1], "a plane has no one radius to be given"),
        (["--shape", "sphere", "--axis", "0,0,1"], "a sphere has no axis to be given"),
        (["--shape", "cylinder", "--radius", -1], "radius must be a positive number of metres, got -1"),
        (["--shape", "cylinder", "--axis", "0,0,0"], "axis has length 0"),
        (["--shape", "cylinder", "--radius", 1, "--metric", "taubin"], "held by Euclidean fits alone"),
    ],
)
def test_what_cannot_be_given_is_one_line(files, words, message):
    result = run(files["cylinder"], *words)
    assert result.exit_code == 1
    assert message in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1


def test_an_axis_of_two_numbers_is_a_wrong_option(files):
    assert run(files["cylinder"], "--shape", "cylinder", "--axis", "0,1").exit_code == 2


@pytest.mark.parametrize("metric", ["euclidean", "taubin", "algebraic"])
def test_metrics_are_told_apart(files, metric):
    held = fitted(files["elliptic-cylinder"], "--shape", "elliptic-cylinder", "--metric", metric)
    assert held["options"]["metric"] == metric
    np.testing.assert_allclose(
        [held["parameters"][f"{name}_radius"] for name in ("greater", "smaller")], [0.6, 0.4], atol=0.02
    )


def test_robust_fits_what_most_points_say(files, tmp_path):
    rng = np.random.default_rng(7)
    points = np.loadtxt(files["cylinder"])
    strangers = rng.uniform(points.min(axis=0), points.max(axis=0), (N * 3 // 7, 3))
    np.savetxt(tmp_path / "mixed.xyz", rng.permutation(np.vstack([points, strangers])), fmt="%.9f")
    plain = run(tmp_path / "mixed.xyz", "--shape", "cylinder")
    robust = fitted(tmp_path / "mixed.xyz", "--shape", "cylinder", "--robust")
    assert plain.exit_code or abs(json.loads(plain.stdout)["parameters"]["radius"] - 0.6) > 0.003
    assert abs(robust["parameters"]["radius"] - 0.6) < 5 * robust["standard_deviation"]["radius"]


def test_units_are_those_of_the_file(files):
    metres = fitted(files["cylinder"], "--shape", "cylinder")
    inches = fitted(files["cylinder"], "--shape", "cylinder", "--units", "in")
    for one in ("parameters", "standard_deviation"):
        assert inches[one]["radius"] == pytest.approx(0.0254 * metres[one]["radius"], rel=1e-9)
    assert inches["rms"] == pytest.approx(0.0254 * metres["rms"], rel=1e-9)


@pytest.mark.long
def test_the_same_bytes_every_time_and_quiet_is_silent(files):
    once, again = run(files["sphere"], "--json"), run(files["sphere"])
    assert once.stdout == again.stdout
    assert run(files["sphere"], "--quiet").stdout == ""


def test_output_file_and_manifest(files, tmp_path):
    out = tmp_path / "fit.json"
    held = fitted(files["plane"], "--shape", "plane", "-o", out, "--json")
    assert json.loads(out.read_text()) == held
    manifest = json.loads((tmp_path / "fit.json.manifest.json").read_text())
    assert manifest["command"] == "fit"
    assert manifest["options"]["shape"] == "plane"
    assert manifest["inputs"][0]["bytes"] == files["plane"].stat().st_size


def test_warnings_of_reading_are_told(files, tmp_path):
    (tmp_path / "holes.xyz").write_text(files["plane"].read_text() + "nan nan nan\n")
    held = fitted(tmp_path / "holes.xyz", "--shape", "plane")
    assert held["n"] == N
    assert held["warnings"] == [f"1 of {N + 1} points are not finite or lie beyond 1e12 m and were left out"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("1 2 3\n4 x 6\n", ["bad.xyz: line 2: 'x' is no number"]),
        ("0 0 0\n1 1 1\n2 2 2\n3 3 3\n4 4 4\n5 5 5\n6 6 6\n7 7 7\n", ["bad.xyz", "line"]),
        ("1 2 3\n" * 20, ["bad.xyz"]),
        ("1 2 3\n", ["bad.xyz", "1"]),
    ],
)
@pytest.mark.parametrize(
    "shape", ["plane", "sphere", "cylinder", "cone", "elliptic-cylinder", "torus", "auto"]
)
def test_unusable_input_is_one_line_and_exit_code_1(tmp_path, text, words, shape):
    (tmp_path / "bad.xyz").write_text(text)
    result = run(tmp_path / "bad.xyz", "--shape", shape)
    assert result.exit_code == 1, result.output
    assert result.stdout == ""
    assert len(result.stderr.strip().splitlines()) == 1
    for word in words:
        assert word in result.stderr


def test_missing_files_and_unknown_options(tmp_path):
    result = run(tmp_path / "none.xyz")
    assert result.exit_code == 1
    assert "none.xyz: no such file" in result.stderr
    (tmp_path / "a.xyz").write_text("1 2 3\n")
    assert run(tmp_path / "a.xyz", "--shape", "ellipsoid").exit_code == 2
    assert run(tmp_path / "a.xyz", "--metric", "manhattan").exit_code == 2
    assert run(tmp_path / "a.xyz", "-o", tmp_path).exit_code == 1


def nist(folder, file):
    fit_file = data_path(f"fitting/nist_l2/{folder}/{file}.fit")
    return [float(word) for word in fit_file.read_text().split()], fit_file.with_suffix(".ds")


@requires_data
@pytest.mark.parametrize("number", [1, 11, 29])
def test_certified_cylinders_and_spheres_of_nist(number):
    certified, points = nist("Cylinder", f"cyl{number}")
    held = fitted(points, "--shape", "cylinder", "--units", "mm")
    assert held["parameters"]["radius"] == pytest.approx(certified[6] / 2000, rel=1e-9)
    certified, points = nist("Sphere", f"sph{number}")
    held = fitted(points, "--shape", "sphere", "--units", "mm")
    assert held["parameters"]["radius"] == pytest.approx(certified[3] / 2000, rel=1e-9)


def test_errors_along_the_rays_of_a_scan(tmp_path):
    """Range noise at oblique incidence: along its rays the radius is right, orthogonally it is too small."""
    angle, height = np.radians(np.linspace(-80, 80, 200)), np.linspace(-0.1, 0.1, 40)
    angle, height = (grid.ravel() for grid in np.meshgrid(angle, height))
    points = np.column_stack([0.06 * np.cos(angle), 0.06 * np.sin(angle), height])
    origin = np.array([3.0, 0, 0])
    rays = (points - origin) / np.linalg.norm(points - origin, axis=1, keepdims=True)
    points += rays * np.random.default_rng(2).normal(0, 0.003, (len(points), 1))
    np.savetxt(tmp_path / "pipe.xyz", points, fmt="%.7f")
    plain = fitted(tmp_path / "pipe.xyz", "--shape", "cylinder")
    along = fitted(tmp_path / "pipe.xyz", "--shape", "cylinder", "--origin", "3,0,0")
    u = along["standard_deviation"]["radius"]
    assert abs(along["parameters"]["radius"] - 0.06) < 4 * u
    assert abs(plain["parameters"]["radius"] - 0.06) > 4 * u
    assert along["rms"] == pytest.approx(0.003, rel=0.05)
    assert along["options"]["rays"]
    assert not plain["options"]["rays"]
    result = run(tmp_path / "pipe.xyz", "--shape", "cylinder", "--rays")
    assert result.exit_code == 1
    assert "pipe.xyz does not tell where the scanner stood; give --origin X,Y,Z" in result.stderr


@pytest.mark.long
@requires_data
def test_rays_of_a_real_scan_come_from_its_file():
    pytest.importorskip("pye57")
    held = fitted(data_path("range/e57/pumpA.e57"), "--shape", "plane", "--robust", "--rays")
    assert held["options"]["rays"]
    assert abs(held["parameters"]["normal"][2]) > 0.99  # the floor
