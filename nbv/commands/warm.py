# SPDX-License-Identifier: MIT
"""Warming: every compiled loop is called once on a small room, so that no later command has to compile.

`python -m nbv.commands.warm` is part of the installation (`make demo`, `make install`). numba keeps what it
compiles beside the sources, or in `NUMBA_CACHE_DIR`; several may run at once.
"""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from PIL import Image

from nbv.commands.complete import CompleteRequest, run_complete
from nbv.commands.plan import PlanRequest, run_plan
from nbv.commands.process.run import Shared
from nbv.commands.scan import Stand, run_scan
from nbv.commands.texture import run_texture
from scenes.files.scan_request import ScanRequest

_ROOM = "builtin:two_occluders"
_SENSOR = """
kind = "pinhole"
name = "small"
fov_deg = 70.0
width = 64
height = 48
[footprint]
divergence_rad = 0.004
"""


def warm(folder: Path) -> None:
    """Scan, plan online and offline, complete and texture, with little to do; results go to `folder`."""
    sensor, scan, image = folder / "small.toml", folder / "scan.npz", folder / "noise.png"
    candidates = folder / "candidates.npz"
    sensor.write_text(_SENSOR)
    noise = np.random.default_rng(0).integers(0, 255, (24, 24, 3), np.uint8)
    Image.fromarray(noise).save(image)
    positions = np.array([[3.0, 1.0, 1.6], [1.0, 4.0, 1.0], [5.0, 1.0, 1.0]])
    np.savez(candidates, positions=positions, directions=np.vstack([np.eye(3), -np.eye(3)]))

    def shared(name: str) -> Shared:
        return Shared(
            out=folder / name, seed=0, as_json=False, quiet=True, threads=None, max_memory=None, limits={}
        )

    stand = Stand((1.0, 1.0, 1.5), (3.0, 3.0, 1.0), None)
    run_scan(
        shared("scan.npz"),
        _ROOM,
        stand=stand,
        sensor=str(sensor),
        noise="profile",
        truth=False,
        up="z",
        units="m",
    )
    run_texture(shared("grown.png"), str(image), mask=None, shape=(16, 16), window=5, order="paper")
    for method in ("nbv", "cover"):
        asked = PlanRequest(
            method=method, sensor=str(sensor), views=2, polish_steps=20, candidates=str(candidates)
        )
        run_plan(shared(method), _ROOM, asked)
    how = CompleteRequest(
        mode="standard", sigma_m=None, max_sd_m=0.02, registration_m=0.005, texture=True, edits=None
    )
    run_complete(shared("completed"), ScanRequest((str(scan),)), how)


if __name__ == "__main__":
    with TemporaryDirectory() as made:
        warm(Path(made))
