# SPDX-License-Identifier: MIT
"""Mutants: a seed and a few mutations in a row, each drawn from its own number so that it can be left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import PurePosixPath
from random import Random

from tests.robustness.fuzzing import containers
from tests.robustness.fuzzing.bytewise import mutate_bytes
from tests.robustness.fuzzing.case import Case
from tests.robustness.fuzzing.e57_pages import mutate_e57
from tests.robustness.fuzzing.textwise import mutate_text

MOST_BYTES = 1 << 20  # of one file; what grows beyond is left as it was
_STRUCTURED: dict[str, tuple[containers.Mutation, ...]] = {
    ".npz": (containers.mutate_npz,),
    ".glb": (containers.mutate_glb,),
    ".gltf": (containers.mutate_gltf,),
    ".png": (containers.mutate_png,),
    ".ply": (containers.mutate_scan_comments, containers.mutate_first_lines),
    ".pcd": (containers.mutate_scan_comments, containers.mutate_first_lines),
    ".las": (containers.mutate_las,),
    ".laz": (containers.mutate_las,),
    ".e57": (mutate_e57,),
    ".json": (containers.mutate_json_file,),
    ".txt": (containers.mutate_first_lines,),
    ".csv": (containers.mutate_first_lines,),
    ".ptx": (containers.mutate_first_lines,),
    ".off": (containers.mutate_first_lines,),
}
_TEXT = {".obj", ".mtl", ".off", ".ptx", ".txt", ".csv", ".xyz", ".log", ".json", ".toml", ".gltf", ".pts"}


@dataclass(frozen=True)
class Mutant:
    """What makes a mutant: a seed by its number, and a number for every mutation."""

    seed: int
    steps: tuple[int, ...]

    @classmethod
    def draw(cls, n_seeds: int, rng: Random) -> Mutant:
        """Draw one: mostly of one to three mutations, seldom of none."""
        n = rng.choice((1, 1, 1, 2, 2, 3, 4, 8)) if rng.random() > 0.002 else 0
        return cls(rng.randrange(n_seeds), tuple(rng.getrandbits(48) for _ in range(n)))

    def build(self, seeds: Sequence[Case]) -> Case:
        """Return the case."""
        case = seeds[self.seed]
        for step in self.steps:
            case = mutate_case(case, Random(step), seeds)
        return case

    def shorter(self) -> list[Mutant]:
        """Return those with one mutation less."""
        return [replace(self, steps=self.steps[:k] + self.steps[k + 1 :]) for k in range(len(self.steps))]


def mutate_case(case: Case, rng: Random, seeds: Sequence[Case] = ()) -> Case:
    """Return a case after one mutation of one of its files, seldom without one of its files."""
    names = sorted(case.files)
    if not names:
        return case
    name = case.entry if case.entry in case.files and rng.random() < 0.7 else rng.choice(names)
    if len(names) > 1 and rng.random() < 0.02:
        return replace(case, files={other: case.files[other] for other in names if other != name})
    if len(names) > 1 and rng.random() < 0.02:
        return case.changed(name, case.files[rng.choice(names)])
    donor = b""
    if seeds and rng.random() < 0.1:
        other = seeds[rng.randrange(len(seeds))]
        donor = other.files[rng.choice(sorted(other.files))]
    data = mutate_file(case.files[name], PurePosixPath(name).suffix.lower(), rng, donor)
    return case.changed(name, data) if len(data) <= MOST_BYTES else case


def mutate_file(data: bytes, suffix: str, rng: Random, donor: bytes = b"") -> bytes:
    """Return the content of a file after one mutation that its suffix allows."""
    structured = _STRUCTURED.get(suffix, ())
    kind = rng.random()
    if structured and kind < 0.6 and data:
        return rng.choice(structured)(data, rng)
    if kind < 0.9 and data and (suffix in _TEXT or _is_text(data)):
        return mutate_text(data, rng, suffix)
    if kind < 0.75 and data and suffix in (".ply", ".pcd"):  # a text header before binary data
        mark = b"end_header" if suffix == ".ply" else b"\nDATA"
        head, found, rest = data.partition(mark)
        return mutate_text(head, rng, suffix) + found + rest
    return mutate_bytes(data, rng, donor)


def _is_text(data: bytes) -> bool:
    return b"\0" not in data[:2048]
