# SPDX-License-Identifier: MIT
"""Rooms of boxes, and the check that exact scans of them would give."""

import numpy as np

from completion.asbuilt.findings import (
    LOA_BANDS_M,
    Alignment,
    DesignCheck,
    DeviationPoints,
    ElementFinding,
    Extra,
    FaceFinding,
    Interval,
    Samples,
)
from nbv.visibility.requirement import SightLimits
from nbv.visibility.samples import sample_surface
from nbv.visibility.visibility import visible_from_positions
from scenes.mesh.design import Element, ElementMesh
from scenes.mesh.labelled_mesh import Appearance, LabelledMesh, join_meshes
from scenes.pose import Pose
from scenes.rays.raycast import RayCaster
from tests.helpers.buildings import Building

HIGH = 2.5
TWO_ROOMS = {  # two rooms of 4 by 4 m with a door between them, the eastern one beyond x = 4.1
    "floor": ((-0.2, -0.2, -0.2), (8.4, 4.2, 0)),
    "ceiling": ((-0.2, -0.2, HIGH), (8.4, 4.2, HIGH + 0.2)),
    "west": ((-0.2, 0, 0), (0, 4, HIGH)),
    "east": ((8.2, 0, 0), (8.4, 4, HIGH)),
    "south 1": ((-0.2, -0.2, 0), (4.1, 0, HIGH)),
    "south 2": ((4.1, -0.2, 0), (8.4, 0, HIGH)),
    "north 1": ((-0.2, 4, 0), (4.1, 4.2, HIGH)),
    "north 2": ((4.1, 4, 0), (8.4, 4.2, HIGH)),
    "between": ((4.0, 1.0, 0), (4.2, 4, HIGH)),
    "lintel": ((4.0, 0, 2.1), (4.2, 1.0, HIGH)),
}
CRATE = ((1.0, 3.2, 0.0), (3.0, 3.9, 2.3))
PANEL = {"panel": ((1.4, 3.98, 0.3), (2.6, 4.0, 1.8))}  # on the wall behind the crate


def design_of(boxes, glass=()) -> ElementMesh:
    """The boxes as elements; those named in `glass` are clear."""
    made = Building()
    for name, (low, high) in boxes.items():
        made.box(name, low, high)
    mesh = made.scene().mesh
    names = list(boxes)
    clear = np.isin(mesh.face_surface, [names.index(name) for name in glass])
    look = Appearance(np.full((len(clear), 3, 3), 0.5), opacity=np.where(clear, 0.2, 1.0))
    mesh = LabelledMesh(mesh.vertices, mesh.faces, mesh.face_surface, look)
    return ElementMesh(mesh, tuple(Element(name, "IfcWall") for name in names), "rooms")


def cells_of(low, high) -> np.ndarray:
    """Middles (n, 3) of the cells of 5 cm on the sides and the top of a box."""
    axes = [np.arange(a + 0.025, b, 0.05) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    outer = np.ones(grid.shape[:3], bool)
    outer[1:-1, 1:-1, :-1] = False
    return grid[outer]


def check_of(design, eyes, crates=(), missing=(), doubtful=None, moved=None) -> DesignCheck:
    """The check of exact scans from `eyes` of a design and `crates`, without the elements `missing`.

    An element of which 0.3 m2 are seen is within; behind a crate it is hidden, else not seen. `doubtful`
    gives offset and half interval of elements, metres. `moved` is a pose that everything is moved by.
    """
    move, names = moved or Pose.identity(), [element.name for element in design.elements]
    built = ~np.isin(design.mesh.face_surface, [names.index(name) for name in missing])
    glass = design.mesh.appearance.opacity < 0.9
    crate_meshes = [design_of({"crate": box}).mesh for box in crates]
    shell = design.mesh.some(built & ~glass)
    alone, all_ = (RayCaster(m.vertices, m.faces) for m in (shell, join_meshes([shell, *crate_meshes])))
    samples = sample_surface(design.mesh, 0.1)
    inside = np.zeros(len(samples), bool)
    middle = samples.points + 0.01 * samples.normals
    for low, high in TWO_ROOMS.values():
        inside |= ((middle > np.array(low) - 1e-6) & (middle < np.array(high) + 1e-6)).all(axis=1)
    samples = samples.some(~inside)
    sees = [
        np.bincount(visible_from_positions(caster, np.array(eyes), samples, SightLimits(0.17)).indices,
                    minlength=len(samples)) > 0
        for caster in (all_, alone)
    ]  # fmt: skip
    gone = np.isin(samples.surface, [names.index(name) for name in missing])
    measured = sees[0] & ~gone
    reason = np.select([measured, gone & sees[0], sees[1]], [0, 6, 1], 2)
    found = []
    for k, element in enumerate(design.elements):
        seen = float(samples.areas[measured & (samples.surface == k)].sum())
        behind = (reason == 1) & (samples.surface == k)
        open_ = "hidden" if behind.any() else "not seen"
        verdict = "missing" if element.name in missing else "within" if seen > 0.3 else open_
        deviation = Interval(0.001, 0.0, 0.002) if verdict == "within" else None
        if element.name in (doubtful or {}):
            off, half = doubtful[element.name]
            verdict, deviation = "undecided", Interval(off, off - half, off + half)
        faces = _faces(design, k, move, deviation, samples.points[measured & (samples.surface == k)])
        found.append(ElementFinding(k, element, verdict, 0.01, faces=faces))
    extra = []
    for k, (low, high) in enumerate(crates):
        cells = move.apply(cells_of(low, high))
        box = np.stack([cells.min(axis=0) - 0.025, cells.max(axis=0) + 0.025])
        extra.append(Extra(f"extra-{k + 1}", box, 1.0, cells))
    upright = Pose.looking_at((0, 0, 0), (1, 0, 0)).rotation
    poses = tuple(move @ Pose.from_parts(upright, np.array(eye)) for eye in eyes)
    turned = design.mesh.at(move.apply(design.mesh.vertices))
    return DesignCheck(
        ElementMesh(turned, design.elements, design.name), tuple(f"s{k}" for k in range(len(eyes))),
        tuple(found), tuple(extra), Alignment(poses, *np.zeros((4, 3)), np.zeros((len(poses), 3)), 0.001),
        faces_tested=10, z=3.0, false_alarms_expected=0.05, loa_bands_m=LOA_BANDS_M,
        samples=Samples(
            move.apply(samples.points), samples.normals @ move.rotation.T, samples.surface, samples.areas,
            np.where(measured, 0, 2).astype(np.int8), reason.astype(np.int8),
            np.where(reason == 1, -2, -1).astype(np.int32),
        ),
        cloud=DeviationPoints(np.zeros((0, 3)), np.zeros(0, np.int32), np.zeros(0), np.zeros(0, np.int8)),
    )  # fmt: skip


def _faces(design, k, move, deviation, measured):
    """The two largest faces of a box; those are tested on which points were measured."""
    own = design.mesh.some(design.mesh.face_surface == k)
    low, high = own.bounds()
    axis = int(np.argmin(high - low))
    area = float(np.prod(np.delete(high - low, axis)))
    faces = []
    for way in (1.0, -1.0):
        normal = way * np.eye(3)[axis]
        centre = (low + high) / 2 + normal * (high - low)[axis] / 2
        on_it = np.abs((measured - centre) @ normal) < 1e-6
        is_tested = deviation is not None and bool(on_it.any())
        faces.append(FaceFinding(
            k, "plane", True, move.apply(centre[None])[0], move.rotation @ normal, area, support=0.9,
            is_tested=is_tested, deviation=deviation if is_tested else None, n_beams=900 * is_tested,
        ))  # fmt: skip
    return tuple(faces)
