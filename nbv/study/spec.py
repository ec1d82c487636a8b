# SPDX-License-Identifier: MIT
"""Study file: which scenes, sensors, requirements, planners and seeds, read from TOML and checked."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self, TypeVar, get_args, get_type_hints

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    create_model,
    field_validator,
    model_validator,
)

from nbv.run.plan_options import Method, RequirementOptions, SearchOptions
from nbv.visibility.requirement import Requirement
from scenes.card import brief, text_of_facts
from scenes.checks import InputError
from scenes.io.checks.documents import read_toml, within_folder
from scenes.io.checks.guard import guard_reading, one_line

_MOST_CASES = 100_000
_COMPARED = 0.95  # beyond it a few square metres decide
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
_Finite = Annotated[float, Field(allow_inf_nan=False)]
Place = tuple[_Finite, _Finite, _Finite]  # metres, in the scene's frame


class Entry(BaseModel):
    """What all entries have: no unknown keys, no change after reading, and a label."""

    model_config = ConfigDict(extra="forbid", frozen=True, str_strip_whitespace=True)
    name: str = Field(default="", max_length=80)

    def __repr__(self) -> str:
        given = [(key, brief(value)) for key, value in self if key in self.model_fields_set]
        return text_of_facts(type(self).__name__, given)

    @property
    def label(self) -> str:
        """What results call it."""
        return self.name


class SceneEntry(Entry):
    """A scene: `builtin:NAME`, or a mesh file beside the study file.

    `spacing_m` is between the samples of its surface; that of the study's `sampling` where not given.
    """

    scene: str = Field(min_length=1)
    spacing_m: Positive | None = None
    up: Literal["x", "y", "z"] | None = None
    units: Literal["mm", "cm", "m", "in", "ft", "us-ft"] = "m"
    mode: Literal["room", "object"] | None = None

    @property
    def is_builtin(self) -> bool:
        """Whether it comes with the package and is no file."""
        return self.scene.startswith("builtin:")

    @property
    def label(self) -> str:
        """Its name, or that of the file."""
        return self.name or Path(self.scene.removeprefix("builtin:")).stem


class SensorEntry(Entry):
    """A sensor: a profile by name, or a TOML file beside the study file; and the errors of its scans."""

    sensor: str = Field(default="generic60", min_length=1)
    noise: str = "none"

    @property
    def label(self) -> str:
        """Its name, or that of the profile, with its errors."""
        text = Path(self.sensor).stem if self.sensor.endswith(".toml") else self.sensor
        return self.name or (text if self.noise == "none" else f"{text}, {self.noise}")


def _fields_of(kind: type, **changed: Any) -> Any:
    """Return an entry with the options that a dataclass declares; `changed` has other types and defaults.

    Options that are changed to None are left out.
    """
    hints, described = get_type_hints(kind), dict[str, Any]()
    for entry in fields(kind):
        limits = entry.metadata["option"].limits
        bounds: dict[str, Any] = {"gt": limits.above, "ge": limits.least, "le": limits.most}
        bounds = {name: bound for name, bound in bounds.items() if bound is not None}
        kinds = get_args(hints[entry.name]) or (hints[entry.name],)
        if float in kinds:
            bounds["allow_inf_nan"] = False
        described[entry.name] = (hints[entry.name], Field(default=entry.default, **bounds))
    described = {name: changed.get(name, given) for name, given in described.items()}
    described = {name: given for name, given in described.items() if given is not None}
    return create_model(kind.__name__, __base__=Entry, **described)


_RequirementFields: Any = _fields_of(RequirementOptions)


class RequirementEntry(_RequirementFields):  # type: ignore[misc]  # made from the declaration
    """What counts as measured; see `nbv.visibility.requirement.Requirement`."""

    def requirement(self) -> Requirement:
        """Return the requirement."""
        return Requirement(**self.model_dump(exclude={"name"}))

    @property
    def label(self) -> str:
        """Its name, or the requirement in words."""
        return str(self.name or self.requirement().describe())


_PlannerFields: Any = _fields_of(
    SearchOptions,
    method=(Method, ...),
    views=(int | None, Field(default=None, ge=1, le=10_000)),
    overlap=(float | None, Field(default=None, gt=0, lt=1)),
    polish_steps=(int | None, Field(default=None, ge=0)),
    time_budget_s=None,
)


class PlannerEntry(_PlannerFields):  # type: ignore[misc]  # made from the declaration
    """A planner, and when it ends: at the target, a share of the reachable area, or after so many views."""

    @model_validator(mode="after")
    def _fits_its_method(self) -> Self:
        if self.infer and self.method not in ("nbv", "cover"):
            raise ValueError(f"infer goes with method nbv or cover, not {self.method}")
        if self.method != "cover" and (self.overlap is not None or self.polish_steps is not None):
            raise ValueError(f"overlap and polish_steps go with method cover, not {self.method}")
        if self.infer and self.overlap is not None:
            raise ValueError("with infer there can be no overlap")
        return self

    @property
    def label(self) -> str:
        """Its name, or that of the method."""
        return str(self.name or self.method + (" with completion" if self.infer else ""))


class Sampling(BaseModel):
    """What all planners choose from and are measured on.

    Attributes
    ----------
    spacing_m : float, optional
        Distance of surface samples, metres; such that there are about 20,000 when not given.
    subdivisions : int
        How finely the directions of candidates lie: 42, 162 or 642 of the sphere for 1, 2 or 3.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    spacing_m: Positive | None = None
    subdivisions: int = Field(default=1, ge=0, le=3)


class PosesEntry(Entry):
    """Where scans are taken from: a `file`, places `at` that `look` at one or each at its own, or far apart.

    `file` holds poses, a trajectory or a plan.json; `farthest` so many candidates of the scene are chosen,
    each the farthest from those before it, drawn by the seed.
    """

    file: str | None = None
    at: tuple[Place, ...] = ()
    look: tuple[Place, ...] = ()
    farthest: int | None = Field(default=None, ge=1, le=10_000)

    @field_validator("at", "look", mode="before")
    @classmethod
    def _one_place(cls, given: Any) -> Any:
        is_one = isinstance(given, list) and bool(given) and not isinstance(given[0], list)
        return [given] if is_one else given

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        kinds = [self.file is not None, bool(self.at), self.farthest is not None]
        if sum(kinds) != 1:
            raise ValueError("give one of file, at (with look) and farthest")
        if bool(self.at) != bool(self.look) or (len(self.look) > 1 and len(self.look) != len(self.at)):
            raise ValueError("look is one place, or one for each of at")
        looks = self.look * len(self.at) if len(self.look) == 1 else self.look
        if same := [list(place) for place, look in zip(self.at, looks, strict=True) if place == look]:
            raise ValueError(f"at and look are the same place {same[0]}; a direction needs two")
        return self

    @property
    def label(self) -> str:
        """Its name, or that of the file, or what it is."""
        if self.name or self.file is not None:
            return self.name or Path(str(self.file)).stem
        n = len(self.at)
        return f"{n} place{'s' if n > 1 else ''}" if n else f"{self.farthest} farthest"


class CommonSpec(Entry):
    """What all studies have: scenes, sensors, requirements and seeds.

    Attributes
    ----------
    title, description : str
        For the report.
    scenes, sensors, requirements : tuple
        Entries; at least one scene.
    seeds : tuple of int
        A number n in the file stands for 0 to n - 1.
    sampling : Sampling
        On what coverage is measured, and from where.
    results : "csv" or "parquet"
        In which format the tables are written.
    """

    title: str = Field(default="", max_length=200)
    description: str = ""
    scenes: tuple[SceneEntry, ...] = Field(min_length=1)
    sensors: tuple[SensorEntry, ...] = Field(default=(SensorEntry(),), min_length=1)
    requirements: tuple[RequirementEntry, ...] = Field(default=(RequirementEntry(),), min_length=1)
    seeds: tuple[Annotated[int, Field(ge=0)], ...] = Field(default=(0,), min_length=1)
    sampling: Sampling = Sampling()
    results: Literal["csv", "parquet"] = "csv"
    _VARIED: ClassVar[tuple[str, ...]]
    _EACH: ClassVar[str]

    @model_validator(mode="before")
    @classmethod
    def _count_of_seeds(cls, given: Any) -> Any:
        if isinstance(given, dict) and type(given.get("seeds")) is int:
            if not 1 <= given["seeds"] <= _MOST_CASES:
                raise ValueError(f"seeds must be a list, or a number of them from 1 to {_MOST_CASES:,}")
            return {**given, "seeds": list(range(given["seeds"]))}
        return given

    @model_validator(mode="after")
    def _labels_differ(self) -> Self:
        for kind in self._VARIED:
            labels = [entry.label for entry in getattr(self, kind)]
            if twice := {label for label in labels if labels.count(label) > 1}:
                raise ValueError(f"two {kind} are called {min(twice)!r}: give each a name of its own")
        if len(set(self.seeds)) < len(self.seeds):
            raise ValueError("seeds must differ")
        n_cases = math.prod(len(getattr(self, kind)) for kind in (*self._VARIED, "seeds"))
        if n_cases > _MOST_CASES:
            raise ValueError(
                f"these are {n_cases:,} {self._EACH}; a study has at most {_MOST_CASES:,}: part it"
            )
        return self


class StudySpec(CommonSpec):
    """A study of plans: every scene with every sensor, requirement, planner (at least one) and seed."""

    kind: Literal["plans"] = "plans"
    planners: tuple[PlannerEntry, ...] = Field(min_length=1)
    _VARIED = ("scenes", "sensors", "requirements", "planners")
    _EACH = "plans"


class ScanStudySpec(CommonSpec):
    """A study of scans: every scene with every sensor, set of poses and seed, judged by every requirement.

    Attributes
    ----------
    poses : tuple of PosesEntry
        Sets of poses; at least one.
    keep : "none", "npz", "e57" or "laz"
        As what the scans are kept; none are by default, and each is dropped when its errors are known.
    complete : bool
        Whether the scans of each set are completed, and compared with the truth.
    register_scans : bool
        Whether the scans of each set are registered to each other, from the poses that they are said to have,
        and compared with the truth; `register` in the study file.
    pose_sd_m, pose_sd_deg : float
        Standard deviation in each axis of how far the scans are off from where they are said to be.
    """

    kind: Literal["scans"]
    poses: tuple[PosesEntry, ...] = Field(min_length=1)
    keep: Literal["none", "npz", "e57", "laz"] = "none"
    complete: bool = False
    register_scans: bool = Field(default=False, alias="register")
    pose_sd_m: float = Field(default=0.0, ge=0, le=10.0)
    pose_sd_deg: float = Field(default=0.0, ge=0, le=30.0)
    _VARIED = ("scenes", "sensors", "poses", "requirements")
    _EACH = "sets of scans"

    @property
    def joins_scans(self) -> bool:
        """Whether anything is asked of all scans of a set together."""
        return self.complete or self.register_scans


def common_share(spec: StudySpec) -> float:
    """Return the share of the reachable area at which planners are compared: that which all aim at, or 95 %.

    Examples
    --------
    >>> planners = [{"method": "nbv"}, {"method": "random", "target": 0.8}]
    >>> common_share(StudySpec(scenes=[{"scene": "builtin:office"}], planners=planners))
    0.8
    """
    return float(min(_COMPARED, *(planner.target for planner in spec.planners)))


def read_study(path: str | Path) -> StudySpec | ScanStudySpec:
    """Read a study file; files that it names lie in its folder. A table [study] may hold what is of no table.

    Raises
    ------
    InputError
        No such file, not TOML, or not a study: the field is named, as `planners[1].target`.
    """
    file = Path(path)
    table = read_toml(file)
    if isinstance(study := table.get("study"), dict):
        table = {**{name: value for name, value in table.items() if name != "study"}, **study}
    if (kind := table.get("kind", "plans")) not in ("plans", "scans"):
        raise InputError(f"{file}: kind: a study is of plans or of scans, not of {kind!r}")
    is_of_scans = kind == "scans"
    try:
        spec = (ScanStudySpec if is_of_scans else StudySpec).model_validate(table)
    except ValidationError as error:
        raise InputError(f"{file}: {one_line(_first_error(error))}") from error
    with guard_reading(file, "a study"):
        return _beside(spec, file.parent)


def _first_error(error: ValidationError) -> str:
    """Return where the first error is and what is wrong, and how many more there are."""
    errors = error.errors(include_url=False, include_context=False, include_input=False)
    first, n_others = errors[0], len(errors) - 1
    what = first["msg"].removeprefix("Value error, ")
    if first["type"] == "extra_forbidden":
        what = "there is no such entry; is it spelt as in the documentation?"
    where = location(first["loc"])
    more = f" (and {n_others} more)" if n_others else ""
    return f"{where}: {what}{more}" if where else f"{what}{more}"


def location(parts: Sequence[str | int]) -> str:
    """Return the place of an entry as one would write it.

    Examples
    --------
    >>> location(["planners", 1, "target"])
    'planners[1].target'
    """
    text = ""
    for part in parts:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else str(part)
    return text


Spec = TypeVar("Spec", bound=CommonSpec)


def _beside(spec: Spec, folder: Path) -> Spec:
    """Return the study with its files' paths from where we are."""

    def absolute(name: str) -> str:
        return str(within_folder(folder, name))

    scenes = tuple(
        entry if entry.is_builtin else entry.model_copy(update={"scene": absolute(entry.scene)})
        for entry in spec.scenes
    )
    sensors = tuple(
        entry.model_copy(update={"sensor": absolute(entry.sensor)})
        if entry.sensor.endswith(".toml")
        else entry
        for entry in spec.sensors
    )
    changed: dict[str, Any] = {"scenes": scenes, "sensors": sensors}
    if isinstance(spec, ScanStudySpec):
        changed["poses"] = tuple(
            entry if entry.file is None else entry.model_copy(update={"file": absolute(entry.file)})
            for entry in spec.poses
        )
    return spec.model_copy(update=changed)
