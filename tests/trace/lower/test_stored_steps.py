"""Steps that a process finds on disk, against those that it traces."""

import copy
import hashlib
import os
import subprocess
import sys
import time
from typing import Any

import numpy as np
import pytest

from ohmward.battery.chemistries import generic_battery
from ohmward.battery.soc import thevenin_filter, voltage_faults
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.logs import Log
from ohmward.trace import Kernel
from ohmward.trace.lower import llvm_logs, reach
from ohmward.trace.lower.stored_steps import key_of
from ohmward.traction.odometry.estimator import Odometry
from ohmward.traction.speed_observer.estimator import SlipEstimator

pytest.importorskip("llvmlite")

BATTERY = generic_battery("lfp", 12.0, 4)


@pytest.fixture(autouse=True)
def _own_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("OHMWARD_CACHE", str(tmp_path / "cache"))


def new(make, kept=True, lowering="machine"):
    """An estimator whose kernel is its own."""
    estimator = make()
    estimator.lowering = lowering
    estimator._kernel = estimator.compiled()
    if not kept:
        estimator._kernel._key = None
    return estimator


def is_traced(estimator):
    return "program" in vars(estimator.kernel)


CASES: dict[str, tuple[Any, list[Any]]] = {
    "charge": (lambda: SocEstimator(BATTERY), [(0.5 * k, -3.0 + 0.1 * k, 13.0 + 0.01 * k) for k in range(40)]),
    "slip": (lambda: SlipEstimator("rlma"), [(0.01 * k, [0.1 * k] * 4, [0.5, 0.6]) for k in range(40)]),
    "odometry": (lambda: Odometry("robotino"), [(0.01 * k, [0.1 * k, 0.2, 0.3], 0.01) for k in range(40)]),
}


LOG = Log("short", *np.array(CASES["charge"][1]).T)


@pytest.mark.parametrize("name", CASES)
def test_a_stored_step_is_the_traced_one_to_the_bit_and_is_not_traced_again(name):
    make, samples = CASES[name]
    traced, keeper = new(make, kept=False), new(make)
    expected = [traced.update(*sample) for sample in samples]
    keeper.update(*samples[0])
    kept = new(make)
    assert is_traced(traced) and not is_traced(kept)
    for sample, estimate in zip(samples, expected, strict=True):
        for one, other in zip(estimate, kept.update(*sample), strict=True):
            np.testing.assert_array_equal(one, other)
    assert not is_traced(kept)


def test_a_short_log_takes_the_stored_step_too():
    make, samples = CASES["charge"]
    live = new(make)
    expected = [live.update(*sample).soc for sample in samples]
    kept = new(make, lowering="auto")
    np.testing.assert_allclose(kept.run(LOG).estimates.soc, expected, rtol=1e-9)
    assert not is_traced(kept)


KEYS = """
from ohmward import Odometry, SlipEstimator, SocEstimator, generic_battery
for estimator in SocEstimator(generic_battery("lfp", 12.0, 4)), SlipEstimator("rlma"), Odometry("robotino"):
    print(estimator.compiled()._key)
"""


def test_every_process_finds_the_same_key_whatever_else_it_has_loaded():
    programs = KEYS, f"import ohmward.cli.soc, ohmward.energy\n{KEYS}"
    one, other = (
        subprocess.check_output([sys.executable, "-c", program], text=True, env=os.environ | {"PYTHONHASHSEED": seed})
        for program, seed in zip(programs, "12", strict=True)
    )
    assert one == other and len(set(one.split())) == 3 and "None" not in one


def test_every_setting_is_in_the_key():
    keys = {SocEstimator(generic_battery("lfp", capacity, 4)).compiled()._key for capacity in (12.0, 12.5, 12.0)}
    keys |= {SlipEstimator("rlma", terrain=ground).compiled()._key for ground in ("gravel", "ice")}
    assert len(keys) == 4
    assert None not in keys


def test_values_that_settings_have_cached_do_not_change_the_key():
    odometry = Odometry("rlma")
    fresh = copy.copy(odometry.settings)
    fresh.__dict__.pop("rims", None)
    assert key_of(odometry.settings.step, (0.0,), ()) == key_of(fresh.step, (0.0,), ())


def test_a_constant_or_an_attribute_that_was_changed_changes_the_key(monkeypatch):
    step = SocEstimator(BATTERY).settings.step
    as_it_is = key_of(step, (0.0,), ())
    with monkeypatch.context() as patched:
        patched.setattr(voltage_faults, "FROZEN_STD", 7.5)
        assert key_of(step, (0.0,), ()) != as_it_is
    with monkeypatch.context() as patched:
        patched.setattr(type(SocEstimator(BATTERY).settings), "of_a_test", 1.0, raising=False)
        assert key_of(step, (0.0,), ()) != as_it_is
    assert key_of(step, (0.0,), ()) == as_it_is


def test_an_array_that_was_changed_in_place_changes_the_key(monkeypatch):
    points = np.zeros(3)
    monkeypatch.setattr(voltage_faults, "OF_A_TEST", points, raising=False)
    step = SocEstimator(BATTERY).settings.step
    as_it_is = key_of(step, (0.0,), ())
    points[1] = 1.0
    assert key_of(step, (0.0,), ()) != as_it_is


def test_functions_of_others_in_the_place_of_ours_are_not_kept(monkeypatch):
    monkeypatch.setattr(thevenin_filter, "clip", step)
    assert key_of(SocEstimator(BATTERY).settings.step, (0.0,), ()) is None


def test_nothing_is_stored_of_a_file_that_was_edited_meanwhile(monkeypatch):
    monkeypatch.setattr(reach, "_STARTED_UNIX_S", 0.0)
    reach._file_digest.cache_clear()
    reach._DESCRIBED.clear()
    assert key_of(SocEstimator(BATTERY).settings.step, (0.0,), ()) is None


def test_a_file_from_the_future_was_not_edited_meanwhile(tmp_path):
    file = tmp_path / "module.py"
    file.write_text("")
    later = time.time() + 1e6  # by the clock of this machine, which is behind
    os.utime(file, (later, later))
    assert reach._file_digest(str(file)) == hashlib.sha256(b"").hexdigest()


def test_nothing_is_stored_of_a_module_without_a_file(monkeypatch):
    monkeypatch.setattr(thevenin_filter, "__file__", "/nowhere/package.zip/thevenin_filter.py")
    assert key_of(SocEstimator(BATTERY).settings.step, (0.0,), ()) is None


def step(state, sample):
    return state + sample, state


def test_functions_of_others_and_those_that_cannot_be_named_are_not_kept():
    assert key_of(step, (0.0, 0.0), ()) is None
    assert key_of(lambda state, sample: (state, sample), (0.0, 0.0), ()) is None
    assert Kernel(step, 0.0, 0.0).live(1.0).step(2.0) == 1.0


def test_an_estimator_that_is_to_run_in_python_does(monkeypatch):
    make, samples = CASES["charge"]
    new(make).update(*samples[0])
    monkeypatch.setattr(llvm_logs, "run_log", None)
    assert np.isfinite(SocEstimator(BATTERY, lowering="python").run(LOG).estimates.soc).all()
