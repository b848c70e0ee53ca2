"""Band of the state of charge to expect from a battery file: on a working day, at any temperature, after one more test.

The robot drives from 90 % down to 30 %, with loads that change and a rest in every hour, while the filter of the file
runs. Battery and sensors do exactly what the file says, so that only the uncertainty in the file remains.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.chemistries import start_noise
from ohmward.battery.models.noise import CurrentSensor
from ohmward.battery.soc.causes import points
from ohmward.battery.soc.explanation import filtered
from ohmward.battery.soc.registry import EstimatorSettings, thevenin_filter
from ohmward.battery.soc.sample import INITIAL_SOC_STD, SocSample
from ohmward.battery.soc.thevenin_filter import TheveninFilter
from ohmward.filters.belief import unpack
from ohmward.quantities import SECONDS_PER_HOUR
from ohmward.trace import Kernel

#: The day: SoC at its start and at its end, mean load in multiples of the capacity per hour, rest in every hour [s].
START_SOC, END_SOC = 0.9, 0.3
FORECAST_LOAD_C = 0.25
REST_S = 600.0
#: Time between two samples, and time for which one load lasts [s].
FORECAST_STEP_S, LOAD_S = 10.0, 60.0
#: Loads of a day in multiples of the mean load, in turn: standing, driving, climbing, driving on.
LOADS = (0.2, 1.0, 2.0, 0.8)
#: The band counts from here on [s]: an unknown start needs its first rests.
COUNTED_FROM_S = 1800.0
#: Temperatures of the usual report on a battery [degC].
TEMPERATURES_DEGC = (25.0, 0.0, -10.0)


@dataclass(frozen=True)
class BandForecast:
    """Half width of the 95 % band, root mean square along the day, in points."""

    temperature_degC: float  #: of the day
    known_start: float  #: where the day begins with a SoC known to within 3 % (1 sigma)
    unknown_start: float  #: where SoC at the start comes from the first voltage


@dataclass(frozen=True)
class BandsAfterTest:
    """Bands at the usual temperatures if one test removed all uncertainty about what it measures."""

    test: str  #: in words, "after ..." or "with ..."
    bands: tuple[BandForecast, ...]  #: one for each temperature, unchanged where the test has no effect


def forecast(battery: Battery, temperatures_degC: Sequence[float] = TEMPERATURES_DEGC) -> tuple[BandForecast, ...]:
    """The bands of this battery file, from the extended filter."""
    settings = thevenin_filter("ekf")(battery, EstimatorSettings(battery.idle_current_A))
    first = SocSample(0.0, 0.0, np.nan, np.nan)
    kernel = Kernel(settings.step, settings.init(first, START_SOC), first, lowering="python")
    return tuple(
        BandForecast(T, band(settings, kernel, T, START_SOC), band(settings, kernel, T, None))
        for T in temperatures_degC
    )


def forecasts_after_tests(
    battery: Battery, temperatures_degC: Sequence[float] = TEMPERATURES_DEGC
) -> tuple[BandsAfterTest, ...]:
    """The bands after each test that the battery has not had, the one that narrows most first."""
    found = [BandsAfterTest(test, forecast(after, temperatures_degC)) for test, after in after_tests(battery).items()]
    return tuple(sorted(found, key=lambda after: _width(after.bands)))


def after_tests(battery: Battery) -> dict[str, Battery]:
    """The battery file after each test, at best: without the uncertainty that the test removes.

    A measured curve is known as well as that of a file made from a low-rate test and a label.
    """
    noise = battery.noise
    curve_V = max(start_noise(battery.chemistry, battery.n_series, ocv_known=True).model_std_V)
    curve_known = replace(
        noise,
        model_std_V=tuple(min(std, curve_V) for std in noise.model_std_V),
        soc_axis_std=0.0,
        full_soc_std=0.0,
        hysteresis_std=0.0,
        capacity_std=0.0,
    )
    idle_A = 0.0 if battery.idle_current_A is None else battery.idle_current_A
    exact = CurrentSensor(battery.sensor.noise_std_A, 0.0, 0.0, 0.0)
    return {
        "after a pulse test in the cold": replace(
            battery, noise=replace(noise, activation_std_K=0.0, ocv_std_V_per_K=0.0)
        ),
        "after a slow discharge and a slow charge": replace(battery, noise=curve_known),
        "after a discharge from full to empty": replace(battery, noise=replace(noise, capacity_std=0.0)),
        "after a new pulse test at room temperature": replace(
            battery, noise=replace(noise, resistance_std=0.0, capacity_std=noise.capacity_std_at_resistance)
        ),
        "with a declared rest current": replace(battery, idle_current_A=idle_A),
        "with a better current sensor": replace(battery, sensor=exact),
    }


def band(settings: TheveninFilter, kernel: Kernel, temperature_degC: float, soc: float | None) -> float:
    """Half width of the 95 % band, root mean square along the day, in points; soc: at the start, None if unknown."""
    day = working_day(settings, temperature_degC)
    first = SocSample(0.0, 0.0, settings.model.ocv.mean_V(START_SOC, temperature_degC), temperature_degC)
    state = settings.init(first, soc, INITIAL_SOC_STD)
    truth = unpack(settings.start(first, START_SOC, INITIAL_SOC_STD).belief).mean
    std = filtered(settings, kernel, state, truth, day).soc_std[np.cumsum(day.dt_s) > COUNTED_FROM_S]
    return points(float(np.mean(std**2)))


def working_day(settings: TheveninFilter, temperature_degC: float) -> SocSample:
    """Samples (T,) of the day, without their voltage."""
    drawn_s = (START_SOC - END_SOC) / FORECAST_LOAD_C * SECONDS_PER_HOUR
    count = int(drawn_s * SECONDS_PER_HOUR / (SECONDS_PER_HOUR - REST_S) / FORECAST_STEP_S)
    time_s = FORECAST_STEP_S * np.arange(1, count + 1)
    loads = np.array(LOADS)[(time_s / LOAD_S).astype(int) % len(LOADS)] / np.mean(LOADS)
    idle_A = settings.idle_current_A or 0.0
    current_A = np.where(
        time_s % SECONDS_PER_HOUR < SECONDS_PER_HOUR - REST_S,
        -FORECAST_LOAD_C * settings.model.capacity_Ah * loads,
        idle_A,
    )
    nothing = np.full(count, np.nan)
    return SocSample(np.full(count, FORECAST_STEP_S), current_A, nothing, np.full(count, temperature_degC))


#: A test that narrows the bands by less than this share is not worth its time.
WORTH_A_TEST = 0.05


def worthwhile_tests(battery: Battery, bands: Sequence[BandForecast]) -> list[BandsAfterTest]:
    """The bands after each test that narrows them, the best first; none if the file has no bands.

    bands: of the file as it is.
    """
    tests = forecasts_after_tests(battery) if bands else ()
    return [test for test in tests if 1.0 - _width(test.bands) / _width(bands) >= WORTH_A_TEST]


def _width(bands: Sequence[BandForecast]) -> float:
    return sum(band.known_start + band.unknown_start for band in bands)


def taken_as_exact(battery: Battery) -> list[str]:
    """Keys of [noise] that are 0 in the file, although no test determines their quantity exactly."""
    keys = ["capacity_std", "resistance_std", "activation_std_K", "ocv_std_V_per_K"]
    keys += ["hysteresis_std"] if any(battery.thevenin.ocv.hysteresis_V) else []
    return [key for key in keys if getattr(battery.noise, key) == 0.0]
