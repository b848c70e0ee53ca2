"""Machine code on disk: written once, whole, and never that of somebody else."""

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

from ohmward.trace.lower import code_cache

KEY = "0123"


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("OHMWARD_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def counted(key):
    """The code by way of the cache, and whether it was compiled."""
    calls: list[str] = []

    def compile_it() -> bytes:
        calls.append(key)
        return b"code of " + key.encode()

    return code_cache.cached(key, compile_it), bool(calls)


def test_the_second_time_nothing_is_compiled(cache):
    assert counted(KEY) == (b"code of " + KEY.encode(), True)
    assert counted(KEY) == (b"code of " + KEY.encode(), False)
    assert counted(KEY + "4")[1]


@pytest.mark.parametrize("damage", [lambda b: b[:-1], lambda b: b[:40] + b"x" + b[41:], lambda b: b""])
def test_a_damaged_entry_is_compiled_anew(cache, damage):
    counted(KEY)
    (entry,) = cache.iterdir()
    assert code_cache.is_cached(KEY)
    entry.write_bytes(damage(entry.read_bytes()))
    assert not code_cache.is_cached(KEY)
    assert counted(KEY) == (b"code of " + KEY.encode(), True)
    assert counted(KEY)[1] is False


def test_a_folder_that_cannot_be_written_is_said_once(tmp_path, monkeypatch):
    blocked = tmp_path / "file"
    blocked.write_text("no folder")
    monkeypatch.setenv("OHMWARD_CACHE", str(blocked))
    code_cache.warn_once.cache_clear()
    with pytest.warns(RuntimeWarning, match="OHMWARD_CACHE"):
        assert counted(KEY)[1]
    assert counted(KEY)[1]  # a second warning would be an error here


def test_several_processes_may_write_at_once(cache):
    code = f"""
from ohmward.trace.lower import code_cache
for k in range(50):
    code_cache.cached({KEY!r} + "4" * (k % 5), lambda: b"x" * 10000)
"""
    writers = [subprocess.Popen([sys.executable, "-c", code]) for _ in range(3)]
    assert all(w.wait() == 0 for w in writers)
    assert len(list(cache.iterdir())) == 5
    assert counted(KEY) == (b"x" * 10000, False)


def test_the_cache_does_not_grow_for_ever(cache, monkeypatch):
    monkeypatch.setattr(code_cache, "MOST_ENTRIES", 8)
    for k in range(30):
        counted(f"{KEY}{k}")
        assert len(list(cache.iterdir())) <= 8
    assert counted(f"{KEY}29")[1] is False


def test_the_folder_and_its_entries_are_the_users_own(cache):
    counted(KEY)
    (entry,) = cache.iterdir()
    assert cache.stat().st_mode & 0o777 == 0o700
    assert entry.stat().st_mode & 0o777 == 0o600


def poison(entry):
    """An entry that is whole and not what was compiled."""
    entry.write_bytes(hashlib.sha256(b"malice").digest() + b"malice")


def poisoned_cache(cache):
    counted(KEY)
    (entry,) = cache.iterdir()
    poison(entry)
    assert counted(KEY) == (b"malice", False)
    return entry


def test_an_entry_that_others_may_write_is_not_used(cache):
    poisoned_cache(cache).chmod(0o620)
    assert counted(KEY) == (b"code of " + KEY.encode(), True)


def test_an_entry_that_is_a_link_is_not_used(cache, tmp_path):
    entry = poisoned_cache(cache)
    entry.rename(tmp_path / "elsewhere")
    entry.symlink_to(tmp_path / "elsewhere")
    assert counted(KEY) == (b"code of " + KEY.encode(), True)
    assert (tmp_path / "elsewhere").read_bytes().endswith(b"malice"), "it was written through the link"


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a file away")
@pytest.mark.parametrize("whose", ["entry", "folder"])
def test_code_of_another_user_is_not_run(cache, whose):
    entry = poisoned_cache(cache)
    os.chown(entry if whose == "entry" else cache, 12345, 12345)
    assert unsafe(KEY, whose == "folder") == (b"code of " + KEY.encode(), True)


@pytest.mark.parametrize("mode", [0o777, 0o770, 0o702, 0o1777])
def test_a_folder_that_others_may_write_to_is_not_used(cache, mode):
    poisoned_cache(cache)
    cache.chmod(mode)
    assert unsafe(KEY, True) == (b"code of " + KEY.encode(), True)


def test_a_folder_that_is_a_link_is_not_used(cache, tmp_path):
    poisoned_cache(cache)
    cache.rename(tmp_path / "elsewhere")
    cache.symlink_to(tmp_path / "elsewhere")
    assert unsafe(KEY, True) == (b"code of " + KEY.encode(), True)


def unsafe(key, warned):
    """As `counted`, with the warning that nothing is kept."""
    code_cache.warn_once.cache_clear()
    if not warned:
        return counted(key)
    with pytest.warns(RuntimeWarning, match="OHMWARD_CACHE"):
        return counted(key)


def test_without_a_home_programs_are_compiled_all_the_same(monkeypatch):
    for name in ("XDG_CACHE_HOME", "LOCALAPPDATA", "OHMWARD_CACHE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(Path, "home", no_home)
    assert unsafe(KEY, True) == (b"code of " + KEY.encode(), True)


def no_home():
    raise RuntimeError("Could not determine home directory.")  # what pathlib does for a user without an entry
