import random
import sys
import time
from types import SimpleNamespace

import pytest

from ohmward.onboard import clock as clock_module
from ohmward.onboard.clock import DELAY_WINDOW_S, LEAP_S, SourceClock


def link(seed=1, count=1000, interval_s=0.1):
    """True times, and receipts after a delay of 2 ms and a tail."""
    draw = random.Random(seed)
    times = [100.0 + interval_s * k for k in range(count)]
    return [(t, t + 0.002 + draw.expovariate(100.0)) for t in times]


def on_ours(clock, stamp_s, received_s):
    """Time of the newest measurement on our clock [s]."""
    clock.observe(stamp_s, received_s)
    return clock.time_s(stamp_s)


def errors(clock, stamps):
    return [on_ours(clock, stamp, received) - true for true, received, stamp in stamps]


def test_the_offset_is_found_and_jitter_goes():
    found = errors(SourceClock(), [(t, received, t - 57.3) for t, received in link()])
    assert max(map(abs, found[50:])) < 0.004
    assert max(found) <= 0.05


def test_a_measurement_is_never_after_its_receipt():
    clock = SourceClock()
    for t, received in link():
        assert on_ours(clock, t - 3.0, received) <= received


@pytest.mark.parametrize("rate", [1 + 200e-6, 1 - 200e-6])
def test_a_clock_that_drifts_is_followed(rate):
    found = errors(SourceClock(), [(t, received, rate * t) for t, received in link(count=20_000)])
    assert max(map(abs, found[1000:])) < 0.012


@pytest.mark.parametrize("leap_s", [3600.0, -3600.0, 5.0, -5.0])
def test_a_clock_that_is_set_is_followed_at_once(leap_s):
    clock = SourceClock()
    rows = [(t, received, t + (leap_s if t > 150.0 else 0.0)) for t, received in link()]
    found = errors(clock, rows)
    assert max(map(abs, found[50:])) < 0.03
    assert clock.steps == 1


@pytest.mark.parametrize("leap_s", [0.9, 0.15])
def test_a_clock_that_is_set_ahead_by_little_is_followed_at_once(leap_s):
    clock = SourceClock()
    rows = [(t, received, t + (leap_s if t > 150.0 else 0.0)) for t, received in link()]
    found = errors(clock, rows)
    assert leap_s < LEAP_S
    assert max(map(abs, found[510:])) < 0.03


@pytest.mark.parametrize("leap_s", [-0.9, -0.5, -0.15])
@pytest.mark.parametrize("interval_s", [0.02, 0.1])
def test_a_clock_that_is_set_back_by_little_is_followed_within_a_second(leap_s, interval_s):
    clock = SourceClock()
    rows = [
        (t, received, t + (leap_s if t > 150.0 else 0.0)) for t, received in link(interval_s=interval_s, count=4000)
    ]
    found = errors(clock, rows)
    after = [error for error, (t, _, _) in zip(found, rows, strict=True) if t > 151.0]
    assert max(map(abs, after)) < 0.03
    assert clock.steps == 1


def test_a_link_that_becomes_slower_is_followed_within_a_window():
    """No stamp goes back: the messages were measured before, until the link has been slow for long."""
    clock = SourceClock()
    rows = [(t, received + (0.5 if t > 150.0 else 0.0), t) for t, received in link()]
    found = errors(clock, rows)
    assert max(map(abs, found[50:600])) < 0.005
    assert max(abs(error - 0.5) for error in found[500 + int(10 * DELAY_WINDOW_S) + 2 :]) < 0.005
    assert clock.steps == 0


def test_jitter_that_lets_messages_overtake_each_other_is_no_step():
    draw = random.Random(1)
    rows = sorted(
        ((t, t + draw.expovariate(50.0), t) for t, _ in link(count=50_000, interval_s=0.02)), key=lambda row: row[1]
    )
    clock = SourceClock()
    assert max(map(abs, errors(clock, rows)[100:])) < 0.02
    assert clock.steps == 0


def test_a_burst_after_a_silence_keeps_its_times():
    """The link stands still for 20 s; all messages come at once then, each with its own stamp."""
    rows = [(t, max(received, 170.0) if 150.0 < t < 170.0 else received, t) for t, received in link()]
    clock = SourceClock()
    found = errors(clock, rows)
    assert max(map(abs, found[50:])) < 0.004
    assert clock.steps == 0


def test_messages_that_overtake_each_other_are_no_steps():
    rows = [(t, received, t) for t, received in link()]
    for k in range(100, 900, 50):
        rows[k] = rows[k][0], rows[k + 3][1] + 0.001, rows[k][2]
    rows.sort(key=lambda row: row[1])
    clock = SourceClock()
    assert max(map(abs, errors(clock, rows)[50:])) < 0.004
    assert clock.steps == 0


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems have a clock module")
@pytest.mark.parametrize(
    ("module_s", "status", "is_set"),
    [(1.0, 5, True), (-1e6, 5, False), (None, 5, False), (None, 0, True), (-1e6, 0, True)],
    ids=["module", "module without a battery", "nothing", "network", "network and a module without a battery"],
)
def test_a_wall_clock_is_set_by_a_module_or_the_network(tmp_path, monkeypatch, module_s, status, is_set):
    if module_s is not None:
        (tmp_path / "rtc0").mkdir()
        (tmp_path / "rtc0" / "since_epoch").write_text(f"{time.time() + module_s:.0f}\n")
    monkeypatch.setattr(clock_module, "_CLOCK_MODULES", tmp_path)
    monkeypatch.setattr(clock_module.ctypes, "CDLL", lambda _: SimpleNamespace(adjtimex=lambda _: status))
    assert clock_module.SystemClock().is_set() == is_set
