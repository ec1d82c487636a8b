# SPDX-License-Identifier: MIT
"""Scripts of docs/recipes: each is named by a page, and those whose program is here run in it."""

import os
import shutil
import subprocess
from pathlib import Path

import ezdxf
import numpy as np
import pytest
import trimesh
from PIL import Image

from tests.helpers.data_paths import ROOT

SCRIPTS = sorted((ROOT / "examples/recipes").glob("*.py"))
PAGES = {page.stem: page.read_text("utf-8") for page in (ROOT / "docs/recipes").glob("*.md")}


def has_qgis():
    """Whether the system's Python knows QGIS."""
    return any(Path("/usr/lib/python3/dist-packages/qgis").glob("core*"))


def run(*words):
    """What a program prints, in an environment of its own Python."""
    inherited = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    done = subprocess.run(
        [str(word) for word in words],
        env=inherited | {"QT_QPA_PLATFORM": "offscreen", "LIBGL_ALWAYS_SOFTWARE": "1"},
        capture_output=True,
        text=True,
        timeout=180,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


@pytest.mark.parametrize(
    "script", [*SCRIPTS, ROOT / "examples/ros2_next_view.py"], ids=lambda path: path.stem
)
def test_each_script_is_named_by_a_page(script):
    compile(script.read_text("utf-8"), script.name, "exec")
    assert any(script.relative_to(ROOT).as_posix() in text for text in PAGES.values())


def test_each_page_shows_marks_and_pictures_that_are_small():
    assert all("**Marks" in text for name, text in PAGES.items() if name != "ros2")
    pictures = list((ROOT / "docs/pictures").glob("recipe_*.png"))
    assert pictures
    assert all(picture.stat().st_size < 120_000 for picture in pictures)


@pytest.mark.long
@pytest.mark.skipif(not (shutil.which("blender") and shutil.which("xvfb-run")), reason="there is no Blender")
def test_blender_tells_inferred_objects_from_measured_ones(tmp_path):
    scene = trimesh.Scene()
    for name, extents in (("observed 1 plane", (3, 2, 0)), ("hypothesised 1 plane", (1, 2, 0))):
        x, y, _ = extents
        square = trimesh.Trimesh([[0, 0, 0], [x, 0, 0], [x, y, 0], [0, y, 0]], [[0, 1, 2], [0, 2, 3]])
        scene.add_geometry(square, node_name=name, geom_name=name)
    scene.export(tmp_path / "completed.glb")
    said = run(
        *("xvfb-run", "-a", "blender", "-b", "--factory-startup"),
        *("--python", ROOT / "examples/recipes/blender_picture.py", "--"),
        *(tmp_path / "completed.glb", tmp_path / "room.png", "1,-4,1", "1,0,1"),
    )
    assert "1 of 2 objects inferred, 2.00 of 8.00 m2" in said
    with Image.open(tmp_path / "room.png") as picture:
        assert len(np.unique(np.asarray(picture.convert("RGB")).reshape(-1, 3), axis=0)) > 1
    assert (tmp_path / "room.blend").is_file()


@pytest.mark.long
@pytest.mark.skipif(not has_qgis(), reason="there is no QGIS")
def test_qgis_reads_the_layers_of_a_plan(tmp_path):
    drawing = ezdxf.new("R2010")
    space = drawing.modelspace()
    for layer, end in (("PLAN-MEASURED", 4.0), ("PLAN-INFERRED", 1.5), ("SECTION-MEASURED", 9.0)):
        space.add_polyline3d([(0, 0, 1.1), (end, 0, 1.1)], dxfattribs={"layer": layer})
    space.add_polyline3d([(0, 0, 1.1), (0, 1, 1.1)], dxfattribs={"layer": "PLAN-MEASURED"})
    drawing.saveas(tmp_path / "completed.dxf")
    script = ROOT / "examples/recipes/qgis_plan.py"
    said = run("/usr/bin/python3", script, tmp_path / "completed.dxf", tmp_path / "plan.png")
    assert "PLAN-MEASURED: 2 lines, 5.00 m" in said
    assert "PLAN-INFERRED: 1 lines, 1.50 m" in said
    assert (tmp_path / "plan.png").is_file()
