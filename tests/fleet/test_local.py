"""A fleet on this machine: one row for each log, bad ones reported, interrupted runs go on."""

import csv
import json

import numpy as np
import pytest

from ohmward.battery.battery_file import save_battery
from ohmward.battery.chemistries import generic_battery
from ohmward.errors import InputError, OhmwardError
from ohmward.fleet import Job, Reading, run_fleet
from ohmward.fleet import local as fleet_local
from ohmward.logs import Log, read_log, write_log

SIGNED = Reading(current_sign="charge")


class PowerCutError(Exception):
    """What ends a run without asking."""


@pytest.fixture
def fleet(tmp_path):
    """Five logs, one of them no log, and a battery."""
    save_battery(generic_battery("nmc", 2.0), tmp_path / "cell.toml")
    rng = np.random.default_rng(0)
    for k in range(4):
        current = -1.0 + rng.normal(0.0, 0.5, 200 + 50 * k)
        voltage = 3.9 + 0.05 * current - 0.0002 * np.arange(current.size)
        write_log(Log(f"robot{k}", np.arange(current.size) * 1.0, current, voltage), tmp_path / f"robot{k}.csv")
    (tmp_path / "robot4.csv").write_text("this is no log\n")
    return [str(tmp_path / f"robot{k}.csv") for k in range(5)], Job(
        str(tmp_path / "cell.toml"), "coulomb", reading=SIGNED
    )


def test_every_log_has_its_row_and_a_bad_one_its_reason(fleet, tmp_path):
    paths, job = fleet
    told = []
    finished = run_fleet(paths, job, tmp_path / "out", progress=lambda *n: told.append(n), batch=2)
    assert [row["path"] for row in finished.rows] == paths
    assert [bool(row["error"]) for row in finished.rows] == [False] * 4 + [True]
    assert told[-1] == (5, 5)
    with (tmp_path / "out" / "summary.csv").open() as stream:
        written = list(csv.DictReader(stream))
    assert [int(row["samples"]) for row in written[:4]] == [200, 250, 300, 350]
    assert "robot4.csv" in written[4]["error"] and not written[4]["soc_final"]


def test_processes_give_what_one_gives(fleet, tmp_path):
    paths, job = fleet
    one = run_fleet(paths, job, tmp_path / "one", batch=1)
    two = run_fleet(paths, job, tmp_path / "two", processes=2, batch=1)
    assert one.rows == two.rows


def test_an_interrupted_run_goes_on_and_ends_as_if_it_had_not_been(fleet, tmp_path, monkeypatch):
    paths, job = fleet
    whole = run_fleet(paths, job, tmp_path / "whole", batch=1)

    def cut(done, total):
        if done == 2:
            raise PowerCutError

    with pytest.raises(PowerCutError):
        run_fleet(paths, job, tmp_path / "out", progress=cut, batch=1)
    with (tmp_path / "out" / "progress.jsonl").open("a") as stream:
        stream.write('{"path": "cut off')
    resumed = run_fleet(paths, job, tmp_path / "out", batch=1)
    assert resumed.resumed == 2 and resumed.rows == whole.rows
    assert (tmp_path / "out" / "summary.csv").read_text() == (tmp_path / "whole" / "summary.csv").read_text()


def test_another_job_does_not_mix_its_results_in(fleet, tmp_path):
    paths, job = fleet
    run_fleet(paths[:1], job, tmp_path / "out")
    with pytest.raises(InputError, match="results of another battery file, filter"):
        run_fleet(paths[:1], Job(job.battery, "ekf", reading=SIGNED), tmp_path / "out")


def test_estimates_can_be_read_as_logs_are(fleet, tmp_path):
    paths, job = fleet
    job = Job(job.battery, job.filter, reading=SIGNED, estimates=str(tmp_path / "out" / "estimates"))
    finished = run_fleet(paths[:1], job, tmp_path / "out")
    from ohmward.logs.read import open_table

    table = open_table(tmp_path / "out" / "estimates" / "robot0.estimates.parquet").load(["soc", "soc_std"])
    assert table.columns["soc"][-1] == finished.rows[0]["soc_final"]
    assert len(read_log(paths[0], current_sign="charge")) == table.columns["soc"].size


def test_what_cannot_begin_is_refused(fleet, tmp_path):
    paths, job = fleet
    with pytest.raises(InputError, match="no logs"):
        run_fleet([], job, tmp_path / "out")
    (tmp_path / "file").write_text("")
    with pytest.raises(OhmwardError, match="cannot be used"):
        run_fleet(paths, job, tmp_path / "file")


def test_more_batches_than_processes_are_all_done(fleet, tmp_path):
    paths, job = fleet
    rows = [row for batch in fleet_local._batches_done(paths, job, 2, 1) for row in batch]
    assert sorted(row["path"] for row in rows) == paths
    json.dumps(rows)
