"""Settings of all tests."""

import gc
import os
from dataclasses import replace

import pytest
from hypothesis import settings

from needs import CHROMIUM

# Traced programs are many objects that live long; at the usual threshold the collector walks through them all the time.
gc.set_threshold(100_000, 20, 20)

# An example that takes long beside other work is no failure; tests of speed measure by themselves.
settings.register_profile("ohmward", deadline=None)
settings.load_profile("ohmward")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """One worker more than processors: tests of the process on the robot wait for servers and clocks."""
    return len(os.sched_getaffinity(0)) + 1 if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1) + 1


@pytest.fixture
def short_drives(monkeypatch):
    """Simulated drives in which all comes in two fifths of the time: each second takes one of a processor."""
    from ohmward_lab.simulate import closed_loop

    whole = closed_loop.find_scenario

    def short(name):
        found = whole(name)
        commands = tuple(replace(command, from_s=0.4 * command.from_s) for command in found.commands)
        return replace(found, duration_s=0.4 * found.duration_s, commands=commands)

    monkeypatch.setattr(closed_loop, "find_scenario", short)


@pytest.fixture
def in_python(monkeypatch):
    """Estimators in Python: the samples of a short test take less time than the compilation of a step, a second."""
    monkeypatch.setenv("OHMWARD_LOWERING", "python")


@pytest.fixture
def quickly_compiled(monkeypatch):
    """Twins without the compiler's optimisation, which takes seconds for large filters; the bits are the same."""
    from ohmward.embedded import twin

    monkeypatch.setattr(twin, "FLAGS", tuple(flag.replace("-O2", "-O0") for flag in twin.FLAGS))


@pytest.fixture(scope="module")
def browser():
    """Chromium, or a skip. Not for the session: while it runs, no other test can run an event loop."""
    playwright = pytest.importorskip("playwright.sync_api")
    if CHROMIUM is None:
        pytest.skip("needs Chromium (Debian: apt-get install chromium)")
    arguments = ["--no-sandbox", "--disable-gpu", "--disable-background-networking"]
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=arguments)
        yield browser
        browser.close()
