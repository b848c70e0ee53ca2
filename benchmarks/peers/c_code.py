"""Generated C of peers, compiled for this processor as one would who wants it fast and right."""

from __future__ import annotations

import shutil
import subprocess
from functools import cache
from pathlib import Path

FLAGS = ("-O3", "-march=native", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=fast")


@cache
def compiler() -> str:
    """The C compiler there is, empty where there is none."""
    return next((name for name in ("clang", "gcc", "cc") if shutil.which(name)), "")


def library(source: Path) -> Path:
    """The shared library of a source, beside it.

    Raises:
        subprocess.CalledProcessError: it does not compile.
    """
    made = source.with_suffix(".so")
    command = [compiler(), *FLAGS, "-w", "-fPIC", "-shared", str(source), "-o", str(made), "-lm"]
    subprocess.run(command, check=True)
    return made
