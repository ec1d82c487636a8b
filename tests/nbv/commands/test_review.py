# SPDX-License-Identifier: MIT
"""`unseen review`: a completion opens again from its manifest, and saves what `--edits` would."""

import json
import threading
import urllib.request

import numpy as np
import pytest

from completion.options import CompletionOptions
from nbv.commands import review as command
from nbv.commands.complete import run_complete
from nbv.commands.options.scans import CompleteOptions, ReviewOptions
from nbv.commands.options.shared import ReadOptions, Shared
from nbv.commands.process import start_run
from nbv.commands.review import EDITS, open_session, restored, save
from nbv.report.review.session import open_scans
from scenes.checks import InputError
from scenes.io.scan_files import write_scan
from tests.nbv.report.review.conftest import make_scan
from tests.nbv.report.review.test_session import parallel, reject, wall_of


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """A finished completion and the options that it was made with."""
    folder = tmp_path_factory.mktemp("review")
    write_scan(make_scan(), folder / "one.npz")
    asked = CompleteOptions(
        scans=(str(folder / "one.npz"),), search="off", up="z", sigma_m=0.001, exports=("svg",),
        read=ReadOptions(origins=()),
    )  # fmt: skip
    run_complete(Shared(out=folder / "out", quiet=True, threads=1), asked)
    return folder, asked


def opened(folder, how):
    shared = Shared(out=folder, quiet=True, threads=1)
    with start_run("review", shared, default="", is_folder=True, writes=False) as run:
        return open_session(run, shared, how, folder)


def test_options_come_back_from_the_manifest(done):
    folder, asked = done
    how = restored(folder / "out")
    assert how == asked
    assert how.record() == asked.record()
    assert how.request() == asked.request()


def test_what_is_saved_is_what_edits_make(done, tmp_path):
    folder, asked = done
    how = restored(folder / "out")
    session = opened(folder / "out", how)
    session.take(reject(session.completion, wall_of(session.completion)))
    session.take(parallel(session.completion, 1, 2, forbidden=True))
    written = save(Shared(threads=1), how, session, folder / "out")
    assert {EDITS, "completion.json", "completed.svg", "report.html"} <= {*written}
    edits = folder / "out" / EDITS
    alone = CompleteOptions(
        scans=asked.scans, search="off", up="z", sigma_m=0.001, exports=("svg",), edits=str(edits),
        relations=str(edits),
    )  # fmt: skip
    run_complete(Shared(out=tmp_path / "alone", quiet=True, threads=1), alone)
    names = {one["name"] for one in json.loads((tmp_path / "alone/manifest.json").read_text())["outputs"]}
    for name in names - {"report.html"}:
        assert (folder / "out" / name).read_bytes() == (tmp_path / "alone" / name).read_bytes(), name
    again = opened(folder / "out", restored(folder / "out"))  # what was said is not said twice
    assert again.said == session.said
    assert np.isclose(again.completion.hypothesised_m2, session.completion.hypothesised_m2)


def test_edits_of_a_file_are_the_first_statements(done, tmp_path):
    folder, asked = done
    session = opened(folder / "out", restored(folder / "out"))
    said = reject(session.completion, wall_of(session.completion))
    said["surface"] = {"point": said["surface"], "kind": "plane"}
    del said["note"]
    angle = {"type": "angle", "surfaces": [said["surface"]] * 2, "value": 90.0, "forbidden": True}
    other = 3 - wall_of(session.completion)  # there are two
    angle["surfaces"][1] = {"point": session.completion.anchor(other).tolist(), "kind": "plane"}
    file = tmp_path / "mine.json"
    file.write_text(json.dumps({"edits": [said], "relations": [angle]}))
    how = CompleteOptions(scans=asked.scans, search="off", up="z", edits=str(file), relations=str(file))
    run_complete(Shared(out=tmp_path / "out", quiet=True, threads=1), how)
    assert opened(tmp_path / "out", restored(tmp_path / "out")).said == [said, angle]


def test_folders_that_cannot_be_reviewed_are_refused(done, tmp_path):
    folder, _ = done
    with pytest.raises(InputError, match="holds no finished completion"):
        restored(tmp_path)
    (tmp_path / "manifest.json").write_text('{"command": "part"}')
    with pytest.raises(InputError, match="written by `unseen part`"):
        restored(tmp_path)
    manifest = json.loads((folder / "out/manifest.json").read_text())
    manifest["inputs"][0]["sha256"] = "0" * 64
    (tmp_path / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(InputError, match="has changed since"):
        restored(tmp_path)
    manifest["inputs"][0]["input"] = "gone.npz"
    (tmp_path / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(InputError, match=r"gone\.npz: does not exist"):
        restored(tmp_path)


def test_the_command_serves_until_it_is_interrupted(done, monkeypatch, capsys):
    folder, _ = done
    found = {}

    def visit():
        address = found["http"]
        with urllib.request.urlopen(f"{address}state") as answer:
            found["state"] = json.loads(answer.read())
        found["server"].shutdown()

    real = command.ReviewServer.listen

    def listen(self, port=0):
        http = real(self, port)
        found.update(http=self.address(http.port), server=http)
        threading.Timer(0.2, visit).start()
        return http

    monkeypatch.setattr(command.ReviewServer, "listen", listen)
    command.run_review(Shared(as_json=True, threads=1), ReviewOptions(folder=str(folder / "out"), open="no"))
    told = json.loads(capsys.readouterr().out)
    assert told["address"] == found["http"]
    assert found["state"]["title"] == "one.npz"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("{", "manifest.json: .*JSON"),
        ("[]", "manifest.json"),
        ('{"command": "complete"}', "manifest.json: .*inputs"),
        ('{"command": "complete", "inputs": [{"input": "a"}], "options": {"scans": 3}}', "manifest.json"),
    ],
)
def test_a_damaged_manifest_is_refused_in_a_sentence(tmp_path, text, told):
    (tmp_path / "manifest.json").write_text(text)
    with pytest.raises(InputError, match=told):
        restored(tmp_path)


@pytest.mark.parametrize("text", ["{", '{"said": 3, "undone": []}', '{"said": [1], "undone": []}', "NaN", ""])
def test_a_damaged_history_is_refused_and_stays(tmp_path, text):
    scan = make_scan()
    (tmp_path / "history.json").write_text(text)
    with pytest.raises(InputError, match=r"history\.json"):
        open_scans([scan], CompletionOptions(texture=False), tmp_path / "history.json")
    assert (tmp_path / "history.json").read_text() == text
