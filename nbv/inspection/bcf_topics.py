# SPDX-License-Identifier: MIT
"""Topics of a check for BCF: what deviates or is missing, and extras, each as seen by a station."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from os import PathLike
from uuid import NAMESPACE_URL, UUID, uuid5

import numpy as np

from completion.asbuilt.findings import DesignCheck, ElementFinding, Extra
from completion.export.bcf import BcfTopic, BcfVersion, Camera, Vector, bcf_of
from nbv.inspection.record import element_label
from nbv.inspection.verdict_colours import EXTRA_COLOUR, VERDICT_COLOURS
from scenes.checks import FloatArray
from scenes.mesh.design import MapConversion
from scenes.run.atomic import write_bytes

_NO_DATE = datetime(1980, 1, 1, tzinfo=UTC)  # the first that a zip knows
_LEAST_EXTRA_M2 = 0.25  # smaller ones are in the table alone
_HIDES_TOLD = 3  # names
_STEEP = 0.98  # cosine with the vertical from which y is up in a view
_FARTHEST = 2.4  # half diagonals of a box, which then fills a view of 60 degrees


def write_bcf(
    path: str | PathLike[str],
    check: DesignCheck,
    *,
    version: BcfVersion = "3.0",
    snapshots: Mapping[int | str, bytes] | None = None,
    written: datetime = _NO_DATE,
    conversion: MapConversion | None = None,
) -> None:
    """Write a topic for each element that deviates or is missing, and each larger extra that is in none.

    Identifiers of elements' topics follow from the design's name, the GlobalId and the verdict: a later check
    gives the same topic the same one. The same check and time give the same bytes.

    Parameters
    ----------
    path : str or path
        The file, "check.bcf".
    check : DesignCheck
        What was found.
    version : "2.1" or "3.0"
        Of BCF.
    snapshots : mapping, optional
        PNG pictures by surface id, and by name of extras.
    written : datetime
        When topics were made.
    conversion : MapConversion, optional
        Which led from the file's frame to that of the check; cameras are in the file's frame.

    Raises
    ------
    InputError
        Another version; the file cannot be written.
    """
    topics = list(_topics(check, snapshots or {}, conversion))
    write_bytes(path, bcf_of(topics, check.design.name, version=version, written=written))


def _topics(
    check: DesignCheck, snapshots: Mapping[int | str, bytes], conversion: MapConversion | None
) -> Iterator[BcfTopic]:
    mesh = check.design.mesh
    for finding in check.elements:
        if finding.verdict not in ("deviates", "missing"):
            continue
        box = mesh.some(mesh.face_surface == finding.surface).bounds()
        normal = np.array(finding.directions_measured[0]) if finding.directions_measured else None
        camera = _camera(check, box, normal, conversion)
        yield _element_topic(check, finding, camera, snapshots.get(finding.surface))
    told = {finding.related_extra for finding in check.elements}
    for extra in check.extra:
        if extra.area_m2 >= _LEAST_EXTRA_M2 and extra.name not in told:
            camera = _camera(check, extra.box_m, None, conversion)
            yield _extra_topic(check, extra, camera, snapshots.get(extra.name))


def _element_topic(
    check: DesignCheck, finding: ElementFinding, camera: Camera, snapshot: bytes | None
) -> BcfTopic:
    element, offset = finding.element, finding.offset
    label = element_label(element)
    is_alone = sum(one.element.global_id == element.global_id for one in check.elements) == 1
    is_far = offset is None or abs(offset.value) >= 2 * finding.tolerance_m
    title = f"{label} {'deviates' if finding.verdict == 'deviates' else 'is missing'}"
    told = f" (see {finding.related_extra})" if finding.related_extra else ""
    return BcfTopic(
        _guid(check, element.global_id if is_alone else f"{label}/{finding.surface}", finding.verdict),
        title=title,
        description=f"{title}: {finding.sentence.rstrip('.')}{told}. {_numbers(finding)}",
        kind="Deviation" if finding.verdict == "deviates" else "Missing",
        status="Open",
        priority="High" if is_far else "Normal",
        labels=(element.storey, element.ifc_class, finding.kind),
        camera=camera,
        components=(element.global_id,),
        colour=VERDICT_COLOURS[finding.verdict],
        snapshot=snapshot,
    )


def _numbers(finding: ElementFinding) -> str:
    """Tolerance, intervals, area measured and accuracy of an element, as a line."""
    lengths = ((name, getattr(finding, name)) for name in ("offset", "bow", "thickness", "radius"))
    parts = [f"Tolerance {1000 * finding.tolerance_m:g} mm."]
    parts += [f"{name.capitalize()} {one.sentence()}." for name, one in lengths if one is not None]
    if finding.tilt is not None:
        parts.append(f"Tilt {finding.tilt.sentence(np.pi / 180, 'deg')}.")
    parts.append(f"{100 * finding.share.measured:.0f} % of {finding.exposed_m2:.1f} m2 measured.")
    parts += [f"{finding.loa_represented}."] if finding.loa_represented else []
    return " ".join(parts)


def _extra_topic(check: DesignCheck, extra: Extra, camera: Camera, snapshot: bytes | None) -> BcfTopic:
    elements = [one.element for one in check.elements]
    near = [one for one in elements if extra.near and extra.near in (one.name, element_label(one))]
    size = " x ".join(f"{side:.2f}" for side in np.ptp(extra.box_m, axis=0))
    beside = f", near {extra.near}" if extra.near else ""
    more = f" and {len(extra.hides) - _HIDES_TOLD} more" if len(extra.hides) > _HIDES_TOLD else ""
    hides = f" It hides {', '.join(extra.hides[:_HIDES_TOLD])}{more}." if extra.hides else ""
    centre = ",".join(f"{x:.3f}" for x in extra.box_m.mean(axis=0))
    return BcfTopic(
        _guid(check, f"{extra.name}/{centre}", "extra"),
        title=f"{extra.name} is in no element of the design{beside}",
        description=f"{extra.area_m2:.2f} m2 of surface, {size} m, is of no element{beside}.{hides}",
        kind="Extra",
        status="Open",
        priority="Normal",
        labels=(near[0].storey if near else "",),
        camera=camera,
        components=tuple(one.global_id for one in near[:1]) if len(near) == 1 else (),
        colour=EXTRA_COLOUR,
        snapshot=snapshot,
    )


def _guid(check: DesignCheck, what: str, verdict: str) -> UUID:
    return uuid5(NAMESPACE_URL, f"unseen/{check.design.name}/{what}/{verdict}")


def _camera(
    check: DesignCheck, box: FloatArray, normal: FloatArray | None, conversion: MapConversion | None
) -> Camera:
    """A view of a box (2, 3) from the nearest station before its measured side, or nearer on that beam."""
    centre, radius = box.mean(axis=0), float(np.linalg.norm(box[1] - box[0])) / 2
    towards = np.array([pose.translation for pose in check.alignment.poses]).reshape(-1, 3) - centre
    away = np.linalg.norm(towards, axis=1)
    before = away > 0 if normal is None else towards @ normal > 0
    if before.any():
        k = int(np.argmin(np.where(before, away, np.inf)))
        eye = centre + towards[k] * min(1.0, _FARTHEST * radius / away[k])
    else:
        eye = centre + _FARTHEST * radius * (np.array([0.0, -1.0, 0.0]) if normal is None else normal)
    if conversion is not None:
        eye, centre = conversion.undo(np.stack([eye, centre]))
    sight = (centre - eye) / np.linalg.norm(centre - eye)
    upwards = np.array([0.0, 1.0, 0.0] if abs(sight[2]) > _STEEP else [0.0, 0.0, 1.0])
    up = upwards - (upwards @ sight) * sight
    return Camera(_vector(eye), _vector(sight), _vector(up / np.linalg.norm(up)))


def _vector(values: FloatArray) -> Vector:
    x, y, z = values.tolist()
    return x, y, z
