"""The filters that everybody runs: model and data as plain numbers, and our filter of the same problem.

Two problems, each on one drive of a simulated cell, 1 s apart:

- `CellProblem`: state of charge and RC voltages of the Thevenin model, [P] 2.3; two RC pairs, and hysteresis if wanted.
- `JointProblem`: states and parameters of the RC model together with learnt noise, the seven-state AUKF of [T] 3.3.

Models take an array module `xp`, so that NumPy and JAX run the same lines; the last axis is the state.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import PchipInterpolator

from ohmward.battery.chemistries import start_model
from ohmward.battery.models.noise import PAIR_CURRENT_C
from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.models.thevenin import Thevenin
from ohmward.battery.soc.sample import SocSample
from ohmward.battery.soc.textbook import TextbookFilter
from ohmward.filters import extended, kalman, unscented
from ohmward.filters.belief import Belief, PackedBelief, pack, unpack
from ohmward.filters.gate import apply_gain
from ohmward.filters.unscented import DEFAULT
from ohmward.logs import Log
from ohmward.trace import sign, table
from ohmward_lab.published import rc_circuit
from ohmward_lab.published.rc import Nominal
from ohmward_lab.published.textbook_joint import LEAST, TextbookJoint
from ohmward_lab.simulate.voltage import simulate_voltage

CAPACITY_AH, START_SOC = 2.0, 0.95
#: Open-circuit voltage at every tenth of SoC: few enough points for peers that write a table as nested choices.
OCV_V = (3.00, 3.47, 3.56, 3.61, 3.65, 3.70, 3.79, 3.90, 4.00, 4.08, 4.19)
HALF_GAP_V, HYSTERESIS_WALK = 0.005, 1e-3


class Posterior(NamedTuple):
    """Mean (n,) and covariance (n, n) after a log."""

    mean: np.ndarray
    cov: np.ndarray


class Scaling(NamedTuple):
    """Weights of 2 n + 1 sigma points and their squared distance."""

    spread: float
    mean: np.ndarray
    cov: np.ndarray


def scaling_of(n: int) -> Scaling:
    """Van der Merwe's, with the alpha, beta and kappa of [T]."""
    alpha, beta, kappa = DEFAULT
    spread = alpha**2 * (n + kappa)
    mean = np.full(2 * n + 1, 0.5 / spread)
    mean[0] = 1 - n / spread
    cov = mean.copy()
    cov[0] += 1 - alpha**2 + beta
    return Scaling(spread, mean, cov)


class Drive(NamedTuple):
    """A log, 1 s apart: current of each instant and mean since the one before [A], terminal voltage [V].

    (T,) each, or (T, B) of many logs.
    """

    current_A: np.ndarray
    mean_A: np.ndarray
    voltage_V: np.ndarray

    def first(self, steps: int) -> Drive:
        """Its first samples."""
        return Drive(*(column[:steps] for column in self))

    @property
    def samples(self) -> SocSample:
        """Inputs of our filters."""
        ones = np.ones(self.current_A.shape)
        return SocSample(ones, self.current_A, self.voltage_V, np.nan * ones)


def cell_model() -> Thevenin:
    """A generic NMC cell with two RC pairs and hysteresis."""
    return start_model("nmc", CAPACITY_AH, ocv=OcvCurve(OCV_V, (HALF_GAP_V,) * len(OCV_V)))


def make_drive(steps: int, seed: int = 1) -> Drive:
    """Loads and rests of 20 s, the cell given back what it gave within two of them: any number of samples."""
    rng = np.random.default_rng(seed)
    loads_A = rng.normal(0.0, 1.0, steps // 40 + 1)
    current_A = np.repeat(np.stack([loads_A, -loads_A], axis=1).ravel(), 20)[:steps] - 2e-6 * CAPACITY_AH
    truth = Log("drive", np.arange(steps, dtype=float), current_A, np.full(steps, 3.7))
    voltage_V = simulate_voltage(cell_model(), truth, START_SOC).voltage_V + 0.002 * rng.standard_normal(steps)
    mean_A = 0.5 * (current_A + np.concatenate([current_A[:1], current_A[:-1]]))
    return Drive(current_A, mean_A, voltage_V)


class CellProblem(NamedTuple):
    """x = [soc, v_1, v_2], or with hysteresis h: x+ = decay x + push, V = OCV(soc) + weights [v_1, v_2, h] + R_0 i.

    With i the mean current of the step, the push is gain i; h decays by e = exp(-rate |i|) and is pushed by
    (1 - e) sign(i).

    method: "ekf" or "ukf".
    decays, gain: (3,) of charge and RC voltages.
    rate: of hysteresis in a step of 1 s [1/A], 0 where there is none.
    weights: (n - 1,) of the states beyond SoC in the voltage.
    curve: (4, segments) coefficients of the OCV, lowest power first, on SoC tenths.
    """

    method: str
    decays: np.ndarray
    gain: np.ndarray
    rate: float
    weights: np.ndarray
    r0_ohm: float
    curve: np.ndarray
    Q: np.ndarray
    R: float
    scaling: Scaling
    start: Posterior
    drive: Drive

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.weights) + 1

    def next_state(self, xp: Any, x: Any, mean_A: Any) -> Any:
        decay, push = self.motion(xp, mean_A)
        return x * decay + push

    def motion(self, xp: Any, mean_A: Any) -> tuple[Any, Any]:
        """Decay and push (..., n) of a step with this mean current (...)."""
        mean_A = xp.asarray(mean_A)[..., None]
        if not self.rate:
            return self.decays, self.gain * mean_A
        kept = xp.exp(-self.rate * abs(mean_A))
        decays = xp.broadcast_to(xp.asarray(self.decays), (*mean_A.shape[:-1], 3))
        push = (1 - kept) * xp.sign(mean_A)
        return xp.concatenate([decays, kept], -1), xp.concatenate([self.gain * mean_A, push], -1)

    def voltage(self, xp: Any, x: Any, current_A: Any) -> Any:
        c, t = self.segment(xp, x[..., 0])
        return c[0] + t * (c[1] + t * (c[2] + t * c[3])) + x[..., 1:] @ self.weights + self.r0_ohm * current_A

    def slope(self, xp: Any, x: Any) -> Any:
        """dV/dx (n,) of one state."""
        c, t = self.segment(xp, x[0])
        per_soc = (c[1] + t * (2 * c[2] + t * 3 * c[3])) * (len(OCV_V) - 1)
        return xp.concatenate([xp.asarray([per_soc]), self.weights])

    def segment(self, xp: Any, soc: Any) -> tuple:
        """Coefficients of the curve where soc is, and the place within the segment."""
        u = soc * (len(OCV_V) - 1)
        k = xp.clip(xp.floor(u), -1, len(OCV_V) - 1)
        return xp.asarray(self.curve)[:, k.astype(int) + 1], u - k


def cell_problem(method: str, steps: int, hysteresis: bool = False) -> CellProblem:
    """The filter of the textbooks as `TextbookFilter` has it, and with hysteresis as a fourth state."""
    model, ours = cell_model(), TextbookFilter(cell_model(), method=method)
    decays = np.exp(-1.0 / np.array(model.tau_s))
    r_ohm = np.array([row[0] for row in model.r_ohm])
    wander = [*(PAIR_CURRENT_C * r_ohm * CAPACITY_AH) ** 2, *([HYSTERESIS_WALK**2] if hysteresis else [])]
    drive = make_drive(steps)
    belief = unpack(cell_start(ours, drive).belief)
    if hysteresis:
        belief = Belief(np.append(belief.mean, 0.0), np.diag([*np.diag(belief.cov), 0.5**2]))
    n = len(belief.mean)
    return CellProblem(
        method=method,
        decays=np.array([1.0, *decays]),
        gain=np.array([1.0 / model.capacity_As, *(1 - decays) * r_ohm]),
        rate=model.hysteresis_rate / model.capacity_As if hysteresis else 0.0,
        weights=np.array([1.0, 1.0, HALF_GAP_V][: n - 1]),
        r0_ohm=model.r0_charge_ohm[0],
        curve=curve_of(OCV_V),
        Q=np.diag([(ours.sensor.noise_std_A / model.capacity_As) ** 2, *wander]),
        R=ours.noise.voltage_std_V**2 + max(ours.noise.model_std_V) ** 2,
        scaling=scaling_of(n),
        start=Posterior(belief.mean, belief.cov),
        drive=drive,
    )


def cell_start(ours: TextbookFilter, drive: Drive) -> Any:
    """Our state before the log."""
    return ours.init(SocSample(*(float(c[0]) for c in drive.samples)), START_SOC - 0.05, 0.05)


class BareState(NamedTuple):
    """Belief, and current of the sample before."""

    belief: PackedBelief
    current_A: Any


class BareCell(NamedTuple):
    """`CellProblem` with the functions of `ohmward.filters` and nothing else: samples 1 s apart that are never bad.

    The covariance is the plain difference P - K S K' of the textbooks, where `TextbookFilter` has Joseph's form.
    """

    problem: CellProblem

    def start(self, drive: Drive) -> BareState:
        return BareState(pack(Belief(*self.problem.start)), float(drive.current_A[0]))

    def step(self, state: BareState, sample: SocSample) -> tuple[BareState, np.ndarray]:
        problem, y = self.problem, np.array([sample.voltage_V])
        mean_A = 0.5 * (sample.current_A + state.current_A)
        decay, push = problem.decays, problem.gain * mean_A
        if problem.rate:
            kept = np.exp(-problem.rate * abs(mean_A))
            decay, push = np.append(decay, kept), np.append(push, (1 - kept) * sign(mean_A))
        prior = kalman.predict(unpack(state.belief), np.diag(decay), problem.Q, push)
        correct = {"ekf": extended, "ukf": unscented}[problem.method].correct
        correction = correct(prior, y, lambda x: self.voltage(x, sample.current_A), np.array([[problem.R]]))
        after = apply_gain(prior, correction.innovation, correction.gain)
        return BareState(pack(after), sample.current_A), after.mean

    def voltage(self, x: np.ndarray, current_A: Any) -> np.ndarray:
        """(1,) in state x."""
        curve_V = table(OCV_V, 0.0, 1.0 / (len(OCV_V) - 1), x[0], kind="hermite")
        return np.array([curve_V + x[1:] @ self.problem.weights + self.problem.r0_ohm * current_A])


def curve_of(values: tuple[float, ...]) -> np.ndarray:
    """(4, K + 1): SciPy's monotone cubic on a uniform grid, lowest power first, and straight lines beyond its ends."""
    cubic = PchipInterpolator(np.arange(len(values)), values)
    slopes = cubic.derivative()([0, len(values) - 1])
    before = [values[0] - slopes[0], slopes[0], 0.0, 0.0]
    after = [values[-1], slopes[-1], 0.0, 0.0]
    return np.column_stack([before, cubic.c[::-1], after])


class JointProblem(NamedTuple):
    """x = [z_Cb, z_Cs, z_Re, z_R0, V_cb, V_cs, V], V measured, as plain numbers; see `TextbookJoint`.

    moves: dt / (2 C_b), dt / (2 C_s), 1 / R_e and R_0 at their nominal values.
    least: (7,) below which no state goes.
    """

    moves: tuple[float, float, float, float]
    least: np.ndarray
    Q: np.ndarray
    R: float
    window: float
    scaling: Scaling
    start: Posterior
    drive: Drive

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.least)

    def next_state(self, xp: Any, x: Any, mean_A: Any, now_A: Any) -> Any:
        return xp.stack(self.elements([x[..., k] for k in range(7)], mean_A, now_A), -1)

    def elements(self, x: Sequence[Any], mean_A: Any, now_A: Any) -> tuple:
        """The next state, element by element."""
        z_bulk, z_surface, z_r, z_instant, bulk_V, surface_V, V = x
        bulk, surface, g = self.moves[0] * z_bulk, self.moves[1] * z_surface, self.moves[2] * z_r
        across_A = g * (surface_V - bulk_V)
        instant_ohm = self.moves[3] * z_instant
        U = V - instant_ohm * (2 * mean_A - now_A)
        moved = (
            bulk_V + bulk * (across_A + mean_A),
            surface_V + surface * (mean_A - across_A),
            U + (surface - bulk) * g * (bulk_V - U) + (surface + bulk) * 0.5 * mean_A + instant_ohm * now_A,
        )
        return z_bulk, z_surface, z_r, z_instant, *moved


def joint_ours() -> TextbookJoint:
    """Our filter of that problem, started from the rule of [P] 2.2 for the capacitances."""
    total_F = rc_circuit.capacitance_for(CAPACITY_AH, OcvCurve(OCV_V))
    return TextbookJoint(Nominal(0.97 * total_F, 0.03 * total_F, 0.03, 0.06))


def joint_problem(steps: int) -> JointProblem:
    """The filter as `TextbookJoint` has it."""
    ours, drive = joint_ours(), make_drive(steps)
    c_bulk, c_surface, r, _ = ours.nominal
    belief = unpack(joint_start(ours, drive).belief)
    return JointProblem(
        (0.5 / c_bulk, 0.5 / c_surface, 1 / r, ours.instant_ohm),
        np.array([LEAST] * 4 + [-np.inf] * 3),
        np.diag(np.square(ours.walk)),
        ours.voltage_std_V**2,
        ours.window,
        scaling_of(len(belief.mean)),
        Posterior(belief.mean, belief.cov),
        drive,
    )


def joint_start(ours: TextbookJoint, drive: Drive) -> Any:
    """Our state before the log."""
    return ours.init(SocSample(*(float(c[0]) for c in drive.samples)))


def disagreement(found: Posterior, reference: Posterior) -> float:
    """Largest difference of the means in sigmas, and of the covariances in products of two."""
    sigma = np.sqrt(np.diag(reference.cov))
    means = np.abs(np.asarray(found.mean) - reference.mean) / sigma
    covs = np.abs(np.asarray(found.cov) - reference.cov) / np.outer(sigma, sigma)
    return float(max(means.max(), covs.max()))
