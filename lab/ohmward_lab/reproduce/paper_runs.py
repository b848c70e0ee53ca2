"""Batteries of [P] tested, identified and discharged by the robot; the estimators along each discharge."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np

from ohmward.battery.battery import Battery, require_thevenin
from ohmward.battery.identification.first_ocv import IdentificationSettings
from ohmward.battery.identification.identify import Identified, identify_in_detail
from ohmward.battery.identification.rc_identification import RcIdentification, identify_rc
from ohmward.battery.models.rc import RcModel
from ohmward.battery.models.rc_elements import circuit_by_rule
from ohmward.battery.models.thevenin import Thevenin
from ohmward.battery.soc.estimator import SocEstimator, SocRun
from ohmward.battery.soc.protocol import Estimator
from ohmward.battery.soc.registry import make_estimator
from ohmward_lab.published.rc_three_states import RcThreeStates
from ohmward_lab.published.registry import GivenStart
from ohmward_lab.reproduce.batteries import (
    TestedBattery,
    lithium_iron_phosphate,
    resistor_pulses,
    robot_discharge,
    sealed_lead_acid,
)
from ohmward_lab.reproduce.row import Errors, errors, mean_errors

#: Other sensors and another drive each; figures show the first.
SEEDS = (1, 2, 3)
#: [P] table 1: state of charge at which the discharges end.
END_SOC = {"lead-acid": 0.60, "lfp": 0.20}
#: [P] 2.1: resistor of the pulse test, and its pulses: seven, and as many as end near the 16 % that it prints for LFP.
LOAD_OHM = {"lead-acid": 13.5, "lfp": 12.0}
PULSES = {"lead-acid": 7, "lfp": 9}
NAMES = {"lead-acid": "sealed lead-acid 12 V 5 Ah", "lfp": "LFP 12 V 6 Ah"}
#: The straight line of a curve is the best one between these states of charge, as in `rc_elements`.
_LINE_SOC = (0.1, 0.9)
#: Mean current of the robot [A]: [P]'s 83 mAh are 0.2 A over 25 minutes, in which the first battery gave 2 Ah; and a
#: slow drive, on which a battery polarises little.
ROBOT_A, SLOW_A = 4.8, 1.0
#: [P] reports RC + KF after its first 500 s.
SETTLED_S = 500.0


class PaperCase(NamedTuple):
    """A battery, identified by [P]'s chain: two RC pairs from the pulse test, the RC model by the 75 % rule."""

    recording: TestedBattery
    found: Identified
    rc: RcIdentification
    rule: RcModel

    @property
    def battery(self) -> Battery:
        """The battery as identified."""
        return self.found.battery

    @property
    def truth(self) -> np.ndarray:
        """True state of charge (T,) along the discharge."""
        return self.recording.truth

    @property
    def counted(self) -> np.ndarray:
        """[P]'s reference (T,): the count of the same sensor that the filters have, from full."""
        return 1.0 + self.recording.drive.charge_Ah() / self.battery.capacity_Ah


def case(chemistry: str, seed: int = SEEDS[0], mean_A: float = ROBOT_A) -> PaperCase:
    """The battery of this chemistry, tested and identified once, and discharged at this mean current."""
    return _case(chemistry, seed, mean_A)


@cache
def _case(chemistry: str, seed: int, mean_A: float) -> PaperCase:
    simulated = sealed_lead_acid() if chemistry == "lead-acid" else lithium_iron_phosphate()
    bench = resistor_pulses(simulated, LOAD_OHM[chemistry], PULSES[chemistry])
    recording = robot_discharge(simulated, bench, END_SOC[chemistry], seed, mean_A)
    if (seed, mean_A) != (SEEDS[0], ROBOT_A):
        return case(chemistry)._replace(recording=recording)
    capacity_Ah = simulated.circuit.capacity_Ah
    settings = IdentificationSettings(
        capacity_Ah, "thevenin-2rc", chemistry, simulated.n_series, initial_soc={recording.bench.name: 1.0}
    )
    found = identify_in_detail(recording.bench, settings)
    model = thevenin_of(found)
    rc = identify_rc(recording.bench, model.ocv, capacity_Ah, 1.0)
    total_F = model.capacity_As / line_slope_V(model)
    rule = RcModel(*circuit_by_rule(rc.response.r_total_ohm, rc.tau.tau_s, total_F), model.ocv, capacity_Ah)
    return PaperCase(recording, found, rc, rule)


def thevenin_of(found: Identified) -> Thevenin:
    """The circuit with two RC pairs."""
    return require_thevenin(found.battery)


def line_slope_V(model: Thevenin) -> float:
    """Slope [V per unit of SoC] of the best straight line through the curve."""
    soc = np.linspace(*_LINE_SOC, 81)
    return float(np.polyfit(soc, model.ocv.mean_V(soc, model.ocv.reference_degC), 1)[0])


def estimators(case: PaperCase) -> dict[str, Battery | Estimator]:
    """The published filters on the identified models, and the default estimator."""
    model, battery = thevenin_of(case.found), case.battery
    return {
        "RC + KF": RcThreeStates(case.rule),
        "RC + KF, P0 = 100 I": RcThreeStates(case.rule, start_variance_V2=100.0),
        "RC + KF, corrected": RcThreeStates(case.rule, jumps=True),
        "T2RC + UKF": GivenStart(model, battery.noise, battery.sensor),
        "hybrid": make_estimator("published.hybrid", replace(battery, rc=case.rule)),
        "default": battery,
    }


def run(chemistry: str, name: str, start_soc: float = 1.0, seed: int = SEEDS[0], mean_A: float = ROBOT_A) -> SocRun:
    """Estimates of one of the estimators along the discharge, from a start that is taken as given."""
    return _run(chemistry, name, start_soc, seed, mean_A)


@cache
def _run(chemistry: str, name: str, start_soc: float, seed: int, mean_A: float) -> SocRun:
    here = case(chemistry, seed, mean_A)
    return SocEstimator(estimators(here)[name], initial_soc=start_soc).run(here.recording.drive)


def soc_errors(
    chemistry: str,
    name: str,
    start_soc: float = 1.0,
    *,
    against: str,
    from_s: float = 0.0,
    to_s: float = np.inf,
    mean_A: float = ROBOT_A,
) -> Errors:
    """Errors of the state of charge in percent, mean over all seeds.

    against: "truth" or "counted".
    from_s, to_s: what comes before and after is left out.
    """
    parts = []
    for seed in SEEDS:
        here, soc = case(chemistry, seed, mean_A), run(chemistry, name, start_soc, seed, mean_A).soc
        time_s = here.recording.drive.time_s
        window = (time_s >= from_s) & (time_s <= to_s)
        parts.append(errors(100.0 * (soc - getattr(here, against))[window]))
    return mean_errors(parts)


def voltage_error_V(chemistry: str, name: str, after: bool = False) -> float:
    """Mean absolute voltage error [V] along the discharge, before or after the sample, mean over all seeds.

    after: of RC + KF alone, whose V_o is a state: the innovation times R / S.
    """
    found = []
    for seed in SEEDS:
        estimates = run(chemistry, name, 1.0, seed).estimates
        error = np.abs(estimates.innovation_V)
        if after:
            filter_ = estimators(case(chemistry, seed))[name]
            assert isinstance(filter_, RcThreeStates)
            error = error * filter_.voltage_variance_V2 / estimates.voltage_std_V**2
        found.append(float(np.nanmean(error)))
    return float(np.mean(found))
