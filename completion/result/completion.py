# SPDX-License-Identifier: MIT
"""Completion: a completed model that writes itself: GLB, OBJ, PLY, DXF, SVG, IFC, E57, JSON."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from itertools import chain
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from completion.backs.closed_things import things_record
from completion.backs.closing import ORIGINS
from completion.export.building.bodies import ScanBeams
from completion.export.building.model import building_model
from completion.export.building.parts import BuildingParts, building_parts
from completion.export.building.things import building_things
from completion.export.decisions import TOLERANCE_M, DecisionSheet, decision_sheet
from completion.export.ifc import ifc_of
from completion.export.room_dimensions import room_stamps, widths_of
from completion.export.svg import svg_of
from completion.observe.tolerance import REGISTRATION_M, EvidenceOptions
from completion.result.completed_model import CompletedModel
from completion.result.labelled_points import PROVENANCE_NAMES, LabelledPoints, join_points
from completion.result.meshes import inferred_points, model_parts, write_panels_ply
from completion.result.record import ObservedDetail, completion_record, polygons_record
from completion.result.verification import Verification
from scenes.checks import InputError
from scenes.io.clouds.e57_writer import write_e57
from scenes.io.formats.format import Units
from scenes.io.meshes.glb_writer import glb_of, scene_of_parts
from scenes.io.meshes.obj import write_obj
from scenes.io.meshes.ply import PlyMesh
from scenes.io.meshes.ply_writer import write_mesh_ply, write_meshes_ply
from scenes.run.atomic import Stage, hold_lock, make_folder, write_bytes, write_json, write_text

if TYPE_CHECKING:
    from trimesh import Scene as TrimeshScene


def building_of(completion: CompletedModel) -> BuildingParts:
    """Return the light model with its walls, slabs, rooms, columns and pipes."""
    several = len(completion.observations) > 1
    tolerance = EvidenceOptions().tolerance(
        flatness_m=completion.flatness_m, registration_m=REGISTRATION_M if several else 0.0
    )
    model = building_model(
        completion.panels(),
        completion.patches,
        polygons_record(completion, completion.drawing_from_reference),
        completion.errors,
        room=completion.completed.room,
        world=completion.drawing_from_reference,
        drawing_from_world=completion.up.drawing_from_world,
    )
    things = tuple(building_things(completion.things))
    model = replace(model, things=things, title=_title_of(completion))
    return building_parts(
        model,
        ScanBeams.of(
            completion.observations,
            completion.measured_surfaces.reach,
            completion.drawing_from_reference,
            tolerance,
        ),
    )


def _title_of(completion: CompletedModel) -> str:
    """The name of the scan that is drawn, or of the first of several."""
    names = [seen.scan.name for seen in completion.observations]
    return names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more"


_BUILDINGS = (".dxf", ".svg", ".ifc")
_COMMENTS = ("unseen: objects called hypothesised were inferred, nobody measured them",)


class Completion(CompletedModel):
    """What `complete` found: the completed model, and the way to save it.

    Attributes
    ----------
    measured_surfaces : ScanSurfaces
        The scans as they were used, and the surfaces that they show.
    completed : CompletedSurfaces
        The surfaces, continued behind their occluders, with relations, errors and features.
    textures : tuple of ChartTexture or None
        Colour of each patch; empty when texture was not asked for.
    inferred : tuple of ChartMesh
        Inferred area of each patch, working frame, every cell by itself.
    audit : AuditResult
        How much of it stands where a beam went through.
    flattened : tuple of FlatScan
        How measured planes are flattened in the meshes that are written, by scan; empty where not asked for.
    things : tuple of ClosedThing
        What stands in the room, with the sides that nobody saw; empty where not asked for.
    backs : BackOptions or None
        How they were closed; None where not asked for.
    world_from_reference : Pose
        From the working frame to the world.
    """

    def save(
        self,
        folder: str | PathLike[str],
        verification: Verification | None = None,
        *,
        observed: ObservedDetail = "auto",
    ) -> None:
        """Write completed.glb, the .ply files, polygons.json, decisions.csv and completion.json.

        All is in world coordinates; glTF's y is up by the transforms of the nodes. The files appear together
        once all are written; until then those of an earlier run stay. With `verification`, completion.json
        also says what later scans say of what the first one alone inferred. Of more than ten million points
        observed.ply holds those of every k-th row and column, unless `observed` is "full"; completion.json
        has k as `observed_step`.

        Raises
        ------
        InputError
            The folder cannot be made or written, or another run writes there, or `observed` is neither.
        """
        record = completion_record(self, verification, observed=observed)
        building = self.building()
        write_model(self, folder, record, building=building, decisions=self.decisions(of=building))

    def to_trimesh(self) -> TrimeshScene:
        """Return the light model as a `trimesh.Scene`, with parts as `observed 1 plane` by name."""
        return scene_of_parts(model_parts(self))

    def building(self) -> BuildingParts:
        """Return the light model with its walls, slabs, rooms, columns and pipes."""
        return building_of(self)

    def decisions(
        self, tolerance_m: float = TOLERANCE_M, *, of: BuildingParts | None = None
    ) -> DecisionSheet:
        """Return the dimensions that people order by, each with its interval and a word on relying on it.

        Half an interval up to `tolerance_m` metres may be relied on. `of` is its `building()`, if that is at
        hand.

        Raises
        ------
        InputError
            The tolerance is not a positive length.
        """
        if not (np.isfinite(tolerance_m) and tolerance_m > 0):
            raise InputError(f"the tolerance is {tolerance_m} m: give a positive length")
        return decision_sheet(of or self.building(), tolerance_m)

    def export(self, path: str | PathLike[str], *, units: Units = "m") -> list[Path]:
        """Write the whole model to one file by suffix; return all files that were written.

        `.glb` and `.obj` (with `.mtl` and textures) are meshes whose objects are called `observed ...` and
        `hypothesised ...`. `.dxf` is a drawing for CAD: facets, folds, a plan and sections; `.svg` a floor
        plan to scale with dimensions; `.ifc` walls, slabs, openings, rooms and columns for BIM (IFC4).
        `.e57` holds the scans as they are, with the poses used, and a cloud `inferred ...` for each surface,
        whose points say surface, provenance, confidence and deviation. `.json` holds the polygons. Where up
        is not z, the drawings are turned so that it is, and say by which 4x4 matrix. `units` is the unit of
        length of `.dxf` and `.ifc`; all others are in metres. `.ifc` has the time of writing, or that of the
        environment variable SOURCE_DATE_EPOCH (seconds since 1970) for equal bytes.

        Raises
        ------
        InputError
            Another suffix, a folder that does not exist, or pye57 is not installed.
        """
        target = Path(path)
        suffix = target.suffix.lower()
        if suffix not in (".glb", ".obj", ".dxf", ".svg", ".ifc", ".e57", ".json"):
            raise InputError(
                f"{target}: cannot export a completion to {suffix or 'a name without suffix'}; known: .glb, "
                ".obj, .dxf, .svg, .ifc, .e57, .json (polygons); observed and inferred .ply are written by "
                "save"
            )
        building = self.building() if suffix in _BUILDINGS else None
        return _export(self, target, building, units)


def write_model(
    completion: Completion,
    folder: str | PathLike[str],
    record: Mapping[str, Any],
    *,
    building: BuildingParts,
    decisions: DecisionSheet,
    exports: Sequence[str] = (),
    units: Units = "m",
) -> None:
    """Derive all that the files of a completion hold, then write them, whole or not at all.

    Parameters
    ----------
    completion : CompletedModel
        What to write.
    folder : str or path
        Made if it is not there.
    record : dict
        What completion.json holds (`completion_record`).
    building : BuildingParts
        What drawings and IFC hold.
    decisions : DecisionSheet
        What decisions.csv holds.
    exports : sequence of "glb", "obj", "dxf", "svg", "ifc", "e57" or "json"
        Formats of further files, called completed.
    units : "mm", "cm", "m", "in", "ft" or "us-ft"
        Unit of length of DXF and IFC.

    Raises
    ------
    InputError
        The folder cannot be made or written, or another run writes there.
    """
    legend = [f"provenance {number} {name}" for number, name in PROVENANCE_NAMES.items()]
    target = make_folder(folder)
    with hold_lock(target), Stage(target) as stage:
        for name in ("completed.glb", "polygons.json", *(f"completed.{name}" for name in exports)):
            path = stage.path(name)
            _export(completion, path, building, units)
        for name, parts in (
            ("observed.ply", completion.observed_parts(int(record["observed_step"]))),
            ("hypothesised.ply", completion.hypothesised_parts()),
        ):
            write_meshes_ply(stage.path(name), world_meshes(completion, parts), legend)
        write_panels_ply(stage.path("model.ply"), completion, legend)
        write_text(stage.path("decisions.csv"), decisions.to_csv())
        _write_things(completion, stage)
        write_json(stage.path("completion.json"), record)
        stage.commit()


def _write_things(completion: Completion, stage: Stage) -> None:
    """Write things.json and the closed shapes, where things were asked for."""
    if completion.backs is None:
        return
    write_json(stage.path("things.json"), things_record(completion.things, completion.up, completion.backs))
    legend = [f"origin {number} {name}" for number, name in enumerate(ORIGINS)]
    for one in completion.things:
        if one.back is not None:
            shape, inferred = one.back.shape, one.is_inferred.astype(np.uint8)
            likely = shape.probability.astype(np.float32)
            write_mesh_ply(
                stage.path(f"things/{one.thing.index + 1:02d}.ply"), one.world_vertices(), shape.faces,
                comments=legend,
                face_properties={"origin": shape.origin, "inferred": inferred, "probability": likely},
            )  # fmt: skip


def world_meshes(completion: CompletedModel, parts: Iterable[LabelledPoints]) -> Iterator[PlyMesh]:
    """Yield parts of a model in world coordinates, with what a PLY file tells of each vertex."""
    for points in chain([join_points([])], parts):  # without any the file has its properties all the same
        known: dict[str, NDArray[Any]] = {
            "red": points.colour[:, 0],
            "green": points.colour[:, 1],
            "blue": points.colour[:, 2],
            "surface": points.surface,
            "provenance": points.provenance,
            "sd": points.sd.astype(np.float32),
            "confidence": points.confidence.astype(np.float32),
        }
        yield PlyMesh(completion.world_from_reference.apply(points.vertices), points.faces, known)


def _export(
    completion: Completion, path: Path, building: BuildingParts | None, units: Units = "m"
) -> list[Path]:
    """Write one file by its suffix; return all that were written. DXF, SVG and IFC need the building."""
    match path.suffix.lower():
        case ".dxf" if building is not None:
            from completion.export.dxf import dxf_of  # its library is loaded where it is asked for

            write_bytes(path, dxf_of(building.model, units, widths_of(building), room_stamps(building)))
        case ".svg" if building is not None:
            write_text(path, svg_of(building))
        case ".ifc" if building is not None:
            write_text(path, ifc_of(building, path.name, written=_now(), units=units))
        case ".obj":
            return write_obj(model_parts(completion), path, _COMMENTS)
        case ".glb":
            write_bytes(path, glb_of(model_parts(completion), completion.up.drawing_from_world))
        case ".e57":
            scans = [scan for scan in completion.scans if scan.valid.any()]
            write_e57(scans, path, list(inferred_points(completion)))
        case ".json":
            write_json(path, polygons_record(completion))
    return [path]


def _now() -> datetime:
    """The time of writing, or that which reproducible builds name (SOURCE_DATE_EPOCH)."""
    named = os.environ.get("SOURCE_DATE_EPOCH", "")
    return datetime.fromtimestamp(int(named), UTC) if named.isdecimal() else datetime.now(UTC)
