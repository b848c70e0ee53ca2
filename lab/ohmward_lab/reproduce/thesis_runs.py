"""Pack of [T] driven by joystick, and the filters of [T] chapter 3 along the drive."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np

from ohmward.battery.battery import Battery, require_thevenin
from ohmward.battery.identification.identify import identify
from ohmward.battery.identification.rc_identification import RcIdentification, identify_rc
from ohmward.battery.models import rc
from ohmward.battery.soc.estimator import SocEstimator, SocRun, samples_of
from ohmward.battery.soc.sample import SocSample
from ohmward.logs.log import Log
from ohmward.trace import Kernel
from ohmward_lab.published.scheme_by_method import SchemeByMethod, SchemeByMethodEstimate
from ohmward_lab.reproduce.batteries import TestedBattery, joystick_drive
from ohmward_lab.simulate.cells import lithium_polymer_pack

#: Another drive and other noise each; figures show the first.
SEEDS = (1, 2, 3)
#: [T] 3.4: from 98 to 90 %; and the whole range, which [T] does not show.
NARROW, WHOLE = (0.98, 0.90), (0.98, 0.10)
#: Standard deviation of the state of charge that the filters are told to start from.
START_STD = 0.005
#: Step [V] of an oscilloscope of 8 bit over the pack's largest voltage.
_SCOPE_V = 42.0 / 256


class ThesisCase(NamedTuple):
    """The pack: its recording, the battery that the default estimator has, and the RC model found offline."""

    recording: TestedBattery
    battery: Battery
    offline: RcIdentification

    @property
    def log(self) -> Log:
        """The drive."""
        return self.recording.drive

    @property
    def truth(self) -> np.ndarray:
        """True state of charge (T,)."""
        return self.recording.truth


@cache
def case(soc: tuple[float, float] = NARROW, seed: int = SEEDS[0]) -> ThesisCase:
    """The pack, tested, identified and driven."""
    recording = joystick_drive(lithium_polymer_pack(), soc, seed)
    pack = recording.battery
    capacity_Ah = pack.circuit.capacity_Ah
    battery = identify(recording.bench, capacity_Ah=capacity_Ah, chemistry=pack.chemistry, n_series=pack.n_series)
    return ThesisCase(recording, battery, identify_rc(recording.bench, require_thevenin(battery).ocv, capacity_Ah, 1.0))


@cache
def run(
    method: str, corrected: bool, soc: tuple[float, float] = NARROW, seed: int = SEEDS[0]
) -> SchemeByMethodEstimate:
    """The scheme of figure 3.10 along the drive, both stages by this method, (T,) each."""
    here = case(soc, seed)
    return run_along(here.log, here.offline.rule, method, corrected, soc[0])


@cache
def scope_run(method: str, seed: int) -> SchemeByMethodEstimate:
    """The same, corrected, with the voltage of an oscilloscope of 8 bit ([T] 3.3.5)."""
    here = case(NARROW, seed)
    scoped = replace(here.log, voltage_V=_SCOPE_V * np.round(here.log.voltage_V / _SCOPE_V))
    return run_along(scoped, here.offline.rule, method, True, NARROW[0])


def run_along(log: Log, model: rc.RcModel, method: str, corrected: bool, start_soc: float) -> SchemeByMethodEstimate:
    """The scheme along any log from a model found offline; it starts at the first voltage, and predicts over others."""
    scheme = SchemeByMethod(model, method, corrected)
    samples = samples_of(log)
    first = SocSample(0.0, *(float(column[0]) for column in samples[1:]))
    first = first._replace(voltage_V=float(log.voltage_V[np.isfinite(log.voltage_V)][0]))
    start = scheme.init(first, start_soc, START_STD)
    return Kernel(scheme.step, start, first).scan(start, samples)[1]


@cache
def default_run(soc: tuple[float, float] = NARROW, seed: int = SEEDS[0]) -> SocRun:
    """The default estimator along the drive, from the same start."""
    here = case(soc, seed)
    return SocEstimator(here.battery, initial_soc=soc[0], initial_soc_std=START_STD).run(here.log)


def offline_voltage(here: ThesisCase, model: rc.RcModel) -> np.ndarray:
    """Voltage (T,) of a circuit that is never corrected, from rest at the right state of charge."""

    class Moved(NamedTuple):
        x: np.ndarray
        current_A: float

    def step(state: Moved, sample: SocSample) -> tuple[Moved, np.ndarray]:
        x = rc.next_state(state.x, 0.5 * (state.current_A + sample.current_A), model, sample.dt_s)
        return Moved(x, sample.current_A), rc.voltage(x, sample.current_A, model)

    samples = samples_of(here.log)
    first = SocSample(0.0, *(float(column[0]) for column in samples[1:]))
    start = Moved(model.at_rest(float(here.truth[0])), first.current_A)
    return Kernel(step, start, first).scan(start, samples)[1][:, 0]
