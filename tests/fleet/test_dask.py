"""A Dask cluster gives what one process gives; workers may die."""

import json
import multiprocessing
import os
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import pytest

from fleet import examples
from ohmward.battery.file import BATTERY_FILE, save_battery
from ohmward.cli.main import main
from ohmward.errors import InputError
from ohmward.fleet import Job, on_dask, run_fleet

distributed = pytest.importorskip("distributed", reason="needs Dask: pip install distributed")


@dataclass(frozen=True)
class Poisoned(Job):
    """Kills the process that reads the log whose path has `poison` in it, as often as that says."""

    poison: str = ""
    deaths: int = 1

    def run(self, paths):
        for path in paths:
            died = Path(path).with_suffix(".deaths")
            count = int(died.read_text()) if died.exists() else 0
            if self.poison in path and count < self.deaths:
                died.write_text(str(count + 1))
                os._exit(1)
        return super().run(paths)


@pytest.fixture
def address():
    """Where the scheduler of a new cluster is: workers that a test before has killed may not come back in time."""
    import dask

    # processes that fork from one that has imported Dask start in a tenth of the time
    method = "forkserver" if "forkserver" in multiprocessing.get_all_start_methods() else "spawn"
    settings = {"distributed.scheduler.allowed-failures": 1, "distributed.worker.multiprocessing-method": method}
    with (
        dask.config.set(settings),
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as cluster,
    ):
        cluster.wait_for_workers(2, timeout=100)
        yield cluster.scheduler_address


def test_a_cluster_gives_what_one_process_gives(tmp_path, address):
    paths, job = examples.write_fleet(tmp_path), examples.job()
    here = run_fleet(paths, job, tmp_path / "here", batch=2)
    told: list[tuple[int, int]] = []
    there = run_fleet(paths, job, tmp_path / "there", partial(on_dask, address=address), lambda *n: told.append(n), 2)
    assert there.rows == here.rows and len(there.failed) == 1
    assert sorted(told) == told and told[-1] == (5, 5)


def test_the_batch_of_a_worker_that_died_is_done_by_another(tmp_path, address):
    paths, job = examples.write_fleet(tmp_path), examples.job()
    poisoned = Poisoned(**vars(job), poison="robot1")
    rows = run_fleet(paths[:4], poisoned, tmp_path / "out", partial(on_dask, address=address), batch=2).rows
    assert rows == job.run(paths[:4])
    assert Path(paths[1]).with_suffix(".deaths").read_text() == "1"


@pytest.mark.slow
def test_a_log_that_no_worker_survives_is_reported_and_the_others_are_done(tmp_path, address):
    paths, job = examples.write_fleet(tmp_path), examples.job()
    poisoned = Poisoned(**vars(job), poison="robot1", deaths=99)
    rows = run_fleet(paths[:4], poisoned, tmp_path / "out", partial(on_dask, address=address), batch=2).rows
    assert [bool(row["error"]) for row in rows] == [False, True, False, False]
    assert "robot1.csv: KilledWorker" in rows[1]["error"]


def test_from_the_command_line(tmp_path, address, capsys, monkeypatch):
    examples.write_fleet(tmp_path)
    save_battery(BATTERY_FILE.parse(examples.job().battery), tmp_path / "cell.toml")
    monkeypatch.chdir(tmp_path)  # the workers are elsewhere
    command = ["fleet", "robot*.csv", "--battery", "cell.toml", "--filter", "coulomb", "--current-sign", "charge"]
    assert main([*command, "--dask", address, "--estimates", "-o", "out", "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert (figures["logs"], figures["failed"]) == (5, 1)
    assert len(list((tmp_path / "out" / "estimates").glob("*.parquet"))) == 4


def test_an_address_without_scheduler_is_refused():
    with pytest.raises(InputError, match="there is no Dask scheduler at tcp:"):
        list(on_dask(examples.job(), [["a.csv"]], "tcp://127.0.0.1:9", timeout_s=0.5))


def test_a_scheduler_without_workers_is_refused():
    with distributed.LocalCluster(n_workers=0, dashboard_address=":0") as cluster:
        address = cluster.scheduler_address
        with pytest.raises(InputError, match=f"no workers; start them with `dask worker {address}`"):
            list(on_dask(examples.job(), [["a.csv"]], address, timeout_s=0.5))
