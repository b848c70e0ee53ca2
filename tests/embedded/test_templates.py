"""The files around the C as their user meets them: Makefile, CMake, the README's example, C++, another compiler."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from embedded.batteries import soc_library
from markdown_pages import programs
from needs import needs_gcc
from ohmward.embedded import controller_export, library, write_library
from ohmward.traction import RLMA

STRICT = ["-std=c99", "-Wall", "-Wextra", "-Wshadow", "-Wconversion", "-Wdouble-promotion", "-Wundef", "-pedantic"]
MAIN = """
int main(void)
{
    const soc_sample sample = {0.0f, -1.0f, 13.2f, 25.0f};
    (void)on_sample(&sample, true);
    return on_sample(&sample, false).soc > 0.0f ? 0 : 1;
}
"""


def do(*words, **options):
    result = subprocess.run(words, capture_output=True, text=True, check=False, **options)
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout + result.stderr


@pytest.fixture
def soc(tmp_path):
    """A folder with a filter whose start takes arguments."""
    write_library(soc_library("textbook-ekf"), tmp_path / "soc")
    return tmp_path / "soc"


@needs_gcc
def test_the_example_of_the_readme_compiles_as_pasted_and_runs(soc):
    (example,) = re.findall(r"^```c\n(.*?)^```", (soc / "README.md").read_text(), re.DOTALL | re.MULTILINE)
    (soc / "main.c").write_text(example + MAIN)
    assert do("gcc", *STRICT, "-Werror", "-o", "app", "main.c", "soc.c", "-lm", cwd=soc) == ""
    do("./app", cwd=soc)


@needs_gcc
def test_the_example_of_the_page_compiles_as_pasted(soc):
    page = Path(__file__).parents[2] / "docs" / "export.md"
    (example,) = [text for text in programs(page, "c") if "DWT_CYCCNT" in text]
    (soc / "example.c").write_text(example)
    assert do("gcc", *STRICT, "-Werror", "-Wno-int-to-pointer-cast", "-c", "example.c", cwd=soc) == ""


@needs_gcc
def test_another_compiler_or_other_flags_compile_anew(soc):
    do("make", "-s", "-C", soc, "test")
    before = (soc / "soc.o").stat().st_mtime_ns
    do("make", "-s", "-C", soc, "lib")
    assert (soc / "soc.o").stat().st_mtime_ns == before
    do("make", "-s", "-C", soc, "lib", "CFLAGS=-O0 -g")
    assert (soc / "soc.o").stat().st_mtime_ns > before
    do("make", "-s", "-C", soc, "clean")
    assert {p.name for p in soc.iterdir()} == set(soc_library("textbook-ekf"))


@pytest.mark.skipif(not shutil.which("arm-none-eabi-gcc"), reason="no cross compiler here: gcc-arm-none-eabi")
def test_the_makefiles_own_words_make_a_library_for_the_target(soc):
    if shutil.which("gcc"):
        do("make", "-s", "-C", soc, "test")
    lines = (soc / "Makefile").read_text().splitlines()
    command = lines[1].removeprefix("#   ").replace('"', "'").replace("make lib", f"make -s -C {soc} lib")
    do("sh", "-c", command)
    assert "elf32-littlearm" in do("arm-none-eabi-objdump", "-f", soc / "libsoc.a")


@needs_gcc
@pytest.mark.skipif(not shutil.which("cmake"), reason="no CMake here")
def test_cmake_builds_tests_and_is_part_of_a_larger_project(soc, tmp_path):
    write_library(library(controller_export(RLMA, "slip-controller", "wheel")), tmp_path / "wheel")
    do("cmake", "-S", soc, "-B", "alone", cwd=tmp_path)
    do("cmake", "--build", "alone", cwd=tmp_path)
    assert "100% tests passed" in do("ctest", cwd=tmp_path / "alone")
    (tmp_path / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.13)\nproject(robot C)\nenable_testing()\n"
        "add_subdirectory(soc)\nadd_subdirectory(wheel)\n"
        "add_executable(robot main.c)\ntarget_link_libraries(robot soc wheel)\n"
    )
    (tmp_path / "main.c").write_text('#include "soc.h"\n#include "wheel.h"\nint main(void) { return 0; }\n')
    do("cmake", "-S", ".", "-B", "build", cwd=tmp_path)
    do("cmake", "--build", "build", cwd=tmp_path)
    assert "100% tests passed, 0 tests failed out of 2" in do("ctest", cwd=tmp_path / "build")


@needs_gcc
@pytest.mark.skipif(not shutil.which("g++"), reason="no C++ compiler here")
def test_cpp_calls_it(soc):
    (soc / "main.cpp").write_text(
        '#include "soc.h"\nint main() { soc_state s; soc_sample x = {0, 0, 13.2f, 25}; soc_output o;\n'
        "soc_start(&s, &x, 0.5f, 0.3f); soc_step(&s, &x, &o); return o.soc > 0 ? 0 : 1; }\n"
    )
    do("gcc", "-c", "soc.c", cwd=soc)
    do("g++", "-Wall", "-Werror", "-o", "app", "main.cpp", "soc.o", "-lm", cwd=soc)
    do("./app", cwd=soc)


@pytest.mark.skipif(not shutil.which("clang"), reason="no clang here")
@pytest.mark.parametrize("option", ["-O0", "-O2", "-Os"])
def test_clang_gives_the_same_bits(soc, option):
    flags = f"{option} -Werror"
    assert "64 of 64" in do("make", "-s", "-C", soc, "test", env=os.environ | {"CC": "clang", "CFLAGS": flags})
