# SPDX-License-Identifier: MIT
"""`unseen warm`: every compiled loop is made and stored, so that no later command has to compile.

The loops are called once on a small room. numba keeps what it compiles beside the sources, or in
`NUMBA_CACHE_DIR`; several may run at once.
"""

from __future__ import annotations

import os
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import numpy as np
from PIL import Image

from completion.observe.tiles import solve_plane
from nbv.commands.complete import run_complete
from nbv.commands.options.planning import PlanOptions, ScanOptions
from nbv.commands.options.scans import CompleteOptions, TextureOptions
from nbv.commands.options.shared import NoOptions, Shared
from nbv.commands.plan import run_plan
from nbv.commands.process import start_run
from nbv.commands.scan import run_scan
from nbv.commands.texture import run_texture
from nbv.run.plan_options import SearchOptions
from nbv.visibility.site import find_site
from scenes.checks import InputError
from scenes.io.scene_files import open_scene

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


def run_warm(shared: Shared, _: NoOptions) -> None:
    """Compile what completion needs and what planning needs, side by side with two threads or more."""
    with start_run("warm", shared, default=os.devnull, is_folder=False, writes=False) as run:
        loop: Any = solve_plane
        store = loop.stats.cache_path
        if store is None:
            raise InputError(
                "numba found no folder that it can store compiled code in; set NUMBA_CACHE_DIR to one"
            )
        parts = (warm_completion, warm_planning)
        n_processes = min(shared.threads or os.cpu_count() or 1, len(parts))
        with (
            TemporaryDirectory() as folder,
            ProcessPoolExecutor(n_processes, mp_context=get_context("spawn")) as pool,
        ):
            run.progress("compile", 0, len(parts))
            for n_done, part in enumerate(as_completed([pool.submit(part, Path(folder)) for part in parts])):
                part.result()
                run.progress("compile", n_done + 1, len(parts))
        run.say({"folder": store}, [f"compiled loops are stored, as in {store}"])


def warm_completion(folder: Path) -> None:
    """Scan a room, complete the scan, taken twice, with texture, and fill an image, with little to do."""
    image = folder / "noise.png"
    noise = np.random.default_rng(0).integers(0, 255, (24, 24, 3), np.uint8)
    Image.fromarray(noise).save(image)
    sensor = _sensor(folder / "scanning.toml")
    scan = ScanOptions(
        scene=_ROOM, at=(1.0, 1.0, 1.5), look=(3.0, 3.0, 1.0), sensor=sensor, noise="profile", truth=False
    )
    run_scan(_shared_options(folder / "scan.npz"), scan)
    scans = (str(folder / "scan.npz"),) * 2
    run_complete(_shared_options(folder / "completed"), CompleteOptions(scans=scans, up="z"))
    run_texture(
        _shared_options(folder / "grown.png"), TextureOptions(image=str(image), grow=(16, 16), window=5)
    )


def warm_planning(folder: Path) -> None:
    """Plan two views online, by a criterion of the literature, and offline."""
    find_site(open_scene(_ROOM))
    candidates = folder / "candidates.npz"
    positions = np.array([[3.0, 1.0, 1.6], [1.0, 4.0, 1.0], [5.0, 1.0, 1.0]])
    np.savez(candidates, positions=positions, directions=np.vstack([np.eye(3), -np.eye(3)]))
    sensor = _sensor(folder / "planning.toml")
    methods: tuple[Literal["nbv", "online:frontier", "cover"], ...] = ("nbv", "online:frontier", "cover")
    for method in methods:
        search = SearchOptions(method=method, views=2, polish_steps=20)
        asked = PlanOptions(scene=_ROOM, search=search, sensor=sensor, candidates=str(candidates))
        run_plan(_shared_options(folder / method.replace(":", "-")), asked)


def _sensor(path: Path) -> str:
    """Write a small sensor's profile and return where."""
    path.write_text(_SENSOR)
    return str(path)


def _shared_options(out: Path) -> Shared:
    return Shared(out=out, quiet=True)
