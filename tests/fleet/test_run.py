"""A fleet: one row for each log, bad ones reported, interrupted runs go on."""

import csv
import json
import os
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import pytest

from fleet import examples
from fleet.examples import SIGNED, write_fleet
from ohmward.errors import InputError, OhmwardError
from ohmward.fleet import Job, in_processes, run_fleet
from ohmward.fleet.run import file_name, read_rows, write_rows
from ohmward.logs import read_log
from ohmward.logs.read import open_table


class PowerCutError(Exception):
    """What ends a run without asking."""


@dataclass(frozen=True)
class Deadly(Job):
    """No process survives it."""

    def run(self, paths):
        os._exit(1)


@dataclass(frozen=True)
class Faulty(Job):
    """Has an error that no one expects in one log."""

    def run(self, paths):
        if any("robot1" in path for path in paths):
            raise KeyError("robot1")
        return super().run(paths)


@pytest.fixture
def fleet(tmp_path):
    return write_fleet(tmp_path), examples.job()


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
    two = run_fleet(paths, job, tmp_path / "two", partial(in_processes, processes=2), batch=1)
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


def test_a_log_that_failed_is_tried_again(fleet, tmp_path):
    paths, job = fleet
    assert len(run_fleet(paths, job, tmp_path / "out").failed) == 1
    Path(paths[4]).write_bytes(Path(paths[0]).read_bytes())
    again = run_fleet(paths, job, tmp_path / "out")
    assert again.resumed == 4 and again.failed == []


def test_a_process_that_is_killed_ends_the_run_with_advice(fleet, tmp_path):
    paths, job = fleet
    with pytest.raises(OhmwardError, match=r"fewer \(--processes"):
        run_fleet(paths, Deadly(**vars(job)), tmp_path / "out", partial(in_processes, processes=2), batch=1)


def test_another_job_does_not_mix_its_results_in(fleet, tmp_path):
    paths, job = fleet
    run_fleet(paths[:1], job, tmp_path / "out")
    with pytest.raises(InputError, match="results of another battery file, filter"):
        run_fleet(paths[:1], Job(job.battery, "ekf", reading=SIGNED), tmp_path / "out")


def test_estimates_can_be_read_as_logs_are(fleet, tmp_path):
    paths, job = fleet
    job = Job(job.battery, job.filter, reading=SIGNED, estimates=str(tmp_path / "out" / "estimates"))
    finished = run_fleet(paths[:1], job, tmp_path / "out")
    table = open_table(finished.rows[0]["estimates"]).load(["soc", "soc_std"])
    assert table.columns["soc"][-1] == finished.rows[0]["soc_final"]
    assert len(read_log(paths[0], current_sign="charge")) == table.columns["soc"].size


def test_logs_of_one_name_in_two_folders_have_estimates_of_their_own(fleet, tmp_path):
    paths, job = fleet
    for folder, path in zip("ab", paths, strict=False):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "day.csv").write_bytes(Path(path).read_bytes())
    job = replace(job, estimates=str(tmp_path / "out" / "estimates"))
    rows = run_fleet([str(tmp_path / folder / "day.csv") for folder in "ab"], job, tmp_path / "out").rows
    written = [open_table(row["estimates"]).load(["soc"]).columns["soc"] for row in rows]
    assert [soc.size for soc in written] == [200, 250]


def test_a_log_that_has_changed_is_estimated_again(fleet, tmp_path):
    paths, job = fleet
    before = run_fleet(paths[:2], job, tmp_path / "out")
    Path(paths[0]).write_bytes(Path(paths[2]).read_bytes())
    after = run_fleet(paths[:2], job, tmp_path / "out")
    assert (before.resumed, after.resumed) == (0, 1)
    assert [row["samples"] for row in after.rows] == [300, 250]


def test_another_version_does_not_mix_its_results_in(fleet, tmp_path, monkeypatch):
    paths, job = fleet
    run_fleet(paths[:1], job, tmp_path / "out")
    monkeypatch.setattr("ohmward.fleet.run.__version__", "999")
    with pytest.raises(InputError, match="or version of ohmward"):
        run_fleet(paths[:1], job, tmp_path / "out")


def test_a_row_after_one_that_was_cut_off_is_read_again(tmp_path):
    write_rows(tmp_path / "rows", [{"path": "1"}])
    with (tmp_path / "rows").open("a") as stream:
        stream.write('{"path": "2", "err')
    write_rows(tmp_path / "rows", [{"path": "3"}])
    assert read_rows(tmp_path / "rows") == [{"path": "1"}, {"path": "3"}]


def test_one_log_with_an_unexpected_error_does_not_end_the_run(fleet, tmp_path):
    paths, job = fleet
    rows = run_fleet(paths[:3], Faulty(**vars(job)), tmp_path / "out").rows
    assert [row["error"] for row in rows] == [None, f"{paths[1]}: KeyError: 'robot1'", None]


def test_names_that_differ_have_files_that_differ():
    names = ["a b", "a_b", "a/b", "a%20b", "Wägen-1.2", "x:y"]
    assert [file_name(name) for name in names] == ["a%20b", "a_b", "a%2Fb", "a%2520b", "Wägen-1.2", "x%3Ay"]


def test_what_cannot_begin_is_refused(fleet, tmp_path):
    paths, job = fleet
    with pytest.raises(InputError, match="no logs"):
        run_fleet([], job, tmp_path / "out")
    (tmp_path / "file").write_text("")
    with pytest.raises(OhmwardError, match="cannot be used"):
        run_fleet(paths, job, tmp_path / "file")


def test_more_batches_than_processes_are_all_done(fleet, tmp_path):
    paths, job = fleet
    rows = [row for batch in in_processes(job, [[path] for path in paths], processes=2) for row in batch]
    assert sorted(row["path"] for row in rows) == paths
    json.dumps(rows)
