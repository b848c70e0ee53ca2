"""Capacity that a part can show, from its anchors, the axis of its curve and the offset of the current sensor."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from ohmward.battery.chemistries import generic_battery
from ohmward.battery.learning.learn import learn
from ohmward.battery.learning.solve import capacity_by_offset, capacity_error2
from ohmward.battery.posterior import Unknowns
from ohmward.battery.soc.anchor_rule import SocAnchor
from ohmward.filters.belief import Belief
from ohmward.logs import Log
from ohmward_lab.simulate.voltage import simulate_voltage

LABEL = generic_battery("lfp", 10.0)
FULL, EMPTY = SocAnchor(0, 1.0, 0.01), SocAnchor(9, 0.0, 0.02)


@pytest.mark.parametrize(
    ("anchors", "error2"),
    [
        ((), (0.05**2 + 0.04**2) / 0.5**2),
        ((FULL, FULL), (0.05**2 + 0.04**2) / 0.5**2),
        ((FULL, EMPTY), 0.01**2 + 0.02**2),
        ((FULL, FULL, EMPTY), 0.01**2 + 0.02**2),
    ],
)
def test_two_events_or_two_places_of_the_curve_show_the_capacity(anchors, error2):
    assert capacity_error2(np.array([0.05, 0.04]), anchors, 0.5) == pytest.approx(error2, rel=1e-12)


def test_an_offset_that_is_found_gives_the_capacity_counted_with_it():
    p = Unknowns({"capacity": 1, "offset": 1})
    prior = Belief(np.zeros(2), np.array([[0.01, 0.0018], [0.0018, 0.0004]]))
    K = prior.cov[:, 1] / (prior.cov[1, 1] + 0.002**2)  # the offset is measured as 0.01 +- 0.002 A
    found = Belief(K * 0.01, prior.cov - np.outer(K, prior.cov[1]))
    by_offset = capacity_by_offset(p, prior, found)
    assert by_offset.mean == pytest.approx(found.mean[0], rel=1e-12)
    assert by_offset.std**2 == pytest.approx(found.cov[0, 0], rel=1e-9)


def drive_and_charge(capacity_Ah: float, lowest_soc: float = 0.0, early: float = 0.0) -> Iterator[Log]:
    """From full down, and back, between rests, by a sensor whose offset moves its count by 2 to 3 %.

    early: SoC by which the knee at empty comes earlier than on the curve of the label.
    """
    soc = np.linspace(0.0, 1.0, len(LABEL.thevenin.ocv.voltage_V))
    voltage_V = np.interp(soc - early * (1.0 - soc), soc, LABEL.thevenin.ocv.voltage_V)
    true = replace(LABEL.thevenin, capacity_Ah=capacity_Ah, ocv=replace(LABEL.thevenin.ocv, voltage_V=tuple(voltage_V)))
    for sign, start_soc in ((-1.0, 1.0), (1.0, lowest_soc)):
        time_s = np.arange(0.0, (0.5 * capacity_Ah + 1.0) * 3600.0, 10.0)
        moving = (time_s >= 1800.0) & (time_s < time_s[-1] - 1800.0)
        current_A = np.where(moving, 2.0 + np.sin(time_s / 400.0), 0.0)
        current_A *= sign * (1.0 - lowest_soc) * capacity_Ah * 3600.0 / np.trapezoid(current_A, time_s)
        log = Log(f"{sign:+g}", time_s, current_A, np.zeros(time_s.size), np.full(time_s.size, 25.0))
        yield replace(log, voltage_V=simulate_voltage(true, log, start_soc).voltage_V, current_A=current_A + 0.05)


@pytest.mark.parametrize("capacity_Ah", [8.8, 11.2])
def test_a_discharge_and_a_charge_between_steep_ends_show_the_capacity(capacity_Ah):
    learnt = learn(LABEL, list(drive_and_charge(capacity_Ah))).battery
    assert learnt.noise.capacity_std < 0.05
    assert learnt.capacity_Ah == pytest.approx(capacity_Ah, rel=2 * learnt.noise.capacity_std)


@pytest.mark.parametrize("capacity_Ah", [8.8, 11.2])
def test_a_knee_above_the_voltage_of_empty_does_not_show_the_capacity(capacity_Ah):
    """It comes earlier than the label has it, as with other cells of the chemistry."""
    learnt = learn(LABEL, list(drive_and_charge(capacity_Ah, lowest_soc=0.1, early=0.08))).battery
    assert learnt.capacity_Ah == pytest.approx(capacity_Ah, rel=2 * learnt.noise.capacity_std)
