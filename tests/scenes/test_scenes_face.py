# SPDX-License-Identifier: MIT
"""The face of `scenes`: the names that users import, all there and all documented."""

import inspect

import scenes

NAMES = [
    "Appearance",
    "Cone",
    "Cylinder",
    "EllipticCylinder",
    "Hits",
    "InputError",
    "LabelledMesh",
    "PinholeProjection",
    "Plane",
    "Pose",
    "Projection",
    "RangeImage",
    "RayCaster",
    "ScanTruth",
    "Scene",
    "SphericalProjection",
    "Sphere",
    "Surface",
    "Torus",
    "builtin_names",
    "builtin_scene",
    "surfaces_close",
]


def test_the_face_lists_its_names_in_order() -> None:
    assert sorted(scenes.__all__) == list(scenes.__all__)
    assert set(NAMES) <= set(scenes.__all__)


def test_every_listed_name_is_there_and_documented() -> None:
    for name in scenes.__all__:
        assert inspect.getdoc(getattr(scenes, name)), name


def test_every_public_method_is_documented() -> None:
    for name in scenes.__all__:
        for attribute, member in vars(getattr(scenes, name)).items():
            if not attribute.startswith("_") and (callable(member) or isinstance(member, property)):
                assert inspect.getdoc(member), f"{name}.{attribute}"


def test_nothing_public_is_missing_from_the_list() -> None:
    public = {
        name
        for name, value in vars(scenes).items()
        if not name.startswith("_") and not inspect.ismodule(value)
    }
    assert public == set(scenes.__all__)
