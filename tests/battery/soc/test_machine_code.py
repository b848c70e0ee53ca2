"""Machine code against Python floats, for every estimator, on a log in which everything goes wrong at once."""

import math

import numpy as np
import pytest

from battery.examples import NMC, drive, simulate
from kernels import kernel_of
from ohmward.battery.battery import Battery
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.registry import ESTIMATORS, EstimatorSettings, make_estimator
from ohmward.battery.soc.sample import SocEstimate, SocFlag, SocSample
from ohmward.logs.log import Log

pytest.importorskip("llvmlite")

NAN, INF = math.nan, math.inf
STEPS = 3000
BATTERY = Battery("cell", NMC.capacity_Ah, voltage_min_V=2.5, voltage_max_V=4.2, thevenin=NMC, idle_current_A=0.0)
FAULTS: dict[str, tuple[float, ...]] = {
    "dt_s": (0.0, -3.0, NAN, INF, 90.0, 2000.0, 1e9),
    "current_A": (NAN, INF, -INF, 1000.0),
    "voltage_V": (NAN, INF, 0.0, 2.0, 100.0),
    "temperature_degC": (NAN, INF, -300.0, 60.0),
}


def faulty_samples() -> SocSample:
    """A drive at intervals from 0.05 to 20 s; one sample in thirty carries a fault, some faults last for a while."""
    rng = np.random.default_rng(5)
    truth = simulate(NMC, drive(rng, STEPS, -0.1, rest_every=3), 0.8)
    dt_s = 10.0 ** rng.uniform(-1.3, 1.3, STEPS)
    columns = [dt_s, truth.current_A + 0.01, truth.voltage_V, 20.0 + 5.0 * rng.standard_normal(STEPS)]
    columns[0][0] = 0.0
    samples = SocSample(*columns)
    for name, values in FAULTS.items():
        for at in rng.integers(1, STEPS, STEPS // 30):
            lasting = 1 if name == "dt_s" else int(rng.integers(1, 4))
            getattr(samples, name)[at : at + lasting] = rng.choice(values)
    samples.voltage_V[1000:1100] = NAN
    samples.current_A[1500:1560] = NAN
    samples.temperature_degC[:200] = NAN
    return samples


SAMPLES = faulty_samples()


def scanned(name: str, lowering: str) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Estimates by field, and the scalars of the last state."""
    estimator = make_estimator(name, BATTERY, EstimatorSettings(idle_current_A=0.0))
    state = estimator.init(SocSample(*(float(c[0]) for c in SAMPLES)))
    kernel = kernel_of(estimator, state, SocSample(0.0, 0.0, 0.0, 0.0), lowering=lowering)
    after, estimates = kernel.scan(state, SAMPLES)
    return estimates._asdict(), np.array(flat(after))


def flat(tree) -> list[float]:
    if isinstance(tree, tuple):
        return [x for part in tree for x in flat(part)]
    return np.ravel(tree).tolist()


@pytest.mark.parametrize("name", ESTIMATORS)
def test_machine_code_is_python_on_a_log_with_every_fault(name):
    (expected, last), (found, also_last) = (scanned(name, lowering) for lowering in ("python", "machine"))
    np.testing.assert_array_equal(found["flags"], expected["flags"])
    for field in SocEstimate._fields:
        np.testing.assert_allclose(found[field], expected[field], rtol=1e-9, atol=1e-9, err_msg=field)
    np.testing.assert_allclose(also_last, last, rtol=1e-9, atol=1e-9)


def test_the_log_has_every_fault():
    flags = np.bitwise_or.reduce(scanned("ekf", "python")[0]["flags"].astype(int))
    wanted = (
        SocFlag.NO_CURRENT
        | SocFlag.NO_VOLTAGE
        | SocFlag.BAD_TIME
        | SocFlag.GAP
        | SocFlag.VOLTAGE_REJECTED
        | SocFlag.REST
    )
    assert flags & wanted == wanted


@pytest.mark.parametrize("temperature", [True, False])
def test_a_log_with_gaps_and_missing_values_is_the_same_from_both(temperature):
    dt_s = np.where(np.isfinite(SAMPLES.dt_s) & (SAMPLES.dt_s > 0.0), SAMPLES.dt_s, 0.1)
    degC = SAMPLES.temperature_degC if temperature else None
    log = Log("faulty", np.cumsum(np.minimum(dt_s, 2000.0)), SAMPLES.current_A, SAMPLES.voltage_V, degC)
    one, other = (
        SocEstimator(make_estimator("ekf", BATTERY), 0.8, lowering=lowering).run(log)
        for lowering in ("python", "machine")
    )
    assert one.counts() == other.counts()
    assert one.counts()["gap"] > 0
    for field, expected in one.estimates._asdict().items():
        np.testing.assert_allclose(getattr(other.estimates, field), expected, rtol=1e-9, atol=1e-9, err_msg=field)
