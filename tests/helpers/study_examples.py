# SPDX-License-Identifier: MIT
"""Small studies, and folders compared byte for byte."""

from pathlib import Path

TINY = 'kind = "pinhole"\nname = "tiny"\nfov_deg = 70.0\nwidth = 48\nheight = 48\n'
SMALL = """
title = "Small"
seeds = 2

[sampling]
spacing_m = 0.5
subdivisions = 0

[[scenes]]
scene = "builtin:two_occluders"

[[scenes]]
scene = "builtin:drum_and_post"

[[sensors]]
sensor = "tiny.toml"

[[requirements]]
max_incidence_deg = 75

[[planners]]
method = "greedy"
target = 0.9

[[planners]]
method = "random"
target = 0.5
"""


def write_study(folder, text=SMALL):
    """Write a study and its sensor, and return its file."""
    (Path(folder) / "tiny.toml").write_text(TINY)
    file = Path(folder) / "study.toml"
    file.write_text(text)
    return file


def contents(folder):
    """Return the bytes of all files in a folder and below but manifests, which hold times."""
    files = sorted(file for file in Path(folder).rglob("*") if file.is_file())
    return {
        file.relative_to(folder).as_posix(): file.read_bytes()
        for file in files
        if file.name != "manifest.json"
    }
