# SPDX-License-Identifier: MIT
"""Registration from any start: how often it is right, and how often it claims what is not so.

Right is within 3 degrees and 10 cm of the truth.

    python -m benchmarks.registration pairs [FIRST] [ROOMS]
    python -m benchmarks.registration joint [FIRST] [ROOMS] [SCANS]
    python -m benchmarks.registration real
    python -m benchmarks.registration alike [FIRST] [PLACES OF A KIND]
    python -m benchmarks.registration objects [FIRST] [PAIRS OF AN ANGLE AND OBJECT]
    python -m benchmarks.registration peers [FIRST] [ROOMS]
    python -m benchmarks.registration starts [FIRST] [PAIRS OF AN OBJECT]
    python -m benchmarks.registration thickness [FIRST] [PLACES]

`pairs` prints by overlap, the least share of either scan's points that the other measured, how often the best
hypothesis is right, how often the right one is claimed, how often the truth is among the alternatives where
it is not, and wrong claims; and the same of pairs of scans of different rooms. `joint` registers all scans of
each room at once. `real` does both with real frames, each turned and moved at random first. `alike` tries
corridors and symmetric rooms, `objects` free-form things from two sides, `peers` other libraries on pairs
of rooms (open3d, kiss-matcher and small_gicp are to be installed), `starts` objects from starts that are
turned, beside ICP, and `thickness` what poses do to that of a wall seen from two rooms.
"""

from __future__ import annotations

import sys

from benchmarks.registration.alike import alike_table
from benchmarks.registration.joint import joint_table
from benchmarks.registration.objects import object_table
from benchmarks.registration.pairs import pair_table
from benchmarks.registration.peers import peer_table
from benchmarks.registration.real import real_table
from benchmarks.registration.starts import start_table
from benchmarks.registration.thickness import thickness_table

_TABLES = {
    "pairs": (pair_table, (9000, 100)),
    "joint": (joint_table, (9000, 20, 6)),
    "real": (real_table, ()),
    "alike": (alike_table, (0, 40)),
    "objects": (object_table, (0, 4)),
    "peers": (peer_table, (9900, 20)),
    "starts": (start_table, (60, 4)),
    "thickness": (thickness_table, (0, 20)),
}


def main() -> None:
    """Print the table that is asked for."""
    word, *given = sys.argv[1:] or ["pairs"]
    table, usual = _TABLES[word]
    numbers = [int(one) for one in given]
    for line in table(*numbers, *usual[len(numbers) :]):
        print(line, flush=True)


if __name__ == "__main__":
    main()
