"""From logs of tests at a known capacity to a battery: the chain of [P] 2.3, every stage of which can be looked at."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import islice
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from ohmward.battery.battery import Battery, LogFit
from ohmward.battery.battery import Provenance as Provenance
from ohmward.battery.chemistries import CHEMISTRIES, start_model, start_noise
from ohmward.battery.identification.circuit import circuit_of, slow_shape, start_of
from ohmward.battery.identification.circuit_fit import CircuitFit, fit_circuit
from ohmward.battery.identification.circuit_prior import prior_for
from ohmward.battery.identification.circuit_solve import CircuitProblem
from ohmward.battery.identification.confidence import confidence_intervals, not_identified
from ohmward.battery.identification.edges import Edge, edge_notes, find_edges
from ohmward.battery.identification.fit_samples import COARSEST_S, FitSamples, thin
from ohmward.battery.identification.noise_from_fit import current_noise_A, noise_from_fit
from ohmward.battery.identification.ocv_from_low_rate import OcvBranch, branch_notes, find_branches, ocv_from_branches
from ohmward.battery.identification.ocv_from_rests import RestPoint, ocv_from_rests, rest_points
from ohmward.battery.identification.open_loop import simulate
from ohmward.battery.identification.rc_identification import RcIdentification, identify_rc
from ohmward.battery.identification.rc_samples import samples_of as outside_long_charges
from ohmward.battery.identification.record import Record, make_records
from ohmward.battery.identification.relaxation import Relaxation, find_relaxations
from ohmward.battery.identification.segments import Phase, find_pulses
from ohmward.battery.identification.soc_axis import SocAxis, anchor_soc, find_anchors
from ohmward.battery.models.noise import BatteryNoise
from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.models.rc import RcModel
from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.battery.models.thevenin import Thevenin
from ohmward.checks import require_positive
from ohmward.errors import InputError
from ohmward.logs.log import Log, Note

MODELS = ("thevenin-0rc", "thevenin-1rc", "thevenin-2rc", "thevenin-3rc", "rc")
DEFAULT_MODEL = "thevenin-2rc"
_OTHER_TEMPERATURE_K = 5.0

Progress = Callable[[str, float], None]


class IdentificationSettings(NamedTuple):
    """What the caller says about the battery; see `identify`."""

    capacity_Ah: float
    model: str = DEFAULT_MODEL
    chemistry: str = ""
    n_series: int = 1
    name: str = ""
    initial_soc: Mapping[str, float] = MappingProxyType({})
    idle_current_A: float | None = None


class LogDetails(NamedTuple):
    """What was found in one log that the circuit was fitted to.

    axis: its state of charge and what that was tied to; pulses; edges; relaxations; rests: ends of long rests.
    parts: samples used by the fit, (N,) each, divided at gaps; simulated_V: voltage of the circuit along each.
    """

    record: Record
    axis: SocAxis
    pulses: tuple[Phase, ...]
    edges: tuple[Edge, ...]
    relaxations: tuple[Relaxation, ...]
    rests: tuple[RestPoint, ...]
    parts: tuple[FitSamples, ...]
    simulated_V: tuple[np.ndarray, ...]

    @property
    def residual_V(self) -> tuple[np.ndarray, ...]:
        """Measured minus simulated voltage of each part, (N,) each."""
        return tuple(s.voltage_V - v for s, v in zip(self.parts, self.simulated_V, strict=True))


class Identified(NamedTuple):
    """The battery and everything that led to it.

    branches: low-rate discharges and charges; first_ocv: the curve before the fit corrected it;
    logs: one for each log that the circuit was fitted to; fit: the fit, None without such a log.
    """

    battery: Battery
    branches: tuple[OcvBranch, ...]
    first_ocv: OcvCurve
    logs: tuple[LogDetails, ...]
    fit: CircuitFit | None


class Preparation(NamedTuple):
    """What the stages before the fit found."""

    branches: tuple[OcvBranch, ...]
    ocv: OcvCurve
    records: tuple[Record, ...]
    axes: tuple[SocAxis, ...]
    notes: tuple[Note, ...]


def identify(
    logs: Log | Sequence[Log],
    *,
    capacity_Ah: float,
    model: str = DEFAULT_MODEL,
    chemistry: str = "",
    n_series: int = 1,
    name: str = "",
    initial_soc: Mapping[str, float] | None = None,
    idle_current_A: float | None = None,
    progress: Progress | None = None,
) -> Battery:
    """The battery in one or several logs of tests; `identify_in_detail` also returns what every stage found.

    logs: low-rate tests give the OCV curve, pulse tests and drives everything else; any of them may be missing.
    capacity_Ah: charge between full and empty, > 0.
    model: one of MODELS.
    chemistry, n_series, name: for the battery file; the chemistry also gives start values where the logs give none.
    initial_soc: state of charge at the start of a log, by its name, where the log does not tell.
    idle_current_A: what the battery delivers at rest, <= 0, where it is known; None finds rests about 0 A and declares
        nothing to the estimators.
    progress: called with the name of the stage and the share done, from 0 to 1.

    Raises:
        InputError: a log is too short, has no current, no rest, a gap of unknown charge, or contradicts the capacity.
    """
    settings = IdentificationSettings(capacity_Ah, model, chemistry, n_series, name, initial_soc or {}, idle_current_A)
    return identify_in_detail(logs, settings, progress).battery


def identify_in_detail(
    logs: Log | Sequence[Log], settings: IdentificationSettings, progress: Progress | None = None
) -> Identified:
    """As `identify`, with what every stage found."""
    logs = (logs,) if isinstance(logs, Log) else tuple(logs)
    _check(settings, logs)
    settings = settings._replace(name=settings.name or logs[0].name)
    report = progress or (lambda stage, share: None)
    report("charge, rests and pulses", 0.0)
    records = tuple(r for log in logs for r in make_records(log, settings.capacity_Ah, settings.idle_current_A or 0.0))
    report("open-circuit voltage", 0.05)
    stage = _before_the_fit(records, settings)
    if not stage.records:
        return _curve_alone(stage, records, settings)
    report("circuit", 0.1)
    if settings.model == "rc":
        return _rc(stage, records, settings)
    return _thevenin(stage, records, settings, lambda share: report("circuit", 0.1 + 0.9 * share))


def _before_the_fit(records: Sequence[Record], settings: IdentificationSettings) -> Preparation:
    """Stages 3 and 4: the first OCV curve, and the state of charge along each log to fit."""
    Q = settings.capacity_Ah
    slow = [r for r in records if r.test == "low-rate"]
    fast = tuple(r for r in records if r.test != "low-rate")
    branches = tuple(b for r in slow for b in find_branches(r, Q, settings.initial_soc.get(r.log.name)))
    reference_degC = _reference_degC(fast or slow)
    if branches:
        ocv = ocv_from_branches(branches, reference_degC)
    else:
        ocv = _ocv_from_rests(fast, settings, reference_degC)
    axes = tuple(_axis(r, settings, ocv) for r in fast)
    notes = (
        *(note for r in records for note in r.charge.notes),
        *branch_notes(branches, Q),
        *(note for axis in axes for note in axis.notes),
    )
    return Preparation(branches, ocv, fast, axes, notes)


def _ocv_from_rests(records: Sequence[Record], settings: IdentificationSettings, reference_degC: float) -> OcvCurve:
    """The curve through the rests of every log whose state of charge is known without a curve."""
    points: list[RestPoint] = []
    first_refusal: InputError | None = None
    for record in records:
        given = settings.initial_soc.get(record.log.name)
        try:
            find_anchors(record, settings.capacity_Ah, None, given)
        except InputError as refusal:
            first_refusal = first_refusal or refusal
            continue
        points += rest_points(record, _axis(record, settings, None).soc)
    if not points and first_refusal:
        raise first_refusal
    return ocv_from_rests(points, min(float(np.nanmin(r.log.voltage_V)) for r in records), reference_degC)


def _axis(record: Record, settings: IdentificationSettings, ocv: OcvCurve | None) -> SocAxis:
    efficiency = CHEMISTRIES[settings.chemistry].coulombic_efficiency if settings.chemistry else 1.0
    return anchor_soc(record, settings.capacity_Ah, ocv, settings.initial_soc.get(record.log.name), efficiency)


def _thevenin(
    stage: Preparation, records: Sequence[Record], settings: IdentificationSettings, progress: Callable[[float], None]
) -> Identified:
    """Stages 5 to 9 for the Thevenin circuit."""
    Q = settings.capacity_Ah
    parts = [thin(r, a.soc) for r, a in zip(stage.records, stage.axes, strict=True)]
    samples = tuple(part for record_parts in parts for part in record_parts)
    problem = CircuitProblem(
        samples,
        stage.ocv,
        Q,
        prior_for(settings.chemistry, _both_directions(stage.branches)),
        slow_shape(stage.ocv, samples, Q),
        _reference_degC(stage.records),
        _temperatures_differ(stage.records),
    )
    fit = fit_circuit(problem, int(settings.model[len("thevenin-")]), progress)
    p = circuit_of(fit.solution, problem, min(axis.efficiency for axis in stage.axes))
    voltages = iter(simulate(s, p, *start_of(fit.solution, k)) for k, s in enumerate(samples))
    details = tuple(
        _details(r, a, own, tuple(islice(voltages, len(own))), Q)
        for r, a, own in zip(stage.records, stage.axes, parts, strict=True)
    )
    hysteresis = any(stage.ocv.hysteresis_V)
    provenance = Provenance(
        Q,
        _measured_capacity_Ah(stage.branches),
        (*(_quality(d) for d in details), *(_curve_fit(b) for b in stage.branches)),
        confidence_intervals(fit, hysteresis, problem.fit_activation),
        tuple(str(note) for note in (*stage.notes, *edge_notes([e for d in details for e in d.edges]))),
    )
    pulses_only = all(r.test == "pulses" for r in stage.records)
    noise = noise_from_fit(fit.solution, problem, p, current_noise_A(stage.records[0].current_A), pulses_only)
    missing = not_identified(fit, samples, Q, hysteresis, hysteresis)
    battery = _battery(settings, records, p, None, noise, provenance, missing)
    battery = _with_rc(battery, stage, settings, p.ocv)
    return Identified(battery, stage.branches, stage.ocv, details, fit)


def _with_rc(battery: Battery, stage: Preparation, settings: IdentificationSettings, ocv: OcvCurve) -> Battery:
    """The battery with the RC model of the same logs; without it, and a sentence why, where they do not give one."""
    try:
        found, *_ = _find_rc(stage, settings, ocv)
    except InputError as refusal:
        return replace(battery, not_identified=(*battery.not_identified, f"RC model: {refusal}"))
    return replace(battery, rc=found.model, rc_noise=found.noise)


def _find_rc(
    stage: Preparation, settings: IdentificationSettings, ocv: OcvCurve
) -> tuple[RcIdentification, Record, SocAxis]:
    """The RC model from the log that moves most charge, and that log."""
    moved = [float(np.abs(r.charge.moved_Ah).sum()) for r in stage.records]
    record, axis = stage.records[int(np.argmax(moved))], stage.axes[int(np.argmax(moved))]
    curve = None if settings.chemistry == "lead-acid" else ocv
    first_s = outside_long_charges(record.log, settings.capacity_Ah).time_s[0]
    start_soc = float(np.interp(first_s, record.log.time_s, axis.soc))
    return identify_rc(record.log, curve, settings.capacity_Ah, start_soc), record, axis


def _rc(stage: Preparation, records: Sequence[Record], settings: IdentificationSettings) -> Identified:
    """The RC model alone."""
    found, record, axis = _find_rc(stage, settings, stage.ocv)
    notes = (*(str(note) for note in stage.notes), *found.notes)
    quality = LogFit(record.log.name, record.test, float(axis.soc.min()), float(axis.soc.max()))
    provenance = Provenance(settings.capacity_Ah, _measured_capacity_Ah(stage.branches), (quality,), (), notes)
    battery = _battery(settings, records, None, found.model, found.noise, provenance, found.not_identified)
    battery = replace(battery, rc_noise=found.noise)
    return Identified(battery, stage.branches, stage.ocv, (), None)


def _curve_alone(stage: Preparation, records: Sequence[Record], settings: IdentificationSettings) -> Identified:
    """Low-rate tests only: the OCV curve is measured, the rest is what the chemistry has in common."""
    Q, n = settings.capacity_Ah, settings.n_series
    noise = start_noise(Q, n, ocv_known=True)
    if settings.chemistry:
        p = start_model(settings.chemistry, Q, n, stage.ocv.scaled(1 / n))
        missing = f"resistances and time constants: no pulses; start values for {settings.chemistry} were taken"
    else:
        p = Thevenin(Q, stage.ocv, (0.0, 0.0), (0.0, 0.0), (), (), reference_degC=stage.ocv.reference_degC)
        missing = (
            "resistances and time constants: no pulses in the logs; taken as 0 (name a chemistry for start values)"
        )
    provenance = Provenance(
        Q,
        _measured_capacity_Ah(stage.branches),
        tuple(_curve_fit(b) for b in stage.branches),
        notes=tuple(str(note) for note in stage.notes),
    )
    one_way = () if _both_directions(stage.branches) else ("hysteresis: one direction only; taken as none",)
    battery = _battery(settings, records, p, None, noise, provenance, (missing, *one_way))
    return Identified(battery, stage.branches, stage.ocv, (), None)


def _battery(
    settings: IdentificationSettings,
    records: Sequence[Record],
    thevenin: Thevenin | None,
    rc: RcModel | None,
    noise: BatteryNoise,
    provenance: Provenance,
    missing: tuple[str, ...],
) -> Battery:
    voltage_V = np.concatenate([r.log.voltage_V for r in records])
    return Battery(
        name=settings.name,
        capacity_Ah=settings.capacity_Ah,
        chemistry=settings.chemistry,
        n_series=settings.n_series,
        voltage_min_V=float(np.nanmin(voltage_V)),
        voltage_max_V=float(np.nanmax(voltage_V)),
        idle_current_A=settings.idle_current_A,
        thevenin=thevenin,
        rc=rc,
        noise=noise,
        identification=provenance,
        not_identified=missing,
    )


def _details(
    record: Record,
    axis: SocAxis,
    parts: tuple[FitSamples, ...],
    simulated_V: tuple[np.ndarray, ...],
    capacity_Ah: float,
) -> LogDetails:
    return LogDetails(
        record,
        axis,
        find_pulses(record.phases, capacity_Ah),
        find_edges(record, axis.soc, capacity_Ah),
        find_relaxations(record, axis.soc),
        rest_points(record, axis.soc),
        parts,
        simulated_V,
    )


def _quality(d: LogDetails) -> LogFit:
    residual_V = np.concatenate(d.residual_V)
    known = np.isfinite(residual_V)
    weight = np.minimum(np.concatenate([s.dt_s for s in d.parts])[known], COARSEST_S)
    rms_V = float(np.sqrt(weight @ residual_V[known] ** 2 / max(weight.sum(), 1e-9)))
    soc = d.axis.soc
    largest_V = float(np.abs(residual_V[known]).max())
    return LogFit(d.record.log.name, d.record.test, float(soc.min()), float(soc.max()), rms_V, largest_V)


def _curve_fit(branch: OcvBranch) -> LogFit:
    soc = branch.soc
    return LogFit(branch.log_name, f"low-rate {branch.direction}", float(soc.min()), float(soc.max()))


def _measured_capacity_Ah(branches: Sequence[OcvBranch]) -> float:
    complete = [b.moved_Ah for b in branches if b.complete]
    return float(np.mean(complete)) if complete else 0.0


def _both_directions(branches: Sequence[OcvBranch]) -> bool:
    return len({b.direction for b in branches}) == 2


def _reference_degC(records: Sequence[Record]) -> float:
    known = [t for r in records if (t := r.typical_degC()) is not None]
    return float(np.median(known)) if known else ROOM_DEGC


def _temperatures_differ(records: Sequence[Record]) -> bool:
    known = [t for r in records if (t := r.typical_degC()) is not None]
    return bool(known) and max(known) - min(known) > _OTHER_TEMPERATURE_K


def _check(settings: IdentificationSettings, logs: Sequence[Log]) -> None:
    require_positive("capacity_Ah", settings.capacity_Ah)
    if settings.model not in MODELS:
        raise InputError(f"model must be one of {', '.join(MODELS)}, got {settings.model!r}")
    if settings.chemistry and settings.chemistry not in CHEMISTRIES:
        raise InputError(f"chemistry must be one of {', '.join(CHEMISTRIES)}, got {settings.chemistry!r}")
    if not logs:
        raise InputError("identify needs at least one log")
    names = [log.name for log in logs]
    for name, soc in settings.initial_soc.items():
        if name not in names:
            raise InputError(f"initial_soc names {name!r}, but the logs are {', '.join(map(repr, names))}")
        if not 0.0 <= soc <= 1.0:
            raise InputError(f"initial_soc of {name!r} must be between 0 and 1 (0.8 is 80 %), got {soc:g}")
