"""The first OCV curve: branches that disagree, and a drive without any rest or low-rate test."""

import numpy as np
import pytest

from battery.identification.examples import NMC_OCV, cell, identify, low_rate_logs, play, pulse_log, steps
from ohmward.battery.chemistries import chemistry, chemistry_prior
from ohmward.battery.identification.first_ocv import FirstOcv, IdentificationSettings, find_first_ocv
from ohmward.battery.identification.ocv_from_logs import branch_axis_std, find_branches, reconcile_branches
from ohmward.battery.identification.record import make_records
from ohmward.battery.identification.soc_axis import TEST_START_STD, anchor_soc
from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.posterior import OCV_KNOTS, SOC_AXIS_STD
from ohmward.errors import InputError
from ohmward.logs import Log

LFP = chemistry("lfp").ocv()


def branches_of(*logs, capacity_Ah=2.0):
    return tuple(b for log in logs for r in make_records(log, capacity_Ah) for b in find_branches(r, capacity_Ah))


def test_branches_that_agree_stay_as_they_are():
    branches = branches_of(*low_rate_logs(cell()))
    assert reconcile_branches(branches) == branches and branch_axis_std(branches) == 0.0


def test_a_charge_that_ends_early_keeps_its_scale():
    """In the cold a charge reaches its limit at 94 % of what came out: it runs from 0 to 0.94, not from 0 to 1."""
    down, up = low_rate_logs(cell())
    short = up.select(slice(0, int(0.945 * len(up))))
    discharge, charge = reconcile_branches(branches_of(down, short))
    assert discharge.complete and not charge.complete
    share = charge.moved_Ah / discharge.moved_Ah
    # its end, where the voltage runs to the limit, is left out
    assert charge.soc[-1] == pytest.approx(share - (1 - share), abs=2e-3)
    assert charge.voltage_V[-1] == pytest.approx(
        np.interp(charge.soc[-1], np.linspace(0, 1, 201), NMC_OCV.voltage_V), abs=0.02
    )
    assert branch_axis_std((discharge, charge)) == pytest.approx(0.25 * (1 - share), abs=1e-6)


def test_a_charge_that_was_counted_wrongly_is_stretched():
    down, up = low_rate_logs(cell())
    wrong = Log("up", up.time_s, 0.94 * up.current_A, up.voltage_V)
    _, charge = reconcile_branches(branches_of(down, wrong))
    assert charge.complete and charge.soc[-1] == pytest.approx(1.0)


def drive(soc, seed=5, name="drive"):
    rng = np.random.default_rng(seed)
    phases = [(20.0, float(current), 1.0) for current in rng.choice([-4.0, -2.0, -1.0, 0.0, 1.5], 200)]
    return play(cell(), *steps(phases), soc=soc, std_V=0.001, seed=seed, name=name)


def test_a_drive_alone_takes_the_curve_of_its_chemistry():
    """No rest, no low-rate test: with the SoC at the start known, the usual curve is corrected where the drive went."""
    battery = identify(drive(0.95), capacity_Ah=2.0, chemistry="nmc", initial_soc={"drive": 0.95})
    soc = np.linspace(0.55, 0.9, 8)
    true_V = np.asarray(NMC_OCV.mean_V(soc, 25.0))
    usual_V = np.asarray(chemistry("nmc").ocv().mean_V(soc, 25.0))
    found_V = np.asarray(battery.thevenin.ocv.mean_V(soc, 25.0))
    # a lasting load lowers the voltage as a lower curve does: the shape is found, the level but for some 20 mV
    assert np.std(found_V - true_V) < 0.35 * np.std(usual_V - true_V)
    assert np.abs(found_V - true_V).max() < 0.7 * np.abs(usual_V - true_V).max()
    assert any("the usual curve of nmc cells was taken" in note for note in battery.identification.notes)
    assert any(sentence.startswith("open-circuit voltage: the usual curve") for sentence in battery.not_identified)
    away = np.array(battery.noise.model_std_V)[[2, 15]]
    assert away[0] > 2 * away[1]


def cycle():
    """A cell at C/3 from full to empty and back, which rests at both ends only."""
    sweep_s = 0.97 * 3 * 3600.0
    phases = [(1800.0, 0.0, 30.0), (sweep_s, -2 / 3, 10.0), (1800.0, 0.0, 30.0), (sweep_s, 2 / 3, 10.0)]
    return play(cell(), *steps([*phases, (1800.0, 0.0, 30.0)]), soc=1.0, std_V=0.0005, name="cycle")


def test_between_rests_that_are_far_apart_the_curve_is_that_of_the_chemistry():
    """A constant current cannot tell a curve that bends from a resistance that does."""
    battery = identify(cycle(), capacity_Ah=2.0, chemistry="nmc", initial_soc={"cycle": 1.0}, model="thevenin-1rc")
    soc = np.linspace(0.1, 0.9, 17)
    error_V = np.asarray(battery.thevenin.ocv.mean_V(soc, 25.0)) - np.asarray(NMC_OCV.mean_V(soc, 25.0))
    std_V = np.array(battery.noise.model_std_V)[2:-2]
    assert any("the usual curve of nmc cells was taken" in note for note in battery.identification.notes)
    assert np.sqrt(np.mean(error_V**2)) < 0.02
    assert np.mean(np.abs(error_V) < 2.0 * std_V) > 0.9


def test_a_lasting_discharge_alone_leaves_the_curve_as_uncertain_as_that_of_its_chemistry():
    """The cells of a chemistry differ by up to 0.1 V in the middle, and one current shows no resistance beside that."""
    soc = np.linspace(0.0, 1.0, 201)
    lower = OcvCurve(tuple(np.asarray(chemistry("nmc").ocv().mean_V(soc, 25.0)) - 0.12 * (1.0 - soc)))
    log = play(cell(lower), *steps([(1.9 * 3600.0, -1.0, 10.0)]), soc=1.0, std_V=0.0005)
    battery = identify(log, capacity_Ah=2.0, chemistry="nmc", initial_soc={"log": 1.0}, model="thevenin-1rc")
    middle = np.linspace(0.1, 0.9, 17)
    error_V = np.asarray(battery.thevenin.ocv.mean_V(middle, 25.0)) - np.asarray(lower.mean_V(middle, 25.0))
    assert np.all(np.abs(error_V) < 2.0 * np.array(battery.noise.model_std_V)[2:-2])


def test_between_rests_that_are_far_apart_the_curve_of_an_unknown_chemistry_is_uncertain():
    records = make_records(cycle(), 2.0)
    first = find_first_ocv(records, IdentificationSettings(2.0, initial_soc={"cycle": 1.0}))
    error_V = np.asarray(first.curve.mean_V(OCV_KNOTS, 25.0)) - np.asarray(NMC_OCV.mean_V(OCV_KNOTS, 25.0))
    prior = first.prior("").curve
    std_V = np.hypot(prior.line_std_V, max(prior.std_V))
    between = (OCV_KNOTS > 0.03) & (OCV_KNOTS < 1.0)
    assert first.source == "rests" and np.abs(error_V[between]).max() > 0.1
    assert np.all(np.abs(error_V) < 2.0 * std_V + 0.03, where=between)


def test_without_a_chemistry_it_is_refused_with_what_would_help():
    with pytest.raises(InputError, match=r"give it \(--ocv, ocv=\).*--chemistry nmc --initial-soc 0.9"):
        identify(drive(0.95), capacity_Ah=2.0, initial_soc={"drive": 0.95})
    with pytest.raises(InputError, match=r"--initial-soc drive=0.8.*--ocv"):
        identify(drive(0.95), capacity_Ah=2.0, chemistry="nmc")


def test_two_drives_of_one_cell_together():
    logs = [drive(0.95, 5, "monday"), drive(0.6, 6, "tuesday")]
    known = {"chemistry": "nmc", "initial_soc": {"monday": 0.95, "tuesday": 0.6}, "ocv": NMC_OCV}
    battery = identify(logs, capacity_Ah=2.0, model="thevenin-2rc", **known)
    assert [fit.log for fit in battery.identification.logs] == ["monday", "tuesday"]
    assert np.array(battery.thevenin.r0_discharge_ohm)[6:18] == pytest.approx(0.030, rel=0.1)


def test_a_rest_after_an_unseen_discharge_lies_on_that_branch():
    """A gap between two rests: the voltage has fallen, so the battery was discharged and rests below the mean curve."""
    p = cell(LFP, tau_s=(20.0, 60.0), hysteresis_rate=50.0)
    rest, load = (1800.0, 0.0, 10.0), (2400.0, -1.0, 10.0)
    whole = play(p, *steps([rest, load, rest, load, rest, (60.0, -1.0, 1.0), rest]), soc=0.99)
    seen = (whole.time_s < 6000) | (whole.time_s > 8600)
    parts = make_records(whole.select(seen), 2.0)
    assert [part.came_from for part in parts] == [0, -1]
    soc = 0.99 + whole.charge_Ah()[seen][len(parts[0].log) :] / 2.0
    (anchor,) = anchor_soc(parts[1], 2.0, LFP).anchors
    mean_alone = LFP.soc_at(float(parts[1].log.voltage_V[anchor.sample]))
    assert abs(anchor.soc - soc[anchor.sample]) < abs(mean_alone - soc[anchor.sample])


def test_the_error_of_the_anchors_reaches_the_noise():
    log = pulse_log(cell(), count=10, std_V=0.0005)
    given = identify(log, capacity_Ah=2.0, chemistry="nmc", initial_soc={"pulses": 1.0}, model="thevenin-1rc")
    half = log.between(0.0, log.time_s[len(log) // 2])
    vague = identify([*low_rate_logs(cell()), half], capacity_Ah=2.0, chemistry="nmc", model="thevenin-1rc")
    assert given.noise.soc_axis_std == pytest.approx(np.hypot(SOC_AXIS_STD, TEST_START_STD))
    assert vague.noise.soc_axis_std > 0.006


def test_a_drive_without_rests_knows_its_lasting_overpotential_less():
    """The same load, once with a rest of 20 min: without it the band of the model is wider under load."""
    known = {
        "capacity_Ah": 2.0,
        "chemistry": "nmc",
        "initial_soc": {"log": 0.95},
        "ocv": NMC_OCV,
        "model": "thevenin-1rc",
    }
    load = [(300.0, -2.0, 2.0), (60.0, -0.5, 2.0)] * 8
    plain = play(cell(), *steps([(60, 0, 2), *load]), soc=0.95, std_V=0.0005)
    rested = play(cell(), *steps([(60, 0, 2), *load[:8], (1200.0, 0.0, 5.0), *load[8:]]), soc=0.95, std_V=0.0005)
    plain_V, rested_V = (np.array(identify(log, **known).noise.model_std_V)[12:18].mean() for log in (plain, rested))
    assert plain_V > rested_V + 0.003


def test_between_rests_the_curve_of_iron_phosphate_bends_rather_than_its_resistance():
    def walk_share(source, chemistry):
        return FirstOcv(LFP, source, ()).prior(chemistry).walk_share

    assert walk_share("rests", "lfp") == chemistry_prior("lfp").walk_share_from_rests < walk_share("given", "lfp")
    assert walk_share("rests", "nmc") == walk_share("given", "nmc")
