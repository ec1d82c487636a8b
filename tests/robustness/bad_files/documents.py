# SPDX-License-Identifier: MIT
"""Bad documents: images, poses, sensors, studies, plans, candidates and edits."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from completion.edits.file import read_edits
from nbv.commands.texture import read_image
from nbv.plan.plan import read_plan
from nbv.scanning.sensor_profile import load_sensor
from nbv.study.spec import read_study
from nbv.visibility.viewpoints import load_candidates
from scenes.io.describe import describe_image
from scenes.io.poses.trajectory import read_poses
from tests.robustness.bad_files.case import Case, Outcome, cut
from tests.robustness.bad_files.meshes import folder_called, png_bomb
from tests.robustness.bad_files.scans import BAD_ROTATIONS, npz_bomb, npz_with_shape, turned

SENSOR = 'kind = "pinhole"\nwidth = 32\nheight = 24\nfov_deg = 60.0\nmin_range_m = 0.5\nmax_range_m = 9.0\n'
STUDY = '[[scenes]]\nscene = "builtin:two_occluders"\n[[planners]]\nmethod = "nbv"\n'
POSE_LINE = "0 0 0 0 0 0 1\n"
EDITS: dict[str, Any] = {"edits": [{"do": "reject", "surface": [0.0, 0.0, 0.0]}]}
SCRIPT = b"#!/bin/sh\n"


def written(name: str, content: str | bytes) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)
        return folder / name

    return write


def picture(kind: str = "PNG", mode: str = "RGB") -> bytes:
    data = io.BytesIO()
    noise = np.random.default_rng(0).integers(0, 256, (60, 80, 3), dtype=np.uint8)
    Image.fromarray(noise).convert(mode).save(data, kind)
    return data.getvalue()


def look(path: Path | str) -> list[str]:
    read_image(str(path))
    return list(describe_image(Path(path))["warnings"])


def nothing(read: Callable[[Any], Any]) -> Callable[[Path | str], tuple[str, ...]]:
    def reads(path: Path | str) -> tuple[str, ...]:
        read(path)
        return ()

    return reads


READS: Mapping[str, tuple[str, str, Callable[[Path | str], Any]]] = {
    "poses .txt": ("a.txt", POSE_LINE * 3, nothing(read_poses)),
    "poses .log": ("a.log", ("0 0 0\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n") * 3, nothing(read_poses)),
    "poses .json": ("a.json", json.dumps([np.eye(4).tolist()] * 3), nothing(read_poses)),
    "COLMAP": ("images.txt", "1 1 0 0 0 1 2 3 1 a.png\n\n2 1 0 0 0 1 2 3 1 b.png\n\n", nothing(read_poses)),
    "TUM": ("a.tum", "".join(f"{k}.0 {POSE_LINE}" for k in range(3)), nothing(read_poses)),
    "sensor": ("a.toml", SENSOR, nothing(load_sensor)),
    "study": ("a.toml", STUDY, nothing(read_study)),
    "plan": ("plan.json", "{}", nothing(read_plan)),
    "edits": ("edits.json", json.dumps(EDITS), nothing(read_edits)),
}


def cases() -> Iterator[Case]:
    """All bad documents."""
    yield from image_cases()
    yield from text_cases()
    yield from pose_cases()
    yield from toml_cases()
    yield from json_cases()
    yield from candidate_cases()


def image_cases() -> Iterator[Case]:
    def case(kind: int, name: str, file: str, data: bytes, *expected: Outcome) -> Case:
        return Case(kind, "image", name, written(file, data), look, expected or ("refused",))

    for kind, suffix in (
        ("PNG", "png"),
        ("JPEG", "jpg"),
        ("TIFF", "tif"),
        ("BMP", "bmp"),
        ("WEBP", "webp"),
        ("PPM", "ppm"),
    ):
        for share in (0.02, 0.6):
            yield case(5, f"{kind} cut at {share:.0%}", f"a.{suffix}", cut(picture(kind), share))
    yield case(5, "0 bytes", "a.png", b"")
    yield case(5, "random bytes", "a.png", bytes(range(256)) * 8)
    yield case(5, "text", "a.png", b"not a picture")
    yield Case(5, "image", "a folder", partial(folder_called, name="a.png"), look)
    yield case(
        5, "a program of PostScript", "a.png", b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\nquit\n"
    )
    yield case(6, "60,000 x 60,000 in a few bytes", "a.png", png_bomb())
    yield case(6, "14,000 x 14,000 of one colour", "a.png", png_bomb(14_000, 14_000))
    yield case(2, "0 x 0 pixels", "a.png", png_bomb(0, 0))
    yield case(11, "16 bits where colours are meant", "a.png", picture("PNG", "I;16"))


def text_cases() -> Iterator[Case]:
    """What goes wrong with all texts."""
    for reader, (name, text, read) in READS.items():
        yield Case(5, reader, "0 bytes", written(name, b""), read)
        yield Case(5, reader, "random bytes", written(name, bytes(range(256)) * 8), read)
        yield Case(5, reader, "a folder", partial(folder_called, name=name), read)
        yield Case(5, reader, "cut short", written(name, text[: int(len(text) * 0.55)] + "x"), read)
        if name.endswith(".json"):
            yield Case(6, reader, "nested 100,000 deep", written(name, "[" * 100_000), read)
            yield Case(6, reader, "objects nested 100,000 deep", written(name, '{"a":' * 100_000), read)
            yield Case(
                6, reader, "a number of 5,000 digits", written(name, '{"views": [' + "9" * 5000 + "]}"), read
            )
            yield Case(5, reader, "another kind of JSON", written(name, '"text"'), read)
            yield Case(1, reader, "NaN", written(name, '{"views": NaN, "edits": NaN}'), read)
            yield Case(
                1, reader, "infinity as 1e999", written(name, '{"views": 1e999, "edits": 1e999}'), read
            )
        if name.endswith(".toml"):
            yield Case(6, reader, "nested 100,000 deep", written(name, "a = " + "[" * 100_000), read)
            yield Case(6, reader, "2 MB", written(name, "#" * 2_000_000), read)


def pose_cases() -> Iterator[Case]:
    lines = {"poses .txt": "a.txt", "TUM": "a.tum", "COLMAP": "images.txt"}
    rows = {
        "poses .txt": "0 0 0 {0}\n", "TUM": "1.0 0 0 0 {0}\n", "COLMAP": "1 {0} 1 2 3 1 a.png\n\n",
    }  # fmt: skip
    for reader, name in lines.items():
        read = READS[reader][2]
        for words, quaternion in (("length 3", "0 0 0 3"), ("length 0", "0 0 0 0")):
            yield Case(
                10, reader, f"a quaternion of {words}", written(name, rows[reader].format(quaternion)), read
            )
        yield Case(
            1, reader, "a quaternion that is NaN", written(name, rows[reader].format("nan 0 0 1")), read
        )
        place = (
            rows[reader]
            .format("0 0 0 1")
            .replace("0 0 0 0 0 0 1", "inf 0 0 0 0 0 1")
            .replace(" 1 2 3 ", " inf 2 3 ")
        )
        yield Case(1, reader, "a place that is infinite", written(name, place), read)
    for words, matrix in BAD_ROTATIONS.items():
        held = turned(matrix)
        kind = 1 if words == "not finite" else 10
        block = "0 0 0\n" + "".join(" ".join(map(str, row)) + "\n" for row in held)
        yield Case(
            kind, "poses .log", f"a pose that is {words}", written("a.log", block), READS["poses .log"][2]
        )
        if kind == 10:
            text = json.dumps([held])
            yield Case(
                10, "poses .json", f"a pose that is {words}", written("a.json", text), READS["poses .json"][2]
            )
    upside = json.dumps([np.array(turned(np.eye(3))).T.tolist(), (np.eye(4) + np.eye(4, k=-3)).tolist()])
    yield Case(
        10, "poses .json", "a pose that is transposed", written("a.json", upside), READS["poses .json"][2]
    )
    yield Case(
        10,
        "poses .log",
        "a matrix of three columns",
        written("a.log", "0 0 0\n" + "1 0 0\n" * 4),
        READS["poses .log"][2],
    )


def toml_cases() -> Iterator[Case]:
    def sensor(kind: int, name: str, old: str, new: str) -> Case:
        return Case(kind, "sensor", name, written("a.toml", SENSOR.replace(old, new)), READS["sensor"][2])

    yield sensor(1, "an angle that is NaN", "60.0", "nan")
    yield sensor(1, "a range that is infinite", "0.5", "inf")
    yield sensor(4, "an angle of 600 degrees", "60.0", "600.0")
    yield sensor(4, "a nearest range beyond the farthest", "0.5", "50.0")
    yield sensor(
        6, "an image of 10^9 x 10^9", "width = 32\nheight = 24", "width = 1000000000\nheight = 1000000000"
    )
    yield sensor(9, "no pixel", "width = 32", "width = 0")
    yield sensor(5, "an unknown entry", "fov_deg", "fow_deg")
    yield sensor(5, "a number as text", "60.0", '"60"')

    def study(kind: int, name: str, old: str, new: str) -> Case:
        return Case(kind, "study", name, written("a.toml", STUDY.replace(old, new)), READS["study"][2])

    for place in ("../room.glb", "/etc/room.glb", "C:\\\\room.glb"):
        yield study(7, f"a scene {place}", "builtin:two_occluders", place)
    yield study(7, "a sensor ../a.toml", "[[planners]]", '[[sensors]]\nsensor = "../a.toml"\n[[planners]]')
    yield study(1, "a target that is NaN", '"nbv"', '"nbv"\ntarget = nan')
    yield study(6, "10^12 seeds", "[[scenes]]", "seeds = 1000000000000\n[[scenes]]")
    yield study(2, "no planner", '[[planners]]\nmethod = "nbv"\n', "")
    yield study(5, "an unknown planner", '"nbv"', '"best"')


def json_cases() -> Iterator[Case]:
    def edits(kind: int, name: str, held: Any) -> Case:
        return Case(kind, "edits", name, written("edits.json", json.dumps(held)), READS["edits"][2])

    yield edits(5, "an unknown action", {"edits": [{"do": "burn", "surface": [0, 0, 0]}]})
    yield edits(3, "a surface that is not listed", {"edits": [{"do": "reject", "surface": 9}]})
    yield edits(
        9,
        "an outline of two corners",
        {"edits": [{"do": "reject", "surface": [0, 0, 0], "outline": [[0, 0, 0]] * 2}]},
    )
    yield edits(
        9,
        "a plane without direction",
        {"edits": [{"do": "end", "surface": [0, 0, 0], "plane": {"point": [0, 0, 0], "normal": [0, 0, 0]}}]},
    )
    yield edits(2, "no list of edits", {"edits": None})
    view = {"world_from_sensor": np.eye(4).tolist(), "gain_m2": 1.0, "met_fraction": 0.5}
    whole = {
        "method": "nbv", "sensor": {"kind": "pinhole", "width": 32, "height": 24, "fov_deg": 60.0},
        "requirement": {"max_incidence_deg": 60.0, "target": 0.9}, "seed": 0,
        "n_candidates": 9, "views": [view],
        "coverage": None, "lower_bound": None, "stopped_because": "done",
    }  # fmt: skip

    def plan(kind: int, name: str, **changes: Any) -> Case:
        return Case(
            kind, "plan", name, written("plan.json", json.dumps({**whole, **changes})), READS["plan"][2]
        )

    yield Case(5, "plan", "sound", written("plan.json", json.dumps(whole)), READS["plan"][2], ("read",))
    yield plan(5, "views that are a number", views=5)
    yield plan(5, "a seed that is a word", seed="many")
    yield plan(5, "a requirement of another kind", requirement={"target": 0.9, "speed": 1})
    yield plan(6, "a sensor of 10^9 x 10^9", sensor={**whole["sensor"], "width": 10**9, "height": 10**9})  # type: ignore[dict-item]
    for name, matrix in BAD_ROTATIONS.items():
        if name != "not finite":
            yield plan(10, f"a view that is {name}", views=[{**view, "world_from_sensor": turned(matrix)}])


def candidate_cases() -> Iterator[Case]:
    read = nothing(load_candidates)
    places, ways = np.zeros((4, 3)), np.eye(3)

    def case(kind: int, name: str, **held: Any) -> Case:
        def write(folder: Path) -> Path:
            np.savez(folder / "c.npz", allow_pickle=True, **{"positions": places, "directions": ways, **held})
            return folder / "c.npz"

        return Case(kind, "candidates", name, write, read)

    yield case(1, "a position that is NaN", positions=places * np.nan)
    yield case(1, "a direction that is NaN", directions=ways * np.nan)
    yield case(2, "no position", positions=places[:0])
    yield case(8, "positions in rows of four", positions=np.zeros((3, 4)))
    yield case(9, "directions without length", directions=ways * 0)
    yield case(4, "an aperture of 500 degrees", half_angle_deg=500.0)
    yield case(16, "positions that are objects", positions=np.full((4, 3), None))
    yield Case(6, "candidates", "300 MB of zeros in 300 KB", npz_bomb, read)
    yield Case(6, "candidates", "a header announcing 10^12 numbers", npz_with_shape, read)
    for share in (0.1, 0.6, 0.95):

        def shortened(folder: Path, share: float = share) -> Path:
            np.savez(folder / "c.npz", positions=places, directions=ways)
            (folder / "c.npz").write_bytes(cut((folder / "c.npz").read_bytes(), share))
            return folder / "c.npz"

        yield Case(5, "candidates", f"cut at {share:.0%}", shortened, read)
    yield Case(
        16, "candidates", "a bare pickle", written("c.npz", b"\x80\x04cos\nsystem\n(S'true'\ntR."), read
    )
