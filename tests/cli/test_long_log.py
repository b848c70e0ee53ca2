"""A million samples through `ohmward soc`: the memory they may take, and the same numbers as in two halves."""

import json
import subprocess
import sys

import numpy as np
import pytest

from cli.examples import MODEL, battery
from ohmward.battery.file import load_battery, save_battery
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.registry import EstimatorSettings, make_estimator
from ohmward.logs import Log, read_log, write_log
from ohmward_lab.simulate.voltage import simulate_voltage

pytest.importorskip("pyarrow")
resource = pytest.importorskip("resource")
pytestmark = pytest.mark.slow

SAMPLES = 1_000_000
#: The peak of a process counts the memory of the one that forked it, so a small one starts it.
LAUNCHER = """
import json, resource, subprocess, sys
done = subprocess.run(sys.argv[1:], check=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
print(json.dumps([json.loads(done.stdout), resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024]))
"""


def long_log(samples=SAMPLES) -> Log:
    """A day at some 10 Hz, with jitter, gaps and values that are missing."""
    rng = np.random.default_rng(2)
    dt_s = 0.1 + 0.01 * rng.standard_normal(samples).clip(-3, 3)
    dt_s[[1000, 50_000]] = 60.0
    time_s = np.cumsum(dt_s)
    current_A = 3.0 * np.sign(np.sin(time_s / 37.0)) * (np.sin(time_s / 700.0) > -0.7)
    voltage_V = simulate_voltage(MODEL, Log("l", time_s, current_A, np.zeros(samples)), 0.6).voltage_V
    voltage_V = voltage_V + 0.005 * rng.standard_normal(samples)
    temperature_degC = np.where(rng.random(samples) < 0.9, np.nan, 25.0 + np.sin(time_s / 1e4))
    for values in (current_A, voltage_V):
        values[rng.random(samples) < 0.001] = np.nan
    return Log("long", time_s, current_A, voltage_V, temperature_degC)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("long")
    save_battery(battery(), folder / "battery.toml")
    log = long_log()
    write_log(log, folder / "long.parquet")
    write_log(log.select(slice(0, SAMPLES // 10)), folder / "short.parquet")
    return folder


def soc(folder, name):
    """The object of --json and the peak of the memory [bytes]."""
    words = ["soc", f"{name}.parquet", "--battery", "battery.toml", "--json", "-o", f"{name}-estimates.parquet"]
    command = [sys.executable, "-S", "-c", LAUNCHER, sys.executable, "-m", "ohmward", *words]
    out = subprocess.run([*command, "--report", f"{name}.html"], cwd=folder, check=True, stdout=subprocess.PIPE)
    return json.loads(out.stdout)


@pytest.fixture(scope="module")
def runs(folder):
    soc(folder, "short")  # compiles the filter, so that neither of the two is measured with the compiler's memory
    return soc(folder, "long"), soc(folder, "short")


def test_a_million_samples_take_less_than_240_bytes_each(folder, runs):
    (long, peak), (short, least) = runs
    assert long["steps"] > 0.99 * SAMPLES > 9.8 * short["steps"]
    assert (peak - least) / (long["steps"] - short["steps"]) < 240
    assert (folder / "long.html").stat().st_size < 16 * SAMPLES  # its figures hold every sample


@pytest.mark.usefixtures("runs")
def test_the_estimates_are_those_of_two_halves(folder):
    written = read_log(folder / "long-estimates.parquet", current_sign="charge")
    log = read_log(folder / "long.parquet", extra=())
    estimator = SocEstimator(
        make_estimator("default", load_battery(folder / "battery.toml"), EstimatorSettings()), lowering="machine"
    )
    halves = [estimator.run(log.select(part)).estimates for part in (slice(0, 500_000), slice(500_000, None))]
    for name in ("soc", "soc_std", "innovation_V", "flags"):
        np.testing.assert_array_equal(written.extra[name], np.concatenate([getattr(h, name) for h in halves]))
