"""Machine code where there is none."""

import sys

import pytest

from ohmward.trace.lower import llvm_machine_code as machine_code

pytest.importorskip("llvmlite")


def test_without_llvmlite_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "llvmlite.binding", None)
    machine_code.llvm.cache_clear()
    with pytest.raises(machine_code.NoMachineCodeError, match="pip install llvmlite"):
        machine_code.llvm()
    monkeypatch.undo()
    machine_code.llvm.cache_clear()
