# SPDX-License-Identifier: MIT
"""Card of a scene: what a notebook shows of it."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np

from scenes.card.card import Card

if TYPE_CHECKING:
    from scenes.world.scene import Scene


def card_of_scene(scene: Scene) -> Card:
    """Return size, surfaces, faces, area and warnings of a scene."""
    kinds = Counter("mesh only" if one is None else type(one).__name__.lower() for one in scene.surfaces)
    vertices, area = scene.mesh.vertices, float(scene.mesh.face_areas().sum())
    size = " x ".join(f"{side:.2f}" for side in np.ptp(vertices, axis=0)) if len(vertices) else "0 x 0 x 0"
    figures = [
        ("extent x, y, z", f"{size} m"),
        ("surface", f"{area:.2f} m\u00b2 in {len(scene.mesh.faces)} faces"),
        ("surfaces", ", ".join(f"{n} {kind}" for kind, n in sorted(kinds.items())) or "none"),
        ("scanned from", "within (room)" if scene.mode == "room" else "around (object)"),
    ]
    figures += [("openings", str(len(scene.openings)))] if scene.openings else []
    return Card("Scene", scene.name, figures, note=" ".join(scene.warnings))
