import numpy as np
import pytest

from battery.identification.examples import cell, pulse_log
from ohmward.battery.identification.log_details import (
    Edge,
    EdgeResistance,
    edge_resistance,
    find_edges,
    find_relaxations,
    fit_exponentials,
)
from ohmward.battery.identification.record import Record, make_records


def record_of(p, **how) -> tuple[Record, np.ndarray]:
    (record,) = make_records(pulse_log(p, count=3, rest_s=1800.0, **how), p.capacity_Ah)
    return record, np.linspace(1, 0, len(record.log))


def edges_of(p, **how) -> tuple[Edge, ...]:
    record, soc = record_of(p, **how)
    return find_edges(record, soc, p.capacity_Ah)


def r0_of(edges, direction) -> EdgeResistance:
    found = edge_resistance(edges, direction)
    assert found is not None
    return found


def test_edges_give_r0_by_direction():
    p = cell()
    p = type(p)(2.0, p.ocv, (0.030,) * 2, (0.036,) * 2, (), ())
    edges = edges_of(p)
    assert len(edges) >= 6
    assert r0_of(edges, -1).ohm == pytest.approx(0.030, rel=1e-3)
    assert r0_of(edges, 1).ohm == pytest.approx(0.036, rel=1e-2)


def test_edges_see_little_of_the_pairs_and_their_noise_is_stated():
    found = r0_of(edges_of(cell(), std_V=0.002), -1)
    assert abs(found.ohm - 0.030) < 3 * found.std_ohm + 2e-4
    assert 1e-5 < found.std_ohm < 2e-3


def test_no_edges_no_resistance():
    assert edge_resistance((), -1) is None


@pytest.mark.parametrize("taus", [(50.0,), (15.0, 400.0)])
def test_exponentials_without_noise(taus):
    time_s = np.linspace(0, np.sqrt(3000.0), 200) ** 2
    voltage_V = 3.7 - sum(0.02 * np.exp(-time_s / tau) for tau in taus)
    fit = fit_exponentials(time_s, voltage_V, len(taus))
    assert fit.v_inf_V == pytest.approx(3.7, abs=2e-4)
    assert fit.tau_s == pytest.approx(taus, rel=0.05)
    assert fit.rms_V < 2e-4


def test_one_against_two_time_constants():
    time_s = np.linspace(0, np.sqrt(3000.0), 200) ** 2
    noise_V = np.random.default_rng(3).normal(0, 0.0005, 200)
    one = 3.7 - 0.02 * np.exp(-time_s / 200) + noise_V
    two = 3.7 - 0.02 * np.exp(-time_s / 20) - 0.02 * np.exp(-time_s / 600) + noise_V
    assert fit_exponentials(time_s, two, 2).aic < fit_exponentials(time_s, two, 1).aic - 20
    assert fit_exponentials(time_s, one, 1).aic < fit_exponentials(time_s, one, 2).aic + 10


def test_relaxations_of_a_pulse_test():
    found = find_relaxations(*record_of(cell()))
    assert len(found) == 3
    assert all(r.pairs == 2 and r.before_A == pytest.approx(-1.0) for r in found)
    assert found[0].double.tau_s == pytest.approx((20.0, 800.0), rel=0.25)
