# SPDX-License-Identifier: MIT
"""Sources of the packages as syntax trees, for the laws on them."""

import ast
from functools import cache

from tests.helpers.data_paths import ROOT


@cache
def tree_of(path: str) -> ast.Module:
    """Syntax tree of a file, its path from the root; read once a process."""
    return ast.parse((ROOT / path).read_text("utf-8"))
