# SPDX-License-Identifier: MIT
"""Features of a part by name, from its dimensions and profiles; without the geometry kernel."""

import numpy as np
import pytest
import trimesh

from benchmarks.cases.dimensioned_parts import dimensioned_part
from completion.export.step.entities import in_order
from completion.parts.dimensions.pipeline import dimensions_of
from completion.parts.part_features import features_of, features_text
from completion.parts.pipeline import model_part
from completion.parts.profiles.pipeline import profiles_of
from scenes.mesh.labelled_mesh import LabelledMesh
from tests.helpers.swept_parts import part_of, plate


def named(part, profiles=()):
    return features_of(part, dimensions_of(part, preferred=False), profiles)


@pytest.mark.parametrize(
    ("bore", "size", "n_faces"),
    [
        (
            [(9, 20), (9, 14), (4.5, 14)],
            "diameter 9.00 mm, through, counterbore diameter 18.00 mm, depth 6.00 mm",
            3,
        ),
        ([(7, 20), (4.5, 17.5)], "diameter 9.00 mm, through, countersink diameter 14.00 mm, 90 deg", 2),
        ([(4.5, 20)], "diameter 9.00 mm, through", 1),
        ([(4.5, 20), (4.5, 8), (0, 8)], "diameter 9.00 mm, depth 12.00 mm", 2),
    ],
)  # fmt: skip
def test_a_hole_is_one_feature_with_its_steps_and_its_size(bore, size, n_faces):
    start = [] if bore[-1][0] == 0 else [(bore[-1][0], 0)]
    profile = [*(start or [(0, 0)]), (30, 0), (30, 20), *bore, *start]
    ring = trimesh.creation.revolve(np.array(profile) / 1000, sections=48)
    (hole,) = named(model_part(LabelledMesh(ring.vertices, ring.faces)))
    assert (hole.name, hole.size) == ("hole 1", size)
    assert len(hole.surfaces) == n_faces


def test_equal_holes_are_within_their_pattern():
    made = dimensioned_part(9, 0.02, 5.0)
    features = named(model_part(made.points, made.face + 1))
    pattern = features[0]
    assert pattern.size == ("5 x hole diameter 6.64 mm, through, pitch circle diameter 84.00 mm")
    assert len({hole.name for hole in pattern.members}) == 5
    assert {hole.kind for hole in pattern.members} == {"hole"}
    within = {label for hole in pattern.members for label in hole.surfaces}
    assert set(pattern.surfaces) == within
    assert not within & {label for one in features[1:] for label in one.surfaces}
    assert len(pattern.record()["members"]) == 5
    assert "5 in 1 pattern" in features_text(features)


def test_a_slot_has_its_walls_and_floor_and_a_round_hole_is_no_loop():
    part = part_of(plate(), (0.0, 6.0, 15.0))
    features = named(part, profiles_of(part))
    assert [one.name for one in features] == ["hole 1", "slot 1", "fillet 1", "fillet 2"]
    slot = features[1]
    width, length, depth = (float(text.split()[1]) for text in slot.size.split(", "))
    assert (width, length, depth) == pytest.approx((10.0, 30.0, 9.0), abs=0.05)
    floor = [label for label, fit in zip(part.labels, part.fits, strict=True)
             if label in slot.surfaces and fit.surface.kind == "plane"]  # fmt: skip
    assert len(slot.surfaces) == 5
    assert len(floor) == 3
    assert features_text(features) == "1 hole, 1 slot, 2 fillets"


def test_a_part_without_features_says_so():
    block = trimesh.creation.box((0.03, 0.02, 0.01))
    assert named(model_part(LabelledMesh(block.vertices, block.faces))) == ()
    assert features_text(()) == "none found"


HEAD = "HEADER;\nENDSEC;\nDATA;\n"
TAIL = "ENDSEC;\nEND-ISO-10303-21;\n"


def test_entities_are_in_an_order_of_their_own():
    first = [
        "#1 = ADVANCED_FACE('it''s #7; \n',$);",
        "#2 = ADVANCED_FACE('b',$);",
        "#3 = NEXT_ASSEMBLY_USAGE_OCCURRENCE('{n}',\n  'body','',#1);",
    ]
    colour = "MECHANICAL_DESIGN_GEOMETRIC_PRESENTATION_REPRESENTATION('',({}),#1);"
    one = [*first, f"#4 = {colour.format('#5')}", "#5 = STYLED_ITEM('',(#6),#1);", "#6 = COLOUR('',1.);",
           f"#7 = {colour.format('#8')}", "#8 = STYLED_ITEM('',(#6),#2);"]  # fmt: skip
    two = [*first, f"#4 = {colour.format('#5')}", "#5 = STYLED_ITEM('',(#6),#2);", "#6 = COLOUR('',1.);",
           f"#7 = {colour.format('#8')}", "#8 = STYLED_ITEM('',(#6),#1);"]  # fmt: skip
    ordered = [
        in_order(HEAD + "\n".join(lines).replace("{n}", n) + "\n" + TAIL)
        for lines, n in ((one, "1"), (two, "12"))
    ]
    assert ordered[0] == ordered[1]
    assert ordered[0].count(";\n") == 3 + len(one) + 2
    assert "#3 = NEXT_ASSEMBLY_USAGE_OCCURRENCE('1','body','',#1);" in ordered[0]
    assert "'it''s #7; '" in ordered[0]
    assert "#5 = STYLED_ITEM('',(#6),#1);" in ordered[0]
    assert "#8 = STYLED_ITEM('',(#6),#2);" in ordered[0]
