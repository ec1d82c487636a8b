# SPDX-License-Identifier: MIT
"""Options of features in completion: which are sought, and what a person knows of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from completion.templates.engine.template import TemplateFit
from scenes.checks import InputError

OPENINGS = ("doorway", "window", "niche")


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class FeatureOptions:
    """Which features completion makes use of.

    Attributes
    ----------
    kinds : tuple of str
        Some of "doorway", "window", "niche".
    given : mapping
        What a person knows of all of them: "width", "height", "depth", metres.
    stated : tuple of TemplateFit, optional
        Features that are known (`applied.file.read_features`): these are used, and none are sought.

    Raises
    ------
    InputError
        An unknown kind.
    """

    kinds: tuple[str, ...] = OPENINGS
    given: Mapping[str, float] = field(default_factory=dict)
    stated: tuple[TemplateFit, ...] | None = None

    def __post_init__(self) -> None:
        for kind in self.kinds:
            if kind not in OPENINGS:
                raise InputError(f"completion uses features of kind {', '.join(OPENINGS)}, got {kind!r}")


FITTED = FeatureOptions()
"""What `complete` makes use of when nobody says otherwise."""
