# SPDX-License-Identifier: MIT
"""Valid files of scans, points and poses, small and written by the project itself; always the same bytes."""

from __future__ import annotations

import io
import json
import re
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from scenes.io.poses.trajectory import write_poses, write_timed_poses
from scenes.io.scan_files import write_scan, write_scans
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection, SphericalProjection
from scenes.scan.range_image import RangeImage
from tests.helpers.scan_examples import POSE, example_scan
from tests.robustness.fuzzing.case import Case, case_of
from tests.robustness.fuzzing.e57_pages import payload, with_xml

CAMERA = PinholeProjection(14, 12, 13.0, 13.5, 6.5, 5.5)
PANORAMA = SphericalProjection(np.linspace(2.4, -2.4, 13), np.linspace(-0.7, 0.6, 11))
POSES = [POSE, Pose.looking_at((1, 2, 1.5), (4, 3, 1)), Pose.looking_at((0, 0, 1), (0, 4, 2))]


def made(make: Callable[[Path], object], entry: str) -> Case:
    """Return what `make` writes into a folder."""
    with tempfile.TemporaryDirectory() as folder:
        return case_of(make, Path(folder), entry)


def scan_files(suffix: str) -> list[Case]:
    """A pinhole scan with colour, a panorama off its rays with intensity."""
    light = np.random.default_rng(1).random(PANORAMA.shape).astype(np.float32)
    panorama = example_scan(PANORAMA, colour=False, off_rays_m=1e-3)
    panorama = RangeImage(
        panorama.ranges,
        PANORAMA,
        panorama.world_from_sensor,
        sensor_points=panorama.sensor_points,
        intensity=light,
    )
    truth = suffix == ".npz"
    scans = [example_scan(CAMERA, truth=truth), panorama]
    return [
        made(lambda folder, scan=scan: write_scan(scan, folder / f"s{suffix}"), f"s{suffix}")
        for scan in scans
    ]


def world_points() -> np.ndarray:
    """Points as a scanner at the origin of `POSE` saw them."""
    scan = example_scan(CAMERA)
    return scan.points()[scan.valid]


def tenth_mm_npz() -> Case:
    """Ranges in tenths of a millimetre, as benchmark files hold them."""
    scan = example_scan(CAMERA)
    ranges = np.where(scan.valid, scan.ranges * 1e4, 0).astype(np.uint32)
    data = io.BytesIO()
    np.savez(
        data,
        range_tenth_mm=np.stack([ranges, ranges]),
        world_from_sensor=np.stack([POSES[0].matrix, POSES[1].matrix]),
        intrinsics=np.array([13.0, 13.5, 6.5, 5.5]),
    )
    return Case({"s.npz": data.getvalue()}, "s.npz")


def points_npz() -> Case:
    """Points with normals."""
    points, data = world_points()[:40], io.BytesIO()
    np.savez(data, points=points, normals=np.broadcast_to([0.0, 0, 1], points.shape))
    return Case({"p.npz": data.getvalue()}, "p.npz")


def pcd_files(encoding: str) -> list[Case]:
    """Clouds of PCL: organised with colour, and unorganised with a viewpoint and normals."""
    from pypcd4 import Encoding, PointCloud

    scan = example_scan(CAMERA, colour=False)
    organised = scan.points_in_sensor().reshape(-1, 3).astype(np.float32)
    rgb = np.arange(len(organised), dtype=np.uint32).view(np.float32)
    loose = organised[np.isfinite(organised).all(axis=1)]
    cases = []
    for points, more, shape in (
        (organised, (rgb,), (CAMERA.width, CAMERA.height)),
        (loose, tuple(np.broadcast_to(np.float32([0, 0, -1]), loose.shape).T), (len(loose), 1)),
    ):
        names = ["x", "y", "z", *(["rgb"] if len(more) == 1 else ["normal_x", "normal_y", "normal_z"])]
        cloud = PointCloud.from_points([*points.T, *more], names, [np.float32] * len(names))
        viewpoint = (1.0, 2.0, 1.5, 0.0, 1.0, 0.0, 0.0)
        cloud.metadata = cloud.metadata.derive(width=shape[0], height=shape[1], viewpoint=viewpoint)
        data = io.BytesIO()
        cloud.save(data, Encoding(encoding))
        cases.append(Case({"s.pcd": data.getvalue()}, "s.pcd"))
    return cases


def sweep_files() -> list[Case]:
    """Sweeps of a lidar with four beams: KITTI's and nuScenes' columns."""
    turn, up = np.meshgrid(np.linspace(-3.1, 3.1, 60), [-0.3, -0.1, 0.1, 0.3])
    rays = np.stack([np.cos(up) * np.cos(turn), np.cos(up) * np.sin(turn), np.sin(up)], axis=-1)
    table = np.concatenate([4.0 * rays, 0.5 + 0 * turn[..., None]], axis=-1).reshape(-1, 4)
    ring = np.repeat(np.arange(4.0), 60)[:, None]
    tables = {"s.bin": table, "s.pcd.bin": np.hstack([table, ring])}
    return [Case({name: held.astype("<f4").tobytes()}, name) for name, held in tables.items()]


def vtk_files() -> list[Case]:
    """A legacy cloud with normals and colours, as text and binary."""
    points = world_points()[:30]
    cases = []
    for is_text in (True, False):

        def numbers(values: np.ndarray, form: str, is_text: bool = is_text) -> bytes:
            if is_text:
                return " ".join(f"{value:.4f}" for value in values.ravel()).encode() + b"\n"
            return values.astype(form).tobytes() + b"\n"

        data = b"".join([
            b"# vtk DataFile Version 3.0\ncloud\n", b"ASCII" if is_text else b"BINARY",
            b"\nDATASET POLYDATA\nPOINTS 30 float\n", numbers(points, ">f4"),
            b"POINT_DATA 30\nNORMALS n float\n", numbers(np.tile([0.0, 0, 1], (30, 1)), ">f4"),
            b"COLOR_SCALARS c 3\n", numbers(np.ones((30, 3)), "u1"),
        ])  # fmt: skip
        cases.append(Case({"p.vtk": data}, "p.vtk"))
    return cases


def e57_files() -> list[Case]:
    """Two structured scans, and an unstructured cloud with a pose as pye57 itself writes it."""
    import pye57

    scans = [example_scan(CAMERA), example_scan(PANORAMA, off_rays_m=1e-3)]
    local = POSE.inverse().apply(world_points())
    fields = {f"cartesian{axis}": np.ascontiguousarray(local[:, k]) for k, axis in enumerate("XYZ")}

    def loose(folder: Path) -> None:
        with pye57.E57(str(folder / "s.e57"), mode="w") as file:
            file.write_scan_raw(
                fields | {"intensity": np.linspace(0, 1, len(local))},
                rotation=[1.0, 0, 0, 0],
                translation=POSE.translation,
            )

    cloud = made(loose, "s.e57")
    fixed = with_xml(payload(cloud.files["s.e57"]), _without_chance)
    return [
        made(lambda folder: write_scans(scans, folder / "s.e57"), "s.e57"),
        made(lambda folder: write_scans(scans[:1], folder / "s.e57"), "s.e57"),
        Case({"s.e57": fixed}, "s.e57"),
    ]


def _without_chance(xml: bytes) -> bytes:
    """The XML without identifiers drawn at random and the time of day."""
    xml = re.sub(rb"\{[0-9a-fA-F-]{36}\}", b"{00000000-0000-0000-0000-000000000000}", xml)
    return re.sub(rb"(<dateTimeValue[^>]*[^/]>)[^<]*", rb"\g<1>0", xml)


def las_files(suffix: str) -> list[Case]:
    """Ours with colour and records, and a plain file of another point format."""
    import laspy

    points = world_points()

    def plain(folder: Path) -> None:
        header = laspy.LasHeader(point_format=3, version="1.2")
        header.creation_date, header.offsets, header.scales = None, points.mean(axis=0), np.full(3, 1e-3)
        data = laspy.LasData(header)
        data.x, data.y, data.z = points.T
        data.red = np.arange(len(points), dtype=np.uint16)
        data.write(
            str(folder / f"s{suffix}"), do_compress=suffix == ".laz", laz_backend=laspy.LazBackend.Lazrs
        )

    return [*scan_files(suffix), made(plain, f"s{suffix}")]


def text_files() -> list[Case]:
    """Text of ours, and of others: separators, names, normals, decimal commas, announced counts."""
    points = world_points()[:30]
    rows = [" ".join(f"{value:.4f}" for value in row) for row in points.tolist()]
    texts = {
        "p.xyz": "\n".join(rows),
        "p.csv": "X [m];Y [m];Z [m];name\n" + "\n".join(row.replace(" ", ";") + ";a" for row in rows),
        "p.txt": "# nx ny nz\n" + "\n".join(f"{row} 0 0 1" for row in rows),
        "q.txt": "\n".join(row.replace(".", ",").replace(" ", ";") for row in rows),
        "p.pts": f"{len(rows)}\n" + "\n".join(rows),
        "p.asc": "x,y,z,nx,ny,nz\r\n" + "\r\n".join(",".join([*row.split(), "0", "0", "1"]) for row in rows),
    }
    cases = [Case({name: text.encode()}, name) for name, text in texts.items()]
    return [*scan_files(".csv"), *scan_files(".xyz"), *cases]


def rgbd_folders(layout: str) -> list[Case]:
    """A folder of two frames in a layout."""
    scans = [example_scan(CAMERA, pose=pose, seed=k) for k, pose in enumerate(POSES[:2])]
    if layout == "align3d":
        return [_align3d(made(lambda folder: write_scans(scans, folder / "f"), "f"))]
    case = made(lambda folder: write_scans(scans, folder / "f", layout=layout), "f")  # type: ignore[arg-type]
    return [case, _with_camera_text(case)]


def _with_camera_text(case: Case) -> Case:
    """The same folder whose camera is told by numbers in a text file."""
    files = {name: data for name, data in case.files.items() if not name.endswith("camera.json")}
    return Case(files | {"f/camera.txt": b"13.0 13.5 6.5 5.5 1000\n"}, "f")


def _align3d(case: Case) -> Case:
    """The same images with a frames.json."""
    root = [
        {
            "depth_image": f"depth/{k + 1:05d}.png",
            "rgb_image": f"color/{k + 1:05d}.png",
            "info": {
                "rt_cam": {"matrix": pose.matrix.tolist()},
                "kcam": {"matrix": [[13.0, 0, 6.5], [0, 13.5, 5.5], [0, 0, 1]], "image_size": [14, 12]},
                "depth_scale": 1e-4,
            },
        }
        for k, pose in enumerate(POSES[:2])
    ]
    images = {name: data for name, data in case.files.items() if name.endswith(".png")}
    return Case(images | {"f/frames.json": json.dumps({"root": root}).encode()}, "f")


def pose_files() -> list[Case]:
    """Trajectories in every form."""
    blocks = "".join(
        f"{k} {k} {k + 1}\n" + "".join(" ".join(map(repr, row)) + "\n" for row in pose.matrix.tolist())
        for k, pose in enumerate(POSES)
    )
    colmap = "# images\n1 0.5 0.5 0.5 0.5 1 2 3 1 a 1.png\n1 2 3\n2 1 0 0 0 1 2 3 1 b.png\n\n"
    texts = {
        "t.log": blocks,
        "t.json": json.dumps([pose.matrix.tolist() for pose in POSES]),
        "p.json": json.dumps({"views": [{"world_from_sensor": pose.matrix.tolist()} for pose in POSES]}),
        "images.txt": colmap,
    }
    return [
        made(lambda folder: write_poses(folder / "pose.txt", POSES), "pose.txt"),
        made(lambda folder: write_timed_poses(folder / "tum.txt", [0.0, 1.0, 2.0], POSES), "tum.txt"),
        *(Case({name: text.encode()}, name) for name, text in texts.items()),
    ]
