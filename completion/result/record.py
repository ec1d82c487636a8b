# SPDX-License-Identifier: MIT
"""Record: a completion as `completion.json` holds it."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from completion.edits.file import edit_record
from completion.fitting.result import surface_parameters
from completion.result.completed_model import CompletedModel
from completion.result.derived_model import DerivedSurface
from completion.result.labelled_points import PROVENANCE_NAMES
from completion.result.verification import Finding, Verification, counterpart


def completion_record(completion: CompletedModel, verification: Verification | None = None) -> dict[str, Any]:
    """What `completion.json` holds; lengths in metres, areas in square metres, world coordinates."""
    record: dict[str, Any] = {
        "edits": [edit_record(edit) for edit in completion.edits],
        "surfaces": [
            _surface_record(completion, number, surface)
            for number, surface in enumerate(completion.derived.surfaces, start=1)
        ],
        "observed_m2": completion.observed_m2,
        "hypothesised_m2": completion.hypothesised_m2,
        "free_space_violation_m2": completion.free_space_violation_m2,
        "mode": completion.mode,
        "n_scans": len(completion.observations),
        "range_noise": [
            {"constant_m": seen.noise.constant_m, "quadratic_per_m": seen.noise.quadratic_per_m}
            for seen in completion.observations
        ],
        "provenance": {number: {"name": name} for number, name in PROVENANCE_NAMES.items()},
    }
    if verification is not None:
        record["first_scan"] = _verification_record(completion, verification)
    return record


def _verification_record(completion: CompletedModel, verification: Verification) -> dict[str, Any]:
    """What later scans say of what the first one alone inferred; surfaces numbered as in the completion."""
    found = (Finding.CONFIRMED, Finding.REFUTED, Finding.HIDDEN)
    surfaces = [
        {
            "surface": counterpart(surface, completion),
            "anchor": surface.anchor.tolist(),
            **{f"{finding.name.lower()}_m2": surface.area_m2(finding) for finding in found},
        }
        for surface in verification.surfaces
    ]
    totals = {f"{finding.name.lower()}_m2": verification.area_m2(finding) for finding in found}
    return {**totals, "surfaces": surfaces}


def _surface_record(completion: CompletedModel, number: int, surface: DerivedSurface) -> dict[str, Any]:
    patch, world = surface.patch, completion.world_from_reference
    fit = patch.source.fit
    return {
        "id": number,
        "kind": fit.surface.kind,
        "anchor": completion.anchor(number).tolist(),
        "parameters": surface_parameters(fit.surface.transformed(world)),
        "standard_deviation": fit.parameter_deviations(),
        "rms": fit.rms,
        "n": fit.n,
        "n_parts": patch.source.n_parts,
        "observed_m2": patch.observed_m2,
        "hypothesised_m2": patch.hypothesised_m2,
        "encloses": patch.limits.encloses,
        "texture": _texture_record(completion, number),
        "user": _user_record(surface),
        "openings": [
            {
                "area_m2": opening.area_m2,
                "seen_share": opening.seen_share,
                "provenance": "user" if opening.declared else "inferred",
                "points": world.apply(opening.points).tolist(),
            }
            for opening in surface.openings
        ],
        "boundary": [
            {
                "kind": segment.kind,
                "provenance": segment.provenance,
                "confidence": segment.confidence,
                "points": world.apply(segment.points).tolist(),
            }
            for segment in surface.boundary
        ],
    }


def _texture_record(completion: CompletedModel, number: int) -> dict[str, Any] | None:
    """How a surface's hidden part got its colour; None without texture."""
    texture = completion.textures[number - 1] if completion.textures else None
    if texture is None:
        return None
    return {
        "texel_m": float(np.sqrt(texture.grid.cell_area)),
        "measured_texels": int(np.count_nonzero(texture.measured)),
        "synthesised_texels": texture.n_synthesised,
        "synthesised_m": texture.synthesised_m,
        "samples": texture.n_samples,
        "window": texture.window,
        "is_plain": texture.is_plain,
        "confidence": texture.confidence,
        "verbatim_share": texture.verbatim_share,
        "is_doubtful": texture.is_doubtful,
    }


def _user_record(surface: DerivedSurface) -> dict[str, Any]:
    """What a person had done to a surface, and what came of it."""
    return {"actions": list(surface.patch.verdict.actions), **asdict(surface.effect)}
