# SPDX-License-Identifier: MIT
"""A room scanned all round, completed, as what drawings show; and a box of known facets."""

from datetime import UTC, datetime
from functools import cache

import numpy as np

from completion import Completion, CompletionOptions, complete
from completion.export.building.model import BuildingModel
from completion.export.building.parts import BuildingParts
from completion.export.dimension import Dimension
from completion.export.ifc import ifc_of
from completion.uncertainty.joint_errors import NO_ERRORS
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import View
from nbv.scanning.sensor_profile import load_sensor
from scenes.io.formats.format import Units
from scenes.pose import Pose
from scenes.world.builtin import builtin_scene

UTM = Pose.from_parts(np.eye(3), np.array([500_000.0, 5_000_000.0, 100.0]))
SIZE = (6.0, 5.0, 2.7)  # of the room, whose least corner is the origin of UTM


@cache
def panorama(name: str = "two_occluders", noise: str = "gaussian-2mm") -> Completion:
    """A built-in scene, scanned all round with noise, far from the origin of the world."""
    view = View(Pose.looking_at((2.0, 3.6, 1.5), (6.0, 2.5, 1.5)), load_sensor("panorama"))
    scan = scan_scene(builtin_scene(name), view, noise=noise, rng=0).transform(UTM)
    return complete(scan, CompletionOptions(texture=False), rng=0)


@cache
def parts_of(done: Completion) -> BuildingParts:
    """The building of a completion, made once a process."""
    return done.building()


def drawn(done: Completion) -> BuildingModel:
    """What drawings show of a completion."""
    return parts_of(done).model


WRITTEN = datetime(2026, 5, 4, 3, 2, 1, tzinfo=UTC)


def ifc_text(parts: BuildingParts, units: Units = "m") -> str:
    """The text of an IFC file of a building, as written at one time."""
    return ifc_of(parts, written=WRITTEN, units=units)


def box() -> BuildingModel:
    """The upright sides of a box of 2 x 1 x 1 m as surfaces 1 to 4, of two facets each; side 2 inferred."""
    base = np.array([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]], float)
    vertices = np.concatenate([base, base + [0, 0, 1.0]])
    faces = [[a, b, b + 4] for a, b in ((0, 1), (1, 2), (2, 3), (3, 0))]
    faces += [[a, b + 4, a + 4] for a, b in ((0, 1), (1, 2), (2, 3), (3, 0))]
    return BuildingModel(
        vertices=vertices,
        faces=np.array(faces),
        surface=np.tile(np.arange(1, 5), 2),
        provenance=np.tile([0, 1, 0, 0], 2),
        kinds=("rest", "plane", "plane", "plane", "plane"),
        folds=(),
        corners=np.zeros((0, 3)),
        corner_sd_m=np.zeros(0),
        openings=(),
        planes=(),
        cylinders=(),
        floor_m=None,
        eye_m=None,
        plans=(),
        errors=NO_ERRORS,
    )


def length(value: float, half: float, share: float = 1.0, existence: float = 1.0) -> Dimension:
    """A length that rests on nothing."""
    return Dimension(
        kind="room width",
        value=value,
        low=value - half,
        high=value + half,
        supports=(),
        ends=np.zeros((2, 3)),
        measured_share=share,
        existence=existence,
    )
