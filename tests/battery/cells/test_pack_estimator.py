import json
import math
from dataclasses import replace

import numpy as np
import pytest

from battery.cells.packs import EQUAL, HEALTHY, UNEQUAL, battery, day, log_of, truths
from battery.examples import LFP, NMC
from battery.soc.test_exchange_watch import NMC as EXCHANGED
from battery.soc.test_exchange_watch import exchanged_log
from ohmward.battery.cells.pack_estimator import PackEstimator
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.sample import SocFlag
from ohmward.errors import InputError

MODELS = {"nmc": NMC, "lfp": LFP}
NAMES = [f"cell_voltage_{k}_V" for k in (1, 2, 3, 4)]


def pack(cells, chemistry="nmc", offset_A=0.0, seed=1):
    found = truths(cells, day(), MODELS[chemistry])
    soc = np.stack([truth.soc for truth in found], axis=1)
    return log_of(found, offset_A, seed=seed), soc, battery(MODELS[chemistry])


def test_equal_cells_are_the_typical_cell():
    found = truths(EQUAL, day(hours=2.0))
    log = log_of(found, noise_V=0.0)
    run = PackEstimator(battery()).run(log)
    alone = SocEstimator(battery()).run(log)
    assert run.typical.soc == pytest.approx(alone.soc, abs=1e-9)
    assert run.cells.soc == pytest.approx(np.repeat(alone.soc[:, None], 4, axis=1), abs=5e-3)
    assert np.ptp(run.cells.soc, axis=1).max() == 0.0
    assert run.pack.soc == pytest.approx(alone.soc, abs=5e-3)
    assert run.warnings() == ()


@pytest.mark.parametrize("chemistry", MODELS)
@pytest.mark.parametrize("offset_A", [0.0, 0.02])
def test_the_weakest_of_unequal_cells_is_found(chemistry, offset_A):
    log, soc, file = pack(UNEQUAL, chemistry, offset_A)
    run = PackEstimator(file, initial_soc=0.95).run(log)
    late = run.time_s > 1800.0
    error, std = (run.cells.soc - soc)[late, 3], run.cells.soc_std[late, 3]
    assert np.sqrt(np.mean(error**2)) <= {"nmc": 0.015, "lfp": 0.02}[chemistry]
    assert np.mean(np.abs(error) < 1.96 * std) >= 0.9
    assert {warning.cell for warning in run.warnings()} == {3}
    warned_s = run.first_warning_s()
    assert warned_s is not None and warned_s < 2.7 * 3600  # the first discharge
    assert run.pack.weakest[-1] == 3
    usable_Ah = (soc * [2.02, 1.98, 2.0, 1.7]).min(axis=1)
    missed_Ah = np.abs(run.pack.usable_Ah - usable_Ah)
    assert np.mean(missed_Ah < 1.96 * run.pack.usable_std_Ah) >= 0.9
    assert missed_Ah[-1] < 0.03


@pytest.mark.parametrize("chemistry", MODELS)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_healthy_pack_gives_no_warning(chemistry, seed):
    log, soc, file = pack(HEALTHY, chemistry, seed=seed)
    run = PackEstimator(file, initial_soc=0.95).run(log)
    assert run.first_warning_s() is None
    error, std = run.cells.soc - soc, run.cells.soc_std
    assert np.mean(np.abs(error) < 1.96 * std) >= 0.9


def test_a_channel_that_stands_still_is_no_drift():
    log, soc, file = pack(HEALTHY, "nmc")
    stuck_V = log.extra[NAMES[1]].copy()
    stuck_V[300:] = stuck_V[300]
    run = PackEstimator(file, initial_soc=0.95).run(replace(log, extra={**log.extra, NAMES[1]: stuck_V}))
    assert run.first_warning_s() is None
    error = run.cells.soc - soc
    assert np.mean(np.abs(error) < 1.96 * run.cells.soc_std) >= 0.9
    assert np.all((run.cells.flags[-100:, 1].astype(int) & SocFlag.NO_VOLTAGE) > 0)


def test_the_cells_of_another_pack_start_as_unknown_ones():
    """The cells of the first stand 10 points apart, those of the second are equal."""
    log, _ = exchanged_log(0.8, 0.4, count=600)
    cells_V = np.repeat(log.voltage_V[:, None] / 7, 7, axis=1)
    cells_V[:600, 0] -= 0.05
    run = PackEstimator(EXCHANGED).run(log, cells_V)
    (begin,) = np.flatnonzero(run.flags.astype(int) & SocFlag.EXCHANGED)
    assert run.cells.soc_difference[begin - 1, 0] < -0.02
    alone = PackEstimator(EXCHANGED).run(log.select(slice(begin, None)), cells_V[begin:])
    assert run.cells.soc_difference[begin:] == pytest.approx(alone.cells.soc_difference, abs=1e-3)


def test_the_offset_of_the_current_sensor_is_common_to_all_cells():
    differences = []
    for offset_A in (0.0, 0.05):
        log, _, file = pack(UNEQUAL, offset_A=offset_A)
        differences.append(PackEstimator(file, initial_soc=0.95).run(log).cells.soc_difference)
    assert differences[1] == pytest.approx(differences[0], abs=0.005)


def test_live_samples_and_a_log_agree():
    log, _, file = pack(UNEQUAL)
    log = log.select(slice(0, 300))
    run = PackEstimator(file, lowering="machine").run(log)
    live = PackEstimator(file, lowering="machine")
    for k in range(len(log)):
        now = live.update(log.time_s[k], log.current_A[k], [log.extra[name][k] for name in NAMES])
    assert now.cells.soc == pytest.approx(run.cells.soc[-1], abs=1e-8)
    assert now.pack.usable_Ah == pytest.approx(run.pack.usable_Ah[-1], abs=1e-8)


@pytest.mark.usefixtures("in_python")
def test_a_snapshot_goes_on_to_the_bit():
    log, _, file = pack(UNEQUAL)
    whole, part = PackEstimator(file), PackEstimator(file)
    rows = [(log.time_s[k], log.current_A[k], [log.extra[name][k] for name in NAMES]) for k in range(40)]
    for row in rows[:20]:
        whole.update(*row)
        part.update(*row)
    part = PackEstimator.restore(file, json.loads(json.dumps(part.snapshot())))
    for row in rows[20:]:
        expected, found = whole.update(*row), part.update(*row)
    assert found.cells.soc.tolist() == expected.cells.soc.tolist()
    assert found.typical == expected.typical


def test_a_snapshot_of_another_pack_is_refused():
    part = PackEstimator(battery(n_series=4))
    part.update(0.0, -1.0, [3.9] * 4)
    with pytest.raises(InputError, match="pack of 3 cells"):
        PackEstimator.restore(battery(n_series=3), part.snapshot())


def test_a_broken_wire_spoils_no_other_cell():
    log, soc, file = pack(HEALTHY)
    cells_V = np.stack([log.extra[name] for name in NAMES], axis=1)
    cells_V[200:, 1] = 0.0
    cells_V[700:, 2] = math.nan
    run = PackEstimator(file, initial_soc=0.95).run(log, cells_V)
    assert np.isfinite(run.cells.soc).all()
    assert np.abs(run.cells.soc - soc)[:, [0, 3]].max() < 0.03
    assert run.first_warning_s() is None


def test_samples_without_any_cell_are_survived():
    estimator = PackEstimator(battery())
    estimator.update(0.0, -1.0, [3.9, 3.9, 3.9, 3.85])
    now = estimator.update(1.0, None, [None] * 4)
    assert np.isfinite(now.cells.soc).all()
    assert "NO_VOLTAGE" in str(now.flags)


def test_a_sample_without_a_time_is_flagged():
    estimator = PackEstimator(battery())
    estimator.update(0.0, -1.0, [3.9] * 4)
    assert "BAD_TIME" in str(estimator.update(math.nan, -1.0, [3.9] * 4).flags)


def test_a_run_has_figures_and_a_table():
    pytest.importorskip("pandas")
    log, _, file = pack(UNEQUAL)
    run = PackEstimator(file).run(log.select(slice(0, 50)))
    assert "cell_voltage_4_V" in run.plot().html()
    assert {"pack_soc", "typical_soc", "cells_soc_3"} <= set(run.to_pandas().columns)


def test_what_is_no_pack_is_refused():
    with pytest.raises(InputError, match="n_series = 1"):
        PackEstimator(battery(n_series=1))
    with pytest.raises(InputError, match="filter must be one of ekf, ukf, gsf"):
        PackEstimator(battery(), filter="coulomb")
    with pytest.raises(InputError, match=r"cell_voltages_V must have the shape \(4,\)"):
        PackEstimator(battery()).update(0.0, -1.0, [3.9] * 3)
    log, _, file = pack(EQUAL)
    with pytest.raises(InputError, match="no voltages of 4 cells"):
        PackEstimator(file).run(log.select(slice(0, 5)).__class__("bare", [0.0, 1.0], [0.0, 0.0], [15.6, 15.6]))
