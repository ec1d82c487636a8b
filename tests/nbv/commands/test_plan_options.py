# SPDX-License-Identifier: MIT
"""Options of `unseen plan` as they stand in manifest and report."""

from nbv.commands.plan import PlanRequest


def test_axis_and_unit_of_the_scene_are_recorded_as_they_were_asked_for():
    options = PlanRequest(up="y", units="mm").options()
    assert (options["up"], options["units"]) == ("y", "mm")
