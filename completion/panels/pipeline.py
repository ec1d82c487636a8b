# SPDX-License-Identifier: MIT
"""Panels on one page: from completed surfaces to facets that meet in their fold edges."""

from __future__ import annotations

from collections.abc import Sequence

from completion.panels.arrangement import arrange
from completion.panels.corner import close_corners
from completion.panels.fold import find_folds
from completion.panels.sheet import Sheet
from completion.panels.welding import Facets, weld


def build(sheets: Sequence[Sheet]):
    folds, corners = close_corners(find_folds(sheets), sheets)
    charts = []
    for sheet in sheets:
        own = [fold for fold in folds if sheet.number in (fold.first, fold.second)]
        charts.append(arrange(sheet, own))
    return folds, corners, charts, weld(charts)
