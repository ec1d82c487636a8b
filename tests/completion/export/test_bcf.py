# SPDX-License-Identifier: MIT
"""BCF files keep the rules of their schemas, are the same every time, and are read by another library."""

import io
import re
import zipfile
from datetime import UTC, datetime
from uuid import UUID
from xml.etree import ElementTree

import pytest

from completion.export.bcf import VERSIONS, BcfTopic, Camera, bcf_of
from scenes.checks import InputError

GUID = r"[a-f0-9]{8}(-[a-f0-9]{4}){3}-[a-f0-9]{12}"
TOPIC = "Title! Priority Index Labels CreationDate! CreationAuthor! Description"
CAMERA = "CameraViewPoint! CameraDirection! CameraUpVector! FieldOfView!"
BOTH = {  # element: its children in their order, ! what must be there (BCF-XML: the schemas of 2.1 and 3.0)
    "File": "Filename Date Reference",
    "VisualizationInfo": "Components OrthogonalCamera PerspectiveCamera Lines ClippingPlanes",
    "Components": "Selection Visibility! Coloring",
    "Selection": "Component!",
    "Coloring": "Color!",
    "Visibility": "Exceptions",
    "CameraViewPoint": "X! Y! Z!",
    "CameraDirection": "X! Y! Z!",
    "CameraUpVector": "X! Y! Z!",
    "Project": "Name",
}
RULES = {
    "2.1": BOTH
    | {
        "Version": "DetailedVersion",
        "ProjectExtension": "Project ExtensionSchema!",
        "Markup": "Header Topic! Comment Viewpoints",
        "Header": "File!",
        "Topic": f"ReferenceLink {TOPIC}",
        "Viewpoints": "Viewpoint Snapshot Index",
        "Color": "Component!",
        "PerspectiveCamera": CAMERA,
    },
    "3.0": BOTH
    | {
        "ProjectInfo": "Project!",
        "Extensions": "TopicTypes! TopicStatuses! Priorities! TopicLabels! Users! SnippetTypes! Stages!",
        "TopicTypes": "TopicType",
        "TopicStatuses": "TopicStatus",
        "Priorities": "Priority",
        "TopicLabels": "TopicLabel",
        "Users": "User",
        "Markup": "Header Topic!",
        "Header": "Files",
        "Files": "File",
        "Topic": f"ReferenceLinks {TOPIC} Viewpoints",
        "Labels": "Label",
        "Viewpoints": "ViewPoint",
        "ViewPoint": "Viewpoint Snapshot Index",
        "Color": "Components!",
        "Color/Components": "Component!",
        "PerspectiveCamera": f"{CAMERA} AspectRatio!",
    },
}
ATTRIBUTES = {  # what must be there, and how it looks
    "Topic": {"Guid": GUID, "TopicType": ".+", "TopicStatus": ".+"},
    "ViewPoint": {"Guid": GUID},
    "VisualizationInfo": {"Guid": GUID},
    "Component": {"IfcGuid": r"[0-9A-Za-z_$]{22}"},
    "Color": {"Color": "[0-9A-F]{6}"},
    "Version": {"VersionId": r"\d\.\d"},
    "Project": {"ProjectId": ".+"},
}
TEXTS = {
    "CreationDate": r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ",
    "X": r"-?\d+\.\d+",
    "FieldOfView": "60",
    **dict.fromkeys(("ExtensionSchema", "SnippetTypes", "Stages"), ""),
}
WRITTEN = datetime(2026, 3, 1, 12, tzinfo=UTC)
TOPICS = [
    BcfTopic(
        UUID(int=k + 1), f"wall {k}", "19.9 mm <behind> & \x00\ud800 its place", "Deviation", "Open", "High",
        ("Ground", "", "Ground"), Camera((0.5, 1.0, 1.5e-7), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)),
        ("0" * 22, "none", "0" * 22) if k else (), snapshot=b"\x89PNG" if k else None,
    )
    for k in range(2)
]  # fmt: skip


def faults(element, rules, parent=""):
    """What an element of a file and all below break of the rules."""
    words = rules.get(f"{parent}/{element.tag}", rules.get(element.tag, "")).split()
    allowed = [name.rstrip("!") for name in words]
    needed = {name[:-1] for name in words if name.endswith("!")}
    tags = [child.tag for child in element]
    found = [f"{element.tag}: {tag} is unknown" for tag in tags if tag not in allowed]
    places = [allowed.index(tag) for tag in tags if tag in allowed]
    found += [f"{element.tag}: order {tags}"] if places != sorted(places) else []
    found += [f"{element.tag}: without {name}" for name in needed - set(tags)]
    for name, pattern in ATTRIBUTES.get(element.tag, {}).items():
        if not re.fullmatch(pattern, element.get(name, "")):
            found.append(f"{element.tag}: {name}={element.get(name)!r}")
    if not tags and not allowed and not element.attrib:
        is_right = re.fullmatch(TEXTS.get(element.tag, ".+"), element.text or "")
        found += [] if is_right else [f"{element.tag}: {element.text!r}"]
    return found + [fault for child in element for fault in faults(child, rules, element.tag)]


def opened(version, topics=TOPICS):
    return zipfile.ZipFile(io.BytesIO(bcf_of(topics, "house.ifc", version=version, written=WRITTEN)))


@pytest.mark.parametrize("version", VERSIONS)
def test_files_keep_the_rules_of_the_schemas(version):
    archive = opened(version)
    names = archive.namelist()
    for name in names:
        if name.endswith(("/", ".png")):
            continue
        root = ElementTree.fromstring(archive.read(name))
        assert faults(root, RULES[version]) == [], name
    extensions = {"extensions.xml"} if version == "3.0" else set()
    assert {name for name in names if "/" not in name} == {"bcf.version", "project.bcfp", *extensions}
    first, second = (f"{topic.guid}/" for topic in TOPICS)
    assert {first, f"{first}markup.bcf", f"{first}viewpoint.bcfv", f"{second}snapshot.png"} < set(names)
    assert f"{first}snapshot.png" not in names


def test_the_rules_find_faults():
    wrong = "<Topic Guid='A' TopicType='x' TopicStatus=''><Index>1</Index><Title/><Bad/></Topic>"
    told = " ".join(faults(ElementTree.fromstring(wrong), RULES["2.1"]))
    for part in (
        "Bad is unknown",
        "order",
        "without CreationDate",
        "Guid='A'",
        "TopicStatus=''",
        "Title: None",
    ):
        assert part in told


@pytest.mark.parametrize("version", VERSIONS)
def test_the_same_topics_give_the_same_bytes_and_texts_are_clean(version):
    archive = opened(version)
    assert archive.testzip() is None
    assert {entry.date_time for entry in archive.infolist()} == {(2026, 3, 1, 12, 0, 0)}
    one, two = (bcf_of(TOPICS, "house.ifc", version=version, written=WRITTEN) for _ in range(2))
    assert one == two
    markup = ElementTree.fromstring(archive.read(f"{TOPICS[1].guid}/markup.bcf"))
    assert markup.findtext(".//Description") == "19.9 mm <behind> & its place"
    view = ElementTree.fromstring(archive.read(f"{TOPICS[1].guid}/viewpoint.bcfv"))
    assert len(view.findall(".//Selection/Component")) == 1
    assert ElementTree.fromstring(archive.read(f"{TOPICS[0].guid}/viewpoint.bcfv")).find("Components") is None


def test_other_versions_are_refused_and_no_topic_is_a_file_too():
    with pytest.raises(InputError, match=r"BCF '1.0' is not written; known: 2.1, 3.0"):
        bcf_of(TOPICS, "a", version="1.0", written=WRITTEN)
    assert opened("3.0", []).namelist() == ["bcf.version", "project.bcfp", "extensions.xml"]


@pytest.mark.parametrize("version", VERSIONS)
def test_another_library_reads_them(tmp_path, version):
    bcfxml = pytest.importorskip("bcf.bcfxml", reason="bcf-client is not installed")
    path = tmp_path / "a.bcf"
    path.write_bytes(bcf_of(TOPICS, "house.ifc", version=version, written=WRITTEN))
    held = bcfxml.load(path)
    assert held.version.version_id == version
    assert held.project.name == "house.ifc"
    assert list(held.topics) == [str(topic.guid) for topic in TOPICS]
    topic = held.topics[str(TOPICS[1].guid)]
    assert (topic.topic.title, topic.topic.topic_type) == ("wall 1", "Deviation")
    (view,) = topic.viewpoints.values()
    assert view.snapshot == b"\x89PNG"
    camera = view.visualization_info.perspective_camera
    assert (camera.camera_view_point.y, camera.camera_direction.y, camera.field_of_view) == (1, -1, 60)
    assert view.visualization_info.components.selection.component[0].ifc_guid == "0" * 22
