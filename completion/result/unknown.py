# SPDX-License-Identifier: MIT
"""Unknown: where a surface may go on, but was hidden, and nothing is inferred."""

from __future__ import annotations

import numpy as np

from completion.boundary.meshing import ChartMesh, mesh_cells
from completion.evidence.evidence import Label
from completion.extension.patch import Patch
from completion.result.labelled_points import mesh_area


def unknown_part(patch: Patch) -> ChartMesh:
    """Return the hidden cells of a surface that were neither measured nor inferred, as a mesh.

    Something nearer stood before them, and no beam passed: the surface may go on there.
    """
    hidden = np.isin(patch.evidence.labels, (Label.OCCLUDED, Label.UNLIT)) & ~patch.evidence.through
    unknown = hidden & patch.is_within & ~patch.observed & ~patch.hypothesised
    return mesh_cells(patch.grid, unknown, patch.limits.cuts, merged=True)


def unknown_m2(patch: Patch) -> float:
    """Return the area of these cells, square metres."""
    part = unknown_part(patch)
    return mesh_area(part.vertices, part.faces)
