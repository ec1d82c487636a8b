# SPDX-License-Identifier: MIT
"""Files by others: each file of the shared data opens as what it is, or is refused with the right words."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from scenes.checks import InputError
from scenes.io.describe import describe
from scenes.io.rgbd.depth import read_depth_image
from scenes.io.scan_files import read_scan, read_scans
from tests.helpers.data_paths import ROOT, data_path, requires_data
from tests.helpers.long_cases import first_in_gate

EXPECTED = {
    "scenes/aws_small_house.glb": "scene of 145844 triangles, 108 surfaces, 64 textures",
    "scenes/habitat_simple_room.glb": "scene of 84 triangles, 7 surfaces",
    "scenes/cgal/anchor_dense.off": "scene",
    "scenes/cgal/mech-holes-shark.off": "scene",
    "scenes/cgal/spheres.ply": "points",
    "scenes/furniture/blendswap-cc-0/oakChair/oakChair.obj": "scene of 8 surfaces, 2 textures",
    "scenes/objects/CesiumMilkTruck.glb": "scene of 5 surfaces",
    "scenes/objects/beetle.obj": "scene; its material file is missing",
    "scenes/objects/cycloidal.ply": "scene",
    "scenes/objects/fandisk.obj": "scene",
    "scenes/objects/featuretype.STL": "scene",
    "scenes/objects/octagonal_pocket.stl": "scene",
    "scenes/objects/rocker-arm.obj": "scene; x is up",
    "scenes/objects/spot.obj": "scene; y is up",
    "scenes/objects/stanford-bunny.obj": "scene of 69451 triangles; y is up",
    "scenes/objects/teapot.obj": "scene; y is up",
    "range/e57/pumpA.e57": "scan of 1074 x 345",
    "range/e57/pipeSpherical.e57": "1220 points; unstructured and without pose: as a scan with --origin",
    "range/e57/tiny_spherical.e57": "points; unstructured and without pose: as a scan with --origin",
    "range/e57/cartesian_invalid_state_single.e57": "points; unstructured and without pose",
    "range/e57/translationWithoutRotation.e57": "3 points; too few for a scan",
    "range/e57/corrupt_crc.e57": "refused: checksum mismatch",
    "range/ptx/complex-transform.ptx": "points; 12 pixels that no projection explains",
    "range/ptx/no-color.ptx": "15 points; in one row: too few for a scan",
    "range/ptx/multiple-and-transform.ptx": "refused: its first transform scales z by 2",
    "range/pcl/office1.pcd": "scan of 480 x 640",
    "range/pcl/table_scene_mug_stereo_textured.pcd": "scan of 480 x 640",
    "range/mOSD/learn0.pcd": "scan of 480 x 640",
    "range/pyransac3d/caixa.ply": "points",
    "range/align3d_sample1": "6 scans of an RGB-D folder (align3d)",
    "range/align3d_sample2": "3 scans of an RGB-D folder (align3d)",
    "range/open3d_redwood": "5 scans of an RGB-D folder (redwood)",
    "range/icl_nuim": "refused: intrinsics and depth scale are not told (481.2,-480,319.5,239.5 and 5000)",
    "range/nyu_dining": "refused: intrinsics and depth scale are not told (518,519,325.5,253.5 and 1000)",
    "range/libpointmatcher/eth_cloud0.xyz": "24989 points",
    "range/libpointmatcher/eth_cloud1.xyz": "points",
    "range/pcl_room/room_scan1.pcd": "112586 points",
    "range/pcl_room/room_scan2.pcd": "112624 points",
    "range/nvblox_3dmatch": "5 scans of an RGB-D folder (frames)",
    "range/tdtk": "2 scans of a 3DTK folder",
    "range/cape_tunnel": "refused: no RGB-D folder, its depth is not registered to its colour",
    "range/open3d_other_formats/NYU_depth.pgm": "depth image; bytes swapped: kinect-disparity in camera.json",
    "range/open3d_other_formats/SUN_depth.png": "depth image; bits turned: sun3d in camera.json",
    "range/open3d_other_formats/TUM_depth.png": "depth image in 1/5000 m",
}
"""What `unseen info` is to say, in the words of docs/results/files-by-others.md."""

WORDS = {
    "; y is up": "suggests that y is up",
    "; x is up": "suggests that x is up",
    "material file is missing": "its material file 'VWBugMesh002.mtl' is missing",
    "without pose": "it is an unstructured cloud",
    "too few for a scan": "are too few",
    "no projection explains": "fit no known projection",
    "checksum mismatch": "checksum mismatch",
    "its first transform scales": r"pose is not rigid: |R'R - 1| = 3",
    "intrinsics and depth scale": "--intrinsics FX,FY,CX,CY) and the depth values a metre",
    "no RGB-D folder": "is not an RGB-D folder",
    "bytes swapped": "kinect-disparity",
    "bits turned": "sun3d",
}
"""What is really said, in warnings or in the refusal."""
IGNORED = {".txt", ".md", ".LICENSE", ".license", ".mtl", ".world", ".xml", ".json", ".log", ".match", ""}
COLOURS = (".jpg", ".ppm")


def said_of(path: Path) -> tuple[str, str]:
    """Kind and headline as in `EXPECTED`, and all that was said as one text."""
    try:
        found = describe(path)
    except InputError as error:
        return "refused", str(error)
    shown = found["kind"]
    if shown == "scene":
        counts = (found["triangles"], found["surfaces"], len(found["textures"]))
        shown += " of {} triangles, {} surfaces, {} texture".format(*counts)
    elif shown == "points":
        shown = f"{found['points']} points"
    elif shown == "scan":
        shown = f"scan of {found['scans'][0]['rows']} x {found['scans'][0]['columns']}"
    elif shown == "scans":
        kind = found["format"].replace("rgbd", "an RGB-D folder").replace("3dtk", "a 3DTK folder")
        shown = f"{found['count']} scans of {kind}"
    return shown, " ".join(found["warnings"])


@requires_data
@pytest.mark.parametrize("name", first_in_gate(20, EXPECTED))
def test_files_open_or_are_refused_in_the_right_words(name: str) -> None:
    shown, said = said_of(data_path(name))
    told = EXPECTED[name].partition(";")[0].partition(":")[0].removesuffix(" in 1/5000 m")
    for part in told.removesuffix("s").split(", "):
        for word in part.split(" of "):
            assert word.removesuffix("s") in shown, (shown, said)
    for words, really in WORDS.items():
        assert (words in EXPECTED[name]) <= (really in said), said


@requires_data
def test_no_file_is_left_out() -> None:
    """Every file under range and scenes is expected above, belongs to a folder that is, or is no data."""
    for folder in ("range", "scenes"):
        for file in sorted(data_path(folder).rglob("*")):
            name = file.relative_to(data_path("")).as_posix()
            is_expected = name in EXPECTED or any(name.startswith(f"{known}/") for known in EXPECTED)
            alike = name.startswith("range/mOSD/learn")  # six frames of one kind
            is_data = file.is_file() and file.suffix not in IGNORED and file.suffix not in COLOURS
            if is_data and not file.stem.endswith(("_color", "LICENSE")):
                assert is_expected or alike or file.suffix == ".png", name


@requires_data
def test_the_documentation_repeats_this_table() -> None:
    page = (ROOT / "docs" / "results" / "files-by-others.md").read_text("utf-8")
    for name, words in EXPECTED.items():
        assert f"| `{name}` | {words} |" in page


@requires_data
@pytest.mark.parametrize("name", sorted(path.name for path in data_path("range/mOSD").glob("*.pcd")))
def test_frames_of_the_mosd(name: str) -> None:
    assert read_scan(data_path(f"range/mOSD/{name}")).shape == (480, 640)


@requires_data
@pytest.mark.parametrize(
    ("name", "camera", "median_m"),
    [
        ("NYU_depth.pgm", {"depth_encoding": "kinect-disparity"}, 351.3 / (1092.5 - 986)),
        ("SUN_depth.png", {"depth_encoding": "sun3d", "depth_scale": 1000}, 2.72),
        ("TUM_depth.png", {"depth_scale": 5000}, 2.415),
    ],
)
def test_depth_encodings_of_open3ds_examples(
    tmp_path: Path, name: str, camera: dict[str, object], median_m: float
) -> None:
    """In a plain folder whose camera.json says the encoding; medians from the data's README."""
    source = data_path(f"range/open3d_other_formats/{name}")
    (tmp_path / "depth").mkdir()
    shutil.copy(source, tmp_path / "depth" / name)
    height, width = read_depth_image(source).shape
    intrinsics = {"fx": 525.0, "fy": 525.0, "cx": (width - 1) / 2, "cy": (height - 1) / 2}
    (tmp_path / "camera.json").write_text(json.dumps({**intrinsics, **camera}))
    scan = read_scan(tmp_path)
    depth = scan.points_in_sensor()[..., 2][scan.valid]
    assert np.median(depth) == pytest.approx(median_m, abs=0.05)
    assert scan.valid.mean() > 0.5


@requires_data
def test_icl_nuim_opens_when_it_is_told_its_camera() -> None:
    camera = (481.2, -480.0, 319.5, 239.5)
    scans = read_scans(data_path("range/icl_nuim"), intrinsics=camera, depth_scale=5000)
    assert len(scans) == 5
