# SPDX-License-Identifier: MIT
"""Values and entities as ISO 10303-21 writes them."""

import re
from datetime import UTC, datetime

import numpy as np
import pytest

from completion.export.ifc_entities import Exact, Ref, StepText, TypedValue, Word

WRITTEN = datetime(2026, 5, 4, 3, 2, 1, tzinfo=UTC)


def written(values):
    file = StepText(b"")
    file.add("Thing", values)
    return re.search(r"#1=THING\((.*)\);", file.text("a", "S", WRITTEN)).group(1)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "$"),
        (True, ".T."),
        (False, ".F."),
        (3, "3"),
        (np.int64(4), "4"),
        (1.0, "1."),
        (-0.0, "0."),
        (0.1, "0.1"),
        (1e-5, "1.E-05"),
        (1.5e-8, "1.5E-08"),
        (1e-12, "0."),
        (5e20, "5.E+20"),
        (np.float64(2.5), "2.5"),
        (Exact(1200 / 3937), "0.3048006096012192"),
        (Ref(7), "#7"),
        (Word("AREA"), ".AREA."),
        (Word("*"), "*"),
        (TypedValue("IfcLabel", "a"), "IFCLABEL('a')"),
        ("it's", "'it''s'"),
        ("back\\slash", "'back\\\\slash'"),
        ("Höhe\n", "'H\\X2\\00F6\\X0\\he\\X2\\000A\\X0\\'"),
        ([1, [2.0, "x"]], "(1,(2.,'x'))"),
        ([], "()"),
    ],
)
def test_values_are_written_as_the_norm_says(value, text):
    assert written([value]) == text


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_numbers_must_be_finite(value):
    with pytest.raises(ValueError, match="finite"):
        written([value])


def test_equal_entities_are_written_once_unless_they_stand_alone():
    file = StepText(b"")
    assert file.add("A", [1]) == file.add("a", [1]) == Ref(1)
    assert file.add("A", [1], alone=True) == Ref(2)
    assert file.add("A", [2]) == Ref(3)


def test_identifiers_follow_from_content_and_key():
    one, same, other = StepText(b"x"), StepText(b"x"), StepText(b"y")
    first = one.guid("wall")
    assert re.fullmatch(r"[0-3][0-9A-Za-z_$]{21}", first)
    assert same.guid("wall") == first
    assert other.guid("wall") != first
    assert one.guid("slab") != first
    with pytest.raises(ValueError, match="'wall' has an identifier already"):
        one.guid("wall")


def test_the_header_says_what_wrote_it_and_when():
    head = StepText(b"").text("a'b", "IFC4", WRITTEN).splitlines()
    assert head[0] == "ISO-10303-21;"
    assert head[3].startswith("FILE_NAME('a''b','2026-05-04T03:02:01+00:00',('not stated'),('not stated'),")
    assert re.search(r"'unseen [\d.]+','The unseen developers - unseen - [\d.]+',''\);$", head[3])
    assert "FILE_SCHEMA(('IFC4'));" in head
    assert head[-1] == "END-ISO-10303-21;"
