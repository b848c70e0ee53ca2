"""A ground with a corner, and an observer that believes in one without: the wheels seem to show a speed and do not."""

from dataclasses import replace

import numpy as np
import pytest

from ohmward.filters.consistency import BAND_95
from ohmward_lab.simulate import closed_loop
from ohmward_lab.simulate.closed_loop.observing import make_observer
from traction.speed_observer.examples import observed


@pytest.fixture(scope="module")
def held_slip():
    """Slip held at 0.12 and then -0.18 on a corner of 0.2, seen by encoders on the driven wheels alone."""
    scenario = closed_loop.find_scenario("slip-steps")
    return closed_loop.run(replace(scenario, sensors=replace(scenario.sensors, encoders="driven")))


def coverage_95(run, **noise):
    scenario, samples = run.scenario, run.rows.sample
    observer = make_observer(scenario.observer, scenario.sensors, scenario.model, scenario.surface.patches[-1])
    observer = replace(observer, noise=replace(observer.noise, **noise))
    _, e = observed(observer, samples, type(samples)(*(np.asarray(values)[0] for values in samples)))
    return np.mean(abs(e.speed_m_s - run.rows.truth.speed_m_s) < BAND_95 * e.speed_std_m_s)


def test_a_corner_that_nobody_believes_in_breaks_no_sigma(held_slip):
    assert coverage_95(held_slip) > 0.9
    assert coverage_95(held_slip, curve_shape_std=1e-6) < 0.7
