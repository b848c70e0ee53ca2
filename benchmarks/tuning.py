"""Noise tuned to simulated days whose noise is known: `python benchmarks/tuning.py` writes tuning.md, in ten minutes.

The days are drawn from the noise model itself, along the shifts of `ohmward assess`, for a battery file whose noise is
then made ten times too large or too small. The last table is of logs that are not drawn from it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from figure import HERE
from ohmward.battery.battery import Battery
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.sample import SocSample
from ohmward.battery.tuning.noise_model import NoiseModel, with_factors
from ohmward.battery.tuning.tune import tune_noise
from ohmward.filters.consistency import BAND_95
from ohmward.logs import Log
from ohmward_lab.assess import lives
from ohmward_lab.assess.battery import BASE
from ohmward_lab.assess.simulated_logs import simulated_log

#: Days that a file is tuned to, and other days of the same battery on which its band is judged.
DAYS, OTHERS = 4, 8
SEEDS = (1, 2)
WRONG = (10.0, 0.1)
#: Truths outside of this have left the curve of the battery.
SOC_RANGE = (0.05, 1.0)

Days = list[tuple[Log, np.ndarray]]


def main() -> None:
    rows = [row for chemistry in lives.CHEMISTRIES for seed in SEEDS for row in measured(chemistry, seed)]
    sensors = [sensor_row(chemistry) for chemistry in lives.CHEMISTRIES]
    (HERE / "tuning.md").write_text(page(rows, sensors), encoding="utf-8")


def known_battery(chemistry: str) -> Battery:
    """A battery file that knows its battery well: the truth of the days."""
    battery = lives.identified(chemistry)
    noise = replace(battery.noise, capacity_std=0.01, resistance_std=0.1, activation_std_K=0.0)
    return replace(battery, noise=noise)


def drawn_days(battery: Battery, chemistry: str, count: int, seed: int) -> Days:
    """So many days, each with its true state of charge."""
    condition = BASE._replace(factor=f"tuning {seed}", offset_C=0.0)
    samples, truth = lives.measured(chemistry, condition, 2 * count, seed)
    rng, days = np.random.default_rng(seed), []
    for run in range(2 * count):
        one = SocSample(samples.dt_s, *(values[:, run] for values in samples[1:]))
        log, soc = simulated_log(NoiseModel(battery), f"day {run}", one, float(truth[0, run]), rng)
        if SOC_RANGE[0] < soc.min() and soc.max() < SOC_RANGE[1]:
            days.append((log, soc))
    return days[:count]


def covered(battery: Battery, days: Days) -> tuple[float, float]:
    """Share of the samples with the truth in the 95 % band of the default estimator, and its RMSE."""
    inside, squares = [], []
    for log, soc in days:
        found = SocEstimator(battery).run(log).estimates
        inside.append(np.mean(np.abs(found.soc - soc) < BAND_95 * found.soc_std))
        squares.append(np.mean((found.soc - soc) ** 2))
    return float(np.mean(inside)), float(np.sqrt(np.mean(squares)))


def measured(chemistry: str, seed: int) -> Iterator[str]:
    """Rows of a chemistry: the file ten times too unsure, and too sure."""
    truth = known_battery(chemistry)
    days = drawn_days(truth, chemistry, DAYS + OTHERS, seed)
    best = covered(truth, days[DAYS:])
    for wrong in WRONG:
        file = replace(truth, noise=with_factors(truth.noise, np.array([wrong, wrong, 1.0])))
        tuning = tune_noise(file, [log for log, _ in days[:DAYS]])
        right_factors = (1.0 / wrong, 1.0 / wrong, 1.0)
        cells = [
            "not told" if one.refused else f"{one.factor / right:.2f}"
            for one, right in zip(tuning.factors, right_factors, strict=True)
        ]
        bands = [covered(file, days[DAYS:]), covered(tuning.battery, days[DAYS:]), best]
        cells += [f"{100 * share:.0f} %, {100 * rmse:.1f}" for share, rmse in bands]
        print(row := f"| {chemistry}, seed {seed} | x {wrong:g} | {' | '.join(cells)} |", flush=True)
        yield row


def sensor_row(chemistry: str) -> str:
    """The voltage noise of the sensors of `ohmward assess`, which this model did not draw."""
    battery, cells = lives.identified(chemistry), lives.BATTERIES[chemistry].n_series
    samples, _ = lives.measured(chemistry, BASE, 2, 9)
    logs = [
        Log(f"shift {run}", np.cumsum(samples.dt_s), *(values[:, run] for values in samples[1:])) for run in range(2)
    ]
    factor = tune_noise(battery, logs).factors[0]
    found, low, high = (1e3 * value * battery.noise.voltage_std_V for value in factor[1:4])
    model = battery.thevenin
    assert model is not None
    ohmic_V = float(np.mean(model.r0_discharge_ohm)) * BASE.current_noise_C * model.capacity_Ah
    parts = (cells * BASE.voltage_noise_V, cells * BASE.voltage_step_V / np.sqrt(12), ohmic_V)
    truth = 1e3 * float(np.sqrt(np.sum(np.square(parts))))
    print(row := f"| {chemistry} | {truth:.2f} mV | {found:.2f} mV | {low:.2f} to {high:.2f} mV |", flush=True)
    return row


def page(rows: list[str], sensors: list[str]) -> str:
    """The page."""
    return "\n".join(
        [
            "# Noise by maximum likelihood",
            "",
            f"Written by `python benchmarks/tuning.py`. Tuned to {DAYS} shifts of 8 h without a truth, whose noise is",
            f"known; judged on {OTHERS} others, from an unknown start: share of the samples with the truth in the 95 %",
            "band, and RMSE in points. A factor of 1 is right.",
            "",
            "| battery | noise of the file | voltage noise | error of the model | time for which it holds on | "
            "covered by the file | tuned | with the right noise |",
            "|---|---|---|---|---|---|---|---|",
            *rows,
            "",
            "White noise of simulated sensors (noise, steps of the converter, and noise of the current times the ohmic",
            "resistance, which is in every voltage), on shifts that this model did not draw:",
            "",
            "| battery | truth | tuned | 95 % |",
            "|---|---|---|---|",
            *sensors,
            "",
        ]
    )


if __name__ == "__main__":
    main()
