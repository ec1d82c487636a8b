# SPDX-License-Identifier: MIT
"""A check made by hand: a room of six elements, one for each verdict, and two extras."""

import numpy as np

from completion.asbuilt.findings import (
    LOA_BANDS_M,
    Alignment,
    BeamEvidence,
    DesignCheck,
    DeviationPoints,
    ElementFinding,
    Extra,
    FaceFinding,
    Hider,
    Inference,
    Interval,
    Samples,
    Shares,
)
from scenes.mesh.design import Element, ElementMesh
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.pose import Pose

BOXES = {  # least corner, size: a room of 4 by 3 by 2.5 m, metres
    "floor": ((0, 0, -0.2), (4, 3, 0.2)),
    "wall south": ((0, -0.2, 0), (4, 0.2, 2.5)),
    "wall north": ((0, 3, 0), (4, 0.2, 2.5)),
    "wall east": ((4, 0, 0), (0.2, 3, 2.5)),
    "door": ((1, -0.15, 0), (0.9, 0.1, 2)),
    "column": ((3.2, 2.2, 0), (0.3, 0.3, 2.5)),
}
CLASSES = ("IfcSlab", "IfcWall", "IfcWall", "IfcWall", "IfcDoor", "IfcColumn")
_QUADS = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))


def example_design(origin=(0.0, 0.0, 0.0)) -> ElementMesh:
    """Six boxes, outside outside, moved to `origin`."""
    unit = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float64)
    triangles = np.array([(q[i], q[j], q[k]) for q in _QUADS for i, j, k in ((0, 1, 2), (0, 2, 3))])
    places = [np.array(at) + unit * np.array(size) + np.array(origin) for at, size in BOXES.values()]
    faces = np.concatenate([triangles + 8 * k for k in range(len(places))]).astype(np.int32)
    mesh = LabelledMesh(np.vstack(places), faces, np.repeat(np.arange(6, dtype=np.int32), 12))
    elements = tuple(
        Element(name, kind, f"0{k:021d}", "Ground", "W200" if kind == "IfcWall" else "")
        for k, (name, kind) in enumerate(zip(BOXES, CLASSES, strict=True))
    )
    return ElementMesh(mesh, elements, "room.ifc")


def _face(place, element: int, normal, offset: Interval | None, **more) -> FaceFinding:
    """The main face of a box on the side of `normal`, with 900 beams about `offset`; the room at `place`."""
    at, size = (np.array(held, np.float64) for held in tuple(BOXES.values())[element])
    n = np.array(normal, np.float64)
    area = float(np.prod(size[np.abs(n) < 0.5]))
    counts = np.zeros(40, np.int64)
    if offset is not None:
        counts[int((offset.value + 0.05) / 0.0025) + np.arange(-1, 2)] = 200, 500, 200
    return FaceFinding(
        element, "plane", True, place + at + size * (0.5 + 0.5 * n), n, area,
        measured_m2=0.0 if offset is None else 0.9 * area, n_beams=int(counts.sum()),
        support=0.0 if offset is None else 0.95, is_tested=offset is not None,
        deviation=offset, offset=offset, rms_m=0.002, histogram=counts, **more,
    )  # fmt: skip


def example_check(origin=(0.0, 0.0, 0.0)) -> DesignCheck:
    """A floor within; walls 20 mm off, undecided, hidden by a crate; a missing door; a column not seen.

    `origin` (3,) moves all, metres.
    """
    design, shift = example_design(origin), np.array(origin, np.float64)
    moved = Interval(-0.0199, -0.0212, -0.0186, (0.0, 1.0, 0.0))
    level = Interval(0.001, -0.0003, 0.0023, (0.0, 0.0, 1.0))
    turned = Interval(0.0002, -0.0004, 0.0008)
    doubtful = Interval(0.0096, 0.0079, 0.0113, (0.0, -1.0, 0.0))
    found = [
        {"verdict": "within", "sentence": "1 mm off its place, at most 2.3 mm (95 %).", "offset": level,
         "share": Shares(0.92, 0.05, 0.03), "directions_measured": ((0.0, 0.0, 1.0),),
         "beams": BeamEvidence(11.0, 0.0, 0.9, 5210), "not_seen": {"hidden": 0.06, "too oblique": 0.02},
         "faces": (_face(shift, 0, (0, 0, 1), level),)},
        {"verdict": "deviates", "kind": "offset", "sentence": "19.9 mm behind its place (18.6 to 21.2 mm).",
         "offset": moved, "tilt": turned, "thickness": Interval(0.001, -0.001, 0.003),
         "share": Shares(0.61, 0.22, 0.17), "directions_measured": ((0.0, 1.0, 0.0),),
         "beams": BeamEvidence(7.0, 0.0, 0.5, 4100), "not_seen": {"out of range": 0.1, "hidden": 0.29},
         "faces": (_face(shift, 1, (0, 1, 0), moved, tilt=turned),)},
        {"verdict": "undecided", "sentence": "9.6 mm off its place: 7.9 to 11.3 mm holds the tolerance.",
         "offset": doubtful, "share": Shares(0.7, 0.0, 0.3), "directions_measured": ((0.0, -1.0, 0.0),),
         "beams": BeamEvidence(6.0, 0.0, 0.1, 3000), "not_seen": {"out of view": 0.3},
         "faces": (_face(shift, 2, (0, -1, 0), doubtful),)},
        {"verdict": "hidden", "sentence": "extra-1 hides it from s1 and s2.", "share": Shares(0.0, 0.4, 0.6),
         "hidden": (Hider("extra-1", ("s1", "s2"), 5.2), Hider("column", ("s1",), 0.7)),
         "beams": BeamEvidence(0.0, 0.0, 5.9, 2500), "not_seen": {"hidden": 0.95, "out of view": 0.05},
         "inference": Inference(0.4, 0.83, "A continued surface lies there on 40 % (probability 0.83)."),
         "faces": (_face(shift, 3, (-1, 0, 0), None),)},
        {"verdict": "missing", "sentence": "640 beams went through its body.", "share": Shares(0.0, 0.0, 1.0),
         "beams": BeamEvidence(0.0, 1.5, 0.1, 640), "not_seen": {"not met": 1.0}, "related_extra": "extra-2",
         "faces": (_face(shift, 4, (0, 1, 0), None),)},
        {"verdict": "not seen", "sentence": "No station looked there.", "share": Shares(0.0, 0.0, 1.0),
         "not_seen": {"out of range": 1.0}, "faces": (_face(shift, 5, (0, -1, 0), None),)},
    ]  # fmt: skip
    measured = ("LOA30", "LOA20", "LOA30", "", "", "")
    elements = tuple(
        ElementFinding(
            k, design.elements[k], tolerance_m=0.005 if k == 4 else 0.01, exposed_m2=9.0,
            loa_represented=measured[k], loa_measured="LOA40" if measured[k] else "", **held,
        )
        for k, held in enumerate(found)
    )  # fmt: skip
    crate, leaf = _grid((3.3, 0.2, 0.0), (0.4, 1.8, 1.5)), _grid((1.0, 0.0, 0.0), (0.05, 0.9, 2.0))
    extra = tuple(
        Extra(name, np.array([held.min(axis=0), held.max(axis=0)]) + shift, area, held + shift, **more)
        for name, held, area, more in (
            ("extra-1", crate, 5.4, {"stations": ("s1", "s2"), "near": "floor", "hides": ("wall east",)}),
            ("extra-2", leaf, 1.8, {"stations": ("s1",), "near": "door"}),
        )
    )  # fmt: skip
    return DesignCheck(
        design, ("s1", "s2"), elements, extra, _alignment(shift), faces_tested=247, z=3.71,
        false_alarms_expected=0.05, loa_bands_m=LOA_BANDS_M, samples=_samples(design, elements),
        cloud=_cloud(shift, crate), warnings=("1 component was inside out and was turned.",),
    )  # fmt: skip


def _grid(at, size) -> np.ndarray:
    """Middles (n, 3) of cells of 5 cm in a box."""
    axes = [a + np.arange(0.025, s, 0.05) for a, s in zip(at, size, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def _alignment(shift) -> Alignment:
    poses = tuple(Pose.looking_at(shift + eye, shift + (2, 1.5, 1)) for eye in ((1, 1, 1.6), (2.5, 2.5, 1.6)))
    return Alignment(
        poses, np.array([0.001, 0.0, -0.0098]), np.array([0.0, 0.0, 0.02]), np.full(3, 0.0004),
        np.full(3, 0.003), np.array([[0.0002, 0, 0], [-0.0002, 0, 0]]), tau_m=0.0012,
        sentences=("The scans were moved by 9.9 mm: floors that are all as high cannot be told from that.",),
    )  # fmt: skip


def _samples(design: ElementMesh, elements) -> Samples:
    """The middle of each triangle of the design, in the state that its element has most of."""
    corners, owner = design.mesh.vertices[design.mesh.faces], design.mesh.face_surface
    states = np.array([np.argmax([e.share.measured, e.share.inferred, e.share.unknown]) for e in elements])
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normal, axis=1) / 2
    state = states[owner].astype(np.int8)
    reason = np.where(state == 0, 0, np.array([0, 0, 0, 1, 6, 4])[owner]).astype(np.int8)
    return Samples(
        corners.mean(axis=1), normal / (2 * area[:, None]), owner.astype(np.int32), area, state, reason,
        np.where(reason == 1, -2, -1).astype(np.int32),
    )  # fmt: skip


def _cloud(shift, crate) -> DeviationPoints:
    """Points on the floor, the southern wall and the column, of the crate, and one near nothing."""
    flat = np.stack(np.meshgrid(np.arange(0.1, 4, 0.1), np.arange(0.1, 2.5, 0.1)), axis=-1).reshape(-1, 2)
    floor = np.column_stack([flat, np.full(len(flat), 0.001)])
    south = np.column_stack([flat[:, 0], np.full(len(flat), -0.0199), flat[:, 1]])
    places = (floor, south, [[3.2, 2.3, 1.0]], crate[::50], [[2.0, 1.5, 1.2]])
    held = ((0, 0.001, 0), (1, -0.0199, 0), (5, np.nan, 1), (-1, np.nan, 2), (-1, np.nan, 3))
    counts = [len(one) for one in places]
    element, off, state = (np.repeat(column, counts) for column in zip(*held, strict=True))
    return DeviationPoints(
        np.vstack([np.asarray(one, np.float64) for one in places]) + shift,
        element.astype(np.int32), off, state.astype(np.int8),
    )  # fmt: skip
