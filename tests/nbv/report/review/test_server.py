# SPDX-License-Identifier: MIT
"""The review server answers its own page on this machine, and nobody else."""

import json

import numpy as np
import pytest
from werkzeug.test import Client

from nbv.report.review.asking import distance_between, facts_of, hidden_box, surface_at
from nbv.report.review.session import document_of
from nbv.report.viewer.encoding import decoded_header
from tests.nbv.report.review.test_session import reject, wall_of

HOST = {"base_url": "http://127.0.0.1:8000"}


@pytest.fixture
def client(server):
    return Client(server)


def path(server, question=""):
    return f"/{server.token}/{question}"


def post(client, server, question, **asked):
    return client.post(path(server, question), json=asked, **HOST)


def test_the_page_names_its_title_as_text_and_runs_its_own_script_alone(client, server):
    answer = client.get(path(server), **HOST)
    assert answer.status_code == 200
    assert "<script>alert(1)" not in answer.text
    assert "&lt;script&gt;alert(1)" in answer.text
    policy = answer.headers["Content-Security-Policy"]
    nonce = policy.split("script-src 'nonce-")[1].split("'")[0]
    assert len(nonce) >= 16
    assert answer.text.count(f'<script nonce="{nonce}">') == 1
    assert client.get(path(server), **HOST).headers["Content-Security-Policy"] != policy


@pytest.mark.parametrize("wrong", ["/", "/state", "/wrong/state", "//state", "/../etc/passwd"])
def test_without_the_token_nothing_is_told(client, wrong):
    answer = client.get(wrong, **HOST)
    assert answer.status_code == 403
    assert "surfaces" not in answer.text


@pytest.mark.parametrize("outside", ["../state", "..%2f..%2fetc/passwd", "state/../../x", "report.html"])
def test_there_are_no_files_to_reach(client, server, outside):
    assert client.get(path(server, outside), **HOST).status_code in (403, 404)


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:9999"])
def test_other_pages_are_refused(client, server, origin):
    answer = client.post(path(server, "undo"), json={}, headers={"Origin": origin}, **HOST)
    assert answer.status_code == 403


def test_other_names_of_this_machine_are_refused(client, server):
    answer = client.get(path(server, "state"), base_url="http://evil.example:8000")
    assert answer.status_code == 403


def test_its_own_origin_is_not(client, server):
    answer = client.post(
        path(server, "ask"), json={"surface": 1}, headers={"Origin": "http://127.0.0.1:8000"}, **HOST
    )
    assert answer.status_code == 200


@pytest.mark.parametrize(
    ("body", "kind", "status"),
    [
        ("{", "application/json", 400),
        ("[]", "application/json", 400),
        ("{}", "text/plain", 400),
        ("[" * 100_000, "application/json", 400),
        ('{"statement": 3}', "application/json", 422),
        (json.dumps({"statement": {"do": "explode"}}), "application/json", 422),
        (json.dumps({"statement": {"do": "reject", "surface": [1e400, 0, 0]}}), "application/json", 422),
    ],
)
def test_questions_that_are_none_are_answered_in_a_sentence(client, server, body, kind, status):
    answer = client.post(path(server, "try"), data=body, content_type=kind, **HOST)
    assert answer.status_code == status
    assert answer.json["error"]


def test_a_question_that_is_too_long_is_refused(client, server):
    answer = client.post(
        path(server, "try"), data=b" " * ((1 << 20) + 1), content_type="application/json", **HOST
    )
    assert answer.status_code == 400


def test_the_page_tries_takes_and_undoes(client, server):
    completion = server.session.completion
    said = reject(completion, wall_of(completion))
    tried = post(client, server, "try", statement=said)
    assert tried.json["inferred_m2"][1] < tried.json["inferred_m2"][0]
    view = decoded_header(client.get(path(server, "view"), **HOST).text)
    trial = decoded_header(client.get(path(server, "trial-view"), **HOST).text)
    faces = [{one["key"]: one["faces"] for one in held["layers"]} for held in (view, trial)]
    assert faces[0]["measured"] == faces[1]["measured"]
    assert faces[1].get("inferred", 0) < faces[0]["inferred"]
    taken = post(client, server, "take", statement=said).json
    assert taken["said"] == [said]
    assert taken["version"] == 1
    assert client.get(path(server, "state"), **HOST).json == taken
    assert post(client, server, "undo").json["undone"] == 1
    assert post(client, server, "undo").status_code == 422
    assert document_of(server.session.said) == {"edits": [], "relations": []}
    assert post(client, server, "save").json == {"written": ["x"]}


def test_a_click_is_answered_by_what_is_known_there(client, server):
    completion = server.session.completion
    wall = wall_of(completion)
    patch = completion.patches[wall - 1]
    centres = patch.grid.centres().reshape(*patch.grid.shape, 3)
    inferred = completion.world_from_reference.apply(centres[patch.hypothesised])
    place = inferred[len(inferred) // 2]
    found = post(client, server, "ask", place=place.tolist()).json
    assert found["surface"] == wall
    assert found["place"]["state"] == "inferred"
    assert 0 < found["place"]["probability"] <= 1
    assert found["inferred_m2"] == pytest.approx(patch.hypothesised_m2)
    assert sum(one["share"] for one in found["hidden_by"]) == pytest.approx(1, abs=0.2)
    assert any(one["known"] == "seen" for one in found["ends"])
    assert found["seen_by"][0]["pixels"] > 100
    assert post(client, server, "ask", place=[50, 50, 50]).json == {"surface": None}
    assert post(client, server, "ask", surface=99).status_code == 422
    snaps = post(client, server, "snaps", surface=wall, place=place.tolist()).json
    assert {"at this height", "upright through here"} <= {one["sentence"] for one in snaps}
    tried = post(client, server, "try", statement={
        "do": "end", "surface": found["anchor"], **next(one["cut"] for one in snaps if "plane" in one["cut"])
    })  # fmt: skip
    assert tried.status_code == 200


def test_an_opening_is_the_rectangle_between_two_clicks(client, server):
    completion = server.session.completion
    wall = wall_of(completion)
    places = completion.anchor(wall) + np.array([[0.0, 0, 0], [0.2, 0, 0.3]])
    corners = np.array(post(client, server, "rectangle", surface=wall, places=places.tolist()).json)
    assert corners.shape == (4, 3)
    plane = completion.patches[wall - 1].grid.surface.transform(completion.world_from_reference)
    assert np.abs(plane.distance(corners)).max() < 1e-9
    sides = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    assert sides[0] == pytest.approx(sides[2])
    assert np.ptp(corners[:, 2]) == pytest.approx(0.3, abs=0.02)
    assert post(client, server, "rectangle", surface=wall, places=[places[0].tolist()] * 2).status_code == 422


def test_a_distance_has_the_interval_of_the_surfaces_at_its_ends(server):
    completion = server.session.completion
    wall = wall_of(completion)
    assert surface_at(completion, completion.anchor(wall)) == wall
    other = next(k for k in range(1, len(completion.patches) + 1) if k != wall)
    found = distance_between(completion, np.stack([completion.anchor(wall), completion.anchor(other)]))
    assert found["half_m"] > 0
    assert found["length_m"] > found["half_m"]
    nowhere = distance_between(completion, np.array([completion.anchor(wall), [50.0, 0, 0]]))
    assert nowhere["half_m"] is None
    assert facts_of(completion, wall)["sd_mm"] > 0


def test_the_next_station_looks_at_what_is_hidden(client, server):
    completion = server.session.completion
    wall = wall_of(completion)
    found = post(client, server, "stand", surface=wall).json
    assert found["why_none"] == ""
    assert found["gain_m2"] > 0.05
    middle = hidden_box(completion, wall).mean(axis=0)
    assert (middle - found["place"]) @ found["direction"] > 0.5
    nowhere = post(client, server, "stand", surface=99)
    assert nowhere.status_code == 422
