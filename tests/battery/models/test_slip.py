"""The curve of an aged cell against half cells whose electrodes slip."""

import numpy as np
import pytest

from ohmward.battery.models.ocv import slip_shape

SOC = np.linspace(0.0, 1.0, 201)
LOSS = 0.1


def graphite_V(x):
    """A graphite electrode at filling x: steep when empty, flat above."""
    return 0.1 + 0.9 * np.exp(-x / 0.03)


def oxide_V(removed):
    """A layered oxide by the charge removed from the full cell, over the new cell's capacity."""
    return 4.3 - 0.9 * removed


def phosphate_V(filling):
    """Iron phosphate at its filling: flat, with a knee where the electrode is full."""
    return 3.42 - 0.5 * np.exp(-(1.0 - filling) / 0.01)


def rms(values):
    return np.sqrt(np.mean(np.square(values)))


@pytest.mark.parametrize("share", [0.5, -0.5])
def test_full_and_empty_stay_full_and_empty(share):
    assert slip_shape(0.0, share) == 0.0
    assert slip_shape(1.0, share) == 0.0
    assert np.all(np.asarray(slip_shape(SOC, share)) >= 0.0)
    assert slip_shape(-0.3, share) == slip_shape(1.3, share) == 0.0


def test_beyond_the_knee_the_whole_loss_slips():
    assert slip_shape(0.9, 1.0) == pytest.approx(0.1, rel=0.06)
    assert slip_shape(0.3, -1.0) == pytest.approx(0.3, rel=0.02)


def test_lost_lithium_moves_the_curve_of_a_layered_oxide_as_its_electrodes_do():
    new_V = oxide_V(1.0 - SOC) - graphite_V(SOC)
    aged_V = oxide_V((1.0 - SOC) * (1.0 - LOSS)) - graphite_V(SOC * (1.0 - LOSS))
    slipped_V = np.interp(SOC + LOSS * np.asarray(slip_shape(SOC, 1.0)), SOC, new_V)
    inside = (SOC > 0.05) & (SOC < 0.98)
    assert rms(slipped_V[inside] - aged_V[inside]) < 0.5 * rms(new_V[inside] - aged_V[inside])


def test_lost_lithium_keeps_the_empty_end_of_iron_phosphate():
    def staged_V(x):
        return graphite_V(x) - 0.03 / (1.0 + np.exp(-(x - 0.5) / 0.02))

    new_V = phosphate_V(1.0 - SOC) - staged_V(SOC)
    aged_V = phosphate_V((1.0 - SOC) * (1.0 - LOSS)) - staged_V(SOC * (1.0 - LOSS))
    slipped_V = np.interp(SOC - LOSS * np.asarray(slip_shape(SOC, -1.0)), SOC, new_V)
    inside = (SOC > 0.05) & (SOC < 0.9)
    assert rms(slipped_V[inside] - aged_V[inside]) < 0.3 * rms(new_V[inside] - aged_V[inside])
