"""The cache of compiled programs, and what happens where there is no machine code."""

import subprocess
import sys

import pytest

from ohmward.trace.lower import llvm_machine_code as machine_code

pytest.importorskip("llvmlite")
SOURCE = "define void @nothing() {\n  ret void\n}\n"


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("OHMWARD_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def counted(source):
    """The code by way of the cache, and whether it was compiled."""
    calls: list[str] = []

    def compile_it() -> bytes:
        calls.append(source)
        return b"code of " + source.encode()

    return machine_code.cached(source, compile_it), bool(calls)


def test_the_second_time_nothing_is_compiled(cache):
    assert counted(SOURCE) == (b"code of " + SOURCE.encode(), True)
    assert counted(SOURCE) == (b"code of " + SOURCE.encode(), False)
    assert counted(SOURCE + ";")[1]


@pytest.mark.parametrize("damage", [lambda b: b[:-1], lambda b: b[:40] + b"x" + b[41:], lambda b: b""])
def test_a_damaged_entry_is_compiled_anew(cache, damage):
    counted(SOURCE)
    (entry,) = cache.iterdir()
    entry.write_bytes(damage(entry.read_bytes()))
    assert counted(SOURCE) == (b"code of " + SOURCE.encode(), True)
    assert counted(SOURCE)[1] is False


def test_a_folder_that_cannot_be_written_is_said_once(tmp_path, monkeypatch):
    blocked = tmp_path / "file"
    blocked.write_text("no folder")
    monkeypatch.setenv("OHMWARD_CACHE", str(blocked))
    machine_code.say_once.cache_clear()
    with pytest.warns(RuntimeWarning, match="OHMWARD_CACHE"):
        assert counted(SOURCE)[1]
    assert counted(SOURCE)[1]  # a second warning would be an error here


def test_several_processes_may_write_at_once(cache):
    code = f"""
from ohmward.trace.lower import llvm_machine_code as machine_code
for k in range(50):
    machine_code.cached({SOURCE!r} + ";" * (k % 5), lambda: b"x" * 10000)
"""
    writers = [subprocess.Popen([sys.executable, "-c", code]) for _ in range(3)]
    assert all(w.wait() == 0 for w in writers)
    assert len(list(cache.iterdir())) == 5
    assert counted(SOURCE) == (b"x" * 10000, False)


def test_without_llvmlite_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "llvmlite.binding", None)
    machine_code.llvm.cache_clear()
    with pytest.raises(machine_code.NoMachineCodeError, match="pip install llvmlite"):
        machine_code.llvm()
    monkeypatch.undo()
    machine_code.llvm.cache_clear()


def test_the_cache_does_not_grow_for_ever(cache, monkeypatch):
    monkeypatch.setattr(machine_code, "MOST_ENTRIES", 8)
    for k in range(30):
        counted(f"{SOURCE};{k}")
        assert len(list(cache.iterdir())) <= 8
    assert counted(f"{SOURCE};29")[1] is False
