# SPDX-License-Identifier: MIT
"""User options: what a person sets of a completion, declared once for command line and Python."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from scenes.card import Value
from scenes.run.option import NOT_NEGATIVE, NumberRange, check_limits, choices, option

Mode = Literal["conservative", "standard", "bold"]
KINDS = ("walls", "floors", "ceilings", "pipes", "planes", "cylinders")
"""What may be chosen: roles of planes that enclose the room, cylinders seen from outside, shapes."""


@dataclass(frozen=True, kw_only=True, slots=True)
class UserOptions(Value):
    """Options of `complete` that a person sets; `CompletionOptions` has those of the stages as well.

    Attributes
    ----------
    mode : "conservative", "standard" or "bold"
        How probable inferred area must be (`LEAST_CONFIDENCE`); conservative area also lies in the hull of
        the measured area.
    sigma_m : float, optional
        Standard deviation of the range noise, metres; estimated from each scan when None.
    projector_m : float, optional
        Where the projector, or second camera, of triangulating cameras stands on their x axis, metres, to the
        right when positive, 0 for none; estimated from each scan when None. Surface that is hidden from it
        may be inferred.
    max_sd_m : float
        A surface is continued only as far as its predicted standard deviation stays below this, metres.
    min_area_m2 : float, optional
        Surfaces with less measured area, square metres, are not continued and have no number: they stay in
        the model as measured. When None, so do planes of less than 0.05, and than 0.2 % of all that was
        measured, that are no floor, wall or ceiling.
    only : tuple of str
        The kinds of surface, of `KINDS`, that are continued and numbered; all when empty. Other surfaces
        still bound and hide them.
    registration_m : float
        Pose error of several scans, metres, where the scans do not show it: scans that measured the same
        surfaces do. For such scans it is the error that they show, and at least this, but no more than 5 mm.
    moves_scans : bool
        Whether scans whose poses contradict their measurements are moved into agreement.
    texture : bool
        Whether inferred area is textured.

    Raises
    ------
    InputError
        An unknown mode or kind, or a number outside its limits.
    """

    mode: Mode = option("--mode", "How far surfaces are continued.", "standard")
    sigma_m: float | None = option(
        "--sigma",
        "Standard deviation of the range noise.",
        None,
        metavar="M",
        shown="from the scans",
        limits=NOT_NEGATIVE,
    )
    projector_m: float | None = option(
        "--projector",
        "Offset of a Kinect's projector to the right of the camera (negative: to the left); 0: none.",
        None,
        metavar="M",
        shown="from the scans",
        limits=NumberRange(least=-1.0, most=1.0),
    )
    max_sd_m: float = option(
        "--max-sd",
        "Largest predicted standard deviation of inferred surface.",
        0.02,
        metavar="M",
        limits=NOT_NEGATIVE,
    )
    min_area_m2: float | None = option(
        "--min-area",
        "Smallest measured area of a surface to be continued; 0 continues all.",
        None,
        metavar="M2",
        shown="0.05 at most, of planes",
        limits=NOT_NEGATIVE,
    )
    only: tuple[str, ...] = option(
        "--only",
        f"Continue only these kinds: {', '.join(KINDS)}.",
        (),
        metavar="KINDS",
        shown="all",
        is_repeated=True,
        parse=choices(KINDS, ","),
    )
    registration_m: float = option(
        "--registration",
        "Pose error to assume if the scans do not show it.",
        0.005,
        metavar="M",
        limits=NOT_NEGATIVE,
    )
    moves_scans: bool = option(
        "--keep-poses", "Move no scan, even if its pose contradicts the others.", True, is_negated=True
    )
    texture: bool = option("--no-texture", "Leave inferred area untextured.", True, is_negated=True)

    def __post_init__(self) -> None:
        from scenes.checks import InputError  # numpy comes with it, which help does without

        if self.mode not in ("conservative", "standard", "bold"):
            raise InputError(f"mode must be conservative, standard or bold, got {self.mode!r}")
        for kind in self.only:
            if kind not in KINDS:
                raise InputError(f"only must be some of {', '.join(KINDS)}, got {kind!r}")
        check_limits(self)
