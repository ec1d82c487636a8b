# SPDX-License-Identifier: MIT
"""What STEP export gives: the file, and what is to be known of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True, eq=False)
class FaceOutcome:
    """What became of a region.

    Attributes
    ----------
    number, kind : int, str
        Its surface.
    reason : str
        Why it has no face; empty where it has.
    measured_share : float
        Share of the face's area that was measured.
    sd_m : float
        Standard deviation of the surface along its normal, metres.
    is_open : bool
        Whether the face ends where its measurement does, without a neighbour.
    """

    number: int
    kind: str
    reason: str
    measured_share: float
    sd_m: float
    is_open: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class StepModel:
    """A part as STEP.

    Attributes
    ----------
    data : bytes
        The file.
    shape : kernel shape
        What it holds, millimetres.
    faces : tuple of FaceOutcome
        One a region.
    n_solids, n_open : int
        Solids, and shells or faces that are open.
    volume_m3 : float
        Of the solids.
    is_valid : bool
        Whether the geometry kernel finds nothing wrong.
    gap_m : float
        By how much edges are off the surfaces that they part, at most: 0 where these cross.
    reason : str
        Why it is no solid, in one sentence; empty where it is.
    """

    data: bytes
    shape: Any
    faces: tuple[FaceOutcome, ...]
    n_solids: int
    n_open: int
    volume_m3: float
    is_valid: bool
    gap_m: float
    reason: str

    @property
    def is_solid(self) -> bool:
        """Whether all of it closes."""
        return self.n_solids > 0 and not self.reason

    def record(self) -> dict[str, Any]:
        """Return what summaries hold of it."""
        return {
            "solid": self.is_solid,
            "solids": self.n_solids,
            "open_shells": self.n_open,
            "faces": sum(not one.reason for one in self.faces),
            "regions": len(self.faces),
            "volume_m3": self.volume_m3 if self.n_solids else None,
            "valid": self.is_valid,
            "gap_m": self.gap_m,
            "reason": self.reason or None,
            "open_faces": [one.number for one in self.faces if one.is_open and not one.reason],
            "without_face": [
                {"surface": one.number, "kind": one.kind, "reason": one.reason}
                for one in self.faces
                if one.reason
            ],
        }
