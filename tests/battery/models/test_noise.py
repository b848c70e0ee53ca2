"""Noise of a battery's model along its state of charge."""

from __future__ import annotations

import pytest

from ohmward.battery.models.noise import BatteryNoise
from ohmward.errors import InputError


def test_overpotential_share_is_one_number_or_stands_on_a_grid():
    assert BatteryNoise(overpotential_share=0.2).overpotential_share_at(0.7) == 0.2
    along = BatteryNoise(overpotential_share=(0.1, 0.1, 0.5))
    assert along.overpotential_share_at(0.25) == pytest.approx(0.1)
    assert along.overpotential_share_at(0.75) == pytest.approx(0.3)
    assert along.overpotential_share_at(1.2) == pytest.approx(0.5)


def test_a_negative_share_is_refused():
    with pytest.raises(InputError, match="overpotential_share"):
        BatteryNoise(overpotential_share=(0.1, -0.1))
