# SPDX-License-Identifier: MIT
"""Sessions: statements are tried, taken, undone and kept; they do what edit files do."""

import json

import numpy as np
import pytest

from completion.edits.file import edits_of
from completion.options import CompletionOptions
from completion.pipeline import complete
from completion.relations.relation import scan_relations_of
from nbv.report.review.asking import rectangle
from nbv.report.review.session import document_of
from scenes.checks import InputError
from scenes.inclination import Up


def wall_of(completion):
    """Number of the surface with most inferred area."""
    return 1 + int(np.argmax([patch.hypothesised_m2 for patch in completion.patches]))


def reject(completion, number):
    return {"do": "reject", "surface": completion.anchor(number).tolist(), "note": f"surface {number}"}


def parallel(completion, one, two, **more):
    return {"type": "parallel", "surfaces": [completion.anchor(k).tolist() for k in (one, two)], **more}


def test_what_is_tried_is_told_and_not_taken(session):
    before = session.completion
    wall = wall_of(before)
    found = session.try_out(reject(before, wall))
    assert session.said == []
    assert session.completion is before
    changed = [one for one in found.surfaces if one.before == wall]
    assert changed[0].inferred_m2[0] == pytest.approx(before.patches[wall - 1].hypothesised_m2)
    assert changed[0].inferred_m2[1] < 0.01
    assert found.inferred_m2[1] < found.inferred_m2[0]
    assert found.measured_m2[1] == pytest.approx(found.measured_m2[0])
    assert found.unknown_m2[1] > found.unknown_m2[0]
    assert not found.is_refused
    assert found.seconds > 0


def test_take_undo_and_redo(session):
    before = session.completion
    said = reject(before, wall_of(before))
    session.take(said)
    after = session.completion
    assert after.hypothesised_m2 < before.hypothesised_m2
    session.undo()
    assert session.completion is before
    with pytest.raises(InputError, match="nothing to undo"):
        session.undo()
    session.redo()
    assert session.completion is after
    with pytest.raises(InputError, match="nothing to redo"):
        session.redo()
    assert session.version == 3


def test_a_session_goes_on_where_a_killed_one_was(session, measured):
    before = session.completion
    one, two = reject(before, wall_of(before)), parallel(before, 1, 2)
    session.take(one)
    session.take(two)
    session.undo()
    again = measured.session(session.file)
    assert again.said == [one]
    again.redo()
    assert again.said == [one, two]


def test_statements_do_what_their_file_does(session, measured):
    session.take(reject(session.completion, wall_of(session.completion)))
    session.take(parallel(session.completion, 1, 2))
    document = json.loads(json.dumps(document_of(session.said)))
    options = CompletionOptions(
        texture=False, up=Up.along("z"), edits=edits_of(document, "file"),
        stated_relations=scan_relations_of(document, "file"),
    )  # fmt: skip
    alone = complete(measured.scan, options, rng=0)
    mine = session.completion
    assert len(alone.patches) == len(mine.patches)
    for one, two in zip(alone.patches, mine.patches, strict=True):
        assert np.array_equal(one.provenance, two.provenance)
        assert np.array_equal(one.confidence, two.confidence)


def test_a_relation_that_the_scans_deny_is_refused_with_its_misfit(session):
    completion = session.completion
    normals = [patch.grid.surface.normal_direction for patch in completion.patches]
    one, two = next(
        (k, m) for k in range(len(normals)) for m in range(k) if abs(normals[k] @ normals[m]) < 0.2
    )
    found = session.try_out(parallel(completion, one + 1, two + 1))
    assert found.is_refused
    assert "refused by the scans" in found.sentences[0]
    assert "standard deviations off" in found.sentences[0]


def test_what_was_measured_stays_in_an_opening(session):
    completion = session.completion
    wall = wall_of(completion)
    anchor = completion.anchor(wall)
    outline = rectangle(completion, wall, anchor + np.array([[-0.1, 0, -0.1], [0.1, 0, 0.1]]))
    said = {"do": "opening", "surface": anchor.tolist(), "outline": outline.tolist()}
    found = session.try_out(said)
    assert found.sentences[0].endswith("m2 of it stay: they were measured.")
    assert float(found.sentences[0].split()[0]) == pytest.approx(0.04, abs=0.02)
    assert found.is_refused


@pytest.mark.parametrize(
    ("statement", "message"),
    [
        ({"do": "reject", "surface": [90.0, 0.0, 0.0]}, "surface"),
        ({"do": "explode", "surface": 1}, "do"),
        ({"type": "parallel", "surfaces": [[0, 0, 0]]}, "surface"),
        ({"do": "merge", "surfaces": [[0.0, 0.0, 0.0]]}, "two surfaces"),
    ],
)
def test_what_cannot_be_meant_is_refused_and_changes_nothing(session, statement, message):
    with pytest.raises(InputError, match=message):
        session.take(statement)
    assert session.said == []
    assert not session.file.exists()
