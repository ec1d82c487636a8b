# SPDX-License-Identifier: MIT
"""`python -m benchmarks.completion.quantities`: areas, thicknesses, openings and volumes of a duplex house.

The house is scanned from a station in each of its largest rooms, without doors and windows, completed, and
taken apart as for IFC. What is told is compared with the house's own elements: how many of how many
quantities are within 5 %.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from typing import Annotated

import numpy as np
import typer

from benchmarks.completion.ledger.sources import DATA
from benchmarks.completion.quantities.comparison import Pair, areas, openings, rooms, thicknesses, walls
from benchmarks.completion.quantities.elements import TrueBuilding
from benchmarks.completion.relations.building import station_places
from completion import CompletionOptions, complete
from completion.exchange.building.parts import BuildingParts
from nbv import PinholeSensor, scan_scene
from nbv.scanning.sensors.sensor import SphericalSensor
from scenes import RangeImage
from scenes.checks import FloatArray
from scenes.io.scene_files import open_scene
from scenes.pose import Pose

_PANORAMA = SphericalSensor(
    azimuth_span_deg=360.0, elevation_min_deg=-60.0, elevation_max_deg=60.0, width=1080, height=360,
    name="panorama", max_range_m=12.0,
)  # fmt: skip
_CAMERA = PinholeSensor(fov_deg=90.0, width=640, height=480, max_range_m=8.0, name="camera")
_SEEN = 0.5


def quantities(
    stations: Annotated[int, typer.Option("--stations", min=1, help="In the largest rooms.")] = 14,
    noise: Annotated[str, typer.Option("--noise", help="Of the scans.")] = "gaussian-2mm",
    sensor: Annotated[str, typer.Option("--sensor", help="panorama or camera (eight frames).")] = "panorama",
    listed: Annotated[bool, typer.Option("--list", help="Each quantity as well.")] = False,
) -> None:
    """Print the table."""
    truth = TrueBuilding.read(DATA / "buildings/duplex.npz")
    start = time.process_time()
    scans = list(house_scans(stations, noise, sensor))
    done = complete(scans, CompletionOptions(texture=False), rng=0)
    parts = done.building()
    print(f"{len(scans)} scans, {len(parts.faces)} planes, {time.process_time() - start:.0f} s of processors")
    measured = np.concatenate([scan.points()[scan.valid][::4] for scan in scans])
    print("| | within 5 % | of | told | off, median | 90 % |")
    print("|---|---|---|---|---|---|")
    for name, pairs in _groups(truth, parts, measured):
        print(_row(name, pairs), flush=True)
        for pair in pairs if listed else ():
            print(f"    {pair.kind}: {pair.said:.4f} of {pair.true:.4f}, seen {pair.seen:.2f}")


def _groups(
    truth: TrueBuilding, parts: BuildingParts, measured: FloatArray
) -> Iterator[tuple[str, list[Pair]]]:
    sides = list(truth.sides())
    found = list(areas(sides, parts, measured))
    yield "sides of walls, at least half seen, area", [pair for pair in found if pair.seen >= _SEEN]
    yield "sides of walls, less seen, area", [pair for pair in found if 0 < pair.seen < _SEEN]
    holes = list(openings(truth, parts))
    yield "openings between rooms, area", [pair for pair in holes if pair.kind == "inner"]
    yield "openings to the outside, area", [pair for pair in holes if pair.kind == "outer"]
    yield "walls seen from both sides, thickness", list(walls(truth, sides, parts, measured))
    told = list(thicknesses(truth, parts.bodies, np.random.default_rng(0)))
    yield "thicknesses told, of walls", [pair for pair in told if pair.kind == "wall"]
    yield "thicknesses told, of slabs", [pair for pair in told if pair.kind == "slab"]
    levels, volumes = zip(*rooms(truth, parts), strict=True)
    yield "rooms, floor area", list(levels)
    yield "rooms, volume", list(volumes)


def _row(name: str, pairs: Sequence[Pair]) -> str:
    found = [pair for pair in pairs if pair.said > 0]
    errors = np.array([pair.error for pair in found])
    told = " | ".join(f"{100 * np.quantile(errors, q):.2f} %" if len(errors) else "-" for q in (0.5, 0.9))
    return f"| {name} | {sum(pair.is_right for pair in pairs)} | {len(pairs)} | {len(found)} | {told} |"


def house_scans(n: int, noise: str, sensor: str) -> Iterator[RangeImage]:
    """Scans from the middle of rooms: a panorama in each, or eight frames of a camera."""
    scene = open_scene(DATA / "buildings/duplex.glb", up="y").without(("*Door*", "*Window*"))
    caster = scene.ray_caster()
    for k, place in enumerate(station_places(scene, n)):
        turns = (0.3,) if sensor == "panorama" else np.radians(20.0 + 45.0 * np.arange(8))
        for j, turn in enumerate(turns):
            down = 0.0 if sensor == "panorama" else (-0.35, 0.25)[j % 2]
            pose = Pose.looking_at(place, place + np.array([np.cos(turn), np.sin(turn), down]))
            chosen = _PANORAMA if sensor == "panorama" else _CAMERA
            yield scan_scene(scene, pose, chosen, noise=noise, rng=100 * k + j, truth=False, caster=caster)


if __name__ == "__main__":
    typer.run(quantities)
