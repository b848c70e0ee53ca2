"""Battery packages with filters of their own on models of their own: what their users get for a step.

Their numbers are not ours: another model each. PyBatterySE's is identified by its companion PyBatteryID from the same
drive, ProgPy's is its equivalent circuit as it comes.
"""

from __future__ import annotations

import contextlib
import io
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from importlib import import_module
from typing import Any

import numpy as np

from peers import Absent
from timing import Times, measure
from workloads import CAPACITY_AH, OCV_V, START_SOC, Drive, make_drive

STEPS, FIT_STEPS = 100, 4000


def battery_packages(repeats: int) -> Iterator[tuple[str, str, Times | Absent]]:
    """Package, filter, and time of a step or what is missing."""
    runs: dict[tuple[str, str], Callable[[], object]] = {}
    absent = []
    for title, package, make in (("PyBatterySE", "pybatteryse", pybatteryse), ("ProgPy", "progpy", progpy)):
        try:
            import_module(package)
        except ModuleNotFoundError:
            absent.append((title, "", Absent(title, package)))
            continue
        with quiet():
            runs |= {(title, how): run for how, run in make().items()}
    with quiet():
        times = measure(runs, repeats)
    yield from ((title, how, t.per(STEPS)) for (title, how), t in times.items())
    yield from absent


def pybatteryse() -> dict[str, Callable[[], object]]:
    """Its extended filter of charge and overpotentials, and with the capacity too."""
    from pybatteryid.identification import identify_model
    from pybatteryid.modelstructure import ModelStructure
    from pybatteryse import load_filter, load_statespace_representation

    drive, capacity_As = make_drive(FIT_STEPS), 3600.0 * CAPACITY_AH
    structure = ModelStructure(battery_capacity=capacity_As, sampling_period=1)
    soc = np.linspace(0.0, 1.0, len(OCV_V))
    structure.add_emf_function({"soc_values": soc, "voltage_values": np.array(OCV_V)})
    structure.add_basis_functions(["1/s", "log[s]", "s"])
    model = identify_model(
        dataset(drive) | {"initial_soc": START_SOC, "time_values": np.arange(FIT_STEPS)},
        structure,
        model_order=2,
        nonlinearity_order=1,
        optimizers=["ridgecv.sklearn"],
    )

    def run(filter_: Any, mean: np.ndarray, cov: np.ndarray) -> object:
        return filter_.run(dataset=dataset(drive.first(STEPS + 1)), initial_state=mean, initial_covariance=cov)

    runs = {}
    for how, parts, extra in (
        ("EKF, charge and overpotentials, 3 states", ["s", "overpotentials"], []),
        ("joint EKF, with the capacity, 4 states", ["s", "overpotentials", "capacity"], [capacity_As]),
    ):
        space = load_statespace_representation(model, state_components=parts)
        filter_ = load_filter(
            space,
            "extended_kalman_filter",
            variance_eta_u=1e-3,
            variance_eta_y_e=1e-4,
            variance_eta_capacity=0.1 if extra else None,
        )
        mean = np.array([START_SOC, *[0.0] * model.model_order, *extra])
        cov = np.diag([2.5e-3, *[1e-6] * model.model_order, *(1e4 for _ in extra)])
        runs[how] = partial(run, filter_, mean, cov)
    return runs


def dataset(drive: Drive) -> dict[str, np.ndarray]:
    return {"current_values": drive.current_A, "voltage_values": drive.voltage_V}


def progpy() -> dict[str, Callable[[], object]]:
    """Its unscented filter and its particle filter on its equivalent circuit: two outputs, voltage and temperature."""
    from progpy.models import BatteryCircuit
    from progpy.state_estimators import ParticleFilter, UnscentedKalmanFilter
    from progpy.uncertain_data import MultivariateNormalDist

    battery = BatteryCircuit()
    start = battery.initialize()
    labels, mean = list(start.keys()), np.array(list(start.values()), dtype=float)
    belief = MultivariateNormalDist(labels, mean, np.diag([1e-2, 1e2, 1.0, 1.0]))
    state, samples = start, []
    for k, i in enumerate(np.abs(make_drive(STEPS).current_A)):
        u = battery.InputContainer({"i": i})
        state = battery.next_state(state, u, 1.0)
        samples.append((k + 1.0, u, battery.output(state)))

    def run(make: Callable[[], Any]) -> None:
        filter_ = make()
        for sample in samples:
            filter_.estimate(*sample)

    unscented = partial(UnscentedKalmanFilter, battery, belief, dt=1.0)
    particles = partial(ParticleFilter, battery, belief, num_particles=100, dt=1.0)
    return {
        "UKF on BatteryCircuit, 4 states, 2 outputs": partial(run, unscented),
        "particle filter on it, 100 particles": partial(run, particles),
    }


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Without progress bars and warnings."""
    with (
        warnings.catch_warnings(),
        contextlib.redirect_stderr(io.StringIO()),
        contextlib.redirect_stdout(io.StringIO()),
    ):
        warnings.simplefilter("ignore")
        yield
