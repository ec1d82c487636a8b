# SPDX-License-Identifier: MIT
"""BCF: topics with a camera, components and a picture, for programs that plan buildings.

BCF-XML 2.1 and 3.0 of buildingSMART: markup.xsd, visinfo.xsd, project.xsd, extensions.xsd, version.xsd.
"""

from __future__ import annotations

import io
import re
import zipfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Literal
from uuid import UUID, uuid5
from xml.etree.ElementTree import Element, indent, tostring

from scenes.checks import InputError
from scenes.io.checks.guard import one_line

BcfVersion = Literal["2.1", "3.0"]
VERSIONS: tuple[BcfVersion, ...] = ("2.1", "3.0")
_IFC_GUID = re.compile(r"[0-9A-Za-z_$]{22}")
_ASPECT = 4 / 3
_FIELD_OF_VIEW_DEG = 60.0  # 2.1 asks for 45 to 60
_LISTS = (  # of extensions.xml, and the names of their entries
    ("TopicTypes", "TopicType"), ("TopicStatuses", "TopicStatus"), ("Priorities", "Priority"),
    ("TopicLabels", "TopicLabel"), ("Users", "User"), ("SnippetTypes", "SnippetType"), ("Stages", "Stage"),
)  # fmt: skip

Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Camera:
    """A perspective camera of 60 degrees: place, metres, and unit vectors, in the frame of the IFC file."""

    place: Vector
    direction: Vector
    up: Vector


@dataclass(frozen=True, slots=True)
class BcfTopic:
    """An issue.

    Attributes
    ----------
    guid : UUID
        Its own.
    title, description : str
        As lines of text.
    kind, status, priority : str
        Words that programs sort by.
    labels : tuple of str
        More of them; empty ones are left out.
    camera : Camera
        Where it is seen from.
    components : tuple of str
        GlobalIds of the elements that it is about; what is none is left out.
    colour : str
        Of these elements, "d1331e".
    snapshot : bytes, optional
        PNG.
    """

    guid: UUID
    title: str
    description: str
    kind: str
    status: str
    priority: str
    labels: tuple[str, ...]
    camera: Camera
    components: tuple[str, ...] = ()
    colour: str = "d1331e"
    snapshot: bytes | None = None


def bcf_of(
    topics: Sequence[BcfTopic],
    model: str,
    *,
    version: BcfVersion = "3.0",
    written: datetime,
    author: str = "unseen",
) -> bytes:
    """Return topics as a BCF file; the same topics and time give the same bytes.

    Parameters
    ----------
    topics : sequence of BcfTopic
        In their order.
    model : str
        Name of the IFC file that they are about; of the project too.
    version : "2.1" or "3.0"
        Of the format.
    written : datetime
        When topics were made; from 1980 on.
    author : str
        Who made them.

    Raises
    ------
    InputError
        Another version.
    """
    if version not in VERSIONS:
        raise InputError(f"BCF {version!r} is not written; known: {', '.join(VERSIONS)}")
    is_new = version == "3.0"
    files = {"bcf.version": _version(version), "project.bcfp": _project(model, is_new)}
    if is_new:
        files["extensions.xml"] = _extensions(topics, author)
    parts: dict[str, bytes] = {name: _document(root) for name, root in files.items()}
    for number, topic in enumerate(topics, start=1):
        folder = f"{topic.guid}/"
        made = _topic(topic, number, (author, written.astimezone(UTC)), is_new)
        parts[folder] = b""
        parts[f"{folder}markup.bcf"] = _document(_markup(topic, made, model, is_new))
        parts[f"{folder}viewpoint.bcfv"] = _document(_viewpoint(topic, is_new))
        if topic.snapshot is not None:
            parts[f"{folder}snapshot.png"] = topic.snapshot
    return _zipped(parts, written)


def _zipped(parts: dict[str, bytes], written: datetime) -> bytes:
    """An archive with entries of its folders, as the format asks, all of one time."""
    stream = io.BytesIO()
    moment = written.astimezone(UTC)
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, held in parts.items():
            entry = zipfile.ZipInfo(name, (max(moment.year, 1980), *moment.timetuple()[1:6]))
            entry.create_system = 3
            entry.external_attr = (0o40755 << 16 | 0x10) if name.endswith("/") else 0o100644 << 16
            archive.writestr(entry, held, zipfile.ZIP_STORED if not held else zipfile.ZIP_DEFLATED)
    return stream.getvalue()


def _document(root: Element) -> bytes:
    indent(root)
    text: bytes = tostring(root, encoding="UTF-8", xml_declaration=True)
    return text


def _node(tag: str, content: str | Iterable[Element] = (), **attributes: str) -> Element:
    """An element of XML that holds text, as one line, or other elements."""
    made = Element(tag, {name: one_line(value) for name, value in attributes.items()})
    if isinstance(content, str):
        made.text = one_line(content) or "-"
    else:
        made.extend(content)
    return made


def _version(version: str) -> Element:
    detail = [] if version == "3.0" else [_node("DetailedVersion", version)]
    return _node("Version", detail, VersionId=version)


def _project(model: str, is_new: bool) -> Element:
    project = _node("Project", [_node("Name", model)], ProjectId=str(uuid5(UUID(int=0), model)))
    if is_new:
        return _node("ProjectInfo", [project])
    return _node("ProjectExtension", [project, _node("ExtensionSchema")])


def _extensions(topics: Sequence[BcfTopic], author: str) -> Element:
    words: dict[str, Iterable[str]] = {
        "TopicType": [topic.kind for topic in topics],
        "TopicStatus": [topic.status for topic in topics],
        "Priority": [topic.priority for topic in topics],
        "TopicLabel": [label for topic in topics for label in _labels(topic)],
        "User": [author],
    }
    lists = ((name, entry, dict.fromkeys(words.get(entry, ()))) for name, entry in _LISTS)
    return _node(
        "Extensions", [_node(name, [_node(entry, one) for one in held]) for name, entry, held in lists]
    )


def _labels(topic: BcfTopic) -> list[str]:
    return [label for label in dict.fromkeys(map(one_line, topic.labels)) if label]


def _topic(topic: BcfTopic, number: int, made: tuple[str, datetime], is_new: bool) -> Element:
    author, moment = made
    labels = [_node("Label" if is_new else "Labels", label) for label in _labels(topic)]
    content = [
        _node("Title", topic.title),
        _node("Priority", topic.priority),
        _node("Index", str(number)),
        *([_node("Labels", labels)] if is_new else labels),
        _node("CreationDate", moment.isoformat(timespec="seconds").replace("+00:00", "Z")),
        _node("CreationAuthor", author),
        _node("Description", topic.description),
    ]
    return _node(
        "Topic", content, Guid=str(topic.guid), TopicType=topic.kind, TopicStatus=topic.status
    )  # fmt: skip


def _markup(topic: BcfTopic, made: Element, model: str, is_new: bool) -> Element:
    file = _node("File", [_node("Filename", model)], IsExternal="true")
    pictures = [] if topic.snapshot is None else [_node("Snapshot", "snapshot.png")]
    names = [_node("Viewpoint", "viewpoint.bcfv"), *pictures]
    guid = _view_guid(topic)
    if is_new:
        made.append(_node("Viewpoints", [_node("ViewPoint", names, Guid=guid)]))
        return _node("Markup", [_node("Header", [_node("Files", [file])]), made])
    return _node("Markup", [_node("Header", [file]), made, _node("Viewpoints", names, Guid=guid)])


def _view_guid(topic: BcfTopic) -> str:
    return str(uuid5(topic.guid, "viewpoint"))


def _viewpoint(topic: BcfTopic, is_new: bool) -> Element:
    camera = [
        _node(f"Camera{name}", [_node(axis, f"{x:.6f}") for axis, x in zip("XYZ", vector, strict=True)])
        for name, vector in (
            ("ViewPoint", topic.camera.place),
            ("Direction", topic.camera.direction),
            ("UpVector", topic.camera.up),
        )
    ]
    camera.append(_node("FieldOfView", f"{_FIELD_OF_VIEW_DEG:g}"))
    camera += [_node("AspectRatio", f"{_ASPECT:.6f}")] if is_new else []
    content = [_node("PerspectiveCamera", camera)]
    if guids := [guid for guid in dict.fromkeys(topic.components) if _IFC_GUID.fullmatch(guid)]:
        coloured = [_node("Component", IfcGuid=guid) for guid in guids]
        colour = topic.colour.lstrip("#").upper()
        selected = [_node("Component", IfcGuid=guid) for guid in guids]
        shown = [
            _node("Selection", selected),
            _node("Visibility", DefaultVisibility="true"),
            _node(
                "Coloring",
                [_node("Color", [_node("Components", coloured)] if is_new else coloured, Color=colour)],
            ),
        ]
        content.insert(0, _node("Components", shown))
    return _node("VisualizationInfo", content, Guid=_view_guid(topic))
