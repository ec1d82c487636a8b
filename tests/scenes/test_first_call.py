# SPDX-License-Identifier: MIT
"""First call: a package loads what it needs for what is done, and no large library before."""

import subprocess
import sys

import pytest

HEAVY = (
    "scipy.spatial",
    "scipy.optimize",
    "scipy.ndimage",
    "scipy.special",
    "scipy.sparse",
    "scipy.stats",
    "trimesh",
    "numba",
    "cv2",
    "skimage",
    "matplotlib",
    "pydantic",
)


@pytest.mark.parametrize("module", ["scenes.io.scan_files", "scenes.io.describe", "texture.surface_fill"])
def test_no_large_library_loads_before_it_is_needed(module):
    code = f"import sys, {module}; print([name for name in {HEAVY} if name in sys.modules])"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"
