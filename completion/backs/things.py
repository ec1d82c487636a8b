# SPDX-License-Identifier: MIT
"""Things: what stands in a room and is none of it, in all scans together.

Pixels that are of no floor, ceiling or wall, and not behind one, are linked to neighbours that are no farther
away than the sampling allows, and to pixels of the same completed surface. What lies above a level surface,
and reaches below it nowhere, stands on it and is a thing of its own, so that a table and the cups on it are
apart. Parts in several scans are one thing where they share space.
"""

from __future__ import annotations

from collections.abc import Sequence

from completion.backs.candidate import Candidate, join_hanging, relate
from completion.backs.joining import join_parts
from completion.backs.separation import Part, RoomFrame, ScanView
from completion.backs.standing import Outlines
from completion.backs.thing import Thing
from completion.evidence.evidence import Scans
from completion.extension.patch import Patch
from completion.room.roles import Room
from scenes.inclination import Up
from scenes.pose import Pose
from scenes.run.mapping import trim


def why_none(up: Up) -> str:
    """Return why no things are separated; "" where they are."""
    return "" if up.is_decided else "up is undecided, so that nothing stands on anything: say it by --up"


def find_things(
    patches: Sequence[Patch], scans: Scans, room: Room, up: Up, world_from_reference: Pose
) -> tuple[Thing, ...]:
    """Separate what stands in a room into things; none where up is undecided (`why_none`).

    Parameters
    ----------
    patches : sequence of Patch
        The completed surfaces, working frame.
    scans : Scans
        The scans, each pixel with the number of its surface.
    room : Room
        Floors, ceilings, walls, working frame.
    up : Up
        Which way is up in the world.
    world_from_reference : Pose
        From the working frame to the world.
    """
    if not up.is_decided:
        return ()
    # 1. Separate: parts of each scan that are none of the room, by what they stand on.
    frame = RoomFrame.of(patches, room, scans)
    parts = list[Part]()
    for number, seen in enumerate(scans.observations):
        parts += ScanView.of(number, seen, scans.owners[number], frame).parts(frame)
        trim()

    # 2. Join: parts behind an occluder, or seen in several scans, are one thing; so is what hangs above or in
    #    another, where nothing else can stand.
    candidates = [Candidate.of(joined, scans) for joined in join_parts(parts, patches, scans, frame.is_room)]
    candidates = join_hanging(
        candidates, frame, Outlines.of([one.pixels for one in candidates], scans, frame.up)
    )
    candidates.sort(key=lambda one: -one.n_pixels)

    # 3. Choose: what was seen to hang, to be fixed to a wall or to go up to the ceiling is of the building.
    outlines = Outlines.of([one.pixels for one in candidates], scans, frame.up)
    kept = [one for one in candidates if one.is_resolved(frame, outlines) and one.stands(frame, outlines)]
    outlines = Outlines.of([one.pixels for one in kept], scans, frame.up)

    # 4. Relate: what things stand on, touch, hide.
    return tuple(relate(kept, frame, outlines, patches, world_from_reference))
