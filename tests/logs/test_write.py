import errno
import os
import resource
from contextlib import contextmanager

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from ohmward.errors import InputError, OhmwardError
from ohmward.logs import Log, read_log, write_log, write_table

SUFFIXES = [".csv", ".bdf.csv", ".parquet", ".bdf.parquet"]
numbers = st.floats(-1e6, 1e6)


@st.composite
def logs(draw):
    size = draw(st.integers(1, 30))  # a current that stays the same for 30 more rows may be left out on reading
    steps = draw(arrays(float, size, elements=st.floats(1e-3, 1e3)))

    def signal(of=numbers):
        values = draw(arrays(float, size, elements=of | st.just(np.nan)))
        values[0] = draw(of)  # a column without any value is refused on reading
        return values

    extra = draw(st.sets(st.sampled_from(["soc", "Ah in", 'a "quoted" one', "x,y", "größe"])))
    return Log(
        name="log",
        time_s=np.cumsum(steps),
        current_A=signal(),
        voltage_V=signal(st.floats(20.0, 26.0)),  # what no battery shows is left out on reading
        temperature_degC=draw(
            st.none() | arrays(float, size, elements=st.floats(10.0, 30.0))
        ),  # and so is a jump of more
        extra={name: signal() for name in sorted(extra)},
        start_unix_s=draw(st.none() | st.floats(1e9, 2e9)),
    )


def assert_equal(actual, expected):
    measured = np.isfinite(expected.current_A) | np.isfinite(expected.voltage_V)
    together = (np.isfinite(expected.current_A) & np.isfinite(expected.voltage_V)).sum()
    np.testing.assert_array_equal(actual.time_s, expected.time_s[measured])
    if 2 * together >= min(np.isfinite(expected.current_A).sum(), np.isfinite(expected.voltage_V).sum()):
        np.testing.assert_array_equal(actual.current_A, expected.current_A[measured])
    np.testing.assert_array_equal(actual.voltage_V, expected.voltage_V[measured])
    for name, values in expected.extra.items():
        if name in actual.extra:
            np.testing.assert_array_equal(actual.extra[name], values[measured])
        else:
            assert not np.isfinite(values[measured]).any()
    if expected.temperature_degC is None:
        assert actual.temperature_degC is None
    else:
        np.testing.assert_array_equal(actual.temperature_degC, expected.temperature_degC[measured])


@pytest.mark.parametrize("suffix", SUFFIXES)
@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(log=logs())
def test_what_is_written_is_read_back_to_the_last_digit(tmp_path, suffix, log):
    path = tmp_path / f"log{suffix}"
    write_log(log, path)
    back = read_log(path, current_sign="charge")
    assert back.name == "log"
    assert_equal(back, log)
    if log.start_unix_s is None:
        assert back.start_unix_s is None
    else:
        assert back.start_unix_s == pytest.approx(log.start_unix_s, abs=1e-6)


def log(**changes):
    fields = {"name": "l", "time_s": [0.0, 1.0], "current_A": [1.0, np.nan], "voltage_V": [12.0, 12.5]}
    return Log(**{**fields, **changes})


def test_csv_is_plain_to_the_eye(tmp_path):
    write_log(log(temperature_degC=[20.0, 20.5], extra={"soc": [0.5, 0.25]}), tmp_path / "log.csv")
    assert (tmp_path / "log.csv").read_text() == (
        "time_s,current_A,voltage_V,temperature_degC,soc\n0.0,1.0,12.0,20.0,0.5\n1.0,,12.5,20.5,0.25\n"
    )


def test_bdf_has_the_names_of_the_format(tmp_path):
    write_log(log(temperature_degC=[20.0, 20.5], start_unix_s=5.0), tmp_path / "log.bdf.csv")
    header = (tmp_path / "log.bdf.csv").read_text().splitlines()[0]
    assert header == "Test Time / s,Current / A,Voltage / V,Temperature T1 / degC,Unix Time / s"


def test_text_columns_can_be_written(tmp_path):
    write_table({"n": np.array([1, 2]), "word": np.array(["a", 'b,"c"'])}, tmp_path / "t.csv")
    assert (tmp_path / "t.csv").read_text() == 'n,word\n1,a\n2,"b,""c"""\n'


@pytest.mark.parametrize(
    ("write", "message"),
    [
        (
            lambda folder: write_log(log(), folder / "log.xlsx"),
            r"unknown suffix '\.xlsx'; name the file \.csv, ",
        ),
        (
            lambda folder: write_log(log(extra={"time_s": [0, 1]}), folder / "l.csv"),
            "extra column 'time_s' has the name",
        ),
        (lambda folder: write_table({"a": np.ones(1), "b": np.ones(2)}, folder / "t.csv"), r"columns differ in length"),
    ],
)
def test_refusals(tmp_path, write, message):
    with pytest.raises(InputError, match=message):
        write(tmp_path)
    assert not list(tmp_path.iterdir())


@contextmanager
def small_disk():
    """No file may grow beyond 1000 bytes, as on a full disk; nor may that of pytest's own report, between fixtures."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_full_disk_leaves_the_old_file_and_nothing_else(tmp_path, suffix):
    path = tmp_path / f"log{suffix}"
    path.write_text("the old one")
    rng = np.random.default_rng(0)
    with small_disk(), pytest.raises(OhmwardError, match=r"cannot be written .*free space or choose another folder"):
        write_table({"x": rng.normal(size=10_000)}, path)
    assert path.read_text() == "the old one"
    assert list(tmp_path.iterdir()) == [path]


def test_an_error_while_syncing_leaves_nothing(tmp_path, monkeypatch):
    def no_space(handle):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", no_space)
    with pytest.raises(OhmwardError, match="No space left on device"):
        write_log(log(), tmp_path / "log.csv")
    assert not list(tmp_path.iterdir())


def test_an_interruption_leaves_nothing(tmp_path, monkeypatch):
    def interrupted(path, columns, progress):
        path.write_text("half")
        raise KeyboardInterrupt

    monkeypatch.setattr("ohmward.logs.write._write_csv", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_log(log(), tmp_path / "log.csv")
    assert not list(tmp_path.iterdir())


def test_a_folder_that_does_not_exist_is_named(tmp_path):
    with pytest.raises(OhmwardError, match=r"nowhere.*cannot be written"):
        write_log(log(), tmp_path / "nowhere" / "log.csv")
