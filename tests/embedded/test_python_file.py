"""An estimator as one file of Python: alone it gives what the estimator gives, on good samples and bad ones."""

import dataclasses
import json
import subprocess
import sys
from importlib.util import module_from_spec, spec_from_file_location

import numpy as np
import pytest

from embedded.batteries import BATTERY, soc_export
from ohmward import generic_battery, save_battery
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.registry import make_estimator
from ohmward.battery.soc.sample import SocFlag, SocSample
from ohmward.cli.main import main
from ohmward.embedded import battery_export, controller_export
from ohmward.embedded.battery import vector_samples
from ohmward.embedded.python_file import python_file
from ohmward.errors import InputError
from ohmward.toml_file import write_text
from ohmward.trace import Kernel
from ohmward.traction import RLMA

FILTERS = ("default", "ekf", "ukf", "textbook-ekf", "textbook-ukf", "coulomb", "rc")


def loaded(text, folder, name="model"):
    path = folder / f"{name}.py"
    write_text(path, text)
    spec = spec_from_file_location(name, path)
    assert spec and spec.loader
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def rows(T=600):
    """Current, voltage and temperature of a drive at 1 Hz, with values that are missing."""
    rng = np.random.default_rng(3)
    X = np.stack([rng.normal(-4.0, 3.0, T), 13.2 + 0.02 * rng.standard_normal(T), np.full(T, 21.0)], axis=1)
    X[100:110, 0], X[150:160, 1], X[200:300, 2] = np.nan, np.nan, np.nan
    return X


def estimates(name, samples):
    """Estimates of the package over samples (T,), from its own start."""
    estimator = make_estimator(name, BATTERY)
    first = SocSample(*(float(column[0]) for column in samples))
    state = estimator.init(first)
    return Kernel(estimator.step, state, first).scan(state, samples)[1]


@pytest.mark.parametrize("name", FILTERS)
def test_it_gives_what_the_estimator_gives(name, tmp_path):
    X = rows()
    model = loaded(python_file(soc_export(name, "model")), tmp_path)
    interval_s = np.where(np.arange(len(X)) == 0, 0.0, 1.0)
    wanted = estimates(name, SocSample(interval_s, *X.T)).soc
    np.testing.assert_allclose(model.Model(X)[0], wanted, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("chemistry", ["nmc", "lfp"])
@pytest.mark.parametrize("name", ["ekf", "gsf"])
def test_its_first_estimate_is_that_of_the_live_estimator(chemistry, name, tmp_path):
    """Full, empty, between and absurd; at rest, loaded and charging; warm, cold and without a temperature."""
    battery = generic_battery(chemistry, 12.0)
    export = battery_export(battery, name, "model")
    for given in ({}, {"soc": 0.9, "soc_std": 0.05}):
        model = loaded(python_file(export, **given), tmp_path, f"model_{len(given)}")
        spelled = {f"initial_{word}": value for word, value in given.items()}
        for voltage_V in (*battery.thevenin.ocv.mean_V(np.array([0.0, 0.3, 0.97]), 25.0), 0.0, np.nan):
            for current_A, temperature_degC in ((0.0, 25.0), (-18.0, -15.0), (6.0, np.nan), (np.nan, 40.0)):
                row = current_A, float(voltage_V), temperature_degC
                live = SocEstimator(battery, **spelled, filter=name, lowering="python").update(0.0, *row)
                assert model.Model([row])[0][0] == pytest.approx(live.soc, abs=1e-9), (given, row)


@pytest.mark.parametrize("name", FILTERS)
def test_faults_of_sensors_and_clock_have_the_same_results(name, tmp_path):
    samples = vector_samples(BATTERY)
    model = loaded(python_file(soc_export(name, "model")), tmp_path)
    assert {flag.name: flag.value for flag in SocFlag} == model.FLAGS
    state, outputs = model.start(model.Sample(*samples[0].tolist()), *model.START), []
    for row in samples.tolist():
        state, output = model.step(state, model.Sample(*row))
        outputs.append(output)
    wanted = estimates(name, SocSample(*samples.T))
    for field in ("soc", "soc_std", "flags"):
        found = [getattr(output, field) for output in outputs]
        np.testing.assert_allclose(found, getattr(wanted, field), rtol=1e-9, atol=1e-9)


def test_a_run_in_parts_is_the_run(tmp_path):
    model = loaded(python_file(soc_export("ekf", "model")), tmp_path)
    X = rows()
    whole, _ = model.Model(X)
    first, z = model.Model(X[:1])
    second, z = model.Model(X[1:250], z)
    third, _ = model.Model(X[250:], z)
    np.testing.assert_array_equal(np.concatenate([first, second, third]), whole)
    np.testing.assert_array_equal(model.Model(X, [])[0], whole)
    with pytest.raises(ValueError, match="X must have rows"):
        model.Model(X[:, :2])


@pytest.mark.parametrize("padding", [(-6.0, 13.25, 25.0), (0.0, 13.25, 25.0), (0.0, 0.0, 0.0), (np.nan,) * 3])
def test_an_hour_of_padding_costs_nothing(padding, tmp_path):
    """Blind benchmarks put 3,600 rows before each run: the first row, even without the current of its voltage."""
    model = loaded(python_file(soc_export("default", "model")), tmp_path)
    X = np.stack([np.full(120, -6.0), np.linspace(13.25, 13.1, 120), np.full(120, 25.0)], axis=1)
    padded, z = model.Model(np.tile(padding, (3600, 1)))
    assert (padded == padded[0]).all()
    np.testing.assert_array_equal(model.Model(X, z)[0], model.Model(X)[0])


def test_a_rest_of_equal_rows_is_known_under_the_load_after_it(tmp_path):
    """Its voltage is its own: the load changes it, so the run does not begin again."""
    model = loaded(python_file(soc_export("ekf", "model")), tmp_path)
    rest, load = [0.0, 13.6, 25.0], [-6.0, 13.3, 25.0]
    rested, loaded_alone = model.Model([rest] * 60 + [load])[0][-1], model.Model([load])[0][-1]
    assert rested == pytest.approx(model.Model([rest, load])[0][-1])
    assert rested > loaded_alone + 0.05


def test_another_interval_is_that_of_the_rows(tmp_path):
    model = loaded(python_file(soc_export("coulomb", "model", sample_time_s=10.0), 10.0), tmp_path)
    soc = model.Model(np.stack([np.full(31, -12.0), 13.2 - 1e-3 * np.arange(31), np.full(31, 25.0)], axis=1))[0]
    assert soc[0] - soc[-1] == pytest.approx(300.0 / 3600.0, rel=0.01)


def test_it_needs_numpy_only(tmp_path):
    loaded(python_file(soc_export("ekf", "model")), tmp_path)
    program = f"""\
import sys
sys.path.insert(0, {str(tmp_path)!r})
sys.modules["ohmward"] = None
from model import Model
print(Model([[-1.0, 13.2, 25.0]])[0][0], "scipy" in sys.modules)"""
    found = subprocess.run([sys.executable, "-I", "-c", program], capture_output=True, text=True, check=True)
    soc, other = found.stdout.split()
    assert 0.0 < float(soc) < 1.0 and other == "False"


def test_the_name_of_a_battery_is_only_text(tmp_path):
    named = dataclasses.replace(BATTERY, name='a"""\nraise SystemExit(3) \\')
    assert loaded(python_file(battery_export(named, "ekf", "model")), tmp_path).Model.__name__ == "Model"


def test_what_has_no_state_of_charge_is_refused():
    with pytest.raises(InputError, match="estimators of the state of charge"):
        python_file(controller_export(RLMA, "slip-controller", "wheel"))
    with pytest.raises(InputError, match="that start from the first voltage, such as gsf"):
        python_file(soc_export("published.hybrid", "model"))
    with pytest.raises(InputError, match="name must be one that Python can import"):
        python_file(soc_export("ekf", "class"))


def test_the_command_writes_it(tmp_path, capsys):
    battery = str(tmp_path / "battery.toml")
    save_battery(BATTERY, battery)
    command = ["export", battery, "--language", "python", "-o", str(tmp_path / "out")]
    assert main([*command, "--initial-soc", "0.9", "--initial-soc-std", "0.02", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["files"] == ["Model.py"]  # the name that blind benchmarks import
    model = loaded((tmp_path / "out" / "Model.py").read_text(encoding="utf-8"), tmp_path)
    assert model.START == (0.9, 0.02)
    soc = model.Model(rows())[0]
    assert np.isfinite(soc).all() and soc[-1] < soc[100]
    for wrong, sentence in ((["--style", "loops"], "writes no C"), (["--name", "a-b"], "import")):
        assert main([*command, *wrong]) == 2
        assert sentence in capsys.readouterr().err
