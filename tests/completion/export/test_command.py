# SPDX-License-Identifier: MIT
"""`unseen complete --export dxf|svg|ifc`: drawings and BIM beside the other files, or the reason."""

from typer.testing import CliRunner

from completion.export.svg import svg_of
from nbv.cli import app
from scenes.io.scan_files import write_scan
from tests.helpers.completion_examples import completed, example
from tests.helpers.exchange_examples import WRITTEN, ifc_text


def test_the_command_writes_what_python_exports(tmp_path, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", str(int(WRITTEN.timestamp())))
    write_scan(example("two_occluders", pixels=120), tmp_path / "scan.npz")
    words = ["complete", str(tmp_path / "scan.npz"), "--no-texture", "-o", str(tmp_path / "out")]
    done = CliRunner().invoke(
        app, [*words, "--export", "dxf", "--export", "svg", "--export", "ifc", "--export-units", "ft"]
    )
    assert done.exit_code == 0, done.stderr
    assert (tmp_path / "out/completed.dxf").read_text("utf-8").startswith("  0\nSECTION\n")
    text = (tmp_path / "out/completed.ifc").read_text("utf-8")
    assert text == ifc_text(completed("two_occluders", pixels=120).building(), "ft")
    text = (tmp_path / "out/completed.svg").read_text("utf-8")
    assert text == svg_of(completed("two_occluders", pixels=120).building())


def test_other_formats_are_told_the_known_ones():
    done = CliRunner().invoke(app, ["complete", "scan.npz", "--export", "dwg"])
    assert done.exit_code == 2
    assert "'dwg' is none of obj, e57, dxf, svg, ifc" in done.stderr
