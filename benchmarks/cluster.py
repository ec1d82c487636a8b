# SPDX-License-Identifier: MIT
"""A visibility matrix on threads, and on a local cluster of 1 to 4 processes: one run, the same bytes.

60 positions look at 200,000 samples of a closed room of a million triangles. Run by `make bench`, or alone:

    python benchmarks/cluster.py [ROUNDS]

Of a cluster, what its start costs (processes, imports) is told apart from the matrix; the first matrix has
each process map the scene and build its tree, later ones find both there.
"""

from __future__ import annotations

import hashlib
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from rays import room_with_spheres
from scipy.sparse import csr_array

from nbv.plan.remote_visibility import RemoteVisibility
from nbv.run.workers import cluster
from nbv.visibility.requirement import SightLimits
from nbv.visibility.samples import SurfaceSamples, sample_surface
from nbv.visibility.visibility import visible_from_positions
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.rays.raycast import RayCaster

N_POSITIONS, N_SAMPLES = 60, 200_000
PROCESSES = (1, 2, 3, 4)


def digest(matrix: csr_array) -> str:
    """Return the first digits of the hash of a matrix."""
    parts = (matrix.indptr.astype(np.int64), matrix.indices.astype(np.int32), matrix.data)
    return hashlib.sha256(b"".join(part.tobytes() for part in parts)).hexdigest()[:12]


def problem() -> tuple[LabelledMesh, SurfaceSamples, np.ndarray]:
    """The room, 200,000 samples of it in Morton order, and places between the spheres."""
    mesh = LabelledMesh(*room_with_spheres())
    spacing = float(np.sqrt(mesh.face_areas().sum() / N_SAMPLES))
    samples = sample_surface(mesh, spacing)
    positions = np.random.default_rng(1).uniform([-3.5, -3.5, -1], [3.5, 3.5, 1], (N_POSITIONS, 3))
    return mesh, samples, positions


def tell(name: str, seconds: list[float], matrix: csr_array, n_samples: int, note: str = "") -> None:
    """Print a line: median time, rays a second, and the hash of the result."""
    middle = float(np.median(seconds))
    rate = N_POSITIONS * n_samples / middle / 1e6
    print(f"| {name} | {middle:.2f} | {rate:.1f} | {digest(matrix)} | {note} |", flush=True)


def main(rounds: int = 3) -> None:
    """Print a table."""
    mesh, samples, positions = problem()
    limits = SightLimits()
    print(f"{len(mesh.faces):,} faces, {len(samples):,} samples, {N_POSITIONS} positions; {rounds} rounds\n")
    print("| who casts | s | million lines of sight a second | result | start, and first matrix |")
    print("|---|---|---|---|---|")
    for n_threads in (1, 2):
        caster, times = RayCaster(mesh.vertices, mesh.faces, n_threads=1), []
        for _ in range(rounds):
            begin = time.perf_counter()
            matrix = visible_from_positions(caster, positions, samples, limits, n_threads=n_threads)
            times.append(time.perf_counter() - begin)
        tell(f"{n_threads} threads", times, matrix, len(samples))
    for n_processes in PROCESSES:
        begin = time.perf_counter()
        with tempfile.TemporaryDirectory() as folder, cluster(f"local:{n_processes}", 1) as workers:
            started = time.perf_counter() - begin
            times, found = [], list[csr_array]()
            for number in range(rounds + 1):
                begin = time.perf_counter()
                shifted = positions + 1e-9 * number  # nothing is asked twice
                remote = RemoteVisibility(workers, Path(folder))
                matrix = remote.from_positions(mesh, shifted if number else positions, samples, limits)
                times.append(time.perf_counter() - begin)
                found.append(matrix)
        note = f"{started:.1f} s, {times[0]:.2f} s"
        tell(f"cluster of {n_processes}", times[1:], found[0], len(samples), note)


if __name__ == "__main__":
    main(*(int(text) for text in sys.argv[1:2]))
