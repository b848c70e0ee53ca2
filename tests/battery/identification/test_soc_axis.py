from dataclasses import replace

import numpy as np
import pytest

from battery.anchor_examples import day, label
from battery.identification.examples import LFP_OCV, NMC_OCV, cell, play, pulse_log, steps
from ohmward.battery.chemistries import Normal
from ohmward.battery.identification.record import make_records
from ohmward.battery.identification.soc_axis import SocAxis, anchor_soc, capacity_from_rests, full_charges, sweep_anchor
from ohmward.battery.soc.anchor_rule import SocAnchor
from ohmward.battery.soc.anchors import find_anchors
from ohmward.errors import InputError
from ohmward.logs import Log


def record_of(log, capacity_Ah=2.0):
    (record,) = make_records(log, capacity_Ah)
    return record


def cc_cv(p, start, efficiency=1.0):
    """Charge at C/2, then a current that dies away as at a constant voltage, a rest, a discharge of 1 Ah."""
    taper = [(300.0, 1.0 * 0.7**k, 10.0) for k in range(12)]
    stored = (1 - start) * 2.0 / efficiency
    taper_Ah = sum(s * i / 3600 for s, i, _ in taper)
    phases = [
        (600, 0, 30),
        ((stored - taper_Ah) * 3600, 1.0, 20),
        *taper,
        (3600, 0, 60),
        (3600, -1.0, 10),
        (600, 0, 30),
    ]
    log = play(p, *steps(phases), soc=start)
    top_V = 4.2 - 0.0 * log.voltage_V
    rising = (log.current_A > 0) & (log.time_s > 600 + (stored - taper_Ah) * 3600)
    return Log("charge", log.time_s, log.current_A, np.where(rising, top_V, np.minimum(log.voltage_V, 4.2)))


def test_given_soc_wins():
    axis = anchor_soc(record_of(pulse_log(cell(), count=2, rest_s=600)), 2.0, NMC_OCV, initial_soc=0.99)
    assert axis.soc[0] == 0.99 and axis.anchors[0].reason == "given"


def test_a_given_start_leaves_later_full_charges_what_they_are():
    """A charge from 30 % that is told as 31 %, by a sensor that counts too much: full is full."""
    log = cc_cv(cell(), 0.3)
    axis = anchor_soc(record_of(replace(log, current_A=log.current_A + 0.05)), 2.0, initial_soc=0.31)
    assert [anchor.reason for anchor in axis.anchors] == ["given", "full charge"]
    assert axis.soc[0] == pytest.approx(0.31) and axis.soc[axis.anchors[1].sample] == pytest.approx(1.0)
    assert axis.efficiency == 1.0 and 0.005 < axis.std < 0.01
    assert "given, full charge" in str(axis.notes[0])


def test_a_start_that_full_charges_contradict_is_said():
    """From full to full, told as 90 %."""
    charge = cc_cv(cell(), 0.3)
    time_s = np.concatenate([np.arange(60) * 30.0, 1800.0 + charge.time_s])
    full_V = charge.voltage_V[charge.current_A == 0.0].max()
    voltage_V = np.concatenate([np.full(60, full_V), charge.voltage_V])
    log = Log("full", time_s, np.concatenate([np.zeros(60), charge.current_A]), voltage_V)
    axis = anchor_soc(record_of(log), 2.0, initial_soc=0.9)
    assert axis.soc[0] == pytest.approx(1.0)
    assert "0.9 as given, but its full charges say 1.000" in str(axis.notes[-1])


def test_end_of_a_full_charge_is_full():
    record = record_of(cc_cv(cell(), 0.3))
    assert len(full_charges(record, 2.0)) == 1
    axis = anchor_soc(record, 2.0)
    assert axis.soc[0] == pytest.approx(0.3, abs=0.02)
    assert axis.soc.max() == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("chemistry", ["nca", "lfp", "lead-acid"])
def test_a_test_and_a_battery_file_find_the_same_full_charges(chemistry):
    log, truth = day(
        chemistry, 0.5, [(0.2, 0.0), (8.0, 0.3), (1.0, 0.0), (1.0, -0.4), (0.5, 0.0), (9.0, 0.2), (1.0, 0.0)]
    )
    battery = label(chemistry)
    of_file = [anchor.sample for anchor in find_anchors(log, battery) if anchor.kind == "full charge"]
    of_test = [full.sample for full in full_charges(record_of(log, battery.capacity_Ah), battery.capacity_Ah)]
    assert len(of_file) == len(of_test) == 2
    assert np.all(truth[[*of_file, *of_test]] > 0.99)


def test_a_charge_that_stops_early_is_not_full():
    log = play(cell(), *steps([(600, 0, 30), (3600, 1.0, 10), (3600, 0, 30)]), soc=0.3)
    assert full_charges(record_of(log), 2.0) == ()


def test_rest_at_a_known_curve():
    p = cell()
    log = play(p, *steps([(1200, 0, 30), (1800, -1, 5), (3600, 0, 30)]), soc=0.62)
    assert anchor_soc(record_of(log), 2.0, NMC_OCV).soc[0] == pytest.approx(0.62, abs=2e-3)


def test_the_steepest_rest_is_believed():
    p = cell(LFP_OCV)
    log = play(p, *steps([(1200, 0, 30), (6500, -1, 20), (7200, 0, 60)]), soc=0.95)
    (anchor,) = anchor_soc(record_of(log), 2.0, LFP_OCV).anchors
    assert anchor.sample == len(log) - 1
    assert anchor.soc == pytest.approx(0.95 - 6500 / 7200, abs=0.01)


def test_a_full_sweep_starts_full():
    axis = anchor_soc(record_of(pulse_log(cell(), count=3, rest_s=600)), 2.0)
    assert axis.soc[0] == pytest.approx(1.0, abs=1e-6)


def test_a_sweep_to_below_the_voltage_of_an_empty_battery_lacks_nothing_at_the_top():
    """A capacity that a high rate does not give is missing at the bottom; a log that just stops may lack it on top."""
    record = record_of(pulse_log(cell(), count=3, rest_s=600), 2.2)
    lowest_V = float(np.nanmin(record.log.voltage_V))
    (unknown,), (emptied,) = sweep_anchor(record, 2.2), sweep_anchor(record, 2.2, lowest_V + 0.01)
    assert unknown.std == 0.03
    assert emptied.std == 0.01
    (stopped,) = sweep_anchor(record, 2.2, lowest_V - 0.01)
    assert stopped == unknown
    assert anchor_soc(record, 2.2, empty_V=lowest_V + 0.01).std == 0.01


def test_nothing_known_is_refused():
    log = play(cell(), *steps([(1200, 0, 30), (1800, -1, 5), (3600, 0, 30)]), soc=0.62)
    with pytest.raises(InputError, match="its state of charge is unknown"):
        anchor_soc(record_of(log), 2.0)


def test_a_log_that_gaps_divide_is_refused_for_these_not_for_milliampere_hours():
    """Each part moves a few thousandths of the capacity."""
    log = play(cell(), *steps([(60, 0, 1), (20, -1, 1), (3600, 0, 1), (20, -1, 1), (60, 0, 1)]), soc=0.6)
    parts = make_records(log.select((log.time_s < 100) | (log.time_s > 3600)), 2.0)
    with pytest.raises(InputError, match="is divided at 1 gap") as refused:
        anchor_soc(parts[0], 2.0)
    assert "mAh" not in str(refused.value)


def test_capacity_far_too_small_is_refused_with_figures():
    with pytest.raises(
        InputError, match=r"with a capacity of 1\.5 Ah .* would run from -0\..* it moves 1\.9.* tied to"
    ):
        anchor_soc(record_of(pulse_log(cell(), count=3, rest_s=600), 1.5), 1.5)


def test_capacity_a_little_wrong_is_reported_with_figures():
    record = record_of(pulse_log(cell(), count=5, rest_s=3600), 2.12)
    axis = anchor_soc(record, 2.12, NMC_OCV)
    assert capacity_from_rests(record, axis, NMC_OCV, 2.12) == pytest.approx(2.0, rel=0.01)
    (warning,) = [n for n in axis.notes if n.level == "warning"]
    assert "agree for a capacity of" in warning.text and "not for the given 2.12 Ah" in warning.text
    right = record_of(pulse_log(cell(), count=5, rest_s=3600))
    assert not [n for n in anchor_soc(right, 2.0, NMC_OCV).notes if n.level == "warning"]


def test_efficiency_from_two_full_charges():
    once = cc_cv(cell(), 0.5, efficiency=0.9)
    Ah = once.charge_Ah()
    top = full_charges(record_of(once), 2.0)[0].sample
    back = slice(0, top + 1)
    time_s = np.concatenate([once.time_s, once.time_s[-1] + 1.0 + once.time_s[back]])
    again = Log(
        "twice",
        time_s,
        np.concatenate([once.current_A, once.current_A[back]]),
        np.concatenate([once.voltage_V, once.voltage_V[back]]),
    )
    axis = anchor_soc(record_of(again), 2.0)
    assert len(axis.anchors) == 2
    assert axis.efficiency == pytest.approx((Ah[top] - Ah[-1]) / Ah[top], rel=0.01)
    assert [axis.soc[a.sample] for a in axis.anchors] == pytest.approx([1.0, 1.0])


def test_default_efficiency_where_the_log_does_not_tell():
    axis = anchor_soc(record_of(cc_cv(cell(), 0.5, efficiency=0.9)), 2.0, efficiency=0.9)
    assert axis.efficiency == 0.9 and axis.soc[0] == pytest.approx(0.5, abs=0.02)


def test_a_count_that_ends_below_empty_has_drifted_by_that():
    """A drift that grows evenly from 0 to 6 % has a root mean square of 6 % / sqrt(3)."""
    anchors = (SocAnchor(0, 1.0, 0.01, "full charge"),)
    inside, beyond = (SocAxis(np.linspace(1.0, end, 11), anchors, 1.0, ()) for end in (0.0, -0.06))
    assert inside.std == pytest.approx(0.01, rel=1e-12)
    assert beyond.std == pytest.approx(np.hypot(0.01, 0.06 / np.sqrt(3.0)), rel=1e-12)


def emptied(given_Ah, rate=0.25, degC=25.0):
    """Axis for a given capacity of a cell of 2 Ah that a load takes from full to 1 %."""
    seconds = 0.99 * 3600 / rate
    log = play(cell(), *steps([(600, 0, 30), (seconds, -2.0 * rate, 10), (1200, 0, 30)]), soc=1.0)
    log = replace(log, temperature_degC=np.full(len(log), degC))
    empty_V = float(np.nanmin(log.voltage_V)) + 0.01
    return anchor_soc(record_of(log, given_Ah), given_Ah, empty_V=empty_V, left_per_C=Normal(0.04, 0.06))


@pytest.mark.parametrize("given_Ah", [1.9, 2.12, 2.2])
def test_a_count_that_a_cut_off_contradicts_is_tied_to_it(given_Ah):
    axis = emptied(given_Ah)
    assert axis.soc.min() == pytest.approx(0.01, abs=1e-3)
    assert axis.capacity_ratio * given_Ah == pytest.approx(2.0, rel=2e-3)
    (warning,) = [note for note in axis.notes if note.level == "warning"]
    assert "where a load has emptied the battery" in warning.text
    assert axis.std == pytest.approx(np.sqrt(np.mean([a.std**2 for a in axis.anchors])), rel=1e-12)


def test_a_cold_count_of_more_than_the_capacity_is_tied_to_empty():
    axis = emptied(1.9, degC=5.0)
    assert axis.soc.min() == pytest.approx(0.0, abs=1e-9)
    assert axis.capacity_ratio * 1.9 == pytest.approx(1.98, rel=2e-3)
    (warning,) = [note for note in axis.notes if note.level == "warning"]
    assert "Is 1.98 Ah the capacity that estimators should use, not 1.9 Ah?" in warning.text


def test_a_cut_off_that_agrees_changes_nothing():
    axis = emptied(2.0)
    assert len(axis.anchors) == 1 and axis.capacity_ratio == 1.0
    assert not [note for note in axis.notes if note.level == "warning"]


@pytest.mark.parametrize(("rate", "degC", "left"), [(1.0, 25.0, 0.10 - 0.04 / 1.1), (0.25, 5.0, 0.0)])
def test_a_fast_load_leaves_the_count_open_and_a_cold_one_says_nothing(rate, degC, left):
    axis = emptied(2.2, rate, degC)
    assert axis.soc.min() == pytest.approx(0.1, abs=2e-3)
    assert axis.left == pytest.approx(left, abs=2e-3)
    assert axis.std == pytest.approx(np.hypot(axis.anchors[0].std, left / np.sqrt(3.0)), abs=2e-3)
