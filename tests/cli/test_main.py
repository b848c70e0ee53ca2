import json
import os
import re
import shlex
import signal
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

import ohmward
from markdown_pages import redirected
from ohmward.__main__ import run
from ohmward.battery.chemistries import CHEMISTRIES
from ohmward.battery.identification import DEFAULT_MODEL, MODELS
from ohmward.battery.soc.registry import DEFAULT, ESTIMATORS, published
from ohmward.cli import arguments, main
from ohmward.cli.parser import count, pair, share
from ohmward.errors import OhmwardError
from ohmward.traction import RLMA, save_robot

COMMANDS = tuple(main.COMMANDS)


def python(*words: str, **options) -> subprocess.CompletedProcess:
    return subprocess.run([sys.executable, *words], capture_output=True, text=True, check=False, **options)


def ohmward_in_a_shell(line: str, **options) -> subprocess.CompletedProcess:
    return subprocess.run(
        ["bash", "-c", line.replace("ohmward", f"{sys.executable} -m ohmward")],
        capture_output=True,
        text=True,
        check=False,
        **options,
    )


def help_of(command: str, capsys) -> str:
    with pytest.raises(SystemExit) as end:
        main.main([command, "--help"])
    assert end.value.code == 0
    return capsys.readouterr().out


@pytest.mark.parametrize("words", [("--help",), *((command, "--help") for command in COMMANDS)])
def test_help_imports_no_numpy(words):
    code = f"import sys; from ohmward.cli.main import main\ntry: main({list(words)!r})\nexcept SystemExit: pass\n"
    done = python("-c", code + "assert 'numpy' not in sys.modules and 'msgspec' not in sys.modules", cwd="/")
    assert done.returncode == 0, done.stderr


def test_help_is_instant():
    def cost_s(*words: str) -> float:
        before = os.times()
        python(*words)
        after = os.times()
        return after.children_user - before.children_user + after.children_system - before.children_system

    of_help_s = min(cost_s("-m", "ohmward", "--help") for _ in range(5))
    assert of_help_s < 2 * min(cost_s("-c", "import numpy") for _ in range(5))


def test_version(capsys):
    with pytest.raises(SystemExit):
        main.main(["--version"])
    assert capsys.readouterr().out == f"ohmward {ohmward.__version__}\n"


@pytest.mark.parametrize("words", [("qqq",), ("soc",), ("soc", "day.csv"), ("doctor", "x.csv", "--nonsense")])
def test_usage_errors_are_refused_like_all_others(words, refused):
    assert "--help`" in refused(*words)


@pytest.mark.parametrize("typed, meant", [("sco", "soc"), ("identfy", "identify"), ("misson", "mission")])
def test_a_mistyped_command_is_answered_with_the_one_that_was_meant(typed, meant, refused):
    assert f"did you mean `ohmward {meant}`?" in refused(typed, "day.csv")


def test_a_mistyped_option_is_named_before_those_that_are_missing(refused):
    assert "no option '--batery'; did you mean `--battery`?" in refused("soc", "day.csv", "--batery", "battery.toml")


@pytest.mark.parametrize(
    ("words", "before"),
    [
        (("", "--battery", "b.toml"), "soc"),
        (("d.csv", "--battery", ""), "--battery"),
        (("-o=", "--report="), "--report"),
    ],
)
def test_an_empty_argument_is_no_folder(words, before, refused):
    assert f"the argument behind {before!r} is empty" in refused("soc", *words)


@pytest.mark.parametrize("words, same", [((), ("--help",)), (("help",), ("--help",)), (("help", "soc"), ("soc", "-h"))])
def test_no_command_and_help_show_the_help(words, same, capsys):
    shown = []
    for line in (words, same):
        with pytest.raises(SystemExit, match="0"):
            main.main(list(line))
        shown.append(capsys.readouterr().out)
    assert shown[0] == shown[1]


def test_a_fault_of_ohmward_is_told_from_a_finding(here, monkeypatch, capsys):
    def broken(*_, **__):
        raise ValueError("min() arg is an empty sequence")

    monkeypatch.setattr("ohmward.logs.log.read_log", broken)
    assert main.main(["doctor", "day.csv"]) == main.BUG
    said = capsys.readouterr().err
    assert "Traceback" in said and "this is a fault of ohmward" in said and "ValueError: min() arg" in said


@pytest.mark.parametrize(
    "words", [("doctor", "{}.csv"), ("soc", "day.csv", "--battery", "battery.toml", "-o", "{}.csv")]
)
def test_a_path_that_the_system_refuses_is_no_fault_of_ohmward(words, here, refused):
    assert "(File name too long); choose another path" in refused(*(word.format(300 * "x") for word in words))


def test_a_terminal_without_a_sign_loses_only_the_sign(here):
    environment = os.environ | {"PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0", "LC_ALL": "C"}
    done = python("-m", "ohmward", "soc", "day.csv", "--battery", "battery.toml", env=environment)
    assert done.returncode == 0, done.stderr
    assert re.search(r"% \? \d", done.stdout)


def test_an_interrupt_while_modules_load_leaves_no_traceback(monkeypatch):
    class Interrupted:
        def find_spec(self, name, path=None, target=None):
            raise KeyboardInterrupt

    monkeypatch.delitem(sys.modules, "ohmward.cli.main")
    monkeypatch.setattr(sys, "meta_path", [Interrupted()])
    assert run() == 130


def test_abbreviated_options_are_refused(here, refused):
    assert "--truth-sta" in refused("soc", "day.csv", "--battery", "battery.toml", "--truth-sta", "1")


def test_help_names_what_there_is(capsys):
    assert set(re.findall(r"\b[a-z.-]+\b", help_of("soc", capsys))) >= {*ESTIMATORS, *published()}
    text = help_of("identify", capsys)
    assert all(name in text for name in ("thevenin-0rc", "thevenin-3rc", "rc"))
    assert MODELS[:2] == ("thevenin", "thevenin-0rc") and MODELS[-2:] == ("thevenin-3rc", "rc")
    assert all(name in text for name in CHEMISTRIES)


def test_defaults_are_those_of_the_library():
    arguments = main.parse(["soc", "day.csv", "--battery", "b.toml"])
    assert arguments.filter == DEFAULT
    arguments = main.parse(["identify", "test.csv", "--capacity-ah", "1"])
    assert arguments.model == DEFAULT_MODEL


@pytest.mark.parametrize(
    ("words", "name", "value"),
    [
        (("service", "install", "--print", "my.toml"), "setup", "my.toml"),
        (("learn", "1.csv", "--battery", "b.toml", "2.csv", "-q", "3.csv"), "logs", ["1.csv", "2.csv", "3.csv"]),
        (("soc", "--battery", "b.toml", "--", "-1.csv"), "log", "-1.csv"),
    ],
)
def test_options_may_stand_between_files(words, name, value):
    assert getattr(main.parse(words), name) == value


@pytest.mark.parametrize("command", COMMANDS)
def test_every_help_has_examples_and_the_options_common_to_all(command, capsys):
    options, examples = help_of(command, capsys).split("\nexamples:\n")
    assert f"  ohmward {command}" in examples
    assert "-v, --verbose" in options and "-q, --quiet" in options


EXAMPLES = [
    line.strip()
    for add_arguments in (arguments.doctor, arguments.identify, arguments.soc)
    for line in (add_arguments.__doc__ or "").splitlines()
    if line.startswith("    ohmward ")
]


@pytest.mark.parametrize("line", EXAMPLES)
def test_examples_of_the_help_can_be_pasted(line, here, capsys):
    save_robot(RLMA, here / "robot.toml")
    rows = "".join(f"{k / 20},1,{k % 9}\n" for k in range(99))
    (here / "drive.csv").write_text(f"time_s,velL_rad_s,velR_rad_s\n{rows}")
    if line.startswith("ohmward identify"):
        (here / "battery.toml").unlink()
        line += " --model thevenin-1rc" if "--model" not in line else ""
    words, file = redirected(shlex.split(line)[1:])
    assert main.main(words) == 0
    if file:
        assert capsys.readouterr().out


def test_a_closed_pipe_is_quiet(here):
    done = ohmward_in_a_shell("set -o pipefail; ohmward doctor day.csv | true", cwd=here)
    assert done.stderr == ""
    assert done.returncode in (0, main.BROKEN_PIPE)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
@pytest.mark.parametrize("option", ["", "--json"])
def test_a_full_disk_under_standard_output_is_no_fault_of_ohmward(here, option):
    done = ohmward_in_a_shell(f"ohmward doctor day.csv {option} > /dev/full", cwd=here)
    assert done.returncode == main.REFUSED
    assert done.stderr.splitlines()[-1] == (
        "ohmward: error: standard output takes no more (No space left on device); free the disk, or send it elsewhere"
    )


def test_a_battery_file_that_is_written_again_is_kept_beside_the_new_one(tmp_path, capsys):
    file = tmp_path / "battery.toml"
    words = ["--capacity-ah", "12", "-o", str(file), "--json"]
    assert main.main(["generic", "--chemistry", "lfp", *words]) == 0
    assert json.loads(capsys.readouterr().out)["backup"] is None
    before = file.read_bytes()
    assert main.main(["generic", "--chemistry", "nmc", *words]) == 0
    backup = Path(json.loads(capsys.readouterr().out)["backup"])
    assert backup == tmp_path / "battery.toml.bak" and backup.read_bytes() == before != file.read_bytes()


def test_a_file_in_the_place_of_another_is_named(here, capsys):
    assert main.main(["soc", "day.csv", "--battery", "day.csv"]) == main.REFUSED
    assert capsys.readouterr().err.endswith("day.csv: is no TOML; is it a battery file?\n")
    assert main.main(["soc", "battery.toml", "--battery", "battery.toml"]) == main.REFUSED
    assert "battery.toml: is a TOML file, not a log" in capsys.readouterr().err


def test_an_interrupt_ends_with_130(here, monkeypatch):
    def interrupted(*_, **__):
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr("ohmward.logs.log.read_log", interrupted)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # background jobs start with it ignored
    try:
        assert main.main(["doctor", "day.csv"]) == 130
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_log_that_does_not_fit_into_memory_is_refused(here, monkeypatch, refused):
    def too_long(*_, **__):
        raise MemoryError("Unable to allocate 80 GB")

    monkeypatch.setattr("ohmward.logs.log.read_log", too_long)
    assert "out of memory (Unable to allocate 80 GB); cut the log into parts" in refused("doctor", "day.csv")


def test_warnings_are_one_line(here, monkeypatch, capsys):
    def warn(*_, **__):
        warnings.warn("the disk is warm", RuntimeWarning, stacklevel=1)
        raise OhmwardError("and full")

    monkeypatch.setattr("ohmward.logs.log.read_log", warn)
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        main.main(["doctor", "day.csv"])
    assert capsys.readouterr().err == "ohmward: note: the disk is warm\nohmward: error: and full\n"


def test_notes_go_to_standard_error_with_json(here, capsys):
    main.main(["doctor", "day.csv", "--json"])
    out, err = capsys.readouterr()
    assert out.startswith("{")
    assert "positive current charges the battery" in err


def test_nothing_half_written_when_the_disk_refuses(here, monkeypatch, refused):
    def full(*_):
        raise OSError(28, os.strerror(28))

    monkeypatch.setattr("os.fsync", full)
    message = refused("soc", "day.csv", "--battery", "battery.toml", "-o", "estimates.csv")
    assert "No space left on device" in message
    message = refused("soc", "day.csv", "--battery", "battery.toml", "--report", "report.html")
    assert "No space left on device" in message
    assert sorted(p.name for p in here.iterdir()) == ["battery.toml", "day.csv", "ocv.csv", "test.csv"]


@pytest.mark.parametrize(("text", "value"), [("current=I batt", ("current", "I batt")), ("a=b=c", ("a", "b=c"))])
def test_pairs(text, value):
    assert pair(text) == value


@pytest.mark.parametrize("text", ["current", "=x", "current="])
def test_pairs_that_are_none(text):
    with pytest.raises(Exception, match="NAME=VALUE"):
        pair(text)


@pytest.mark.parametrize("text", ["80", "-0.1", "1.01", "nan", "full"])
def test_shares_that_are_none(text):
    with pytest.raises(Exception, match="must be"):
        share(text)
    assert share("1") == 1.0


@pytest.mark.parametrize("text", ["0", "-3", "2.5", "four"])
def test_counts_that_are_none(text):
    with pytest.raises(Exception, match="whole number"):
        count(text)


def test_the_demo_is_a_command():
    assert "demo" in main.COMMANDS


def test_threads_do_not_fight_over_small_matrices_unless_the_user_wants_it(monkeypatch, capsys):
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    assert main.main(["simulate", "--list"]) == 0
    assert os.environ["OMP_NUM_THREADS"] == "3"
    monkeypatch.delenv("OMP_NUM_THREADS")
    assert main.main(["simulate", "--list"]) == 0
    assert os.environ["OMP_NUM_THREADS"] == "1"
