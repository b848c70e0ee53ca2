"""The published estimators and drives pass what those of the product pass."""

import pytest

from battery.soc import test_faults, test_machine_code, test_registry
from embedded import test_battery, test_wild_samples
from embedded.batteries import soc_library
from fleet import test_lanes
from needs import needs_gcc
from ohmward.traction import RLMA
from ohmward.traction.drive_checks import check_drive
from ohmward_lab.published.rc import rc_of_thevenin
from ohmward_lab.published.rc_filter import RcFilter
from ohmward_lab.published.registry import PUBLISHED
from ohmward_lab.simulate import closed_loop
from ohmward_lab.simulate.closed_loop import drive_log, find_scenario

each = pytest.mark.parametrize("name", PUBLISHED)
#: RC + KF overflows singles by months, time and again.
OVERFLOWS = {"published.rc-kf"}


@each
def test_it_runs_streams_alike_and_stays_near_the_truth(name):
    test_registry.test_every_estimator_runs_streams_alike_and_stays_near_the_truth(name)


@each
def test_machine_code_is_python_on_a_log_with_every_fault(name):
    test_machine_code.test_machine_code_is_python_on_a_log_with_every_fault(name)


@pytest.mark.parametrize("fault", test_faults.SINGLE)
def test_one_bad_sample_is_flagged_and_changes_next_to_nothing(fault, monkeypatch):
    filter_ = RcFilter(rc_of_thevenin(test_faults.NMC), test_faults.NOISE)
    monkeypatch.setitem(test_faults.ESTIMATORS, "published.rc-kf", filter_)
    test_faults.test_one_bad_sample_is_flagged_and_changes_next_to_nothing("published.rc-kf", fault)


@each
def test_it_is_traced_once_for_all_batches(name):
    test_lanes.test_every_estimator_is_traced_once_for_all_batches(name)


@needs_gcc
@each
def test_it_can_be_exported(name, tmp_path):
    test_battery.test_every_other_estimator_can_be_exported(name, tmp_path)


@needs_gcc
@pytest.mark.filterwarnings("ignore:invalid value encountered in cast:RuntimeWarning")
@pytest.mark.parametrize("name", [name for name in PUBLISHED if name not in OVERFLOWS])
def test_numbers_come_back_after_any_samples(name, tmp_path):
    test_wild_samples.assert_numbers_come_back(soc_library(name), test_wild_samples.BATTERY, "soc", tmp_path)


@pytest.mark.parametrize("case", ["slip-case-1", "slip-case-2"])
def test_the_cases_of_the_dissertation_have_no_wrong_sign(case):
    log = drive_log(closed_loop.run(find_scenario(case)))
    assert check_drive(RLMA, log).notes == log.notes
