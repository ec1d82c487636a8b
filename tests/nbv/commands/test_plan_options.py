# SPDX-License-Identifier: MIT
"""Options of `unseen plan` as they stand in manifest and report."""

from nbv.commands.options import PlanOptions
from nbv.commands.plan import options_record


def test_axis_and_unit_of_the_scene_are_recorded_as_they_were_asked_for():
    options = options_record(PlanOptions(up="y", units="mm"))
    assert (options["up"], options["units"]) == ("y", "mm")
