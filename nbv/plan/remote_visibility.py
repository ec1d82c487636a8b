# SPDX-License-Identifier: MIT
"""Remote visibility: blocks of positions are cast by workers that map scene and samples from one folder.

What all blocks share is written once, under the hash of its bytes, and mapped into the memory of each
worker; Embree's tree is built once in each process. A position's row depends on nothing but itself, so the
matrix is the one that `nbv.visibility.visibility.visible_from_positions` returns, whoever casts.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from shutil import rmtree
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from nbv.run.workers import Workers, workers_of
from nbv.visibility.requirement import SightLimits
from nbv.visibility.samples import SurfaceSamples
from nbv.visibility.visibility import Progress, stack_rows, visible_from_positions
from scenes.checks import FloatArray, InputError
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.rays.raycast import RayCaster
from scenes.run.atomic import atomic_path

_BLOCK = 8  # positions a piece of work
_KEPT = 2  # trees and sets of samples that a worker's process keeps
_SHARED = ".shared"
_SAMPLE_ARRAYS = ("points", "normals", "areas", "face", "surface", "pair")


@dataclass(frozen=True, slots=True)
class SharedArrays:
    """Arrays in a folder that all workers see, as `.npy` files named by the hash of their bytes.

    The folder is absolute; `names` say what each array is called, and the SHA-256 of its bytes.
    """

    folder: str
    names: tuple[tuple[str, str], ...]

    @classmethod
    def write(cls, folder: Path, arrays: Mapping[str, NDArray[np.generic]]) -> SharedArrays:
        """Write arrays of any shape that are not there yet."""
        folder.mkdir(parents=True, exist_ok=True)
        names = []
        for name, array in arrays.items():
            plain = np.ascontiguousarray(array)
            digest = hashlib.sha256(f"{plain.dtype.str}{plain.shape}".encode() + plain.tobytes()).hexdigest()
            file = folder / f"{digest}.npy"
            if not file.is_file():
                with atomic_path(file) as temporary:
                    np.save(temporary, plain, allow_pickle=False)
            names.append((name, digest))
        return cls(str(folder.resolve()), tuple(names))

    def mapped(self) -> dict[str, NDArray[np.generic]]:
        """Return the arrays in the shape they had, mapped into memory.

        Raises
        ------
        InputError
            A worker does not see the folder.
        """
        arrays: dict[str, NDArray[np.generic]] = {}
        for name, digest in self.names:
            file = Path(self.folder) / f"{digest}.npy"
            try:
                arrays[name] = np.asarray(np.load(file, mmap_mode="r", allow_pickle=False))
            except (OSError, ValueError) as error:
                raise InputError(
                    f"{file}: a worker cannot read this; all must see the output folder under the same path, "
                    "on a disk that they share"
                ) from error
        return arrays


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """Positions (b, 3) from which to look, and what to look at."""

    mesh: SharedArrays
    samples: SharedArrays
    tolerance_m: float
    limits: SightLimits
    positions: FloatArray


def look(block: Block, n_threads: int | None) -> list[tuple[NDArray[np.int64], FloatArray]]:
    """Return for each position of a block the samples (m,) that it sees, and their cosines (m,)."""
    samples = _samples(block.samples, block.tolerance_m)
    seen = visible_from_positions(
        _caster(block.mesh), block.positions, samples, block.limits, n_threads=n_threads
    )
    return [
        (seen.indices[start:end], seen.data[start:end])
        for start, end in zip(seen.indptr[:-1], seen.indptr[1:], strict=True)
    ]


@lru_cache(maxsize=_KEPT)
def _caster(mesh: SharedArrays) -> RayCaster:
    """Return the tree of a shared mesh; each process builds it once. Threads look, each alone."""
    arrays = mesh.mapped()
    return RayCaster(arrays["vertices"], arrays["faces"], n_threads=1)


@lru_cache(maxsize=_KEPT)
def _samples(samples: SharedArrays, tolerance_m: float) -> SurfaceSamples:
    arrays: dict[str, Any] = samples.mapped()
    return SurfaceSamples(**arrays, tolerance_m=tolerance_m)


@dataclass(frozen=True, slots=True)
class RemoteVisibility:
    """Workers that cast, and the folder that all of them see under the same path."""

    workers: Workers
    folder: Path

    def from_positions(
        self,
        mesh: LabelledMesh,
        positions: FloatArray,
        samples: SurfaceSamples,
        limits: SightLimits,
        progress: Progress | None = None,
    ) -> csr_array:
        """Return the cosines (n_positions, n_samples) as `visible_from_positions` does.

        Raises
        ------
        InputError
            A worker does not see the folder, or work was lost for good.
        """
        scene = SharedArrays.write(self.folder, {"vertices": mesh.vertices, "faces": mesh.faces})
        seen = SharedArrays.write(self.folder, {name: getattr(samples, name) for name in _SAMPLE_ARRAYS})
        blocks = [
            Block(
                mesh=scene,
                samples=seen,
                tolerance_m=samples.tolerance_m,
                limits=limits,
                positions=positions[start : start + _BLOCK],
            )
            for start in range(0, len(positions), _BLOCK)
        ]
        rows: list[list[tuple[NDArray[np.int64], FloatArray]]] = [[] for _ in blocks]
        keys = [_key(block) for block in blocks]
        for done, (number, found) in enumerate(self.workers.each(look, blocks, keys), start=1):
            rows[number] = found
            if progress is not None:
                progress("visibility", min(done * _BLOCK, len(positions)), len(positions))
        return stack_rows([row for block in rows for row in block], len(samples))


@contextmanager
def remote_visibility(
    scheduler: str | None, n_threads: int | None, folder: Path
) -> Iterator[RemoteVisibility | None]:
    """Yield the workers of a scheduler, None without one; what they share lies in `folder` meanwhile."""
    shared = folder / _SHARED
    if scheduler is None:
        rmtree(shared, ignore_errors=True)  # of a run with a scheduler that was killed
        yield None
        return
    try:
        with workers_of(scheduler, n_threads) as workers:
            yield RemoteVisibility(workers, shared)
    finally:
        rmtree(shared, ignore_errors=True)


def _key(block: Block) -> str:
    """Return what tells equal blocks: the hashes of what they look at, the limits, and the positions."""
    text = repr((block.mesh, block.samples, block.tolerance_m, block.limits))
    return hashlib.sha256(text.encode() + block.positions.tobytes()).hexdigest()
