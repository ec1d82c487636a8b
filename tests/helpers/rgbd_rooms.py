# SPDX-License-Identifier: MIT
"""A box room seen by a depth camera, written as phones, data sets and reconstructions lay out their files."""

import json
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from scenes.pose import Pose
from scenes.rays.raycast import RayCaster
from scenes.scan.projection import PinholeProjection

Image = np.ndarray[Any, Any]
SIZE = np.array([5.0, 4.0, 2.7])
CAMERA = PinholeProjection(64, 48, 50.0, 49.0, 31.3, 23.8)
FLIP = np.diag([1.0, -1.0, -1.0, 1.0])  # camera axes of OpenGL and ARKit
Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])  # a world with y up


@dataclass(frozen=True)
class Frame:
    """Depth in metres, a colour that tells the frames apart, and the pose (4, 4), world from camera."""

    depth: Image
    grey: int
    matrix: Image

    @property
    def mm(self) -> Image:
        return np.rint(1000 * self.depth).astype(np.uint16)

    @property
    def arkit(self) -> Image:
        """The pose with ARKit's axes of camera and world."""
        return Y_UP @ self.matrix @ FLIP

    def colour(self, width: int = 64, height: int = 48) -> Image:
        return np.full((height, width, 3), self.grey, np.uint8)


def see_room(camera: PinholeProjection = CAMERA, n_frames: int = 4, rays: Image | None = None) -> list[Frame]:
    """Return frames of the room; `rays` (rows, columns, 3), with z 1, go before the camera's own."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * SIZE
    quads = [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)]
    caster = RayCaster(corners, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]))
    looks = camera.directions() if rays is None else rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    frames = []
    for k in range(n_frames):
        pose = Pose.looking_at((2.9 - 0.1 * k, 1.0 + 0.05 * k, 1.5), (1.5 + k, 4.0, 0.9))
        turned = pose.rotate(looks.reshape(-1, 3)).reshape(looks.shape)
        hits = caster.first_hit(pose.translation[None], turned).ranges.reshape(looks.shape[:2])
        frames.append(Frame(hits * looks[..., 2], 20 + 50 * k, np.array(pose.matrix)))
    return frames


def off_walls(points: Image) -> float:
    """Return how far points (n, 3) lie off the walls at most, metres."""
    return float(np.minimum(np.abs(points), np.abs(points - SIZE)).min(axis=-1).max())


def save(path: Path, values: Any) -> None:
    """Write an image, an array, a text or JSON by the suffix of its path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".exr":
        path.write_bytes(exr_bytes(values))
    elif path.suffix == ".npy":
        np.save(path, values)
    elif path.suffix == ".npz":
        np.savez(path, depth=values)
    elif isinstance(values, dict | list):
        path.write_text(json.dumps(values))
    elif isinstance(values, str):
        path.write_text(values)
    else:
        cv2.imwrite(str(path), values)


def exr_bytes(depth: Image, lines: int = 16) -> bytes:
    """Return an OpenEXR image of one channel R of 32 bits, packed by ZIP: 16 lines a block (or 1, ZIPS)."""
    height, width = depth.shape
    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    attributes = {
        b"channels\0chlist": b"R\0" + struct.pack("<4i", 2, 0, 1, 1) + b"\0",
        b"compression\0compression": bytes([3 if lines == 16 else 2]),
        b"dataWindow\0box2i": window,
        b"displayWindow\0box2i": window,
        b"lineOrder\0lineOrder": b"\0",
    }
    head = struct.pack("<ii", 20000630, 2)
    head += b"".join(key + b"\0" + struct.pack("<i", len(v)) + v for key, v in attributes.items()) + b"\0"
    blocks = []
    for first in range(0, height, lines):
        plain = np.frombuffer(depth[first : first + lines].astype("<f4").tobytes(), np.uint8).astype(int)
        mixed = np.concatenate([plain[0::2], plain[1::2]])
        steps = np.concatenate([mixed[:1], np.diff(mixed) + 128]).astype(np.uint8)
        packed = zlib.compress(steps.tobytes())
        packed = packed if len(packed) < len(plain) else plain.astype(np.uint8).tobytes()
        blocks.append(struct.pack("<ii", first, len(packed)) + packed)
    starts = np.cumsum([len(head) + 8 * len(blocks), *map(len, blocks[:-1])])
    return head + struct.pack(f"<{len(blocks)}Q", *starts.tolist()) + b"".join(blocks)


def pixels_of(camera: PinholeProjection = CAMERA, scale: float = 1.0, half: float = 0.0) -> list[float]:
    """Return fx, fy, cx, cy of an image `scale` times as large, centres at integers plus `half`."""
    centres = [(centre + 0.5) * scale - 0.5 + half for centre in (camera.cx, camera.cy)]
    return [camera.fx * scale, camera.fy * scale, *centres]


def quaternion(matrix: Image) -> list[float]:
    """Return x, y, z, w."""
    return [float(part) for part in Rotation.from_matrix(matrix[:3, :3]).as_quat()]


def write_video(path: Path, frames: list[Frame], size: tuple[int, int] = (1920, 1440)) -> None:
    video = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), 30, size)
    for frame in frames:
        video.write(frame.colour(*size))
    video.release()


def write_stray(
    folder: Path,
    frames: list[Frame],
    *,
    own: bool = False,
    suffix: str = "png",
    scale: float = 30,
    world: Image = Y_UP,
) -> None:
    """Stray Scanner; `own` intrinsics of each frame, as newer versions write, and a wrong shared matrix."""
    fx, fy, cx, cy = pixels_of(scale=scale)
    names = "timestamp, frame, x, y, z, qx, qy, qz, qw" + ", fx, fy, cx, cy, distortion_center_x" * own
    rows = [names]
    for k, frame in enumerate(frames):
        save(folder / "depth" / f"{k:06d}.{suffix}", frame.mm)
        save(folder / "confidence" / f"{k:06d}.png", np.full((48, 64), 2, np.uint8))
        matrix = world @ frame.matrix
        words = [f"{100 + k / 60}", f"{k:06d}", *map(repr, [*map(float, matrix[:3, 3]), *quaternion(matrix)])]
        rows.append(", ".join([*words, *([f"{fx}, {fy}, {cx}, {cy}, "] if own else [])]))
    save(folder / "odometry.csv", "\n".join(rows) + "\n")
    shared = [fx, fy, cx, cy] if not own else [1.0, 1.0, cx, cy]
    lines = [[shared[0], 0, shared[2]], [0, shared[1], shared[3]], [0, 0, 1]]
    save(folder / "camera_matrix.csv", "\n".join(", ".join(map(str, line)) for line in lines))


def write_polycam(folder: Path, frames: list[Frame], *, corrected: bool = True) -> None:
    """Polycam; with `corrected` cameras those of ARKit are wrong."""
    kinds = {"cameras": frames[::-1], "corrected_cameras": frames} if corrected else {"cameras": frames}
    for k, frame in enumerate(frames):
        name = f"{281000000 + 1000 * k}"
        save(folder / "keyframes/depth" / f"{name}.png", frame.mm)
        save(folder / "keyframes/confidence" / f"{name}.png", np.full((48, 64), 127, np.uint8))
        save(folder / "keyframes/images" / f"{name}.jpg", frame.colour(1024, 768))
        for kind, of in kinds.items():
            held: dict[str, Any] = dict(zip(("fx", "fy", "cx", "cy"), pixels_of(scale=16), strict=True))
            held |= {f"t_{i}{j}": float(of[k].arkit[i, j]) for i in range(3) for j in range(4)}
            save(
                folder / "keyframes" / kind / f"{name}.json",
                held | {"width": 1024, "height": 768, "blur_score": 3.5},
            )


def write_record3d(folder: Path, frames: list[Frame], *, per_frame: bool = True) -> None:
    """Record3D's EXR + JPG: poses in the world of the first camera, K column by column."""
    first = np.linalg.inv(frames[0].matrix @ FLIP)
    poses = [first @ frame.matrix @ FLIP for frame in frames]
    fx, fy, cx, cy = pixels_of(scale=2)
    held = {"w": 128, "h": 96, "dw": 64, "dh": 48, "fps": 30, "initPose": [0, 0, 0, 1, 0, 0, 0]}
    held["K"] = [1, 0, 0, 0, 1, 0, cx, cy, 1] if per_frame else [fx, 0, 0, 0, fy, 0, cx, cy, 1]
    held["poses"] = [[*quaternion(pose), *map(float, pose[:3, 3])] for pose in poses]
    held["perFrameIntrinsicCoeffs"] = [[fx, fy, cx, cy]] * len(frames) if per_frame else []
    save(folder / "metadata.json", held)
    for k, frame in enumerate(frames):
        save(folder / "depth" / f"{k}.exr", frame.depth.astype(np.float32))
        save(folder / "rgb" / f"{k}.jpg", frame.colour(128, 96))


def write_rtabmap(folder: Path, frames: list[Frame], *, form: str = "id", robot: bool = False) -> None:
    """RTAB-Map's export, images named by number ("id") or time ("stamp"); poses of the camera or `robot`."""
    local = np.array([[0.0, 0, 1, 0.2], [-1, 0, 0, 0], [0, -1, 0, 1.1], [0, 0, 0, 1]])
    rows = ["#timestamp x y z qx qy qz qw" + " id" * (form == "id")]
    fx, fy, cx, cy = pixels_of(scale=2)
    for k, frame in enumerate(frames):
        stamp, number = 1700000000.25 + 0.4 * k, 3 * k + 1
        name = f"{stamp:.6f}" if form == "stamp" else f"{number}"
        save(folder / "map_depth" / f"{name}.png", frame.mm)
        save(folder / "map_rgb" / f"{name}.jpg", frame.colour(128, 96))
        save(
            folder / "map_calib" / f"{name}.yaml",
            f"%YAML:1.0\n---\ncamera_name: {name}\nimage_width: 128\nimage_height: 96\ncamera_matrix:\n"
            f"   rows: 3\n   cols: 3\n   data: [ {fx}, 0., {cx}, 0., {fy}, {cy}, 0., 0., 1. ]\n"
            "distortion_coefficients:\n   rows: 1\n   cols: 5\n   data: [ 0., 0., 0., 0., 0. ]\n"
            "distortion_model: plumb_bob\nlocal_transform:\n   rows: 3\n   cols: 4\n"
            f"   data: [ {', '.join(map(str, local[:3].ravel()))} ]\n",
        )
        pose = frame.matrix @ np.linalg.inv(local) if robot else frame.matrix
        words = [*pose[:3, 3], *quaternion(pose)] if form != "matrix" else pose[:3].ravel()
        lead, end = ([f"{stamp:.6f}"], [str(number)] * (form == "id")) if form != "matrix" else ([], [])
        rows.append(" ".join([*lead, *(repr(float(word)) for word in words), *end]))
    save(folder / f"map_{'poses' if robot else 'camera_poses'}.txt", "\n".join(rows) + "\n")


def write_scannet(folder: Path, frames: list[Frame], *, aligned: bool = False) -> None:
    """ScanNet as SensReader unpacks it; colours of another aspect ratio; `aligned` by its scene's text."""
    turn = Pose.looking_at((0.5, 0.2, 0.0), (1.0, 0.0, 0.0)).matrix if aligned else np.eye(4)
    for k, frame in enumerate(frames):
        save(folder / "depth" / f"{k}.png", frame.mm)
        save(folder / "color" / f"{k}.jpg", frame.colour(130, 97))
        rows = np.linalg.inv(turn) @ frame.matrix
        save(folder / "pose" / f"{k}.txt", "\n".join(" ".join(map(repr, map(float, row))) for row in rows))
    for name, (fx, fy, cx, cy) in {"depth": pixels_of(), "color": pixels_of(scale=2)}.items():
        text = f"{fx} 0 {cx} 0\n0 {fy} {cy} 0\n0 0 1 0\n0 0 0 1\n"
        save(folder / "intrinsic" / f"intrinsic_{name}.txt", text)
    if aligned:
        numbers = " ".join(map(repr, map(float, turn.ravel())))
        save(folder / "scene0000_00.txt", f"axisAlignment = {numbers}\ncolorHeight = 97\n")


def write_arkitscenes(folder: Path, frames: list[Frame], *, late_s: float = 0.0) -> None:
    """ARKitScenes; poses and intrinsics `late_s` after the images."""
    rows = []
    for k, frame in enumerate(frames):
        time = 3386.117 + 0.1 * k
        for kind, image in (("lowres_depth", frame.mm), ("lowres_wide", frame.colour()),
                            ("confidence", np.full((48, 64), 2, np.uint8))):  # fmt: skip
            save(folder / kind / f"41048190_{time:.3f}.png", image)
        pixels = " ".join(map(str, pixels_of()))
        save(folder / "lowres_wide_intrinsics" / f"41048190_{time + late_s:.3f}.pincam", f"64 48 {pixels}")
        back = np.linalg.inv(frame.matrix)
        words = [*Rotation.from_matrix(back[:3, :3]).as_rotvec(), *back[:3, 3]]
        rows.append(" ".join([f"{time + late_s:.6f}", *(repr(float(word)) for word in words)]))
    save(folder / "lowres_wide.traj", "\n".join(rows) + "\n")


def write_model(folder: Path, frames: list[Frame], model: str, values: list[float], size: tuple[int, int],
                *, binary: bool = False) -> None:  # fmt: skip
    """A COLMAP model whose images are `left/a1.jpg` and so on, in another order than their names."""
    folder.mkdir(parents=True, exist_ok=True)
    back = [np.linalg.inv(frame.matrix) for frame in frames]
    images = [
        (k + 7, [q[3], *q[:3], *map(float, m[:3, 3])], f"left/a{k + 1}.jpg")
        for k, m in enumerate(back)
        if (q := quaternion(m))
    ][::-1]
    if not binary:
        save(
            folder / "cameras.txt", f"# cameras\n3 {model} {size[0]} {size[1]} {' '.join(map(str, values))}\n"
        )
        rows = [f"{k} {' '.join(map(repr, numbers))} 3 {name}\n1.5 2.5 -1" for k, numbers, name in images]
        save(folder / "images.txt", "# images\n" + "\n".join(rows) + "\n")
        return
    kinds = [
        "SIMPLE_PINHOLE",
        "PINHOLE",
        "SIMPLE_RADIAL",
        "RADIAL",
        "OPENCV",
        "OPENCV_FISHEYE",
        "FULL_OPENCV",
    ]
    head = struct.pack("<QiiQQ", 1, 3, kinds.index(model), *size)
    (folder / "cameras.bin").write_bytes(head + struct.pack(f"<{len(values)}d", *values))
    data = struct.pack("<Q", len(images))
    for k, numbers, name in images:
        data += struct.pack("<i7di", k, *numbers, 3) + name.encode() + b"\0"
        data += struct.pack("<Q", 2) + struct.pack("<ddq", 1.5, 2.5, -1) * 2
    (folder / "images.bin").write_bytes(data)


def write_colmap(folder: Path, frames: list[Frame], *, kind: str = "geometric", binary: bool = True,
                 model: str = "PINHOLE", size: tuple[int, int] = (64, 48)) -> None:  # fmt: skip
    """COLMAP's dense workspace."""
    values = pixels_of(scale=size[0] / 64, half=0.5)
    write_model(folder / "sparse", frames, model, values, size, binary=binary)
    for k, frame in enumerate(frames):
        height, width = frame.depth.shape
        path = folder / "stereo/depth_maps/left" / f"a{k + 1}.jpg.{kind}.bin"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(f"{width}&{height}&1&".encode() + frame.depth.astype("<f4").tobytes())
        save(folder / "images/left" / f"a{k + 1}.jpg", frame.colour(*size))


def write_transforms(folder: Path, frames: list[Frame], *, suffix: str = "png", shared: bool = True,
                     lens: dict[str, Any] | None = None) -> None:  # fmt: skip
    """The `transforms.json` of nerfstudio, with intrinsics once or for each frame."""
    fx, fy, cx, cy = pixels_of(scale=2, half=0.5)
    camera = {"w": 128, "h": 96, "fl_x": fx, "fl_y": fy, "cx": cx, "cy": cy, "camera_model": "OPENCV"}
    camera |= lens or {}
    entries = []
    for k, frame in enumerate(frames):
        depth = frame.mm if suffix == "png" else frame.depth.astype(np.float32)
        save(folder / "depths" / f"d_{k}.{suffix}", depth)
        save(folder / "images" / f"frame_{k:05d}.jpg", frame.colour(128, 96))
        entry = {"file_path": f"images/frame_{k:05d}.jpg", "depth_file_path": f"depths/d_{k}.{suffix}",
                 "transform_matrix": (frame.matrix @ FLIP).tolist()}  # fmt: skip
        entries.append(entry if shared else entry | camera)
    save(folder / "transforms.json", {**(camera if shared else {}), "frames": entries})


def write_splats(folder: Path, frames: list[Frame], *, suffix: str = "tiff", by_name: bool = True) -> None:
    """Depth renders beside the `cameras.json` of Gaussian splatting, by the names of images or in order."""
    entries = []
    for k, frame in enumerate(frames):
        name = f"IMG_{k + 20}" if by_name else f"{k:05d}"
        place = folder / "depth" if by_name else folder / "train/ours_30000/vis"
        save(place / f"{name if by_name else 'depth_' + name}.{suffix}", frame.depth.astype(np.float32))
        entry = {"id": k, "img_name": f"IMG_{k + 20}", "width": 64, "height": 48, "fx": 50.0, "fy": 49.0}
        place, turn = frame.matrix[:3, 3].tolist(), frame.matrix[:3, :3].tolist()
        entries.append(entry | {"position": place, "rotation": turn})
    save(folder / "cameras.json", entries)
