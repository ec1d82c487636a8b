# SPDX-License-Identifier: MIT
"""What users see of values: texts of five lines at most, cards with the same facts, names to import."""

import ast
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from html import unescape

import numpy as np
import pytest

import completion
import nbv
import scenes
import texture
from completion.options import CompletionOptions
from scenes.card import brief, text_of_facts
from scenes.checks import Value
from tests.helpers.annotations import Definition, Place, exported, named_by, reached, resolve
from tests.helpers.completion_examples import completed, example
from tests.helpers.room_examples import ROOM, VIEW, covered_by_two
from tests.helpers.study_examples import write_study
from tests.nbv.inspection.checks import example_check

MOST_CHARACTERS, MOST_LINES, MOST_ENTRIES = 400, 5, 4
PACKAGES = ("completion", "nbv", "scenes", "texture")


def is_data(node: Definition) -> bool:
    """Whether a definition is a dataclass or a named tuple."""
    if not isinstance(node, ast.ClassDef):
        return False
    above = [ast.unparse(one) for one in (*node.decorator_list, *node.bases)]
    return any("dataclass" in one or one == "NamedTuple" for one in above)


def shows_itself(place: Place, node: Definition) -> bool:
    """Whether a class is a `Value`, is `shown` as one, or has a text of its own."""
    if not isinstance(node, ast.ClassDef):
        return False
    if any(ast.unparse(decorator) == "shown" for decorator in node.decorator_list):
        return True
    if any(isinstance(item, ast.FunctionDef) and item.name == "__repr__" for item in node.body):
        return True
    bases = [resolve(place[0], ast.unparse(base).split("[")[0]) for base in node.bases]
    return any(base[0][1] == "Value" or shows_itself(*base) for base in bases if base is not None)


def test_all_values_that_users_can_reach_show_themselves() -> None:
    values = {place: node for place, node in reached().items() if is_data(node)}
    assert len(values) > 200
    bare = [place for place, node in values.items() if not shows_itself(place, node)]
    assert bare == [], "give these the base `scenes.checks.Value`, named tuples the decorator `shown`"


def signature_of(name: str, node: Definition) -> Definition:
    """A function, or a class that has only the fields of options."""
    if not isinstance(node, ast.ClassDef):
        return node
    given = [item for item in node.body if isinstance(item, ast.AnnAssign) and name.endswith("Options")]
    return ast.ClassDef(name, bases=[], keywords=[], body=list(given), decorator_list=[])


def test_classes_that_public_functions_and_options_name_can_be_imported() -> None:
    places = {place for place, _ in exported().values()}
    missing = {
        f"{package}.{name} names {named[1]} of {named[0]}"
        for (package, name), (place, node) in exported().items()
        for named, of in named_by(place, signature_of(name, node)).items()
        if isinstance(of, ast.ClassDef) and named not in places
    }
    assert missing == set()


def values_below(value: object, seen: dict[int, object], depth: int = 10) -> Iterator[object]:
    """The values of the packages in a value, itself first; of many entries the first ones."""
    if id(value) in seen or depth == 0:
        return
    seen[id(value)] = value
    inner: list[object] = []
    if type(value).__module__.split(".")[0] in PACKAGES:
        yield value
        inner = [getattr(value, one.name) for one in fields(value)] if is_dataclass(value) else []
    elif isinstance(value, tuple | list | Mapping):
        inner = list(value.values() if isinstance(value, Mapping) else value)[:MOST_ENTRIES]
    for one in inner:
        yield from values_below(one, seen, depth - 1)


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> list[object]:
    """Results and options as users meet them, and all that is in them."""
    folder = tmp_path_factory.mktemp("study")
    room = completed("chair_before_wall", pixels=120)
    scan = example("two_occluders", pixels=100)
    points = scan.points()[scan.valid]
    places = np.stack(np.meshgrid(np.arange(20.0), np.arange(30.0), [0.0]), axis=-1).reshape(-1, 3)
    image = np.random.default_rng(0).integers(0, 255, (40, 30, 3), dtype=np.uint8)
    hole = np.zeros((40, 30), bool)
    hole[10:14, 10:15] = True
    fill = texture.fill(image, hole, window=5, rng=0)
    tops = [
        ROOM, VIEW, covered_by_two(), scan, room, room.building(), room.decisions(), room.panels(),
        nbv.CheckedDesign(example_check()),
        completion.model_part(places, np.ones(len(places), int), relations=None),
        completion.fit(points[:200] * [1, 1, 0], "plane"),
        completion.select(places),
        completion.verify(room, [scan]),
        completion.find_features([scan], ["doorway"]),
        completion.check_poses([scan, scan]),
        scenes.PointCloud(points),
        fill, texture.examine(fill, hole), texture.fill_surface(image / 255, hole, window=5, rng=0),
        texture.find_lattice(image),
        nbv.read_study(write_study(folder)),
        nbv.plan_views(ROOM, VIEW.sensor, method="greedy", target=0.1, views=2, rng=0),
        CompletionOptions(backs=completion.BackOptions()),
        *(getattr(face, name)() for face in (nbv, completion) for name in face.__all__ if "Options" in name),
        *(nbv.load_sensor(name) for name in nbv.sensor_names()),
    ]  # fmt: skip
    return [value for top in tops for value in values_below(top, {})]


def test_texts_of_values_are_short(shown: list[object]) -> None:
    texts = {type(value).__name__: repr(value) for value in shown}
    assert len(texts) > 100
    long = {name for name, text in texts.items() if len(text) > MOST_CHARACTERS}
    assert long | {name for name, text in texts.items() if text.count("\n") >= MOST_LINES} == set()


def test_cards_tell_what_texts_tell(shown: list[object]) -> None:
    for value in shown:
        if isinstance(value, Value) and type(value)._repr_html_ is Value._repr_html_:
            html = unescape(value._repr_html_())
            assert all(label in html and told in html for label, told in value._facts()), type(value)


def test_long_facts_are_cut_and_many_left_out() -> None:
    text = text_of_facts("Walk", [(f"leg {k}", "far " * 200) for k in range(30)])
    assert len(text) <= MOST_CHARACTERS
    assert text.count("\n") < MOST_LINES
    assert text.endswith(" ...)")
    assert text_of_facts("Walk", []) == "Walk()"


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (np.float32(0.5), "0.5"),
        ({"a": np.zeros(9)}, "{'a': float64 (9,)}"),
        ((np.eye(3),), "(float64 (3, 3),)"),
        ({1, 2}, "{1, 2}"),
        ("long " * 30, "'long long long long long long long long long..."),
        (completion.Finding.HIDDEN, "HIDDEN"),
        (object(), "object"),
        (VIEW, "View(pinhole at 0.500, 0.500, 1.500)"),
        (covered_by_two, "_lru_cache_wrapper"),
    ],
)
def test_values_in_brief(value: object, text: str) -> None:
    assert brief(value) == text
