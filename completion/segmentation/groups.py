# SPDX-License-Identifier: MIT
"""Groups: which parts have been found to be one surface, while they are being joined."""

from __future__ import annotations


class Groups:
    """Parts 0 to n - 1 in groups, at first each in its own; a group keeps the number that it is joined to."""

    def __init__(self, n: int) -> None:
        self._number = list(range(n))
        self._members = {part: [part] for part in range(n)}

    def of(self, part: int) -> list[int]:
        """The parts in the group of a part, ascending."""
        return self._members[self._number[part]]

    def are_one(self, one: int, other: int) -> bool:
        """Tell whether two parts are in one group."""
        return self._number[one] == self._number[other]

    def join(self, one: int, other: int) -> None:
        """Put the group of the other part into that of the one."""
        here, there = self._number[one], self._number[other]
        moved = self._members.pop(there)
        for part in moved:
            self._number[part] = here
        self._members[here] = sorted(self._members[here] + moved)

    def all(self) -> list[list[int]]:
        """The parts of each group, ascending, by the groups' numbers."""
        return [self._members[number] for number in sorted(self._members)]
