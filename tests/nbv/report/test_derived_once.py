"""What follows from a completed model is computed once a run, for all files and pictures alike."""

import sys
from collections import Counter

from typer.testing import CliRunner

import completion.boundary.meshing as meshing
import completion.export.panels.outline as outline
import completion.result.labelled_points as observed_points
import completion.result.openings as openings
import completion.texturing.chart_texture as atlas
import nbv.report.completion_report  # noqa: F401 - so that all the command uses is loaded
from nbv.cli import app
from scenes.io.scan_files import write_scan
from tests.helpers.completion_examples import example


def count_calls(monkeypatch, function, key):
    """Count the calls of a function, wherever it was imported to, by what `key` makes of its arguments."""
    calls = Counter()

    def counted(*args, **named):
        calls[key(*args, **named)] += 1
        return function(*args, **named)

    for module in [
        module for name, module in sys.modules.items() if name.split(".")[0] in ("completion", "nbv")
    ]:
        for name in [name for name, held in vars(module).items() if held is function]:
            monkeypatch.setattr(module, name, counted)
    return calls


def mesh_of(grid, cells, cuts, trims=(), *, merged):
    return grid, cells.tobytes(), len(cuts), len(trims), merged


def test_a_run_with_report_derives_everything_once(tmp_path, monkeypatch):
    write_scan(example("two_occluders", pixels=80), tmp_path / "scan.npz")
    meshes = count_calls(monkeypatch, meshing.mesh_cells, mesh_of)
    holes = count_calls(monkeypatch, openings.find_openings, lambda patch: patch)
    cells = count_calls(monkeypatch, outline.outline_cells, lambda patch: patch)
    pages = count_calls(monkeypatch, atlas.make_atlas, len)
    scans = count_calls(monkeypatch, observed_points.remainder, lambda seen, _owners, _shifts: len(seen))
    words = ["complete", str(tmp_path / "scan.npz"), "-o", str(tmp_path / "out"), "--export", "obj"]
    found = CliRunner().invoke(app, words)
    assert found.exit_code == 0, found.output
    for calls in (meshes, holes, cells, pages, scans):
        assert calls
        assert set(calls.values()) == {1}
