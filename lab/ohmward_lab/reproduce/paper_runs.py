"""Batteries of [P] tested, identified and discharged by the robot; the estimators along each discharge."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from ohmward.battery.battery import Battery, require_thevenin
from ohmward.battery.identification.identify import Identified, identify_in_detail
from ohmward.battery.identification.rc_identification import RcIdentification, identify_rc
from ohmward.battery.identification.settings import IdentificationSettings
from ohmward.battery.models.rc import RcModel
from ohmward.battery.models.rc_elements import circuit_by_rule, circuit_of
from ohmward.battery.models.thevenin import Thevenin
from ohmward.battery.soc.estimator import SocEstimator, SocRun
from ohmward.battery.soc.protocol import Estimator
from ohmward.errors import InputError
from ohmward_lab.published.given_start import GivenStart
from ohmward_lab.published.rc_three_states import RcThreeStates
from ohmward_lab.reproduce.batteries import TestedBattery, lithium_iron_phosphate, robot_discharge, sealed_lead_acid
from ohmward_lab.reproduce.row import Errors, errors, mean_errors

#: Other sensors and another drive each; figures show the first.
SEEDS = (1, 2, 3)
#: [P] 4.1 and 4.2: state of charge at which the discharges end.
END_SOC = {"lead-acid": 0.40, "lfp": 0.16}
NAMES = {"lead-acid": "sealed lead-acid 12 V 5 Ah", "lfp": "LFP 12 V 6 Ah"}
#: The straight line of a curve is the best one between these states of charge, as in `rc_elements`.
_LINE_SOC = (0.1, 0.9)
#: [P] reports RC + KF after its first 500 s.
SETTLED_S = 500.0


class PaperCase(NamedTuple):
    """A battery, identified by [P]'s chain: two RC pairs from the pulse test, the RC model by the 75 % rule."""

    recording: TestedBattery
    found: Identified
    rc: RcIdentification
    rule: RcModel
    fitted: RcModel

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


@cache
def case(chemistry: str, seed: int = SEEDS[0]) -> PaperCase:
    """The battery of this chemistry, tested, identified and discharged."""
    simulated = sealed_lead_acid() if chemistry == "lead-acid" else lithium_iron_phosphate()
    recording = robot_discharge(simulated, END_SOC[chemistry], seed)
    capacity_Ah = simulated.circuit.capacity_Ah
    settings = IdentificationSettings(capacity_Ah, "thevenin-2rc", chemistry, simulated.n_series)
    found = identify_in_detail(recording.bench, settings)
    model = thevenin_of(found)
    rc = identify_rc(recording.bench, model.ocv, capacity_Ah, 1.0)
    total_F = model.capacity_As / line_slope_V(model)
    rule = RcModel(*circuit_by_rule(rc.response.r_total_ohm, rc.tau.tau_s, total_F), model.ocv, capacity_Ah)
    if rc.fit is None:
        raise InputError(f"the pulse test of {recording.bench.name!r} gives no least squares of the RC model")
    _, r0, r1, tau_s = rc.fit.numbers
    fitted = RcModel(*circuit_of(total_F, r0, r1, tau_s), model.ocv, capacity_Ah)
    return PaperCase(recording, found, rc, rule, fitted)


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
        "RC + KF, corrected": RcThreeStates(case.fitted, jumps=True),
        "T2RC + UKF": GivenStart(model, battery.noise, battery.sensor),
        "default": battery,
    }


@cache
def run(chemistry: str, name: str, start_soc: float = 1.0, seed: int = SEEDS[0]) -> SocRun:
    """Estimates of one of the estimators along the discharge, from a start that is taken as given."""
    here = case(chemistry, seed)
    return SocEstimator(estimators(here)[name], initial_soc=start_soc).run(here.recording.drive)


def soc_errors(chemistry: str, name: str, start_soc: float = 1.0, *, against: str, after_s: float = 0.0) -> Errors:
    """Errors of the state of charge in percent, mean over all seeds.

    against: "truth" or "counted".
    after_s: what comes before is left out.
    """
    parts = []
    for seed in SEEDS:
        here, soc = case(chemistry, seed), run(chemistry, name, start_soc, seed).soc
        late = here.recording.drive.time_s >= after_s
        parts.append(errors(100.0 * (soc - getattr(here, against))[late]))
    return mean_errors(parts)
