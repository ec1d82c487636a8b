# SPDX-License-Identifier: MIT
"""Planted states: true offsets against rays, scores of an oracle, distances of peers against closed form."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks.cases.asbuilt import PlantedState, planted_state
from benchmarks.cases.houses.solids import box, volume
from benchmarks.cases.offices import office_design
from benchmarks.cases.surveys import Sighting, Survey, sighting, survey
from benchmarks.methods.distances import DesignTree, aligned_points, cloud_to_mesh, judged, multiscale
from benchmarks.metrics.verdicts import rates, score
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
    Verdict,
)
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import SphericalSensor
from scenes.mesh.design import Element, ElementMesh
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.pose import Pose
from scenes.rays.raycast import RayCaster

T = 0.01


@cache
def case() -> tuple[PlantedState, Survey, Sighting]:
    """A small office with planted deviations, scanned coarsely."""
    state = planted_state(office_design(5, seed=3), 0)
    scans = survey(state, "0mm", 0, 0.15)
    return state, scans, sighting(state, scans.true)


def oracle(state: PlantedState, seen: Sighting, off_m: float = 0.0) -> DesignCheck:
    """A check that knows the truth; its intervals are off it by `off_m`, and 1 mm wide to either side."""

    def interval(value: float) -> Interval:
        return Interval(value + off_m, value + off_m - 0.001, value + off_m + 0.001)

    found = []
    for k, element in enumerate(state.design.elements):
        change = state.change(k)
        verdict: Verdict = "within" if seen.measured[k] else "not seen"
        if change.kind.startswith("hidden"):
            verdict = "hidden"
        elif change.is_gone:
            verdict = "missing"
        elif seen.measured[k] and seen.worst_m[k] >= 0.999 * T:
            verdict = "deviates"
        faces = tuple(
            FaceFinding(
                k, "plane", True, one.centre, one.normal, one.area_m2, is_tested=True, place=one.centre,
                offset=interval(change.offset_at(one.centre, one.normal)),
            )
            for one in state.main_faces if one.element == k and not change.is_gone
        )  # fmt: skip
        thickness = interval(change.size if change.kind == "thickness" else 0.0)
        found.append(ElementFinding(k, element, verdict, T, thickness=thickness, faces=faces))
    z3, none = np.zeros(3), np.zeros((0, 3))
    return DesignCheck(
        state.design, (), tuple(found),
        (Extra("extra-1", np.zeros((2, 3)), 1.0, seen.extra),),
        Alignment((), z3, z3, z3, z3, none, 0.001), 1, 1.96, 0.05, LOA_BANDS_M,
        Samples(none, none, *(np.zeros(0, kind) for kind in (np.int32, float, np.int8, np.int8, np.int32))),
        DeviationPoints(none, np.zeros(0, np.int32), np.zeros(0), np.zeros(0, np.int8)),
    )  # fmt: skip


def test_true_offsets_are_what_rays_meet() -> None:
    state = case()[0]
    built, tried = state.built.mesh, set()
    for face in state.main_faces:
        change, own = state.change(face.element), built.face_surface == face.element
        is_still = face.element not in state.changes and face.element % 10  # one in ten is enough
        if change.is_gone or change.kind == "open" or is_still:
            continue
        place = state.design.mesh.corners[face.faces[0]].mean(axis=0)
        start = place + 0.5 * face.normal
        hit = RayCaster(built.vertices, built.faces[own]).first_hit(start[None], -face.normal[None])
        if hit.hit[0] and state.source_face[np.flatnonzero(own)[hit.face[0]]] in face.faces:
            true = change.offset_at(place, face.normal)
            assert 0.5 - hit.ranges[0] == pytest.approx(true, abs=2e-4), change.label
            tried.add(change.kind)
    assert tried >= {"unchanged", "moved", "tilted", "thickness", "bowed"}


def test_an_oracle_fares_perfectly_and_one_that_says_within_does_not() -> None:
    state, _, seen = case()
    found = score(oracle(state, seen), state, seen)
    told = rates(found.judged, T)
    assert (told.false_deviates, told.false_missing, told.false_within, told.hidden_missing) == (0, 0, 0, 0)
    for share in (told.deviating_told, told.removed_told, told.hidden_told):
        assert share.part == share.whole > 0
    assert told.left_open.part == 0 < told.left_open.whole
    assert all(one.holds for one in found.covered)
    assert {one.truth for one in found.covered if one.what == "offset"} >= {"moved", "tilted", "bowed"}
    assert (found.extra_right, found.extra_found) == (1.0, 1.0)
    blind = rates([replace(one, verdict="within") for one in found.judged], T)
    assert blind.false_within >= 8
    assert blind.deviating_told.part == blind.removed_told.part == 0


def test_intervals_that_are_off_do_not_hold() -> None:
    state, _, seen = case()
    covered = score(oracle(state, seen, off_m=0.002), state, seen).covered
    assert not any(one.holds for one in covered)


def test_scans_carry_wrong_poses_and_no_truth() -> None:
    _, scans, _ = case()
    motions = [
        given.world_from_sensor.matrix @ true.world_from_sensor.inverse().matrix
        for given, true in zip(scans.given, scans.true, strict=True)
    ]
    assert np.ptp(motions, axis=0).max() < 1e-9  # stations agree, together they are off
    assert 1e-4 < np.abs(motions[0] - np.eye(4)).max() < 0.02
    assert all(scan.truth is None for scan in scans.given)
    error = scans.true[0].range_error()
    assert np.nanmean(error) == pytest.approx(0.001, abs=2e-4)


def test_same_seed_same_bytes() -> None:
    state, scans, _ = case()
    again = planted_state(office_design(5, seed=3), 0)
    assert np.array_equal(again.built.mesh.vertices, state.built.mesh.vertices)
    other = survey(again, "0mm", 0, 0.15)
    assert np.array_equal(other.given[2].ranges, scans.given[2].ranges)


def test_office_is_made_of_closed_bodies_and_glass() -> None:
    design = office_design(3, seed=0).design
    corners, owner = design.mesh.corners, design.mesh.face_surface
    assert all(volume(corners[owner == k]) > 0 for k in range(len(design.elements)))
    look = design.mesh.appearance
    assert look is not None
    assert look.opacity is not None
    clear = np.unique(owner[look.opacity < 0.5])
    assert {design.elements[k].ifc_class for k in clear} == {"IfcWindow"}
    assert len(clear) == 6


def test_peers_measure_what_moved() -> None:
    solids = [box([0, 0, 0], [2, 0.2, 2]), box([3, 0, 0], [5, 0.2, 2]), box([9, 0, 0], [9.5, 0.2, 1])]
    mesh = LabelledMesh(
        np.concatenate(solids).reshape(-1, 3),
        np.arange(108, dtype=np.int32).reshape(-1, 3),
        np.repeat([0, 1, 2], 12),
    )
    design = ElementMesh(mesh, tuple(Element(f"wall {k}") for k in range(3)))
    rng = np.random.default_rng(0)
    flat = rng.uniform([0.1, 0, 0.1], [1.9, 0, 1.9], (8000, 3))
    points = np.concatenate([flat, flat + [3, -0.02, 0]]) + rng.normal(0, 0.002, (16000, 1)) * [0, 1, 0]
    for found in (
        cloud_to_mesh(points, design, DesignTree(mesh)),
        multiscale(points, design, np.array([[2.5, -3.0, 1.0]])),
    ):
        assert found[:2] == pytest.approx([0.0, 0.02], abs=1.5e-3)
        assert judged(found, T) == ["within", "deviates", "no data"]


def test_least_squares_bring_scans_back() -> None:
    office, sensor = office_design(1, seed=0), SphericalSensor(width=180, height=75)
    still = [
        scan_scene(office.furnished, Pose.looking_at(eye, eye + [1.0, 0.0, 0.0]), sensor)
        for eye in office.stations
    ]
    away = Pose.from_parts(np.eye(3), np.array([0.004, -0.003, 0.004]))
    tree = DesignTree(office.design.mesh)
    points = aligned_points([scan.transform(away) for scan in still], office.design, tree)
    true = np.concatenate([scan.points()[scan.valid] for scan in still])
    assert np.abs(np.mean(points - true, axis=0)).max() < 1e-3
