"""Live steps that a process finds on disk, against those that it traces."""

import copy

import numpy as np
import pytest

from ohmward.battery.chemistries import generic_battery
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.trace import Kernel, kernel
from ohmward.trace.lower.kept_steps import keeping, key_of
from ohmward.traction.odometry.estimator import Odometry
from ohmward.traction.speed_observer.estimator import SlipEstimator

pytest.importorskip("llvmlite")

BATTERY = generic_battery("lfp", 12.0, 4)


@pytest.fixture(autouse=True)
def _own_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("OHMWARD_CACHE", str(tmp_path / "cache"))


@pytest.fixture
def untraced(monkeypatch):
    """Called to let nobody trace any more."""

    def refuse(*_, **__):
        raise AssertionError("traced")

    return lambda: monkeypatch.setattr(kernel, "trace", refuse)


def estimates(make, samples):
    """Estimates of a new estimator whose kernel is its own."""
    estimator = make()
    estimator._kernel = estimator.compiled()
    return [estimator.update(*sample) for sample in samples]


CASES = {
    "charge": (lambda: SocEstimator(BATTERY), [(0.5 * k, -3.0 + 0.1 * k, 13.0 + 0.01 * k) for k in range(40)]),
    "slip": (lambda: SlipEstimator("rlma"), [(0.01 * k, [0.1 * k] * 4, [0.5, 0.6]) for k in range(40)]),
    "odometry": (lambda: Odometry("robotino"), [(0.01 * k, [0.1 * k, 0.2, 0.3], 0.01) for k in range(40)]),
}


@pytest.mark.parametrize("name", CASES)
def test_a_kept_step_is_the_traced_one_to_the_bit_and_is_not_traced_again(name, untraced):
    make, samples = CASES[name]
    traced = estimates(make, samples)
    with keeping():
        estimates(make, samples)
        untraced()
        kept = estimates(make, samples)
    for a, b in zip(traced, kept, strict=True):
        for one, other in zip(a, b, strict=True):
            np.testing.assert_array_equal(one, other)


def test_every_setting_is_in_the_key():
    with keeping():
        keys = {SocEstimator(generic_battery("lfp", capacity, 4)).compiled()._key for capacity in (12.0, 12.5, 12.0)}
        keys |= {SlipEstimator("rlma", terrain=ground).compiled()._key for ground in ("gravel", "ice")}
    assert len(keys) == 4
    assert None not in keys


def test_values_that_settings_have_cached_do_not_change_the_key():
    odometry = Odometry("rlma")
    fresh = copy.copy(odometry.settings)
    fresh.__dict__.pop("rims", None)
    with keeping():
        assert key_of(odometry.settings.step, (0.0,), ()) == key_of(fresh.step, (0.0,), ())


def step(state, sample):
    return state + sample, state


def test_functions_of_others_and_those_that_cannot_be_named_are_not_kept():
    with keeping():
        assert key_of(step, (0.0, 0.0), ()) is None
        assert key_of(lambda state, sample: (state, sample), (0.0, 0.0), ()) is None
        assert Kernel(step, 0.0, 0.0).live(1.0).step(2.0) == 1.0


def test_nothing_is_kept_unless_asked_for():
    assert SlipEstimator("rlma").compiled()._key is None
