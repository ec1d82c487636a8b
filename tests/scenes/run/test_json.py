# SPDX-License-Identifier: MIT
"""JSON files: written a part at a time, with the bytes of the whole text."""

import numpy as np
import pytest

from scenes.run.atomic import json_text, write_json

DOCUMENTS = [
    {},
    [1, {"a": 2}],
    {"one": None, 2: True, "three": "line\nbreak, \u00e9"},
    {"empty": [], "nothing": {}, "none": (), "array": np.zeros((0, 3))},
    {"surfaces": [{"points": np.array([[1.5, np.nan], [0.1, -np.inf]]), "deep": [{"b": []}]}, {}, [], "x"]},
    {"nested": {"list": [{"a": (1, 2)}, np.int64(3)]}, "last": [1.0]},
]


@pytest.mark.parametrize("document", DOCUMENTS, ids=range(len(DOCUMENTS)))
def test_files_hold_the_text_of_the_whole_document(document, tmp_path):
    write_json(tmp_path / "a.json", document)
    assert (tmp_path / "a.json").read_bytes() == json_text(document).encode("utf-8")


def test_a_document_that_has_no_json_form_leaves_the_file_before(tmp_path):
    write_json(tmp_path / "a.json", {"a": 1})
    with pytest.raises(TypeError, match="object has no JSON form"):
        write_json(tmp_path / "a.json", {"b": [1, object()]})
    assert (tmp_path / "a.json").read_text() == json_text({"a": 1})
    assert [path.name for path in tmp_path.iterdir()] == ["a.json"]
