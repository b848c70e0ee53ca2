"""A log is known again whole, in part, with fewer samples and with another clock; another log never is."""

from dataclasses import replace

import numpy as np
import pytest

from ohmward.battery.fingerprint import fingerprint, overlap_s, unlearnt_parts
from ohmward.logs import Log

HOUR_S = 3600.0


def mission(seed: int = 0, hours: float = 4.0, dt_s: float = 1.0, noise_seed: int | None = None) -> Log:
    """A drive with loads that change every half minute; the noise of its sensors is drawn anew for each seed."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(0.0, hours * HOUR_S, dt_s)
    current_A = -np.repeat(rng.uniform(0.0, 8.0, int(hours * 120) + 1), int(30 / dt_s))[: time_s.size]
    soc = 1.0 + np.cumsum(current_A) * dt_s / HOUR_S / 40.0
    noise = np.random.default_rng(seed if noise_seed is None else noise_seed)
    voltage_V = 3.3 + 0.8 * soc + 0.02 * current_A + 0.004 * noise.standard_normal(time_s.size)
    return Log(f"drive {seed}", time_s, current_A + 0.01 * noise.standard_normal(time_s.size), voltage_V)


def from_zero(log: Log) -> Log:
    return replace(log, time_s=log.time_s - log.time_s[0])


def test_a_log_seen_twice_has_nothing_new():
    log = mission()
    assert unlearnt_parts(log, [fingerprint(log)]) == ()
    assert overlap_s(log, fingerprint(log)) == pytest.approx((0.0, log.duration_s), abs=1e-3)


def test_without_fingerprints_everything_is_new():
    log = mission()
    assert unlearnt_parts(log, []) == (log,)
    assert unlearnt_parts(log, [fingerprint(mission(1)), ""]) == (log,)


@pytest.mark.parametrize("first, last", [(0.0, 0.5), (0.5, 1.0), (0.37, 0.62), (0.1, 0.3)])
def test_a_part_is_known_by_the_whole_whatever_its_clock(first, last):
    log = mission()
    part = from_zero(log.between(first * log.duration_s, last * log.duration_s))
    assert unlearnt_parts(part, [fingerprint(log)]) == ()
    shared = overlap_s(log, fingerprint(part))
    assert shared is not None
    start_s, stop_s = shared
    assert start_s == pytest.approx(first * log.duration_s, abs=2.0)
    assert stop_s - start_s == pytest.approx(part.duration_s, abs=2.0)


def test_only_the_rest_of_a_log_is_new_when_its_first_half_was_seen():
    log = mission()
    first, second = log.between(0.0, 7200.0), log.between(7200.0, np.inf)
    (new,) = unlearnt_parts(log, [fingerprint(from_zero(first))])
    assert new.time_s[0] == pytest.approx(7200.0, abs=2.0)
    assert new.time_s[-1] == log.time_s[-1]
    assert unlearnt_parts(log, [fingerprint(first), fingerprint(from_zero(second))]) == ()


def test_two_logs_that_overlap_are_told_apart():
    log = mission()
    first, second = log.between(0.0, 9000.0), from_zero(log.between(6000.0, np.inf))
    (new,) = unlearnt_parts(second, [fingerprint(first)])
    assert new.time_s[0] == pytest.approx(3000.0, abs=2.0)


@pytest.mark.parametrize("every", [2, 5, 20])
def test_a_log_with_fewer_samples_is_the_same_log(every):
    log = mission()
    thin = from_zero(log.select(slice(3, None, every)))
    assert unlearnt_parts(thin, [fingerprint(log)]) == ()
    assert unlearnt_parts(log, [fingerprint(thin)]) == ()


def test_a_log_of_means_is_the_same_log():
    log = mission()
    time_s, current_A, voltage_V = (a.reshape(-1, 10).mean(axis=1) for a in (log.time_s, log.current_A, log.voltage_V))
    assert unlearnt_parts(Log("means", time_s - time_s[0], current_A, voltage_V), [fingerprint(log)]) == ()


def test_a_few_samples_that_were_repaired_do_not_make_it_another_log():
    log = mission()
    voltage_V = log.voltage_V.copy()
    voltage_V[1000:1030] = np.nan
    assert unlearnt_parts(replace(log, voltage_V=voltage_V), [fingerprint(log)]) == ()


def test_the_same_mission_driven_again_is_another_log():
    """Equal loads from an equal start: only the noise of the sensors differs."""
    again = mission(0, noise_seed=1)
    assert unlearnt_parts(again, [fingerprint(mission(0))]) == (again,)


def test_a_mission_of_another_day_is_another_log_at_any_rate():
    day = replace(mission(0), start_unix_s=1.7e9)
    again = replace(mission(0, noise_seed=1).select(slice(0, None, 5)), start_unix_s=1.7e9 + 86400.0)
    assert unlearnt_parts(again, [fingerprint(day)]) == (again,)


def test_wall_clocks_find_a_log_that_was_thinned_too_much_to_be_found_by_its_content():
    """Loads that change every half minute, sampled every 20 s."""
    day = replace(mission(0), start_unix_s=1.7e9)
    thin = from_zero(day.select(slice(600, None, 20)))
    thin = replace(thin, start_unix_s=1.7e9 + 600.0)
    assert unlearnt_parts(thin, [fingerprint(day)]) == ()


def test_a_rest_says_nothing_about_the_day():
    time_s = np.arange(0.0, 3600.0, 10.0)
    rest = Log("rest", time_s, np.zeros(time_s.size), np.full(time_s.size, 3.7))
    assert unlearnt_parts(rest, [fingerprint(rest)]) == (rest,)


def test_other_logs_are_never_known():
    logs = [mission(seed, hours) for seed in range(6) for hours in (0.5, 3.0)]
    texts = {(log.name, log.duration_s): fingerprint(log) for log in logs}
    for log in logs:
        others = [text for key, text in texts.items() if key[0] != log.name]
        assert unlearnt_parts(log, others) == (log,)


def test_the_size_of_a_fingerprint_grows_slowly():
    assert len(fingerprint(mission(0, 1.0))) < 400
    time_s = np.arange(0.0, 10 * 86400.0, 60.0)
    weeks = Log("weeks", time_s, -1.0 - np.sin(time_s / 7e3), 3.7 + 0.2 * np.sin(time_s / 5e4))
    assert len(fingerprint(weeks)) < 3000


def test_a_log_of_one_sample_has_no_fingerprint():
    log = Log("one", np.zeros(1), np.ones(1), np.full(1, 3.7))
    assert fingerprint(log) == ""
    assert unlearnt_parts(log, [fingerprint(mission())]) == (log,)
