"""Any bits for a sample: what is exported survives, and gives numbers again once its sensors do."""

from collections.abc import Callable, Mapping
from functools import cache, partial

import numpy as np
import pytest

from embedded.batteries import BATTERY as PACK
from embedded.batteries import soc_library
from needs import needs_gcc
from ohmward.battery.soc.registry import available
from ohmward.embedded import Twin, controller_export, library, observer_export, write_library
from ohmward.embedded.traction import CONTROLLERS
from ohmward.embedded.twin import first_of
from ohmward.traction import RLMA, hard_terrain

pytest.importorskip("cffi", reason="pip install cffi for the twin")
pytestmark = needs_gcc
TRIALS, WILD_STEPS, GOOD_STEPS = 20, 100, 1000
BATTERY = np.array([1.0, -1.0, 13.2, 25.0])
DRIVE = np.array([0.01, 1.0, 1.0, 1.0, 1.0, 0.1, 0.1, *[np.nan] * 6])
WHEEL = np.array([0.1, 1.0, 5.0, 0.4, 0.0, 0.0, np.nan, np.nan, 0.001])
#: Not these: textbook-joint believes any current, as published.
NOT_THESE = {"textbook-joint"}


@cache
def controller_library(name):
    return library(controller_export(RLMA, name, "it"))


EXPORTS: dict[str, tuple[Callable[[], Mapping[str, str]], np.ndarray, str]] = {
    **{name: (partial(soc_library, name), BATTERY, "soc") for name in available(PACK) if name not in NOT_THESE},
    "observer": (lambda: library(observer_export(RLMA, hard_terrain("dry asphalt"), "ekf")), DRIVE, "speed_m_s"),
    **{name: (partial(controller_library, name), WHEEL, "torque_Nm") for name in CONTROLLERS},
}


def tree(twin, rows):
    """Samples of the twin from rows (T, n) of scalars."""
    sizes = [int(np.prod(twin.dtype("sample")[word].shape)) for word in twin.Sample._fields]
    parts = np.split(rows, np.cumsum(sizes)[:-1], axis=1)
    shapes = [twin.dtype("sample")[word].shape for word in twin.Sample._fields]
    return twin.Sample(*(part.reshape(len(rows), *shape) for part, shape in zip(parts, shapes, strict=True)))


def wild(rng, good):
    """Samples near the good one of which every third value has any bits at all."""
    shape = (WILD_STEPS, len(good))
    bits = rng.integers(0, 2**32, shape, dtype=np.uint64).astype(np.uint32).view(np.float32)
    near = good * rng.normal(1.0, 1.0, shape)
    return np.where(rng.random(shape) < 0.3, bits, near)


@pytest.mark.filterwarnings("ignore:invalid value encountered in cast:RuntimeWarning")
@pytest.mark.parametrize("name", EXPORTS)
@pytest.mark.usefixtures("quickly_compiled")
def test_numbers_come_back_after_any_samples(name, tmp_path):
    files, good, output = EXPORTS[name]
    assert_numbers_come_back(files(), good, output, tmp_path)


def assert_numbers_come_back(files, good, output, tmp_path):
    write_library(files, tmp_path)
    twin, rng = Twin(tmp_path), np.random.default_rng(0)
    for k in range(TRIALS):
        first = np.full_like(good, np.nan) if k % 2 else wild(rng, good)[0]
        twin.start(first_of(tree(twin, first[None])), **twin.example)
        twin.run(tree(twin, wild(rng, good)))
        after = twin.run(tree(twin, np.tile(good, (GOOD_STEPS, 1))))
        assert np.isfinite(getattr(after, output)[-1])


@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 3e38, -1.0, 1e-40])
def test_a_torque_is_always_a_number(name, value, tmp_path):
    write_library(controller_library(name), tmp_path)
    twin = Twin(tmp_path)
    good = twin.Sample(*WHEEL.tolist())
    for word in twin.Sample._fields:
        twin.start(good)
        twin.step(good)
        for sample in (good._replace(**{word: value}), good, good):
            assert np.isfinite(twin.step(sample).torque_Nm), word
