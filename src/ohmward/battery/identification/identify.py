"""Identification of a battery from logs of tests at a known capacity: the chain of [P] 2.3.

Charge, phases of the current, state of charge, open-circuit voltage, circuit, noise, confidence: one file for each
stage, and `identify_in_detail` returns the results of every stage.

Ohmic drop of a chemistry in which charge transfer may make it nonlinear: lead-acid.

Charge transfer follows Butler and Volmer, i = 2 i_0 sinh(F V / 2RT) with equal coefficients: three times the current
takes less than three times the voltage. Where one electrode takes most of the drop it is V_t asinh(R_0 i / V_t) with
V_t = 2RT / F for each cell, without a further unknown; where conduction does, it is R_0 i. The logs decide.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import chain, islice
from os import PathLike
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.battery import Battery, Provenance
from ohmward.battery.charge_count import require_followed
from ohmward.battery.chemistries import CHEMISTRIES, chemistry_name, start_model, start_noise
from ohmward.battery.fingerprint import fingerprint
from ohmward.battery.identification.circuit_fit import (
    CircuitFit,
    choose_pairs,
    circuit_of,
    curve_notes,
    fit_circuit,
    longest_rest_s,
    longest_tau_s,
    slow_shape,
    start_of,
)
from ohmward.battery.identification.circuit_solve import CircuitProblem
from ohmward.battery.identification.circuit_uncertainty import (
    confidence_intervals,
    current_noise_A,
    load_temperature,
    noise_from_fit,
    not_identified,
    untested_sentences,
    with_usual_hysteresis,
)
from ohmward.battery.identification.first_ocv import (
    DEFAULT_MODEL,
    MODELS,
    FirstOcv,
    IdentificationSettings,
    find_first_ocv,
    known_without_curve,
    line_through,
    soc_axis,
)
from ohmward.battery.identification.fit_samples import FitSamples, simulate, thin, thin_branch
from ohmward.battery.identification.log_details import (
    OTHER_CELLS,
    LogDetails,
    branch_fits,
    edge_notes,
    fit_notes,
    is_reproduced,
    label_notes,
    unlikely_cells,
)
from ohmward.battery.identification.ocv_from_logs import OcvBranch
from ohmward.battery.identification.record import Record, make_records, reference_degC
from ohmward.battery.identification.soc_axis import SocAxis, axis_std
from ohmward.battery.models.noise import BatteryNoise, usual_sensor
from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.models.temperature import FARADAY_C_PER_MOL, GAS_J_PER_MOL_K, KELVIN
from ohmward.battery.models.thevenin import Thevenin
from ohmward.battery.posterior import USUAL_HYSTERESIS_STD
from ohmward.battery.soc.sample import starts_of_logs
from ohmward.checks import require_between, require_one_of, require_positive
from ohmward.errors import InputError
from ohmward.logs.log import Log, LogSource, Note, as_logs
from ohmward.optional import one_blas_thread

#: A nonlinear drop is used where it leaves less than this share of the squared residuals of a linear one: 0.25 to 0.56
#: in pulses, low-rate tests and drives of cells with this law, 1.15 to 2.4 for a measured and a simulated battery
#: without. The evidence cannot decide: its robust weights treat the pulses that a linear drop misses as outliers.
_CLEARLY_BETTER = 0.8
#: Relative error of a capacity on the day of a test that showed all of it: a low-rate test, and another one.
TESTED_CAPACITY_STD, PULSED_CAPACITY_STD = 0.02, 0.04

Progress = Callable[[str, float], None]


class Identified(NamedTuple):
    """The identified battery and the results behind it."""

    battery: Battery
    branches: tuple[OcvBranch, ...]  #: low-rate discharges and charges
    first_ocv: OcvCurve  #: the curve before the fit corrected it
    logs: tuple[LogDetails, ...] = ()  #: one for each log that the circuit was fitted to
    fit: CircuitFit | None = None  #: None without such a log

    @property
    def fits(self) -> bool:
        """True where the circuit reproduces every log that it was fitted to."""
        model, origin = self.battery.thevenin, self.battery.identification
        return origin is None or all(is_reproduced(fit, model.ocv) for fit in origin.logs)


class Preparation(NamedTuple):
    """Results of the stages before the fit."""

    records: tuple[Record, ...]  #: of all logs
    axes: tuple[SocAxis, ...]  #: state of charge along those to fit, `first.fitted`
    first: FirstOcv  #: the first curve, and the records to fit
    notes: tuple[Note, ...]  #: assumptions and findings


def identify(
    logs: LogSource | Sequence[LogSource],
    *,
    capacity_Ah: float,
    model: str = DEFAULT_MODEL,
    chemistry: str = "",
    n_series: int = 1,
    name: str = "",
    initial_soc: float | Mapping[str, float] | None = None,
    idle_current_A: float | None = None,
    ocv: OcvCurve | str | PathLike[str] | Any = None,
    progress: Progress | None = None,
) -> Battery:
    """Identify a battery from one or several test logs; `identify_in_detail` also returns the results of every stage.

    >>> battery = ow.identify("test.csv", capacity_Ah=12, chemistry="lfp", n_series=4)
    >>> ow.save_battery(battery, "battery.toml")

    logs: a Log or several, or paths or DataFrames of them; low-rate tests give the OCV curve, pulse tests and drives
        everything else; any of them may be missing.
    capacity_Ah: charge between full and empty, > 0.
    model: one of MODELS.
    chemistry, n_series, name: for the battery file; the chemistry also gives start values where the logs give none.
    initial_soc: state of charge at the start of every log, or by the names of the logs, where they do not show it. A
        DataFrame is called `frame.attrs["name"]`, else "DataFrame", several "DataFrame 1", "DataFrame 2", ...
    idle_current_A: current of the battery at rest, <= 0, if known; None looks for rests around 0 A and declares
        nothing to the estimators.
    ocv: the open-circuit voltage, if known: an OcvCurve, or a table as `load_ocv` reads it. Then no low-rate test is
        needed, and drives alone identify the rest.
    progress: called with the name of the stage and the share done, from 0 to 1.

    Raises:
        InputError: a log is too short, has no current, no rest, a gap of unknown charge, or contradicts the capacity
            or the number of cells.
    """
    logs = as_logs(logs)
    starts = starts_of_logs(initial_soc, [log.name for log in logs])
    settings = IdentificationSettings(capacity_Ah, model, chemistry, n_series, name, starts, idle_current_A, ocv)
    return identify_in_detail(logs, settings, progress).battery


def identify_in_detail(
    logs: LogSource | Sequence[LogSource], settings: IdentificationSettings, progress: Progress | None = None
) -> Identified:
    """As `identify`, with the results of every stage."""
    logs = as_logs(logs)
    _check(settings, logs)
    name, chemistry = settings.name or logs[0].name, chemistry_name(settings.chemistry)
    settings = settings._replace(name=name, chemistry=chemistry)
    report = progress or (lambda stage, share: None)
    report("charge, rests and pulses", 0.0)
    idle_A = settings.idle_current_A or 0.0
    records = tuple(chain.from_iterable(make_records(log, settings.capacity_Ah, idle_A) for log in logs))
    for record in records:
        if not record.charge.counted:
            require_followed(record.log)
    report("open-circuit voltage", 0.05)
    with one_blas_thread():
        prepared = prepare(records, settings)
        if not prepared.first.fitted:
            return _curve_alone(prepared, settings)
        report("circuit", 0.1)
        return _thevenin(prepared, settings, lambda share: report("circuit", 0.1 + 0.9 * share))


def prepare(records: tuple[Record, ...], settings: IdentificationSettings) -> Preparation:
    """The first OCV curve, and the state of charge along each record to fit.

    Where the logs show no curve the RC model takes the straight line through drives whose state of charge is known.
    """
    try:
        first = find_first_ocv(records, settings)
    except InputError as refusal:
        if settings.model != "rc" or settings.ocv is not None:
            raise
        first = line_through(records, [_axis(r, settings, None) for r in records], settings.capacity_Ah, refusal)
    axes = tuple(_axis(r, settings, None if first.source == "line" else first) for r in first.fitted)
    notes = (
        *chain.from_iterable(record.charge.notes for record in records),
        *first.notes,
        *chain.from_iterable(axis.notes for axis in axes),
    )
    return Preparation(records, axes, first, notes)


def _axis(record: Record, settings: IdentificationSettings, first: FirstOcv | None) -> SocAxis:
    """SoC axis of a record; a curve made from the record's own rests is not used again for its axis."""
    curve, curve_axis_std = (first.curve, first.axis_std) if first else (None, 0.0)
    if first and first.source == "rests" and known_without_curve(record, settings):
        curve = None
    return soc_axis(record, settings, curve, curve_axis_std)


def _thevenin(prepared: Preparation, settings: IdentificationSettings, progress: Callable[[float], None]) -> Identified:
    """The Thevenin circuit, its noise and its confidence."""
    first = prepared.first
    parts = [thin(r, axis.soc) for r, axis in zip(first.fitted, prepared.axes, strict=True)]
    problem = _problem(prepared, tuple(chain.from_iterable(parts)), settings)
    fit, choice = _fit(problem, settings, progress)
    model = circuit_of(fit.solution, min(axis.efficiency for axis in prepared.axes))
    if settings.chemistry:
        model = replace(model, gassing_V=CHEMISTRIES[settings.chemistry].gassing_V(model.ocv))
    voltages = iter(simulate(s, model, *start_of(fit.solution, k)) for k, s in enumerate(problem.samples))
    details = tuple(
        LogDetails(r, axis, part, tuple(islice(voltages, len(part))), model)
        for r, axis, part in zip(first.fitted, prepared.axes, parts, strict=True)
    )
    edges = tuple(chain.from_iterable(log.edges for log in details))
    fits = *(log.quality for log in details), *branch_fits(first.branches)
    checks = *edge_notes(edges), *fit_notes(details, fits, model.ocv), *curve_notes(fit.solution)
    provenance = replace(
        _provenance(prepared, settings, model.ocv, (*choice, *checks)),
        logs=fits,
        confidence=confidence_intervals(fit),
    )
    missing = (
        *first.not_identified,
        *not_identified(fit),
        *untested_sentences(fit, settings.chemistry),
    )
    noise = _noise(prepared, settings, fit, model, details)
    battery = _battery(prepared, settings, with_usual_hysteresis(model, problem), noise)
    battery = replace(battery, identification=provenance, not_identified=missing)
    return Identified(battery, first.branches, first.curve, details, fit)


def _noise(
    prepared: Preparation,
    settings: IdentificationSettings,
    fit: CircuitFit,
    model: Thevenin,
    details: Sequence[LogDetails],
) -> BatteryNoise:
    """The noise of the fit, with the day on which the capacity was known."""
    fitted = prepared.first.fitted
    noise = noise_from_fit(
        fit,
        model,
        pulses_only=all(record.test == "pulses" for record in fitted),
        anchors_std=axis_std(fitted, prepared.axes),
        longest_rest_s=longest_rest_s(fitted),
        measured={branch.direction for branch in prepared.first.branches if branch.complete},
    )
    return _with_known_capacity(noise, prepared, settings.capacity_Ah, details)


def _fit(
    problem: CircuitProblem, settings: IdentificationSettings, progress: Callable[[float], None]
) -> tuple[CircuitFit, tuple[Note, ...]]:
    """The circuit with the number of RC pairs that the model names, or with the most evidence, and notes on it."""
    notes: list[Note] = []
    if settings.model == DEFAULT_MODEL:
        fit, note = choose_pairs(problem, progress)
        notes.append(note)
    else:
        pairs = 1 if settings.model == "rc" else int(settings.model[len("thevenin-")])
        fit = fit_circuit(problem, pairs, progress)
    if settings.chemistry and CHEMISTRIES[settings.chemistry].charge_transfer:
        fit, note = try_transfer(fit, settings.n_series)
        notes.append(note)
    return fit, tuple(notes)


def _problem(
    prepared: Preparation, samples: tuple[FitSamples, ...], settings: IdentificationSettings
) -> CircuitProblem:
    first, Q = prepared.first, settings.capacity_Ah
    prior, degC = first.prior(settings.chemistry), reference_degC(first.fitted)
    # low-rate branches are records of the fit where the chemistry wants them and both directions were measured
    fits_branches = prior.hysteresis_on_branches is not None and first.both_directions
    return CircuitProblem(
        samples,
        first.curve,
        Q,
        prior,
        slow_shape(first.curve, samples, Q),
        degC,
        fit_activation=load_temperature(samples).shows_activation,
        longest_tau_s=longest_tau_s(first.fitted),
        branches=tuple(thin_branch(b, Q, degC) for b in first.branches) if fits_branches else (),
    )


def _curve_alone(prepared: Preparation, settings: IdentificationSettings) -> Identified:
    """The OCV curve of low-rate tests, with start values of the chemistry for everything else."""
    Q, n, ocv = settings.capacity_Ah, settings.n_series, prepared.first.curve
    noise = start_noise(settings.chemistry, n, ocv_known=True)
    missing = "resistances and time constants: no pulses"
    usual = f"that of {settings.chemistry} cells was taken" if settings.chemistry else "assumed zero"
    one_way = f"hysteresis: one direction only; {usual}"
    if settings.chemistry:
        model = start_model(settings.chemistry, Q, n, ocv.scaled(1 / n))
        missing += f"; start values for {settings.chemistry} were taken"
        if not prepared.first.both_directions:
            model, error_V = _beside_one_branch(model, prepared.first.branches[0], settings)
            noise = replace(noise, level_std_V=float(np.hypot(noise.level_std_V, error_V)))
    else:
        model = Thevenin(Q, ocv, (0.0, 0.0), (0.0, 0.0), (), (), reference_degC=ocv.reference_degC)
        missing += " in the logs; assumed zero (name a chemistry for start values)"
    battery = _battery(prepared, settings, model, _with_known_capacity(noise, prepared, Q))
    battery = replace(
        battery,
        identification=_provenance(prepared, settings, ocv),
        not_identified=(missing,) if prepared.first.both_directions else (missing, one_way),
    )
    return Identified(battery, prepared.first.branches, ocv)


def _beside_one_branch(model: Thevenin, branch: OcvBranch, settings: IdentificationSettings) -> tuple[Thevenin, float]:
    """The model with its curve half a usual gap away from the only low-rate branch, and the error of that shift [V].

    Half the gap is the hysteresis of the chemistry and the drop over its usual resistances at the branch's current.
    """
    cell = CHEMISTRIES[settings.chemistry]
    resistance_ohm = (cell.r0_ohm_Ah + cell.r1_ohm_Ah + cell.r2_ohm_Ah) / settings.capacity_Ah
    half_V = settings.n_series * (cell.hysteresis_V + resistance_ohm * abs(branch.current_A))
    shift_V = half_V if branch.direction == "discharge" else -half_V
    curve = replace(
        model.ocv,
        voltage_V=tuple(voltage_V + shift_V for voltage_V in model.ocv.voltage_V),
        hysteresis_V=(settings.n_series * cell.hysteresis_V,) * len(model.ocv.voltage_V),
    )
    return replace(model, ocv=curve), USUAL_HYSTERESIS_STD * half_V


def _battery(prepared: Preparation, settings: IdentificationSettings, model: Thevenin, noise: BatteryNoise) -> Battery:
    """The battery with this circuit, the user's settings, and voltage limits from the logs."""
    voltage_V = np.concatenate([r.log.voltage_V for r in prepared.records])
    noise_A = max((current_noise_A(r) for r in prepared.first.fitted), default=0.0)
    return Battery(
        name=settings.name,
        capacity_Ah=settings.capacity_Ah,
        chemistry=settings.chemistry,
        n_series=settings.n_series,
        voltage_min_V=float(np.nanmin(voltage_V)),
        voltage_max_V=float(np.nanmax(voltage_V)),
        idle_current_A=settings.idle_current_A,
        noise=noise,
        sensor=usual_sensor(settings.capacity_Ah, noise_A),
        thevenin=model,
    )


def _with_known_capacity(
    noise: BatteryNoise, prepared: Preparation, capacity_Ah: float, details: Sequence[LogDetails] = ()
) -> BatteryNoise:
    """The noise with the date of the log that showed the whole capacity, if there is such a log with a date.

    A capacity that the logs contradict is as uncertain as that difference.
    """
    complete = [branch for branch in prepared.first.branches if branch.complete]
    discharges = [branch for branch in complete if branch.direction == "discharge"] or complete  # charges may gas
    logs = {record.log.name: record.log for record in prepared.records}
    if discharges:
        off = abs(float(np.mean([branch.moved_Ah for branch in discharges])) / capacity_Ah - 1.0)
    else:
        off = max((abs(axis.capacity_ratio - 1.0) for axis in prepared.axes), default=0.0)
    tested, std = [logs[branch.log_name] for branch in discharges], TESTED_CAPACITY_STD
    if _last_day(tested) is None:
        tested, std = [log.record.log for log in details if log.is_whole], PULSED_CAPACITY_STD
    if (day := _last_day(tested)) is None:
        return replace(noise, capacity_std=max(noise.capacity_std, off))
    return replace(noise, capacity_known_unix_s=day, capacity_known_std=max(std, off))


def _last_day(logs: Sequence[Log]) -> float | None:
    """End of the last log that has a date [s since 1970], None without any."""
    return max((log.end_unix_s for log in logs if log.end_unix_s is not None), default=None)


def _provenance(
    prepared: Preparation, settings: IdentificationSettings, ocv: OcvCurve, found: Sequence[Note] = ()
) -> Provenance:
    """Provenance of this OCV curve, with the notes of the fit."""
    voltage_V = np.concatenate([r.log.voltage_V for r in prepared.records])
    label = label_notes(voltage_V, ocv, settings.chemistry, settings.n_series)
    complete_Ah = [b.moved_Ah for b in prepared.first.branches if b.complete]
    return Provenance(
        settings.capacity_Ah,
        float(np.mean(complete_Ah)) if complete_Ah else 0.0,
        logs=branch_fits(prepared.first.branches),
        notes=tuple(map(str, (*label, *prepared.notes, *found))),
        fingerprints=tuple(fingerprint(record.log) for record in prepared.records),
    )


def _check(settings: IdentificationSettings, logs: Sequence[Log]) -> None:
    require_positive("capacity_Ah", settings.capacity_Ah)
    require_between("n_series", settings.n_series, 1, np.inf)
    require_one_of("model", settings.model, MODELS)
    if not logs:
        raise InputError("identify needs at least one log")
    starts_of_logs(settings.initial_soc, [log.name for log in logs])
    for log in logs:
        if not np.any(log.voltage_V > 0.0):
            raise InputError(f"log {log.name!r} has no voltage above 0; check its columns")
    voltage_V = np.concatenate([log.voltage_V for log in logs])
    if other := unlikely_cells(voltage_V, chemistry_name(settings.chemistry), settings.n_series, OTHER_CELLS):
        raise InputError(f"{other} (--n-series, n_series=)")


def cells_transfer_V(reference_degC: float, n_series: int) -> float:
    """V_t of cells in series [V]."""
    return n_series * 2 * GAS_J_PER_MOL_K * (reference_degC + KELVIN) / FARADAY_C_PER_MOL


def try_transfer(straight: CircuitFit, n_series: int) -> tuple[CircuitFit, Note]:
    """The fit with a nonlinear drop where the logs clearly show it, else the linear one; a note on it."""
    problem = straight.solution.problem
    transfer_V = cells_transfer_V(problem.reference_degC, n_series)
    near = straight.solution.rates._replace(transfer_V=transfer_V)
    with_transfer = fit_circuit(replace(problem, transfer_V=transfer_V), len(near.tau_s), near=(near,))
    left = with_transfer.solution.rows.misfit / straight.solution.rows.misfit
    found = (
        f"one bent by charge transfer ({transfer_V:.2g} V) leaves {left:.0%} of the squared residuals of a straight one"
    )
    if left < _CLEARLY_BETTER:
        return with_transfer, Note(f"ohmic drop: {found}, and is taken")
    return straight, Note(f"ohmic drop: straight; {found}")
