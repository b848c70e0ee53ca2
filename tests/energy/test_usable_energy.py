from dataclasses import replace
from statistics import NormalDist

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from energy.examples import battery
from ohmward.battery.battery import Battery
from ohmward.battery.chemistries import generic_battery, start_model
from ohmward.battery.models.noise import CurrentSensor
from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.models.thevenin import CircuitInput, Thevenin, open_circuit
from ohmward.battery.models.thevenin import next_state as thevenin_next
from ohmward.battery.models.thevenin import voltage as thevenin_voltage
from ohmward.energy.discharge_end import DischargeEnd
from ohmward.energy.peaks import Peaks
from ohmward.energy.points import normal_points
from ohmward.energy.usable_energy import (
    BATTERY_DIMENSIONS,
    BatteryState,
    discharge,
    discharge_curves,
    soc_after,
    usable_at,
    usable_energy,
    usable_J,
)
from ohmward.errors import InputError

LABEL = generic_battery("lfp", 2.3, 8)


def energy_J(a_battery, charge, power_W):
    return usable_energy(a_battery, charge, power_W).p50


@settings(max_examples=25)
@given(soc=st.floats(0.2, 1.0), reserve=st.floats(0.0, 0.19), r_ohm=st.floats(0.0, 1.0), power_W=st.floats(0.0, 100.0))
def test_a_constant_open_circuit_voltage_has_a_closed_form(soc, reserve, r_ohm, power_W):
    terminal_V = (24.0 + np.sqrt(24.0**2 - 4 * r_ohm * power_W)) / 2
    by_hand = 3600.0 * 10.0 * terminal_V * (soc - reserve)
    found = energy_J(battery(r_ohm=r_ohm), BatteryState(soc, reserve_soc=reserve), power_W)
    assert found == pytest.approx(by_hand, rel=1e-9, abs=1e-6)


def test_a_straight_curve_down_to_the_cut_off():
    # U = 20 + 8 z, no resistance: from z = 0.9 to U = 22 at z = 0.25, Q (20 z + 4 z^2)
    found = energy_J(battery((20.0, 28.0)), BatteryState(0.9, cutoff_V=22.0, diffusion_lag_s=0.0), 50.0)
    assert found == pytest.approx(36000.0 * (20.0 * 0.65 + 4.0 * (0.81 - 0.0625)), rel=1e-5)


def test_the_discharge_branch_is_that_of_the_temperature():
    model, soc = replace(LABEL.thevenin, hysteresis_activation_K=1500.0), np.linspace(0.0, 1.0, 11)
    branch_V, *_ = discharge_curves(replace(LABEL, thevenin=model), soc, -10.0)
    state = np.array([soc, *(np.zeros(11) for _ in model.tau_s), -np.ones(11)])
    assert branch_V == pytest.approx(open_circuit(state, CircuitInput(0.0, -10.0), model), rel=1e-12)


def certain(power_W: float) -> Peaks:
    """A way on which a peak of this power comes at any moment, and none above."""
    return Peaks(np.array([0.0, power_W]), np.array([1e6, 1e6]))


def test_a_straight_curve_down_to_where_a_peak_would_meet_the_cut_off():
    # 50 W at 0.1 ohm; a peak of 150 W takes V (U - V) / 0.1 = 150 at V = 22: U = 22 + 15 / 22, z = (U - 20) / 8
    end = (2.0 + 15.0 / 22.0) / 8.0
    watched = BatteryState(0.9, cutoff_V=22.0, diffusion_lag_s=0.0)
    found = energy_J(battery((20.0, 28.0), r_ohm=0.1), replace(watched, peaks=certain(150.0)), 50.0)
    above = energy_J(battery((20.0, 28.0), r_ohm=0.1), BatteryState(0.9, reserve_soc=end), 50.0)
    assert found == pytest.approx(above, rel=2e-3)
    calm = energy_J(battery((20.0, 28.0), r_ohm=0.1), replace(watched, peaks=certain(50.0)), 50.0)
    alone = energy_J(battery((20.0, 28.0), r_ohm=0.1), watched, 50.0)
    assert calm == pytest.approx(alone, rel=5e-3) and calm > 1.03 * found  # a peak that is the mean is none


def test_a_peak_is_short_and_finds_the_slow_pairs_as_the_mean_left_them():
    slow = Thevenin(10.0, OcvCurve((20.0, 28.0)), (0.05,) * 2, (0.05,) * 2, ((0.1, 0.1),), (1e6,))
    peak_W, mean_W, cutoff_V = 150.0, 50.0, 22.0
    found = energy_J(
        Battery("test", 10.0, thevenin=slow),
        BatteryState(0.9, cutoff_V=cutoff_V, diffusion_lag_s=0.0, peaks=certain(peak_W)),
        mean_W,
    )
    U = cutoff_V + 0.05 * peak_W / cutoff_V  # and the settled pair's share at the mean current
    for _ in range(50):
        mean_V = (U + np.sqrt(U**2 - 4 * 0.15 * mean_W)) / 2
        U = cutoff_V + 0.05 * peak_W / cutoff_V + 0.1 * mean_W / mean_V
    above = energy_J(Battery("test", 10.0, thevenin=slow), BatteryState(0.9, reserve_soc=(U - 20.0) / 8.0), mean_W)
    assert found == pytest.approx(above, rel=1e-2)


def test_rare_peaks_that_a_battery_cannot_give_end_it_after_an_exponential_time():
    # 24 V behind 0.5 ohm give 2 V / 0.5 ohm * 22 V = 88 W down to 22 V, at any state of charge
    per_s, power_W = 1.0 / 3600.0, 20.0
    peaks = Peaks(np.array([0.0, 100.0]), np.array([per_s, per_s]))
    state = BatteryState(1.0, cutoff_V=22.0, diffusion_lag_s=0.0, peaks=peaks)
    found = usable_energy(battery(r_ohm=0.5), state, power_W)
    by_hand = power_W / per_s * -np.log([0.9, 0.5, 0.1])
    assert np.array(found) == pytest.approx(by_hand, rel=5e-3)


def test_a_peak_empties_the_surface_of_the_particles():
    watched = BatteryState(0.9, cutoff_V=22.0, peaks=certain(150.0))
    deep, shallow = battery((20.0, 28.0), r_ohm=0.1), replace(watched, diffusion_lag_s=0.0)
    assert energy_J(deep, watched, 50.0) < energy_J(deep, shallow, 50.0) - 50.0 * 100.0


def test_a_battery_that_has_lived_through_its_peaks_has_no_high_resistance():
    # at 0.1 to 0.5 ohm the peaks come through, above 0.5 ohm they do not: 24 V, 22 V, 88 W
    now = BatteryState(0.8, resistance_ratio=1.0, resistance_std=0.5, cutoff_V=22.0, diffusion_lag_s=0.0)
    way = Peaks(np.array([0.0, 88.0]), np.array([1.0 / 60.0, 1.0 / 60.0]))
    started, came = (
        usable_energy(battery(r_ohm=0.5), replace(now, peaks=way, began_soc=soc), 20.0) for soc in (0.8, 1.0)
    )
    assert started.p10 < 20.0 * 120.0  # one in two fails within a minute or two
    assert came.p10 > 100 * started.p10


def test_a_battery_is_emptied_along_the_discharge_branch():
    model = Thevenin(10.0, OcvCurve((24.0, 24.0), (1.0, 1.0)), (0.0,) * 2, (0.0,) * 2, (), ())
    found = energy_J(Battery("test", 10.0, thevenin=model), BatteryState(0.5), 10.0)
    assert found == pytest.approx(36000.0 * 23.0 * 0.5)


def test_power_that_cannot_be_had_gives_nothing():
    # the most that 24 V behind 1 ohm give is 144 W
    assert energy_J(battery(r_ohm=1.0), BatteryState(1.0), 145.0) == 0.0
    assert energy_J(battery(r_ohm=1.0), BatteryState(1.0), 143.0) > 0.0


def test_against_a_discharge_step_by_step():
    model = start_model("nmc", 10.0, 6)
    power_W, cutoff_V, x, given_J, u = 60.0, 19.5, np.array([0.8, 0.0, 0.0, -1.0]), 0.0, None
    current = -power_W / 22.0
    while True:
        u = CircuitInput(current, 10.0)
        volts = float(thevenin_voltage(x, u, model)[0])
        if volts < cutoff_V:
            break
        current = -power_W / volts
        x = thevenin_next(x, CircuitInput(current, 10.0), model, 5.0)
        given_J += power_W * 5.0
    charge = BatteryState(0.8, temperature_degC=10.0, cutoff_V=cutoff_V, diffusion_lag_s=0.0)
    assert energy_J(Battery("pack", 10.0, thevenin=model), charge, power_W) == pytest.approx(given_J, rel=0.01)


def test_the_spread_of_the_state_of_charge_alone():
    found = usable_energy(battery(), BatteryState(0.5, soc_std=0.05), 10.0)
    by_hand = 36000.0 * 24.0 * (0.5 + 0.05 * 1.28155 * np.array([-1, 0, 1]))
    assert np.array(found) == pytest.approx(by_hand, rel=2e-3)


def test_the_spread_of_the_capacity_alone_is_that_of_ageing():
    # a two-piece normal with 0.15 below and 0.05 above, of which three quarters are below
    inverse = NormalDist().inv_cdf
    p10, p50, p90 = 0.15 * inverse(0.1 / 1.5), 0.15 * inverse(0.5 / 1.5), -0.05 * inverse(0.1 / 0.5)
    found = usable_energy(battery(), BatteryState(0.5, capacity_std=0.1), 10.0)
    assert np.array(found) == pytest.approx(36000.0 * 12.0 * (1 + np.array([p10, p50, p90])), rel=2e-3)


@settings(max_examples=10)
@given(share=st.floats(0.0, 1.0))
def test_the_state_of_charge_after_an_energy_is_the_inverse(share):
    z = normal_points(BATTERY_DIMENSIONS)
    found = discharge(
        battery((20.0, 28.0), 0.1),
        BatteryState(0.8, 0.03, capacity_std=0.02, resistance_std=0.2, reserve_soc=0.1),
        40.0,
        z,
    )
    whole = usable_J(found)
    soc = soc_after(found, share * whole)
    position = np.interp(soc, found.soc, np.arange(len(found.soc)))
    left = [np.interp(p, np.arange(len(found.soc)), found.energy_J[:, k]) for k, p in enumerate(position[:50])]
    assert left == pytest.approx((1 - share) * whole[:50], rel=1e-6, abs=1e-3)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"soc": 60.0}, "soc must be between 0 and 1, got 60"),
        ({"soc": 0.2, "reserve_soc": 0.3}, "reserve_soc must be below soc = 0.2"),
        ({"soc": 0.5, "soh_capacity": 0.0}, "soh_capacity must be > 0"),
        ({"soc": 0.5, "soc_std": -0.1}, "soc_std must be >= 0"),
    ],
)
def test_impossible_charges(fields, message):
    with pytest.raises(InputError, match=message):
        BatteryState(**fields)


def test_parts_side_by_side_are_the_whole_to_the_bit():
    pack, state = generic_battery("lfp", 12.0, 4), BatteryState(soc=0.7, soc_std=0.05)
    z = normal_points(BATTERY_DIMENSIONS)
    np.testing.assert_array_equal(usable_at(pack, state, 30.0, z), usable_J(discharge(pack, state, 30.0, z)))


def test_charge_that_was_counted_is_as_uncertain_as_the_capacity():
    # from full, a tenth less capacity is a tenth of the whole less at any state of charge: d(soc Q) = dQ
    state = BatteryState(0.4, soc_std=0.6 * 0.1, capacity_std=0.1)
    alone = usable_energy(battery(), state, 10.0)
    counted = usable_energy(battery(), replace(state, counted=0.6), 10.0)
    whole_J = 36000.0 * 12.0 * 2.0
    p10, p50 = (1.5 * NormalDist().inv_cdf(share / 1.5) for share in (0.1, 0.5))  # of a capacity that is 3/4 below
    assert counted.p50 - counted.p10 == pytest.approx((p50 - p10) * 0.1 * whole_J, rel=0.02)
    assert alone.p50 - alone.p10 < 0.75 * (counted.p50 - counted.p10)  # sqrt(.6^2 + .4^2) and what is of second order


def test_a_battery_ends_by_its_voltage_while_the_mean_of_its_particles_still_has_charge():
    watched = BatteryState(0.5, cutoff_V=11.0)
    at_20_W, at_40_W = (usable_energy(battery(), watched, power_W) for power_W in (20.0, 40.0))
    free = usable_energy(battery(), replace(watched, cutoff_V=0.0), 20.0)
    assert free.p50 - at_20_W.p50 == pytest.approx(20.0 * 150.0, rel=0.02)  # P T with the usual T
    assert free.p50 - at_40_W.p50 == pytest.approx(40.0 * 150.0, rel=0.02)
    assert free.p50 - at_20_W.p10 == pytest.approx(20.0 * 150.0 * np.exp(1.28155 * 1.1), rel=0.02)
    assert np.ptp(np.array(free)) == pytest.approx(0.0, abs=1.0)


#: 8.1 Ah from 95 % down to 22 V, which is 25 % of charge in a curve from 20 to 28 V.
END = DischargeEnd(8.1, 0.95, 0.0, 1.0, 5.0, 5.0, 22.0, 25.0)


def test_an_earlier_end_measures_the_capacity():
    # without lag and resistance Q (0.95 - 0.25) = 8.1 Ah to 2 % of 10 Ah: Q = 11.57 Ah, of 13 - 3 before
    a_battery = replace(battery((20.0, 28.0)), sensor=CurrentSensor(offset_std_A=0.0))
    state = BatteryState(0.9, soh_capacity=1.3, capacity_std=0.2, cutoff_V=22.0, diffusion_lag_s=0.0, end=END)
    before, after = (usable_energy(a_battery, s, 1e-6) for s in (replace(state, end=None), state))
    exact = [usable_energy(a_battery, replace(state, soh_capacity=q, capacity_std=0.0), 1e-6).p50 for q in (0.5, 1.0)]
    whole_J = (exact[1] - exact[0]) / 0.5
    std = 0.02 / 0.7 / np.hypot(1.0, 0.02 / 0.7 / 0.3)  # the prior is half as wide again on its lower side
    assert after.p50 / whole_J == pytest.approx(8.1 / 0.7 / 10.0, rel=5e-3)
    assert (after.p90 - after.p10) / whole_J == pytest.approx(2 * 1.28155 * std, rel=0.1)
    assert after.p90 - after.p10 < 0.2 * (before.p90 - before.p10)


def test_an_earlier_end_measures_the_lag_of_diffusion():
    # Q (0.95 - 0.25) is 7 Ah; of these 6.5 Ah came at 5 A, so that T = 0.5 Ah / 5 A = 360 s to 2 % of 10 Ah, 144 s
    z = np.linspace(-4.0, 4.0, 2001)
    T = 150.0 * np.exp(1.1 * z)
    upto = np.cumsum(np.exp(-0.5 * z**2 - 0.5 * ((T - 360.0) / 144.0) ** 2))
    median_s = np.interp(0.5 * upto[-1], upto, T)
    a_battery = replace(battery((20.0, 28.0)), sensor=CurrentSensor(offset_std_A=0.0))
    state = BatteryState(0.9, cutoff_V=22.0, end=END._replace(given_Ah=6.5))
    free = usable_energy(a_battery, replace(state, diffusion_lag_s=0.0, end=None), 100.0)
    after = usable_energy(a_battery, state, 100.0)
    assert free.p50 - after.p50 == pytest.approx(100.0 * median_s, rel=0.03) and median_s > 240.0


def test_resistance_settles_with_the_time_under_load():
    soc = np.array([0.5])
    _, settled, of_peak = discharge_curves(LABEL, soc, 25.0)
    for loaded_s, share in ((60.0, 1.0 - np.exp(-60.0 / 1500.0)), (6000.0, 1.0 - np.exp(-4.0))):
        slow_ohm = LABEL.thevenin.r_ohm[1][0]
        assert LABEL.thevenin.tau_s == (20.0, 1500.0)
        _, after, same_peak = discharge_curves(LABEL, soc, 25.0, loaded_s)
        fast = 1.0 - np.exp(-loaded_s / 20.0)
        by_hand = settled - (1.0 - share) * slow_ohm - (1.0 - fast) * LABEL.thevenin.r_ohm[0][0]
        assert after == pytest.approx(by_hand, rel=1e-9) and same_peak == of_peak


def test_a_short_way_needs_no_settled_resistance():
    soon, late = (usable_energy(LABEL, BatteryState(0.5, cutoff_V=22.0, loaded_s=t), 40.0).p50 for t in (60.0, np.inf))
    assert soon > late
