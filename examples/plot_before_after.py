# SPDX-License-Identifier: MIT
"""Two versions of completion beside each other, on every real scan.

`python examples/plot_before_after.py OLD NEW [-o FOLDER] [--only NAME...]` takes two folders with completions
of the same scans, each in a folder of its name as `unseen complete -o` writes it, draws a picture a scan, and
prints how many surfaces are smaller than .05 m2 and how much is inferred. `--make FOLDER` first completes the
scans into FOLDER by the packages that Python finds: with PYTHONPATH at another version, by that one.

Each picture has the older version on the left. Above, the scan's own view: what was measured in grey, and
over it what is inferred, however far behind. Below, a step aside, where what is nearer hides what is farther.
Scans are read from UNSEEN_DATA (default ../shared/data); only their shape is drawn.
"""

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.ndimage import gaussian_filter

from nbv.report.figures.picture import Camera, aside_cameras
from scenes.checks import BoolArray, FloatArray
from scenes.io.clouds.npz import write_npz
from scenes.io.meshes.ply import read_mesh_ply
from scenes.io.rgbd.depth import read_depth_image
from scenes.io.rgbd.frames import depth_scan
from scenes.io.scan_request import ScanRequest, read_request
from scenes.pose import Pose
from scenes.rays.raycast import RayCaster
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage
from scenes.scan.thumbnail import upright

ROOT = Path(__file__).resolve().parents[1]
DATA = Path(os.environ.get("UNSEEN_DATA", ROOT.parent / "shared" / "data")) / "range"
SMALL_M2 = 0.05
_GAP = 8
_COLOURS = 160  # of a picture's palette
_WHITE = np.full(3, 1.0)
_LEVEL = Pose.looking_at((0, 0, 0), (0, 1, 0))  # of depth images without a pose
PROVENANCES = {
    1: ("interior", (0.00, 0.45, 0.70)),
    2: ("between", (0.34, 0.71, 0.91)),
    3: ("edges", (0.00, 0.62, 0.45)),
    4: ("architectural", (0.90, 0.62, 0.00)),
    5: ("full-turn", (0.80, 0.47, 0.65)),
    7: ("no-return", (0.72, 0.05, 0.20)),
}  # the numbers in the files, and colours that the colour-blind tell apart (Okabe & Ito)


def _from_disparity(raw: FloatArray) -> FloatArray:
    """Metres of a Kinect's raw disparity in words that are turned round; 0 where there is none."""
    disparity = raw.astype(np.uint16).byteswap().astype(np.float64)
    return np.where(disparity < 1092.0, 351.3 / np.maximum(1092.5 - disparity, 0.5), 0.0)


def _from_turned(raw: FloatArray) -> FloatArray:
    """Metres of millimetres whose bits are turned by three."""
    words = raw.astype(np.uint16)
    return ((words >> 3) | (words << 13)) / 1000.0


@dataclass(frozen=True)
class Scan:
    """A real scan: its place below `range`, and what its files do not tell.

    `decode` makes metres of what a depth image holds that belongs to no folder of frames.
    """

    path: str
    intrinsics: tuple[float, ...] | None = None
    depth_scale: float | None = None
    origin: tuple[float, ...] | None = None
    decode: Callable[[FloatArray], FloatArray] | None = None

    def source(self, folder: Path) -> str:
        """The path to read; a decoded depth image is written into `folder`."""
        if self.decode is None or self.intrinsics is None:
            return str(DATA / self.path)
        folder.mkdir(parents=True, exist_ok=True)
        decoded = folder / f"{Path(self.path).stem}.npz"
        depth = self.decode(read_depth_image(DATA / self.path))
        camera = PinholeProjection(depth.shape[1], depth.shape[0], *self.intrinsics)
        write_npz(depth_scan(depth, camera, _LEVEL, name=decoded.stem), decoded)
        return str(decoded)

    def options(self) -> list[str]:
        """What the command is told."""
        told = [] if self.origin is None else ["--origin", ",".join(map(str, self.origin))]
        if self.decode is None and self.intrinsics is not None:
            told += ["--intrinsics", ",".join(map(str, self.intrinsics))]
            told += ["--depth-scale", str(self.depth_scale)]
        return told

    def read(self, folder: Path) -> RangeImage:
        """The scan."""
        asked = ScanRequest(
            (self.source(folder),),
            intrinsics=None if self.decode else self.intrinsics,
            depth_scale=self.depth_scale,
            origins=() if self.origin is None else (self.origin,),
            up="auto",
        )
        return read_request(asked).scans[0]


_KINECT = (525.0, 525.0, 319.5, 239.5)
SCANS = {
    "redwood": Scan("open3d_redwood#1"),
    "align3d_office": Scan("align3d_sample1#1"),
    "align3d_living": Scan("align3d_sample2#1"),
    "icl_nuim": Scan("icl_nuim#1", (481.2, -480.0, 319.5, 239.5), 5000.0),
    "nyu_dining": Scan("nyu_dining#1", (518.0, 519.0, 325.5, 253.5), 1000.0),
    "arcade": Scan("tdtk#1"),
    "office1": Scan("pcl/office1.pcd"),
    "mug": Scan("pcl/table_scene_mug_stereo_textured.pcd"),
    "pumpA": Scan("e57/pumpA.e57"),
    **{f"learn{k}": Scan(f"mOSD/learn{k}.pcd") for k in (0, 17, 25, 29, 33, 39)},
    "tunnel": Scan(
        "cape_tunnel/depth_0.png", (575.93, 576.41, 315.15, 230.59), decode=lambda raw: raw / 1000.0
    ),
    "nyu": Scan("open3d_other_formats/NYU_depth.pgm", _KINECT, decode=_from_disparity),
    "sun": Scan("open3d_other_formats/SUN_depth.png", _KINECT, decode=_from_turned),
    "tum": Scan("open3d_other_formats/TUM_depth.png", _KINECT, decode=lambda raw: raw / 5000.0),
    "caixa": Scan("pyransac3d/caixa.ply", origin=(0.0, 0.0, 0.0)),
}


def make(scan: Scan, folder: Path) -> None:
    """Complete a scan into a folder, by the packages that Python finds."""
    command = [sys.executable, "-c", "from nbv.cli import main; main()", "complete"]
    source = scan.source(folder.with_name("decoded"))
    done = subprocess.run([*command, source, *scan.options(), "--no-texture", "-q", "-o", str(folder)])
    if done.returncode:
        print(f"{folder.name}: not completed, exit code {done.returncode}", flush=True)


@dataclass(frozen=True)
class Drawn:
    """A completion to draw: what was measured, and what is inferred with the colour of each face."""

    measured: RayCaster
    inferred: RayCaster | None
    tints: FloatArray

    @classmethod
    def of(cls, folder: Path) -> "Drawn":
        """Read it from the folder of `unseen complete`."""
        measured, inferred = (read_mesh_ply(folder / f"{n}.ply") for n in ("observed", "hypothesised"))
        reasons = np.asarray(inferred.vertex_properties["provenance"], np.int64)
        table = np.zeros((8, 3))
        for number, (_, colour) in PROVENANCES.items():
            table[number] = colour
        tints = table[np.clip(reasons[inferred.faces].max(axis=1, initial=0), 0, 7)]
        caster = RayCaster(inferred.vertices, inferred.faces) if len(inferred.faces) else None
        return cls(RayCaster(measured.vertices, measured.faces), caster, tints)

    def picture(self, origin: FloatArray, rays: FloatArray, *, through: bool) -> FloatArray:
        """Draw (rows, columns, 3) what rays meet; inferred area through what is measured or not."""
        seen = self.measured.first_hit(np.broadcast_to(origin, rays.shape), rays)
        grey = 0.3 + 0.6 * _smooth(seen.incidence_cosine, seen.hit)[..., None]
        image = np.where(seen.hit[..., None], grey * _WHITE, 1.0)
        if self.inferred is None:
            return image
        met = self.inferred.first_hit(np.broadcast_to(origin, rays.shape), rays)
        shown = met.hit & (through | (met.ranges < seen.ranges))
        tint = self.tints[np.maximum(met.face, 0)] * (0.55 + 0.45 * met.incidence_cosine[..., None])
        share = np.where(through & seen.hit, 0.75, 1.0)[..., None]
        return np.where(shown[..., None], share * tint + (1 - share) * image, image)


def _smooth(values: FloatArray, known: BoolArray) -> FloatArray:
    """The mean of what is known around each pixel: noise tilts small faces."""
    share = gaussian_filter(known.astype(np.float64), 4.0)
    return np.asarray(gaussian_filter(np.where(known, values, 0.0), 4.0) / np.maximum(share, 1e-9))


def own_view(scan: RangeImage, width: int) -> FloatArray:
    """Rays (rows, columns, 3) between the scan's pixels, thinned to about a width; its upper side first."""
    rays = scan.world_from_sensor.rotate(scan.projection.directions())
    between = rays[:-1, :-1] + rays[1:, 1:]  # through faces, not through their corners
    between = np.pad(between, ((0, 1), (0, 1), (0, 0)), mode="edge")
    between /= np.linalg.norm(between, axis=-1, keepdims=True)
    return np.ascontiguousarray(upright(between, scan.projection, width))


def pair(scan: RangeImage, versions: Sequence[Drawn], width: int) -> Image.Image:
    """Return the picture of a scan: versions side by side, its own view above a step aside."""
    camera: Camera = aside_cameras(scan)[4]
    views = [
        (scan.origin, own_view(scan, width), True),
        (camera.origin, camera.rays(camera.shape(width)), False),
    ]
    rows = []
    for origin, rays, through in views:
        images = [_framed(one.picture(origin, rays, through=through), width) for one in versions]
        gap = np.ones((len(images[0]), _GAP, 3))
        rows.append(np.concatenate([images[0], gap, *images[1:]], axis=1))
        rows.append(np.ones((_GAP, rows[0].shape[1], 3)))
    whole = np.concatenate(rows[:-1])
    return Image.fromarray((255 * np.clip(whole, 0, 1)).astype(np.uint8))


def _framed(image: FloatArray, width: int) -> FloatArray:
    """The picture at the common width."""
    size = (width, round(width * image.shape[0] / image.shape[1]))
    small = Image.fromarray((255 * np.clip(image, 0, 1)).astype(np.uint8))
    return np.asarray(small.resize(size, Image.Resampling.BILINEAR)) / 255.0


def figures(folder: Path) -> tuple[int, int, float, float]:
    """How many surfaces there are, how many are small, and what was measured and inferred, m2."""
    record = json.loads((folder / "completion.json").read_text("utf-8"))
    areas = [one["observed_m2"] for one in record["surfaces"]]
    small = sum(area < SMALL_M2 for area in areas)
    return len(areas), small, record["observed_m2"], record["hypothesised_m2"]


def main(given: Sequence[str] | None = None) -> None:
    """Make completions, or draw two versions of them side by side."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("versions", nargs="*", type=Path, help="OLD and NEW, folders of completions")
    parser.add_argument("--make", type=Path, help="complete the scans into this folder first")
    parser.add_argument("--only", nargs="*", choices=SCANS, help="of the scans; all when not given")
    parser.add_argument(
        "-o", "--out", type=Path, default=ROOT / "out/before_after", help="folder of pictures"
    )
    parser.add_argument("--width", type=int, default=400, help="of each view, pixels")
    asked = parser.parse_args(given)
    names = [name for name in asked.only or SCANS if (DATA / SCANS[name].path.split("#")[0]).exists()]
    if not names:
        print(f"no scans in {DATA}")
    for name in names if asked.make else ():
        make(SCANS[name], asked.make / name)
    if len(asked.versions) != 2:
        return
    asked.out.mkdir(parents=True, exist_ok=True)
    print("| scan | surfaces | below .05 m2 | measured m2 | inferred m2 |\n|---|---|---|---|---|")
    for name in names:
        folders = [version / name for version in asked.versions]
        if not all((folder / "completion.json").exists() for folder in folders):
            print(f"| {name} | not in both | | | |")
            continue
        scan = SCANS[name].read(asked.out / "decoded")
        picture = pair(scan, [Drawn.of(folder) for folder in folders], asked.width)
        picture.quantize(_COLOURS).save(asked.out / f"before_after_{name}.png", optimize=True)
        (n, few, seen, all_), (m, less, now, more) = (figures(folder) for folder in folders)
        print(
            f"| {name} | {n} -> {m} | {few} -> {less} | {seen:.2f} -> {now:.2f} | {all_:.2f} -> {more:.2f} |"
        )


if __name__ == "__main__":
    main()
