"""The script of continuous integration with stand-ins for commands: what it installs, and what it does without."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / ".ci" / "run"
TOOLS = re.findall(r"[\w-]+", re.findall(r"^tools=\((.*?)\)", SCRIPT.read_text(), re.MULTILINE | re.DOTALL)[0])
MISSING = [tool for tool in ("bash", "dirname") if not shutil.which(tool)]
pytestmark = pytest.mark.skipif(bool(MISSING), reason=f"no shell here: {', '.join(MISSING)} missing")


@pytest.fixture
def run(tmp_path):
    """Run the script where these are the only commands; their calls in order, and the result."""
    for tool in ("bash", "dirname"):
        (tmp_path / tool).symlink_to(shutil.which(tool))

    def script(commands):
        log = tmp_path / "log"
        for name, body in commands.items():
            (tmp_path / name).write_text(f'#!{tmp_path}/bash\necho "{name} $*" >> {log}\n{body}\n')
            (tmp_path / name).chmod(0o755)
        result = subprocess.run(
            ["bash", SCRIPT], env={"PATH": str(tmp_path)}, capture_output=True, text=True, check=False
        )
        return [line for line in log.read_text().splitlines() if not line.startswith("id ")], result

    return script


TESTS = ["make environment", "make test", "make test-lab", "make test-spark"]
ROOT, USER, GOOD, BAD = "echo 0", "echo 1000", "exit 0", "exit 1"


def by_command(calls):
    """Calls of the package manager, and those of make one after the other; the static checks run beside them."""
    assert calls.count("make static") == 1
    return ([c for c in calls if c.startswith(tool) and c != "make static"] for tool in ("apt-get", "make"))


def test_root_installs_what_is_missing_then_tests(run):
    calls, result = run({"id": ROOT, "apt-get": GOOD, "make": GOOD})
    assert result.returncode == 0 and result.stderr == ""
    installed, tested = by_command(calls)
    assert [c.split()[-1] for c in installed[:1]] == ["update"] and len(installed) == 2 and tested == TESTS
    assert set(calls[:3]) == {*installed, TESTS[0]}  # beside the packages of Python, and done before the first test
    for package in ("gcc-arm-none-eabi", "libnewlib-arm-none-eabi", "qemu-system-arm", "--no-install-recommends"):
        assert package in installed[1]


def test_what_is_there_is_not_installed(run):
    calls, result = run({"id": ROOT, "apt-get": GOOD, "make": GOOD} | dict.fromkeys(TOOLS, GOOD))
    assert [*by_command(calls)] == [[], TESTS] and result.returncode == 0


@pytest.mark.parametrize("changed, tests", [(BAD, TESTS), (GOOD, [t for t in TESTS if t != "make test-lab"])])
def test_the_laboratory_is_tested_where_it_changed(run, changed, tests):
    git = f'if [ "$1" = rev-list ]; then echo 1a2b3c; else {changed}; fi'
    calls, result = run({"id": USER, "make": GOOD, "git": git} | dict.fromkeys(TOOLS, GOOD))
    assert [*by_command(calls)] == [[], tests] and result.returncode == 0


def test_a_failure_is_tried_once_more_said_and_survived(run):
    calls, result = run({"id": ROOT, "apt-get": BAD, "make": GOOD})
    installed, tested = by_command(calls)
    assert [c.split()[-1] for c in installed] == ["update", "update"] and tested == TESTS and result.returncode == 0
    assert "INSTALLATION FAILED TWICE" in result.stderr


@pytest.mark.parametrize("commands", [{"id": USER, "apt-get": GOOD, "make": GOOD}, {"id": ROOT, "make": GOOD}])
def test_without_root_or_apt_it_says_what_would_be_needed(run, commands):
    calls, result = run(commands)
    assert [*by_command(calls)] == [[], TESTS] and result.returncode == 0
    assert "NOT INSTALLED" in result.stderr and "gcc-arm-none-eabi" in result.stderr


@pytest.mark.parametrize("failing", ["static", "test"])
def test_a_failing_check_or_test_fails_it(run, failing):
    calls, result = run({"id": USER, "make": f'[ "$1" != {failing} ]'})
    assert calls[-1] != "make test-spark" and result.returncode != 0
