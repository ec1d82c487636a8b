# SPDX-License-Identifier: MIT
"""A threshold stands in the `limits.py` of its stage, with its unit and where it comes from."""

import ast

import pytest

from examples.plot_architecture import PACKAGES, tree_of
from tests.helpers.data_paths import ROOT

FILES = sorted(
    str(path.relative_to(ROOT)) for package in PACKAGES for path in (ROOT / package).rglob("limits.py")
)
LIMITS = [path for path in FILES if not any(isinstance(x, ast.ClassDef) for x in tree_of(path).body)]
LEAST_WORDS = 2  # of a unit or what is measured, and an origin


def words_by_limit(path):
    """How many words stand below each value of a file."""
    body = tree_of(path).body
    words = {}
    for statement, following in zip(body, [*body[1:], None], strict=True):
        if isinstance(statement, ast.Assign | ast.AnnAssign):
            target = statement.target if isinstance(statement, ast.AnnAssign) else statement.targets[0]
            text = following.value if isinstance(following, ast.Expr) else None
            words[ast.unparse(target)] = len(str(text.value).split()) if isinstance(text, ast.Constant) else 0
    return words


def test_stages_have_limits():
    assert LIMITS


@pytest.mark.parametrize("path", LIMITS)
def test_each_limit_says_where_it_comes_from(path):
    assert [name for name, n_words in words_by_limit(path).items() if n_words < LEAST_WORDS] == []
