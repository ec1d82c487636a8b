# SPDX-License-Identifier: MIT
"""3-D view of a check: the design coloured by verdict, extras, and measured points by their deviation."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from completion.asbuilt.findings import VERDICTS, DesignCheck, ElementFinding, Interval, Verdict
from completion.parts.division.result import thin_points
from nbv.inspection.record import element_label
from nbv.inspection.verdict_colours import EXTRA_COLOUR, VERDICT_COLOURS, rgb_of
from nbv.report.figures.drawing import MeshDrawing, mark_pattern, paint_states
from nbv.report.figures.picture import Picture, overview_cameras, picture_of
from nbv.report.viewer.layers import NOTHING, Category, Classes, Layer, Marker, Numbers, Pattern, Viewer
from nbv.report.viewer.part_view import neighbour_normals, point_squares
from nbv.run.wording import letters
from scenes.checks import FloatArray

_MOST_POINTS, _WIDTH = 30_000, 760
_PATTERNS: Mapping[Verdict, Pattern] = {"hidden": "hatched", "not seen": "dotted"}
_CATEGORIES = tuple(
    Category(verdict, rgb_of(VERDICT_COLOURS[verdict]), _PATTERNS.get(verdict, "plain"))
    for verdict in VERDICTS
)
_EXTRA = Category("extra: no element", rgb_of(EXTRA_COLOUR))
_GREY = Category("not asked for", (0.90, 0.91, 0.91))


def check_view(
    check: DesignCheck, cut_m: float | None, following: tuple[Marker, ...] = (), n_threads: int | None = None
) -> Viewer:
    """Return the view of a check; nothing above `cut_m` (metres) is shown at first."""
    verdict = np.full(len(check.design.elements), NOTHING, np.uint16)
    for finding in check.elements:
        verdict[finding.surface] = VERDICTS.index(finding.verdict)
    markers = tuple(
        Marker(letters(k), pose.translation, pose.rotation.T, None, is_step=False)
        for k, pose in enumerate(check.alignment.poses)
    )
    layers = (_design_layer(check, verdict), *_extra_layers(check), *_point_layers(check, verdict))
    return Viewer(
        "The design, coloured by verdict.",
        layers,
        mode="verdict",
        markers=(*markers, *following),
        is_room=False,
        pictures=verdict_pictures(check, verdict, cut_m, n_threads),
        noun="view" if following else "scan",
        cut_m=cut_m,
    )


def worst_deviation(finding: ElementFinding) -> Interval | None:
    """Return how far the worst corner of a tested face is off, a displaced element as a whole; or None."""
    if finding.kind == "displaced":
        return finding.offset
    worst = [face.deviation for face in finding.faces if face.is_tested and face.deviation is not None]
    return max(worst, key=lambda one: abs(one.value), default=None)


def _design_layer(check: DesignCheck, verdict: NDArray[np.uint16]) -> Layer:
    mesh = check.design.mesh
    share, off_mm = np.full((2, len(verdict)), np.nan)
    for finding in check.elements:
        share[finding.surface] = 100 * finding.share.measured
        worst = worst_deviation(finding)
        off_mm[finding.surface] = np.nan if worst is None else 1000 * worst.value
    names = tuple(Category(element_label(element), _GREY.colour) for element in check.design.elements)
    channels = (
        Classes("verdict", "Verdict", _CATEGORIES, verdict, can_hide=True),
        Numbers(
            "share",
            "Measured share",
            "%",
            share,
            low=0,
            high=100,
            small_is_good=False,
            absent="not asked for",
        ),
        _deviations(check, off_mm),
        Classes("element", "Element", names, np.arange(len(names), dtype=np.uint16)),
    )
    return Layer(
        "design", "design", mesh.vertices, mesh.faces, paint=_GREY, place=mesh.face_surface, channels=channels
    )


def _extra_layers(check: DesignCheck) -> tuple[Layer, ...]:
    """Cells of 5 cm of the extras."""
    points = np.concatenate([np.zeros((0, 3)), *(extra.points for extra in check.extra)])
    if not len(points):
        return ()
    owner = np.repeat(np.arange(len(check.extra)), [len(extra.points) for extra in check.extra])
    kept = thin_points(points, _MOST_POINTS)
    mesh = point_squares(points[kept], neighbour_normals(points[kept], points[kept]))
    names = tuple(Category(extra.name, _EXTRA.colour) for extra in check.extra)
    channel = Classes("element", "Element", names, np.repeat(owner[kept], 2).astype(np.uint16))
    drawn = ("extra", "extra", mesh.vertices, mesh.faces, _EXTRA)
    return (Layer(*drawn, channels=(channel,), is_framed=False),)


def _point_layers(check: DesignCheck, verdict: NDArray[np.uint16]) -> tuple[Layer, ...]:
    """Measured points on the elements, by deviation and by the verdict on their element."""
    cloud = check.cloud
    known = np.flatnonzero((cloud.element >= 0) & np.isfinite(cloud.deviation_m))
    if not len(known):
        return ()
    kept = known[thin_points(cloud.points[known], _MOST_POINTS)]
    points, element = cloud.points[kept], cloud.element[kept]
    mesh = point_squares(points, neighbour_normals(points, points))
    channels = (
        Classes("verdict", "Verdict", _CATEGORIES, np.repeat(verdict[element], 2), can_hide=True),
        _deviations(check, np.repeat(1000 * cloud.deviation_m[kept], 2)),
    )
    drawn = ("points", "measured points", mesh.vertices, mesh.faces, _GREY)
    return (Layer(*drawn, channels=channels, shown=False),)


def _deviations(check: DesignCheck, off_mm: FloatArray) -> Numbers:
    """Deviations (n,) along outward normals, on a scale that ends at thrice the usual tolerance."""
    end = 3000 * float(np.median([finding.tolerance_m for finding in check.elements] or [0.01]))
    return Numbers(
        "deviation", "Deviation", "mm", off_mm, low=-end, high=end, digits=1, absent="not measured"
    )


def verdict_pictures(
    check: DesignCheck, verdict: NDArray[np.uint16], cut_m: float | None, n_threads: int | None
) -> tuple[Picture, ...]:
    """Return the design from two sides by the verdict (n,) of each element, up to the cut."""
    mesh = check.design.mesh
    top = mesh.vertices[:, 2][mesh.faces].min(axis=1)
    shown = np.ones(len(top), np.bool_) if cut_m is None else top < cut_m
    drawing = MeshDrawing(mesh, n_threads=n_threads)
    around = overview_cameras(mesh.bounds())
    colours = {number: category.colour for number, category in enumerate(_CATEGORIES)} | {
        NOTHING: _GREY.colour
    }
    pictures = []
    for side, camera in zip(
        ("one side", "the other side"), (around[0], around[len(around) // 2]), strict=True
    ):
        layer = drawing.look(camera, camera.shape(_WIDTH), shown)
        state = np.full(layer.face.shape, -1, np.int64)
        state[layer.hit] = verdict[mesh.face_surface[layer.face[layer.hit]]]
        image = paint_states(state, drawing.shade(layer), colours)
        for number, category in enumerate(_CATEGORIES):
            if category.pattern != "plain":
                image = mark_pattern(image, state == number, category.pattern)
        pictures.append(picture_of(image, f"Verdicts, from {side}."))
    return tuple(pictures)
