import csv
from dataclasses import replace

import numpy as np
import pytest

from battery.anchor_examples import day, label
from cli.examples import CAPACITY_AH, START_SOC, battery, drive
from ohmward.battery.file import save_battery
from ohmward.battery.soc.sample import STD_OF
from ohmward.battery.soc.score import score
from ohmward.cli.main import main
from ohmward.logs import read_log, write_log

SOC = ("soc", "day.csv", "--battery", "battery.toml")

KEYS = {
    "command", "log", "battery", "filter", "steps", "seconds", "duration_s", "soc_initial", "soc_final",
    "soc_std_final", "soc_min", "soc_max", "voltage_rmse_V", "rejected_voltages", "current_offset_A",
    "soh_capacity", "resistance_ratio", "current_offset_std_A", "soh_capacity_std", "resistance_ratio_std",
    "explanation", "fits", "anchors", "cells", "weakest_expected", "flags", "truth", "notes", "output", "report",
}  # fmt: skip
SCORES = {"soc_rmse", "soc_mae", "soc_max_error", "soc_error_mean", "soc_error_std", "coverage_95"}
LATE = {f"{name}_after_1h" for name in SCORES}


def test_keys_are_always_the_same(here, as_json):
    assert set(as_json(*SOC)) == KEYS | SCORES | LATE
    assert set(as_json(*SOC, "--truth", "soc_true")) == KEYS | SCORES | LATE


def test_without_a_truth_there_are_no_errors(here, as_json):
    found = as_json(*SOC)
    assert all(found[name] is None for name in SCORES | LATE)
    assert found["soc_final"] == pytest.approx(drive().extra["soc_true"][-1], abs=0.01)


def test_errors_are_those_of_the_estimates_file(here, as_json):
    found = as_json(*SOC, "--truth", "soc_true", "-o", "estimates.csv")
    with (here / "estimates.csv").open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    soc, std = (np.array([float(row[name]) for row in rows]) for name in ("soc", "soc_std"))
    truth = drive().extra["soc_true"]
    whole, late = score(soc, truth, std), score(soc[1800:], truth[1800:], std[1800:])
    assert whole and late
    for name, value in whole._asdict().items():
        key = {"rmse": "soc_rmse", "mae": "soc_mae", "max_error": "soc_max_error", "coverage_95": name}.get(name)
        if key:
            assert found[key] == pytest.approx(value, rel=1e-9)
            assert found[f"{key}_after_1h"] == pytest.approx(late._asdict()[name], rel=1e-9)
    assert found["soc_rmse"] < 0.01


def test_a_label_is_full_where_the_charger_of_the_log_stops(here, as_json):
    """At 4.0 V a cell: the curve of its chemistry has 83 % there."""
    log, truth = day("nca", 0.1, [(0.2, 0.0), (7.0, 0.3), (0.5, 0.0), (2.0, -0.3)], limit_V=4.0)
    write_log(replace(log, extra={"soc_true": truth / truth.max()}), here / "lower.csv")
    save_battery(label("nca"), here / "label.toml")
    found = as_json("soc", "lower.csv", "--battery", "label.toml", "--truth", "soc_true")
    assert any("full is where its charger stops, at 4 V at rest" in note for note in found["notes"])
    assert found["coverage_95"] > 0.95


def test_a_log_shorter_than_an_hour_has_no_errors_after_it(here, as_json):
    lines = (here / "day.csv").read_text().splitlines(keepends=True)
    (here / "short.csv").write_text("".join(lines[:1500]))
    found = as_json("soc", "short.csv", "--battery", "battery.toml", "--truth", "soc_true")
    assert found["soc_rmse"] < 0.02
    assert all(found[name] is None for name in LATE)


def test_the_errors_of_what_was_learnt_are_those_of_the_last_sample(here, as_json):
    found = as_json(*SOC, "--rest-current", "0", "-o", "estimates.csv")
    last = (here / "estimates.csv").read_text().splitlines()
    row = dict(zip(last[0].split(","), last[-1].split(","), strict=True))
    names = [name for pair in STD_OF.items() for name in pair][2:]
    assert {name: found[name] for name in names} == {name: pytest.approx(float(row[name])) for name in names}
    assert abs(found["current_offset_A"] - 0.02) < 3 * found["current_offset_std_A"] < 0.06
    assert 0.0 < found["soh_capacity_std"] < 0.1 and 0.0 < found["resistance_ratio_std"] < 0.1


def test_the_result_does_not_depend_on_the_files_that_are_written(here, as_json):
    alone, with_files = as_json(*SOC), as_json(*SOC, "-o", "estimates.csv")
    differing = {"seconds", "output"}
    assert {key: alone[key] for key in KEYS - differing} == {key: with_files[key] for key in KEYS - differing}


def test_a_filter_that_learns_nothing_has_no_errors_of_it(here, capsys):
    main([*SOC, "--filter", "coulomb", "--report", "soc.html"])
    text = capsys.readouterr().out
    assert "current offset" not in text and "capacity " not in text.split("Assumed")[0]
    assert "95 % of resistance" not in (here / "soc.html").read_text(encoding="utf-8")


def test_the_estimates_file_is_a_log(here):
    main([*SOC, "-o", "estimates.parquet"])
    log = read_log("estimates.parquet")
    assert len(log) == 3600
    assert {"soc", "soc_std", "voltage_expected_V", "current_offset_A", "flags"} <= set(log.extra)
    assert log.voltage_V == pytest.approx(drive().voltage_V, nan_ok=True)


def test_a_log_is_not_written_over_and_older_results_are(here, capsys):
    log = here / "another-day.csv"
    log.write_text("time_s,current_A,voltage_V\n0,1,3.3\n")
    assert main([*SOC, "-o", log.name]) == 2
    assert "there is another file of this name, without the column soc_std" in capsys.readouterr().err
    assert log.read_text().endswith("0,1,3.3\n")
    for ending in (".csv", ".parquet", ".mcap"):
        assert [main([*SOC, "-o", f"again{ending}"]) for _ in range(2)] == [0, 0]


@pytest.mark.parametrize("name", ["coulomb", "ocv", "ekf", "published.aekf"])
def test_every_filter_runs(name, here, as_json):
    found = as_json(*SOC, "--filter", name, "--initial-soc", str(START_SOC), "--truth", "soc_true")
    assert found["filter"] == name
    assert found["soc_rmse"] < 0.02
    assert found["coverage_95"] > 0.9


def test_the_start_is_used(here, as_json):
    sure = ("--initial-soc-std", "0.001", "--filter", "coulomb")
    assert as_json(*SOC, "--initial-soc", "0.88", *sure)["soc_initial"] == pytest.approx(0.88, abs=0.005)


def test_the_rest_current_is_used(here, as_json):
    offset_A = as_json(*SOC, "--rest-current", "0")["current_offset_A"]
    assert offset_A == pytest.approx(0.02, abs=0.02)
    shifted_A = as_json(*SOC, "--rest-current", "-0.05")["current_offset_A"]
    assert shifted_A - offset_A == pytest.approx(0.05, abs=0.02)
    assert "rest" not in as_json(*SOC, "--rest-current", "unknown")["flags"]


def test_flags_are_counted(here, as_json):
    lines = (here / "day.csv").read_text().splitlines()
    header = lines[0].split(",")
    for k in range(100, 107):
        cells = lines[k].split(",")
        cells[header.index("voltage_V")] = ""
        lines[k] = ",".join(cells)
    (here / "holes.csv").write_text("\n".join(lines) + "\n")
    assert as_json("soc", "holes.csv", "--battery", "battery.toml")["flags"]["no_voltage"] == 7


def test_text_says_the_key_numbers(here, capsys):
    main([*SOC, "--truth", "soc_true"])
    out = capsys.readouterr().out
    for part in ("day with battery 'pack'", "extended Kalman filter", "SoC at the end", "against the truth", "Assumed"):
        assert part in out


@pytest.mark.parametrize(
    ("column", "words", "says"),
    [
        ("soc_true", (), "read as a share"),
        ("soc_pct", (), "read as percent"),
        ("discharged_Ah", ("--truth-start", str(START_SOC)), "counted up in discharging"),
        ("charge_mAh", ("--initial-soc", str(START_SOC)), "counted up in charging"),
    ],
)
def test_every_form_of_the_truth_gives_the_same_errors(column, words, says, here, as_json):
    start = ("--initial-soc", str(START_SOC)) if "--initial-soc" not in words else ()
    found = as_json(*SOC, "--truth", column, *words, *start)
    assert says in found["truth"]
    expected = as_json(*SOC, "--truth", "soc_true", "--initial-soc", str(START_SOC))
    assert found["soc_rmse"] == pytest.approx(expected["soc_rmse"], abs=2e-4)
    assert CAPACITY_AH == 12.0


def test_samples_without_a_truth_are_left_out(here, as_json):
    found, whole = as_json(*SOC, "--truth", "half_true"), as_json(*SOC, "--truth", "soc_true")
    assert found["soc_rmse"] == pytest.approx(whole["soc_rmse_after_1h"])


def test_options_that_contradict_the_file_or_the_log_are_named(here, as_json):
    save_battery(replace(battery(), idle_current_A=-0.1), here / "idle.toml")
    idle = ("soc", "day.csv", "--battery", "idle.toml")
    said = " ".join(as_json(*idle, "--rest-current", "0", "--initial-soc", "0.2")["notes"])
    assert "warning: --rest-current 0 A was used; the battery file says -0.1 A" in said
    assert "warning: --initial-soc 0.2 contradicts the first voltage" in said
    agreed = as_json(*idle, "--rest-current", "-0.1", "--initial-soc", str(START_SOC))["notes"]
    assert not [note for note in agreed if note.startswith("warning: --")]
    assert "--rest-current unknown was used" in " ".join(as_json(*idle, "--rest-current", "unknown")["notes"])


def test_a_wrong_first_voltage_is_named_and_costs_nothing(here, as_json):
    log = drive()
    voltage_V = log.voltage_V.copy()
    voltage_V[0] = 9.5
    write_log(replace(log, voltage_V=voltage_V), here / "early.csv")
    start = ("--battery", "battery.toml", "--initial-soc", str(START_SOC))
    good, bad = (as_json("soc", name, *start) for name in ("day.csv", "early.csv"))
    said = [note for note in bad["notes"] if note.startswith("warning:")]
    assert len(said) == 1 and "V, is not the battery's" in said[0]
    assert bad["soc_final"] == pytest.approx(good["soc_final"], abs=0.005)


def test_the_sentence_and_the_causes_are_in_every_form(here, as_json, capsys):
    explanation = as_json(*SOC, "--report", "soc.html")["explanation"]
    assert set(explanation) == {"soc", "low", "high", "known", "sentence", "causes", "remedies"}
    assert explanation["low"] <= explanation["soc"] <= explanation["high"]
    page = (here / "soc.html").read_text(encoding="utf-8")
    assert explanation["sentence"] in page
    assert explanation["causes"][0]["text"] in page
    main(list(SOC))
    out = capsys.readouterr().out
    assert explanation["sentence"] in out
    assert "What makes the band wide" in out


@pytest.fixture
def of_cells(here):
    """The drive of a pack of three, the second cell 15 points lower than the others and with 0.8 of their capacity."""
    log = drive()
    one, moved = battery(), np.cumsum(np.diff(log.time_s, prepend=0.0) * log.current_A) / 3600.0 / CAPACITY_AH
    soc = [START_SOC + moved, START_SOC - 0.15 + moved / 0.8, START_SOC + moved]
    ocv_V = [one.thevenin.ocv.mean_V(s, 25.0) / 3 for s in soc]
    over_V = (log.voltage_V - 3 * ocv_V[0]) / 3
    rows = [log.time_s, log.current_A, *(v + over_V for v in ocv_V)]
    header = "time_s,current_A,cell_voltage_1_V,cell_voltage_2_V,cell_voltage_3_V"
    np.savetxt(here / "cells.csv", np.stack(rows, axis=1), delimiter=",", header=header, comments="", fmt="%.6g")
    return ("soc", "cells.csv", "--battery", "battery.toml", "--initial-soc", str(START_SOC))


def test_the_cells_of_a_log_are_estimated(of_cells, here, as_json, capsys):
    found = as_json(*of_cells, "-o", "estimates.csv")
    cells = found["cells"]
    assert cells["weakest"] == "cell_voltage_2_V" and len(cells["cells"]) == 3
    assert {warning["cell"] for warning in cells["warnings"]} == {"cell_voltage_2_V"}
    assert cells["usable_Ah"] < 0.8 * CAPACITY_AH * found["soc_final"]
    assert found["weakest_expected"] is None
    header = (here / "estimates.csv").read_text(encoding="utf-8").splitlines()[0].split(",")
    assert {"pack_soc", "pack_usable_Ah", "weakest_cell", "weakest_soc", "cell_2_soc", "cell_2_soc_std"} <= set(header)
    main([*of_cells, "--report", "page.html"])
    text = capsys.readouterr().out
    assert "cell_voltage_2_V will be empty first" in text
    assert "cell_voltage_2_V: state of charge" in (here / "page.html").read_text(encoding="utf-8")


def test_a_filter_without_an_offset_leaves_the_cells(of_cells, as_json):
    assert as_json(*of_cells, "--filter", "coulomb")["cells"] is None


def test_without_cell_voltages_the_weakest_cell_is_said_to_be_unseen(here, as_json, capsys):
    found = as_json(*SOC)
    assert found["cells"] is None
    assert found["weakest_expected"]["soc"] < found["soc_final"]
    main([*SOC])
    assert "weakest cell     not measured; probably" in capsys.readouterr().out


def test_a_drive_has_no_event_that_tells_soc(here, as_json, capsys):
    assert as_json(*SOC)["anchors"] == []
    assert main(list(SOC)) == 0
    assert "Events" not in capsys.readouterr().out


def test_a_log_that_the_file_does_not_fit_ends_with_a_status_and_a_sentence(here, as_json, capsys):
    assert as_json(*SOC)["fits"] is True
    assert main([*SOC, "--current-sign", "discharge"]) == 1
    text = capsys.readouterr().out
    assert "The battery file does not fit this log" in text
    assert "does not fit the log: it would need" in text
