# SPDX-License-Identifier: MIT
"""Options of `unseen plan` as they stand in manifest and report."""

from nbv.commands.coverage import options_record as coverage_options_record
from nbv.commands.options.planning import CoverageOptions, PlanOptions
from nbv.commands.plan import options_record


def test_axis_and_unit_of_the_scene_are_recorded_as_they_were_asked_for():
    options = options_record(PlanOptions(scene="hall.obj", up="y", units="mm"))
    assert (options["up"], options["units"]) == ("y", "mm")


def test_up_of_scans_alone_is_recorded_as_estimated_where_nobody_says_it():
    assert options_record(PlanOptions(scans=("a.npz",)))["up"] == "auto"
    assert options_record(PlanOptions(scans=("a.npz",), up="-y"))["up"] == "-y"
    assert coverage_options_record(CoverageOptions(scans=("a.npz",)))["up"] == "auto"
