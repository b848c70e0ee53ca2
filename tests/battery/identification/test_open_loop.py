import numpy as np
import pytest

from battery.identification.examples import LFP_OCV, NMC_OCV, cell, play, steps
from ohmward.battery.identification.fit_samples import scan, simulate, thin, thin_branch
from ohmward.battery.identification.ocv_from_logs import OcvBranch
from ohmward.battery.identification.record import make_records


def test_scan_is_the_recursion():
    decay, drive = np.array([0.3, 0.9, 0.5, 0.7]), np.array([1.0, 2.0, -1.0, 4.0])
    v = [1.0]
    for a, b in zip(decay[1:], drive[1:], strict=True):
        v.append(a * v[-1] + b)
    assert scan(decay, drive) == pytest.approx(v)
    assert scan(decay, np.column_stack([drive, 2 * drive]))[:, 1] == pytest.approx(2 * np.array(v))


@pytest.mark.parametrize("ocv", [NMC_OCV, LFP_OCV])
def test_all_at_once_equals_step_by_step(ocv):
    p = cell(ocv, hysteresis_rate=30.0)
    time_s, current_A = steps([(60, 0, 7), (300, -2, 5), (100, 1, 3), (500, 0, 20), (700, -1, 11)])
    log = play(p, time_s, current_A, soc=0.9)
    (record,) = make_records(log, p.capacity_Ah)
    soc = 0.9 + log.charge_Ah() / p.capacity_Ah
    (part,) = thin(record, soc)
    assert simulate(part, p) == pytest.approx(log.voltage_V[np.searchsorted(log.time_s, part.time_s)], abs=1e-4)
    exact = part._replace(**_unthinned(record, soc))
    assert simulate(exact, p) == pytest.approx(log.voltage_V, abs=1e-12)


def _unthinned(record, soc):
    time_s, dt_s = record.log.time_s, np.diff(record.log.time_s, prepend=record.log.time_s[0])
    return {
        "time_s": time_s,
        "dt_s": dt_s,
        "current_A": record.current_A,
        "mean_current_A": 3600 * record.charge.moved_Ah / np.where(dt_s > 0, dt_s, 1.0),
        "soc": soc,
        "soc_before": np.append(soc[0], soc[:-1]),
        "temperature_degC": np.full(time_s.size, 25.0),
        "voltage_V": record.log.voltage_V,
    }


def test_thinning_keeps_edges_and_charge():
    time_s, current_A = steps([(600, 0, 1), (10, -2, 0.1), (7200, 0, 1), (10, 1, 0.1), (3600, 0, 1)])
    p = cell()
    (record,) = make_records(play(p, time_s, current_A, soc=0.5), p.capacity_Ah)
    (part,) = thin(record, np.full(time_s.size, 0.5))
    assert part.soc.size < 0.1 * time_s.size
    assert part.dt_s.max() <= 61.0
    for phase in record.phases[1:]:
        assert {phase.first - 1, phase.first} <= set(np.searchsorted(time_s, part.time_s).tolist())
    assert (part.mean_current_A * part.dt_s).sum() / 3600 == pytest.approx(record.charge.total_Ah[-1])


def test_start_values_are_those_of_the_states():
    p = cell(LFP_OCV)
    (record,) = make_records(play(p, *steps([(100, 0, 1), (100, -1, 1)]), soc=0.5), p.capacity_Ah)
    (part,) = thin(record, np.full(len(record.log), 0.5))
    started = simulate(part, p, (0.01, -0.02), hysteresis=1.0)
    assert started[0] == pytest.approx(simulate(part, p)[0] + 0.01 - 0.02 + 0.015)


def test_a_branch_is_a_record_at_every_hundredth():
    soc = np.linspace(1.0, 0.0, 400)
    branch = OcvBranch("down", "discharge", soc, 3.0 + soc, -0.1, 2.0, 25.0, True)
    part = thin_branch(branch, 2.0)
    assert part.soc == pytest.approx(np.linspace(0.98, 0.02, 97))
    assert part.voltage_V == pytest.approx(3.0 + part.soc)
    assert part.dt_s[1:] == pytest.approx(720.0)
    up = thin_branch(branch._replace(direction="charge", soc=soc[::-1], voltage_V=3.0 + soc[::-1]), 2.0)
    assert up.soc == pytest.approx(part.soc[::-1])
