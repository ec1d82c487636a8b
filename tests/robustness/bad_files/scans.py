# SPDX-License-Identifier: MIT
"""Bad scan files: whole ones of every format, and what is done to them; RGB-D folders of all four layouts."""

from __future__ import annotations

import io
import json
import os
import struct
import zipfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from PIL import Image

from scenes.io.clouds.e57 import _CHECKSUM, _PAGE
from scenes.io.describe import scan_warnings
from scenes.io.scan_files import read_scans, write_scan
from scenes.pose import Pose
from scenes.scan.convention import convention_doubt
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage
from tests.helpers.scan_examples import PROJECTIONS, example_scan
from tests.robustness.bad_files.case import Case, Outcome, cut
from tests.robustness.bad_files.meshes import folder_called, png_bomb

FORMATS = ("npz", "ply", "pcd", "ptx", "e57", "las", "laz", "xyz")
CAMERA = PinholeProjection(32, 24, 30.0, 30.0, 15.5, 11.5)
Change = Callable[[bytes], bytes]


def read(path: Path | str, **how: Any) -> list[str]:
    scans = read_scans(path, **how)
    found = [text for scan in scans for text in scan_warnings(scan)]
    return [*found, *filter(None, [convention_doubt(scans)])]


@cache
def whole(suffix: str) -> bytes:
    """A sound scan file."""
    return written(suffix, example_scan(PROJECTIONS["pinhole"]))


def written(suffix: str, scan: RangeImage) -> bytes:
    with TemporaryDirectory() as folder:
        write_scan(scan, Path(folder, f"a.{suffix}"))
        return Path(folder, f"a.{suffix}").read_bytes()


def spoilt(suffix: str, change: Change) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        (folder / f"a.{suffix}").write_bytes(change(whole(suffix)))
        return folder / f"a.{suffix}"

    return write


def scan_of(suffix: str, change: Callable[[RangeImage], RangeImage]) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        write_scan(change(example_scan(PROJECTIONS["pinhole"])), folder / f"a.{suffix}")
        return folder / f"a.{suffix}"

    return write


def arrays(change: Callable[[dict[str, Any]], None], **how: Any) -> Callable[[Path], Path]:
    """A scan of ours whose arrays are changed; the header is a dict meanwhile."""

    def write(folder: Path) -> Path:
        with np.load(io.BytesIO(whole("npz"))) as stored:
            held: dict[str, Any] = {name: stored[name].copy() for name in stored.files}
        held["header"] = json.loads(str(held["header"]))
        change(held)
        if isinstance(held.get("header"), dict):
            held["header"] = np.array(json.dumps(held["header"]))
        np.savez(folder / "a.npz", **held, **how)
        return folder / "a.npz"

    return write


def setting(name: str, value: Any) -> Callable[[dict[str, Any]], None]:
    return lambda held: held.__setitem__(name, value)


def in_header(name: str, value: Any) -> Callable[[dict[str, Any]], None]:
    return lambda held: held["header"].__setitem__(name, value)


def turned(matrix: Any) -> list[list[float]]:
    pose = np.eye(4)
    pose[:3, :3] = matrix
    return pose.tolist()


BAD_ROTATIONS = {
    "scaled by 1.5": np.eye(3) * 1.5,
    "left-handed": np.diag([1.0, 1.0, -1.0]),
    "sheared": np.eye(3) + np.eye(3, k=1) * 0.2,
    "not finite": np.eye(3) * np.nan,
}


def npz_cases() -> Iterator[Case]:
    shape = PROJECTIONS["pinhole"].shape

    def case(kind: int, name: str, change: Callable[[dict[str, Any]], None], *expected: Outcome) -> Case:
        return Case(kind, "npz", name, arrays(change), read, expected or ("refused",))

    yield case(1, "all ranges NaN", setting("ranges", np.full(shape, np.nan)), "warned")
    yield case(1, "a sigma of infinity", in_header("sigma_m", 1e999))
    yield case(2, "no return", setting("ranges", np.full(shape, np.inf)), "warned")
    yield case(2, "no rows", setting("ranges", np.zeros((0, 31))))
    yield case(2, "no header", lambda held: held.pop("header") and None)
    yield case(
        4,
        "ranges in millimetres",
        lambda held: held.__setitem__("ranges", held["ranges"] * 1000),
        "warned",
        "refused",
    )
    yield case(
        4, "micrometres as metres", lambda held: held.__setitem__("ranges", held["ranges"] / 1e6), "warned"
    )
    yield case(8, "rows and columns of the ranges swapped", lambda h: h.__setitem__("ranges", h["ranges"].T))
    yield case(8, "a flat list of ranges", lambda h: h.__setitem__("ranges", h["ranges"].ravel()))
    one = {"kind": "pinhole", "width": 1, "height": 1, "fx": 1.0, "fy": 1.0, "cx": 0.0, "cy": 0.0}

    def single(held: dict[str, Any]) -> None:
        held["header"]["projection"] = one
        held["ranges"], held["colour"] = np.ones((1, 1)), np.zeros((1, 1, 3), np.float32)

    yield case(9, "one pixel", single, "read")
    yield case(9, "a focal length of zero", in_header("projection", {**one, "fx": 0.0}))
    for name, matrix in BAD_ROTATIONS.items():
        yield case(10, f"a pose that is {name}", in_header("world_from_sensor", turned(matrix)))
    yield case(10, "a pose of 3 x 4", in_header("world_from_sensor", np.eye(4)[:3].tolist()))
    yield case(11, "some ranges negative", lambda h: h["ranges"].__setitem__((0, slice(5)), -2.0), "warned")
    yield case(11, "all ranges negative", lambda h: h.__setitem__("ranges", -np.abs(h["ranges"])))
    yield Case(
        16, "npz", "a header that is an object",
        arrays(setting("header", np.array([{"x": 1}], dtype=object)), allow_pickle=True), read,
    )  # fmt: skip
    yield Case(
        16, "npz", "colours that are objects", arrays(setting("colour", np.full((23, 31, 3), None))), read
    )
    yield Case(
        16, "npz", "a bare pickle", spoilt("npz", lambda _: b"\x80\x04cos\nsystem\n(S'true'\ntR."), read
    )
    yield Case(6, "npz", "a header announcing 10^12 numbers", npz_with_shape, read)
    yield Case(6, "npz", "300 MB of zeros in 300 KB", npz_bomb, read)
    yield Case(
        6, "npz", "a header nested 100,000 deep", arrays(setting("header", np.array("[" * 100_000))), read
    )
    yield Case(
        6,
        "npz",
        "a size in 5,000 digits",
        arrays(setting("header", np.array('{"a": ' + "9" * 5000 + "}"))),
        read,
    )


def npz_with_shape(folder: Path) -> Path:
    head = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000, 1000000), }".ljust(117) + b"\n"
    with zipfile.ZipFile(folder / "a.npz", "w") as archive:
        archive.writestr("ranges.npy", b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head + bytes(80))
        archive.writestr("header.npy", b"")
    return folder / "a.npz"


def npz_bomb(folder: Path) -> Path:
    with zipfile.ZipFile(folder / "a.npz", "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        archive.writestr("header.npy", b"")
        with archive.open("ranges.npy", "w") as stream:
            for _ in range(300):
                stream.write(bytes(1 << 20))
    return folder / "a.npz"


def e57_xml(change: Change) -> Change:
    """Change the XML of an E57 file, and put sound checksums and lengths about it."""
    from tests.robustness.bad_files.e57_pages import with_xml

    return lambda data: with_xml(data, change, _PAGE, _CHECKSUM)


def format_cases() -> Iterator[Case]:
    for suffix in FORMATS:
        reader = "text" if suffix == "xyz" else suffix
        for share in (0.05, 0.5, 0.99):
            yield Case(5, reader, f"cut at {share:.0%}", spoilt(suffix, lambda d, s=share: cut(d, s)), read)
        yield Case(5, reader, "0 bytes", spoilt(suffix, lambda _: b""), read)
        yield Case(5, reader, "random bytes", spoilt(suffix, lambda _: bytes(range(256)) * 8), read)
        yield Case(5, reader, "a folder", lambda f, s=suffix: folder_called(f, f"a.{s}"), read)
        yield Case(
            4, reader, "millimetres",
            scan_of(suffix, lambda scan: replace(scan, ranges=scan.ranges * 1000)), read, ("warned",),
        )  # fmt: skip
    mine = example_scan(PROJECTIONS["pinhole"])
    far = Pose.from_parts(mine.world_from_sensor.rotation, np.array([4.5e5, 5.4e6, 100.0]))
    for suffix in FORMATS:
        reader = "text" if suffix == "xyz" else suffix
        yield Case(
            4, reader, "a station at UTM's 5,400 km",
            scan_of(suffix, lambda scan: replace(scan, world_from_sensor=far)), read, ("read",),
        )  # fmt: skip
    nothing = np.full(mine.shape, np.inf)
    for suffix in ("npz", "ply", "pcd", "ptx"):
        yield Case(
            2, suffix, "no return in any pixel",
            scan_of(suffix, lambda scan: replace(scan, ranges=nothing)), read, ("warned", "refused"),
        )  # fmt: skip


def text_cases() -> Iterator[Case]:
    def case(kind: int, reader: str, name: str, change: Change, *expected: Outcome) -> Case:
        suffix = "xyz" if reader == "text" else reader
        return Case(kind, reader, name, spoilt(suffix, change), read, expected or ("refused",))

    def first_row(data: bytes, row: bytes, start: int) -> bytes:
        lines = data.split(b"\n")
        lines[start] = row + b" " + b" ".join(lines[start].split()[3:])
        return b"\n".join(lines)

    yield case(1, "text", "a point that is NaN", lambda d: first_row(d, b"nan 0 0", 2), "warned")
    yield case(
        1, "text", "a point that is infinite", lambda d: first_row(d, b"inf 0 0", 2), "warned", "refused"
    )
    yield case(1, "ptx", "a transform that is NaN", lambda d: d.replace(d.split(b"\n")[9], b"nan 0 0 1"))
    yield case(1, "pcd", "a VIEWPOINT that is NaN", lambda d: d.replace(b"VIEWPOINT ", b"VIEWPOINT nan "))
    for suffix in ("las", "laz"):
        for words, number in (("NaN", np.nan), ("infinite", np.inf), ("zero", 0.0)):
            packed = struct.pack("<d", number)
            kind = 9 if number == 0 else 1
            yield case(kind, suffix, f"a step that is {words}", lambda d, p=packed: d[:131] + p + d[139:])
        yield case(
            1, suffix, "an offset that is NaN", lambda d: d[:155] + struct.pack("<d", np.nan) + d[163:]
        )
    yield case(1, "ptx", "a point that is NaN", lambda d: first_row(d, b"nan 0 0", 12), "warned")
    yield case(
        2, "e57", "no point announced", e57_xml(lambda x: x.replace(b'recordCount="572"', b'recordCount="0"'))
    )
    yield case(5, "ptx", "more columns announced", lambda d: b"999\n" + d.partition(b"\n")[2])
    yield case(5, "ptx", "columns that are words", lambda d: b"many\n" + d.partition(b"\n")[2])
    yield case(5, "pcd", "more points announced", lambda d: d.replace(b"POINTS 713", b"POINTS 714"))
    yield case(5, "pcd", "a field of three bytes", lambda d: d.replace(b"SIZE 4", b"SIZE 3"))
    yield case(5, "ply", "more points announced", lambda d: d.replace(b"vertex 713", b"vertex 714"))
    yield case(5, "ply", "the other byte order", lambda d: d.replace(b"little", b"big"))
    yield case(5, "las", "more points announced", lambda d: d[:247] + struct.pack("<Q", 10**6) + d[255:])
    yield case(5, "laz", "more points announced", lambda d: d[:247] + struct.pack("<Q", 10**6) + d[255:])
    yield case(6, "las", "10^15 points announced", lambda d: d[:247] + struct.pack("<Q", 10**15) + d[255:])
    yield case(6, "laz", "10^15 points announced", lambda d: d[:247] + struct.pack("<Q", 10**15) + d[255:])
    yield case(6, "ptx", "10^9 x 10^9 points announced", lambda d: b"1000000000\n" * 2 + d.split(b"\n", 2)[2])
    yield case(6, "pcd", "10^9 x 10^9 points announced", pcd_of_size(b"1000000000", b"1000000000"))
    yield case(
        6, "pcd", "a field counted 10^12 times", lambda d: d.replace(b"COUNT 1", b"COUNT 1000000000000")
    )
    yield case(
        6, "ply", "10^12 points announced", lambda d: d.replace(b"vertex 713", b"vertex 1000000000000")
    )
    yield case(
        6,
        "text",
        "a header nested 100,000 deep",
        lambda d: b"# unseen " + b"[" * 100_000 + b"\n" + d.split(b"\n", 1)[1],
    )
    yield case(
        6,
        "text",
        "an image of 10^5 x 10^5",
        lambda d: d.replace(b'"width": 31', b'"width": 100000').replace(b'"height": 23', b'"height": 100000'),
    )
    yield case(
        6,
        "e57",
        "10^12 points announced",
        e57_xml(lambda x: x.replace(b'recordCount="', b'recordCount="1000000000')),
    )
    yield case(6, "e57", "entities that double 30 times", e57_xml(laughing_xml))
    yield case(
        6,
        "e57",
        "elements 100,000 deep",
        e57_xml(lambda x: x.replace(b"<guid", b"<a>" * 100_000 + b"<guid", 1)),
    )
    yield case(5, "e57", "XML that is cut", e57_xml(lambda x: x[: len(x) // 2]))
    yield case(7, "e57", "an entity that names a file", e57_xml(naming_xml))
    yield case(8, "pcd", "WIDTH and HEIGHT swapped", pcd_foreign(b"23", b"31"), "warned")
    yield case(8, "pcd", "HEIGHT 1 without VIEWPOINT", pcd_foreign(b"713", b"1"))
    yield case(8, "ptx", "rows and columns swapped", ptx_swapped, "warned")
    yield case(8, "e57", "no rows and columns, no pose", e57_xml(without_grid))
    yield case(8, "las", "no rows and columns", lambda d: d.replace(b"unseen", b"others"))
    yield case(8, "laz", "no rows and columns", lambda d: d.replace(b"unseen", b"others"))
    yield case(8, "text", "no rows and columns", lambda d: d.split(b"\n", 2)[2])
    yield case(8, "ply", "no grid", lambda d: d.replace(b"comment unseen", b"comment others"))
    yield case(8, "text", "a pixel twice", lambda d: d + d.strip().rsplit(b"\n", 1)[1] + b"\n")
    for name, factor in (("scaled", b"1.5 0 0 0"), ("left-handed", b"-1 0 0 0")):
        yield case(10, "ptx", f"a transform that is {name}", ptx_transform(factor))
    yield case(
        10, "pcd", "a VIEWPOINT of length 3", lambda d: d.replace(viewpoint(d), b"VIEWPOINT 0 0 0 3 0 0 0")
    )
    yield case(10, "e57", "a quaternion of length 3", e57_xml(long_quaternion))
    yield case(10, "ply", "a pose that is left-handed", header_pose)
    yield case(10, "text", "a pose that is left-handed", header_pose)


def viewpoint(data: bytes) -> bytes:
    return next(line for line in data.split(b"\n") if line.startswith(b"VIEWPOINT"))


def pcd_of_size(width: bytes, height: bytes) -> Change:
    def change(data: bytes) -> bytes:
        data = data.replace(b"WIDTH 31", b"WIDTH " + width).replace(b"HEIGHT 23", b"HEIGHT " + height)
        return data.replace(b"POINTS 713", b"POINTS %d" % (int(width) * int(height)))

    return change


def pcd_foreign(width: bytes, height: bytes) -> Change:
    """A file without our comments, and without a place."""

    def change(data: bytes) -> bytes:
        data = pcd_of_size(width, height)(data).replace(b"# unseen ", b"# others ")
        return data.replace(viewpoint(data), b"VIEWPOINT 0 0 0 1 0 0 0")

    return change


def ptx_swapped(data: bytes) -> bytes:
    columns, rows, rest = data.split(b"\n", 2)
    return rows + b"\n" + columns + b"\n" + rest


def ptx_transform(first: bytes) -> Change:
    def change(data: bytes) -> bytes:
        lines = data.split(b"\n")
        lines[6:10] = [first, b"0 1 0 0", b"0 0 1 0", b"0 0 0 1"]
        return b"\n".join(lines)

    return change


def header_pose(data: bytes) -> bytes:
    """Mirror the pose in a header in comments: the sign of its first number is turned."""
    key = b'"world_from_sensor": [['
    at = data.index(key) + len(key)
    return data[:at] + (data[at + 1 :] if data[at : at + 1] == b"-" else b"-" + data[at:])


def laughing_xml(xml: bytes) -> bytes:
    lines = [b'<!ENTITY a0 "ha">'] + [b'<!ENTITY a%d "&a%d;&a%d;">' % (k + 1, k, k) for k in range(30)]
    return xml.replace(b"<e57Root", b"<!DOCTYPE e57Root [" + b"".join(lines) + b"]>\n<e57Root", 1)


def naming_xml(xml: bytes) -> bytes:
    doctype = b'<!DOCTYPE e57Root [<!ENTITY x SYSTEM "file:///etc/hostname">]>\n<e57Root'
    return xml.replace(b"<e57Root", doctype, 1)


def without_grid(xml: bytes) -> bytes:
    import re

    xml = re.sub(rb"<pose .*?</pose>", b"", xml, flags=re.DOTALL)
    return xml.replace(b"rowIndex", b"rowOther").replace(b"columnIndex", b"columnOther")


def long_quaternion(xml: bytes) -> bytes:
    import re

    return re.sub(rb"<w type=\"Float\">[^<]*</w>|<w type=\"Float\"/>", b'<w type="Float">3</w>', xml, count=1)


def cases() -> Iterator[Case]:
    """All bad scan files."""
    yield from npz_cases()
    yield from format_cases()
    yield from text_cases()
    yield from folder_cases()


def fill(folder: Path, poses: Sequence[Pose] | None = None, scale: float = 1000.0, **camera: Any) -> Path:
    """A plain RGB-D folder of three frames before a wall with a step."""
    inside = folder / "frames"
    for name in ("color", "depth"):
        (inside / name).mkdir(parents=True)
    given = poses or stations()
    for k, pose in enumerate(stations(), start=1):
        depth = depth_from(pose)
        Image.fromarray(np.rint(depth * scale).astype(np.uint16)).save(inside / "depth" / f"{k}.png")
        Image.new("RGB", (CAMERA.width, CAMERA.height), (9, 99, 9)).save(inside / "color" / f"{k}.png")
    held = {name: getattr(CAMERA, name) for name in ("fx", "fy", "cx", "cy")}
    (inside / "camera.json").write_text(json.dumps({**held, "depth_scale": 1000.0, **camera}))
    write_poses(inside / "pose.txt", given)
    return inside


def stations() -> list[Pose]:
    return [Pose.looking_at((0.4 * k, -4 + 0.5 * k, 1.2), (0.1 * k, 0, 1.0)) for k in range(3)]


def write_poses(path: Path, poses: Sequence[Pose]) -> None:
    from scenes.io.poses.trajectory import write_poses as write

    write(path, poses)


def depth_from(pose: Pose) -> Any:
    """The z-depth of the wall y = 0, and of a step of 0.8 m before it where x > 0.3."""
    rays = CAMERA.directions()
    in_world = pose.rotate(rays)
    wall, step = (-(pose.translation[1] + before) / in_world[..., 1] for before in (0.0, 0.8))
    across = pose.translation[0] + step * in_world[..., 0]
    return np.where(across > 0.3, step, wall) * rays[..., 2]


def folder_cases() -> Iterator[Case]:
    def case(
        kind: int, name: str, write: Callable[[Path], Path | str], *expected: Outcome, **how: Any
    ) -> Case:
        return Case(kind, "RGB-D", name, write, lambda p: read(p, **how), expected or ("refused",))

    def with_depth(values: Any) -> Callable[[Path], Path]:
        def write(folder: Path) -> Path:
            inside = fill(folder)
            Image.fromarray(values).save(inside / "depth" / "2.tif")
            (inside / "depth" / "2.png").unlink()
            return inside

        return write

    def with_text(name: str, text: str) -> Callable[[Path], Path]:
        def write(folder: Path) -> Path:
            inside = fill(folder)
            (inside / name).write_text(text)
            return inside

        return write

    def with_bytes(name: str, data: bytes) -> Callable[[Path], Path]:
        def write(folder: Path) -> Path:
            inside = fill(folder)
            (inside / name).write_bytes(data)
            return inside

        return write

    def with_link(name: str) -> Callable[[Path], Path]:
        def write(folder: Path) -> Path:
            inside = fill(folder)
            (inside / name).rename(folder / "secret.png")
            os.symlink(folder / "secret.png", inside / name)
            return inside

        return write

    shape = CAMERA.shape
    opengl = Pose(np.diag([1.0, -1, -1, 1]))
    yield case(1, "depths that are NaN", with_depth(np.full(shape, np.nan, np.float32)), "warned")
    yield case(1, "a focal length NaN", with_text("camera.json", '{"fx": NaN, "fy": 1, "cx": 1, "cy": 1}'))
    yield case(2, "no depth image", lambda f: folder_called(f, "frames"))
    yield case(2, "depths that are all zero", with_depth(np.zeros(shape, np.uint16)), "warned")
    yield case(5, "a depth image cut short", with_bytes("depth/2.png", cut(depth_png(), 0.5)))
    yield case(5, "a depth image of 0 bytes", with_bytes("depth/2.png", b""))
    yield case(5, "a depth image of another size", with_depth(np.ones((9, 9), np.uint16)))
    yield case(5, "a camera file cut short", with_text("camera.json", '{"fx": 1'))
    yield case(5, "a camera file nested 100,000 deep", with_text("camera.json", "[" * 100_000))
    yield case(6, "a depth image of 60,000 x 60,000", with_bytes("depth/2.png", png_bomb()))
    yield case(6, "a colour image of 60,000 x 60,000", with_bytes("color/2.png", png_bomb()))
    yield case(7, "a depth image that is a link outside", with_link("depth/2.png"))
    yield case(7, "a colour image that is a link outside", with_link("color/1.png"))
    for name in ("../secret.png", "/etc/hostname", "color/../../secret.png"):
        row = f"1.0 {name} 1.0 depth/1.png\n"
        yield case(7, f"associations.txt names {name}", with_text("associations.txt", row))
        listed = {"root": [{"depth_image": name, "rgb_image": "color/1.png", "info": {}}]}
        yield case(7, f"frames.json names {name}", with_text("frames.json", json.dumps(listed)))
    swapped = {"cx": CAMERA.cy, "cy": CAMERA.cx}
    yield case(8, "the principal point swapped", lambda f: fill(f, **swapped), "warned")
    yield case(8, "width and height swapped", lambda f: fill(f, width=24, height=32))
    for name, matrix in BAD_ROTATIONS.items():
        poses = json.dumps([turned(matrix)] * 3)
        yield case(10, f"poses that are {name}", lambda f, t=poses: replaced_poses(f, t))
    yield case(10, "OpenGL's poses", lambda f: fill(f, [one @ opengl for one in stations()]), "warned")
    yield case(10, "poses the other way", lambda f: fill(f, [one.inverse() for one in stations()]), "warned")
    yield case(10, "two poses for three frames", lambda f: fill(f, stations()[:2]))
    yield case(11, "depth of 8 bits", with_bytes("depth/2.png", depth_png(np.uint8)))
    yield case(11, "8-bit depth in 16 bits", with_depth(np.full(shape, 200, np.uint16)), "warned")
    yield case(11, "depths that are negative", with_depth(np.full(shape, -2.0, np.float32)))
    yield case(11, "metres for millimetres", fill, "warned", depth_scale=1.0)
    yield case(11, "a scale of a million", fill, "warned", depth_scale=1e6)
    yield case(11, "a scale of zero", fill, depth_scale=0.0)
    yield case(11, "a scale of NaN", fill, depth_scale=float("nan"))


def replaced_poses(folder: Path, text: str) -> Path:
    inside = fill(folder)
    (inside / "pose.txt").unlink()
    (inside / "poses.json").write_text(text)
    return inside


def depth_png(kind: Any = np.uint16) -> bytes:
    data = io.BytesIO()
    Image.fromarray((np.arange(CAMERA.width * CAMERA.height).reshape(CAMERA.shape) % 250).astype(kind)).save(
        data, "PNG"
    )
    return data.getvalue()
