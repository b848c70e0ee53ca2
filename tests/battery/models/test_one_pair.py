"""The circuit with one RC pair that is the same at every SoC, and the noise to assume with it."""

from dataclasses import replace

import numpy as np
import pytest

from ohmward.battery.models.noise import BatteryNoise
from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.models.one_pair import mean_activation_K, one_pair, one_pair_noise
from ohmward.battery.models.thevenin import Thevenin


def test_a_circuit_with_one_constant_pair_is_its_own():
    """Then the noise is the file's as well, but for errors that hold on for the time constant."""
    model = Thevenin(6.0, OcvCurve((11.75, 13.0)), (0.03, 0.03), (0.03, 0.03), ((0.02, 0.02),), (400.0,))
    alone = one_pair(model)
    np.testing.assert_allclose(
        [*alone.r0_discharge_ohm, *alone.r_ohm[0], *alone.tau_s], [0.03, 0.03, 0.02, 0.02, 400.0]
    )
    noise = one_pair_noise(model, BatteryNoise(overpotential_share=0.05))
    np.testing.assert_allclose(noise.overpotential_share, 0.05)
    assert noise.correlation_s == pytest.approx(400.0)


def test_what_one_pair_leaves_out_is_an_error_of_the_overpotential():
    """R_0 alone, twice as large at empty: a third of the mean at either end."""
    model = Thevenin(6.0, OcvCurve((11.75, 13.0)), (0.04, 0.02), (0.04, 0.02), (), ())
    noise = one_pair_noise(model, BatteryNoise(overpotential_share=0.0))
    np.testing.assert_allclose(np.array(noise.overpotential_share)[[0, 10, 20]], [1 / 3, 0.0, 1 / 3], atol=1e-12)
    assert one_pair(model).r0_charge_ohm == pytest.approx((0.03, 0.03))


def test_the_activation_of_a_circuit_is_the_mean_of_its_parts():
    model = Thevenin(
        6.0, OcvCurve((11.75, 13.0)), (0.03,) * 2, (0.03,) * 2, ((0.01,) * 2,), (40.0,), activation_K=2000.0
    )
    assert mean_activation_K(model) == 2000.0
    assert mean_activation_K(replace(model, pair_activation_K=4000.0)) == pytest.approx(2500.0)
