"""`ohmward setup`: the setup of `ohmward run`, written from what a robot's bus, broker or recording offers.

In a package, since colcon takes every file `setup.py` for a package of its own.
"""

from __future__ import annotations

import argparse
import json
import math
import re
import shlex
import sys
import urllib.parse
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ohmward.atomic import back_up, write_text
from ohmward.battery.chemistries import chemistry, generic_battery
from ohmward.battery.file import BATTERY_FILE
from ohmward.cli import arguments
from ohmward.cli.outcome import Outcome, check_output
from ohmward.cli.parser import Parser
from ohmward.cli.wording import bullets, fields, paragraphs
from ohmward.errors import InputError
from ohmward.logs.bags.bag_table import is_recording
from ohmward.logs.can_file import is_can
from ohmward.onboard import discovery
from ohmward.onboard.can_bus import CanDatabase, CanPort
from ohmward.onboard.message import ScaledSignal, signal_line
from ohmward.onboard.mqtt_broker import MqttBroker
from ohmward.onboard.recognition import Answers, Offered, Question, ask_wheels, recognise
from ohmward.onboard.robot_setup import SETUP_FILE
from ohmward.onboard.sinks.ros2 import Ros2Sink
from ohmward.onboard.sources.ros2 import TOPICS, wheel_of
from ohmward.quantities import QUANTITIES
from ohmward.toml_file import noun_of
from ohmward.traction.robot.packaged import PACKAGED, generic_robot, load_robot
from ohmward.traction.robot.robot import ROBOT_FILE

_DATABASES = (".dbc", ".kcd", ".sym", ".arxml")
_BUS = re.compile(r"(?P<interface>[a-z]\w*):(?P<channel>[^/].*)|(?P<link>v?can\d+)")
_PORT = re.compile(r"/dev/\S+|COM\d+|socket://\S+")

_SOURCES = (
    f"give a CAN database ({', '.join(_DATABASES)}), a recording of CAN (candump, ASC, BLF, TRC, SavvyCAN) or of ROS "
    "(MCAP, SQLite, rosbag1, or their folder), can0 or INTERFACE:CHANNEL, mqtt://HOST, or a serial port"
)
#: Example of a chemistry.
_CHEMISTRY = "lfp"
#: A cell may be charged at this many times its open-circuit voltage.
_CHARGED = 1.03

#: Settings of the ROS source whose topics are found by their type. Others give a speed, which may be that of the wheels
#: themselves, or one to the east: they are wired only if named.
_BY_TYPE = ("battery_state", "joint_states", "imu")


class Offer(NamedTuple):
    """A source of the setup: its kind and settings, the signals that it offers, and the questions about it."""

    kind: str
    settings: dict[str, Any]
    offered: list[Offered]
    topics: tuple[discovery.BagTopic, ...] = ()
    questions: tuple[Question, ...] = ()


class SetupPlan(NamedTuple):
    """A setup that can be written."""

    args: argparse.Namespace  #: of the command line: path of the setup, sources as given, name of the robot
    sources: list[tuple[Offer, Mapping[str, ScaledSignal]]]
    battery: str | None  #: path of its file; likewise `robot`
    robot: str | None
    files: dict[str, str]  #: path -> text of battery and robot files that are made
    questions: list[Question]
    notes: list[str]
    unused: list[str]


def run(args: argparse.Namespace) -> Outcome:
    """Examine the sources, ask open questions on a terminal, and write the files."""
    check_output("--output", args.output, (".toml",), (args.battery or "", args.robot or ""))
    offers = [_look(source, args) for source in args.sources]
    plan = make_plan(args, offers)
    asking = sys.stdin.isatty() and not args.json
    while asking and plan.questions and (words := _ask(plan.questions)):
        parser = Parser(prog="ohmward setup")
        arguments.setup(parser)
        args = parser.parse_args([*args.sources, *words], argparse.Namespace(**vars(args) | {"sources": None}))
        plan = make_plan(args, offers)
    if not (plan.questions or _found(plan)):
        among = ", ".join(_heard(one) for offer in offers for one in offer.offered)
        raise InputError(
            f"no signal of a battery or of wheels was recognised among {among or 'none'}; wire some: "
            "--signal battery_current_A=NAME"
        )
    if plan.battery is None and plan.robot is None:
        raise InputError(
            f"{len(_found(plan))} signals recognised, and neither a battery nor a robot to estimate with; "
            + " ".join(question.text for question in plan.questions),
            [word for question in plan.questions for word in (question.option, question.example)],
        )
    backups = _write(plan)
    return Outcome(_summary(plan, backups), _text(plan, backups), status=1 if plan.questions else 0)


def _heard(one: Offered) -> str:
    """Name of an offered number, with its range where that is known."""
    lowest, highest = one.range
    return f"{one.name} ({lowest:.4g} to {highest:.4g})" if lowest <= highest else one.name


def _look(source: str, args: argparse.Namespace) -> Offer:
    """The signals that a source offers."""
    path = Path(source)
    if path.suffix.lower() in _DATABASES:
        return _can(CanPort(channel=args.channel or "can0"), source, discovery.of_database(CanDatabase(source)))
    if (path.is_file() or path.is_dir()) and is_recording(path):
        return _recording(discovery.topics_of_bag(source), {})
    if path.is_file() and is_can(path):
        log = discovery.of_can_log(source, CanDatabase(_database(source, args)))
        return _can(CanPort(channel=args.channel or "can0"), args.dbc, log)
    if path.is_file() or path.is_dir():
        raise InputError(
            f"{source} is a recording neither of a CAN bus nor of ROS, so it does not show what the robot will send; "
            f"{_SOURCES}. What is in a log: ohmward doctor {shlex.quote(source)}"
        )
    if source.startswith("mqtt://"):
        return _broker(source, args)
    if _PORT.fullmatch(source):
        return _line(source, args)
    if found := _BUS.fullmatch(source):
        port = CanPort(found["interface"] or "socketcan", found["channel"] or found["link"])
        return _can(port, args.dbc, discovery.of_bus(port, CanDatabase(_database(source, args)), args.seconds))
    raise InputError(f"{source!r} is neither a file nor another source; {_SOURCES}")


def _database(source: str, args: argparse.Namespace) -> str:
    if args.dbc is None:
        raise InputError(f"{source}: frames have no names without the database of the bus: --dbc robot.dbc")
    return str(args.dbc)


def _can(port: CanPort, dbc: str, offered: list[Offered]) -> Offer:
    settings = {"interface": port.interface, "channel": port.channel, "dbc": dbc}
    return Offer("can", settings, offered)


def _broker(source: str, args: argparse.Namespace) -> Offer:
    url = urllib.parse.urlsplit(source)
    settings: dict[str, Any] = {"host": url.hostname or "localhost", "port": url.port or 1883}
    settings |= {"username": url.username} if url.username else {}
    settings |= {"password": args.password} if args.password else {}
    offered = discovery.of_broker(MqttBroker(**settings), args.seconds)
    own = sorted({topic for one in offered if (topic := one.name.rpartition("#")[0]) and one.short in QUANTITIES})
    left = [one for one in offered if one.name.partition("#")[0] not in own]
    return Offer("mqtt", settings | ({"topics": own} if own else {}), left)


def _line(source: str, args: argparse.Namespace) -> Offer:
    """Numbers that a board prints, or messages, whose values have only the names that --message gives."""
    given = {number: names.split(",") for number, names in args.message}
    heard, printed = ({}, []) if given else discovery.of_line(source, args.baud, args.seconds)
    settings = {"port": source, "baud": args.baud}
    if printed and not heard:
        return Offer("serial", settings, printed)
    questions = [
        Question(f"message {number} has {count} values: what are they, in order?", "--message", f"{number}=NAME,...")
        for number, count in heard.items()
    ]
    names = [name for names in given.values() for name in names if name.partition(".")[0] not in QUANTITIES]
    offered = [Offered(name, name) for name in names if name]
    return Offer("serial", settings | {"messages": given}, offered, (), tuple(questions))


def _recording(topics: Sequence[discovery.BagTopic], chosen: Mapping[str, str]) -> Offer:
    """Topics of a ROS recording, which the robot has too; where several have one type, a question asks which.

    chosen: topics by the setting of the source, where the user names them.
    """
    settings: dict[str, Any] = {}
    questions, joints = [], []
    for key, type_ in TOPICS.items():
        of_type = [topic for topic in topics if topic.type == type_ and chosen.get(key, topic.name) == topic.name]
        if not of_type or key not in (*_BY_TYPE, *chosen):
            continue
        if len(of_type) > 1:
            names = ", ".join(topic.name for topic in of_type)
            questions.append(
                Question(f"{names} are all {type_}: which one is it?", "--signal", f"{key}={of_type[0].name}")
            )
        settings[key] = of_type[0].name
        joints += list(of_type[0].joints)
    offered = [Offered(joint, f"{joint} velocity", "rad/s") for joint in joints]
    return Offer("ros2", settings, offered, tuple(topics), tuple(questions))


def make_plan(args: argparse.Namespace, offers: Sequence[Offer]) -> SetupPlan:
    """Signals of the sources, files of battery and robot, and the open questions."""
    of_ros = dict(pair for pair in args.signal if pair[0] in TOPICS)
    signals = {signal: name for signal, name in args.signal if signal not in TOPICS}
    answers = Answers(signals, dict(args.unit), args.current_sign, args.shaft, args.counts_per_turn)
    _check_topics(of_ros, [topic for offer in offers for topic in offer.topics])
    offers = [_recording(offer.topics, of_ros) if offer.kind == "ros2" else offer for offer in offers]
    first = [recognise(offer.offered, None, _of(answers, offer, len(offers) == 1)) for offer in offers]
    sent = [s for offer, found in zip(offers, first, strict=True) for s in _named(offer, found.signals)]
    signals_of_battery = [signal for signal in sent if signal.startswith(("battery", "cell"))]
    battery = _battery(args, signals_of_battery, _voltage_V(offers, [found.signals for found in first]))
    robot = _robot(args, [signal for signal in sent if signal.startswith("wheel")])
    of_robot = ROBOT_FILE.parse(robot.text) if robot.text else load_robot(robot.path) if robot.path else None
    questions = [*battery.questions, *robot.questions, *(question for offer in offers for question in offer.questions)]
    sources: list[tuple[Offer, Mapping[str, ScaledSignal]]] = []
    notes: list[str] = []
    others: list[Offered] = []
    wired: list[str] = []
    for offer in offers:
        found = recognise(offer.offered, of_robot, _of(answers, offer, len(offers) == 1))
        settings = offer.settings
        if offer.kind == "ros2":
            joints = {s.partition(".")[2]: j.name for s, j in found.signals.items()}
            joints = joints if any(wheel_of(joint) != wheel for wheel, joint in joints.items()) else {}
            offer = offer._replace(settings=settings | ({"joints": joints} if joints else {}))
        sources.append((offer, {} if offer.kind == "ros2" else found.signals))
        wired += _named(offer, found.signals)
        others += [one for one in offer.offered if one.name in found.unused]
        questions += found.questions
        notes += [*found.notes, *_speed_notes(offer)]
    if of_robot and not any(question.option == "--message" for question in questions):
        questions += ask_wheels(of_robot, wired, others)
    unused = [*(one.name for one in others), *(name for offer in offers for name in _unused_topics(offer))]
    made = {str(file.path): file.text for file in (battery, robot) if file.text}
    return SetupPlan(args, sources, battery.path, robot.path, made, questions, notes, unused)


def _unused_topics(offer: Offer) -> dict[str, str]:
    """Topics of a ROS recording that are not wired -> their types."""
    return {topic.name: topic.type for topic in offer.topics if topic.name not in offer.settings.values()}


def _speed_notes(offer: Offer) -> list[str]:
    """Notes on topics with a speed, which are wired only if named."""
    keys = {type_: key for key, type_ in TOPICS.items() if key not in _BY_TYPE}
    return [
        f"{name} is not used, since it may be odometry of the wheels, or a velocity to the east; if it is the forward "
        f"speed from GNSS, lidar or cameras, add --signal {keys[type_]}={name}"
        for name, type_ in _unused_topics(offer).items()
        if type_ in keys
    ]


def _of(answers: Answers, offer: Offer, alone: bool) -> Answers:
    """The answers about one source: those on signals that it offers, or all of them if it is the only source."""
    names = {name for one in offer.offered for name in (one.name, one.short)}
    return answers._replace(signals={s: name for s, name in answers.signals.items() if alone or name in names})


def _check_topics(chosen: Mapping[str, str], topics: Sequence[discovery.BagTopic]) -> None:
    """Raise InputError for a topic that no recording has, or that is of another type than its setting takes."""
    for key, name in chosen.items():
        if not any(topic.name == name and topic.type == TOPICS[key] for topic in topics):
            listing = ", ".join(f"{topic.name} ({topic.type})" for topic in topics) or "none"
            raise InputError(
                f"--signal {key}={name}: there is no such topic of type {TOPICS[key]}; there are: {listing}"
            )


def _named(offer: Offer, signals: Mapping[str, ScaledSignal]) -> list[str]:
    """Signals that a source will send, as far as they are known."""
    messages = [name for names in offer.settings.get("messages", {}).values() for name in names]
    of_ros = ["battery_voltage_V"] if "battery_state" in offer.settings else []
    return [*signals, *of_ros, *(name for name in messages if name.partition(".")[0] in QUANTITIES)]


class _File(NamedTuple):
    """File of the battery or of the robot."""

    path: str | None  #: None where there is none
    text: str = ""  #: of a file that is to be made
    questions: tuple[Question, ...] = ()


def _voltage_V(offers: Sequence[Offer], wired: Sequence[Mapping[str, ScaledSignal]]) -> float:
    """Usual voltage of the battery as heard or recorded; nan where it is not known."""
    for offer, signals in zip(offers, wired, strict=True):
        if signal := signals.get("battery_voltage_V"):
            values = next(one.values for one in offer.offered if one.name == signal.name)
            if np.isfinite(values).any():
                return signal.scale * float(np.nanmedian(values)) + signal.offset
        for topic in offer.topics:
            if topic.name == offer.settings.get("battery_state"):
                return topic.voltage_V
    return math.nan


def _battery(args: argparse.Namespace, signals: Sequence[str], voltage_V: float) -> _File:
    """The battery file that is given, one made from the label, or one that is already beside the setup."""
    path = str(Path(args.output).with_name("battery.toml"))
    if args.battery:
        BATTERY_FILE.load(args.battery)
        return _File(str(args.battery))
    cells = sum(signal.startswith("cell") for signal in signals)
    if args.chemistry and args.capacity_ah and (n_series := args.n_series or cells):
        return _File(path, BATTERY_FILE.dump(generic_battery(args.chemistry, args.capacity_ah, n_series)))
    if not (args.chemistry or args.capacity_ah) and noun_of(path) == BATTERY_FILE.noun:
        return _File(path)
    n_series = 8
    in_series = "how many of its cells are in series?"
    if voltage_V > 0.0:
        usual = args.chemistry or _CHEMISTRY
        n_series = _cells_in_series(usual, voltage_V)
        in_series += f" {voltage_V:.4g} V suggest about {n_series} of {usual}"
    of_chemistry = "of which chemistry is the battery? Or its file, --battery FILE.toml"
    answers = {
        Question(of_chemistry, "--chemistry", _CHEMISTRY): args.chemistry,
        Question("which capacity [Ah] is on its label?", "--capacity-ah", "40"): args.capacity_ah,
        Question(in_series, "--n-series", str(n_series)): args.n_series or cells,
    }
    return _File(None, questions=_unanswered(answers) if signals else ())


def _cells_in_series(name: str, voltage_V: float) -> int:
    """Number of cells of a chemistry at a voltage between nearly empty and full, nearest to half full."""
    low_V, half_V, full_V = np.quantile(chemistry(name).ocv_V, (0.1, 0.5, 1.0))
    counts = range(math.ceil(voltage_V / (_CHARGED * full_V)), math.floor(voltage_V / low_V) + 1)
    half = voltage_V / half_V
    return min(counts, key=lambda count: abs(count - half), default=max(round(half), 1))


def _robot(args: argparse.Namespace, wheels: Sequence[str]) -> _File:
    """The robot file, chosen as in `_battery`; a packaged robot has a name instead of a path."""
    path = str(Path(args.output).with_name("wheels.toml"))
    if args.robot:
        load_robot(args.robot)
        return _File(str(args.robot))
    sizes = (args.mass_kg, args.wheel_radius_m, args.track_m)
    if all(sizes):
        layout = "skid-steer" if (args.wheels or len(wheels)) > 2 else "two-wheel"
        made = generic_robot(*sizes, args.wheelbase_m, args.gear, layout, args.name)
        return _File(path, ROBOT_FILE.dump(made))
    if not any(sizes) and noun_of(path) == ROBOT_FILE.noun:
        return _File(path)
    of_mass = f"what does the robot weigh [kg]? Or its file, --robot FILE.toml, or {', '.join(PACKAGED)}"
    answers = {
        Question(of_mass, "--mass-kg", "60"): args.mass_kg,
        Question("what is the radius of its wheels [m]?", "--wheel-radius-m", "0.1"): args.wheel_radius_m,
        Question("how far apart are its left and right wheels [m]?", "--track-m", "0.45"): args.track_m,
    }
    return _File(None, questions=_unanswered(answers) if wheels else ())


def _unanswered(answers: Mapping[Question, Any]) -> tuple[Question, ...]:
    """The questions without an answer."""
    return tuple(question for question, answer in answers.items() if not answer)


def _ask(questions: Sequence[Question]) -> list[str]:
    """Answers given on the terminal, as words of a command line; an empty answer leaves its question open."""
    print(f"{len(questions)} to ask; Enter leaves one open", file=sys.stderr)
    words: list[str] = []
    for k, question in enumerate(questions, start=1):
        fixed, equals, example = question.example.rpartition("=")
        print(f"{k}/{len(questions)} {question.text} [{example}] ", end="", file=sys.stderr, flush=True)
        if answer := sys.stdin.readline().strip():
            file = {"--chemistry": "--battery", "--mass-kg": "--robot"}.get(question.option)
            if file and (answer.endswith(".toml") or answer in PACKAGED):
                words += [file, answer]
            else:
                words += [question.option, f"{fixed}{equals}{answer}"]
    return words


def _write(plan: SetupPlan) -> dict[str, str]:
    """Write the files; returns path -> backup of the file that was there before."""
    text = "\n".join(_lines(plan)) + "\n"
    SETUP_FILE.parse(text)
    backups = {}
    for path, content in {**plan.files, plan.args.output: text}.items():
        if backup := back_up(Path(path)):
            backups[path] = str(backup)
        write_text(Path(path), content)
    return backups


def _lines(plan: SetupPlan) -> Iterator[str]:
    yield SETUP_FILE.header
    yield f"# Written by `ohmward setup` from {', '.join(plan.args.sources)}."
    yield from (f"# To be answered: {q.text} {q.option} {q.example}" for q in plan.questions)
    head = {"format": SETUP_FILE.format, "name": plan.args.name, "battery": plan.battery, "robot": plan.robot}
    yield from _settings(head | {"counts_per_turn": plan.args.counts_per_turn})
    for k, (offer, signals) in enumerate(plan.sources):
        if not (signals or offer.kind == "ros2" or offer.settings.get("topics") or offer.settings.get("messages")):
            continue
        same = any(other.kind == offer.kind for other, _ in plan.sources[:k])
        yield from ("", "[[source]]", f'kind = "{offer.kind}"')
        yield from _settings(offer.settings | ({"name": f"{offer.kind}-{k + 1}"} if same else {}))
        for key in ("messages", "joints"):
            if entries := offer.settings.get(key):
                yield from ("", f"[source.{key}]", *(f"{json.dumps(n)} = {json.dumps(v)}" for n, v in entries.items()))
        if signals:
            yield from ("", "[source.signals]", *(signal_line(*one) for one in signals.items()))
    for kind in ("page", "store"):
        yield from ("", "[[sink]]", f'kind = "{kind}"')
    if of_ros := next((offer.settings for offer, _ in plan.sources if offer.kind == "ros2"), None):
        yield from ("", "[[sink]]", 'kind = "ros2"')
        own = Ros2Sink.battery_state
        is_heard = of_ros.get("battery_state", "").strip("/") == own
        yield from _settings({"battery": plan.battery, "battery_state": f"ohmward/{own}" if is_heard else None})


def _settings(values: Mapping[str, Any]) -> Iterator[str]:
    """Lines of settings; strings, numbers and lists are written in TOML as in JSON."""
    for key, value in values.items():
        if value is not None and not isinstance(value, dict):
            yield f"{key} = {json.dumps(value, ensure_ascii=False)}"


def _wired(signal: ScaledSignal) -> str:
    scale = f" × {signal.scale:.6g}" if signal.scale != 1.0 else ""
    return f"{signal.name}{scale}{f' {signal.offset:+.6g}' if signal.offset else ''}"


def _found(plan: SetupPlan) -> dict[str, str]:
    """What the robot sends, by ohmward's names: signals, ROS topics, and values that have such names already."""
    found: dict[str, str] = {}
    for offer, signals in plan.sources:
        found |= {s: _wired(signal) for s, signal in signals.items()}
        settings = offer.settings
        found |= {key: settings[key] for key in TOPICS if key in settings}
        found |= {f"wheel {wheel}": joint for wheel, joint in settings.get("joints", {}).items()}
        found |= {f"topic {topic}": "names of its own" for topic in settings.get("topics", ())}
        found |= {n: f"message {k}" for k, names in settings.get("messages", {}).items() for n in names if n}
    return found


def _summary(plan: SetupPlan, backups: Mapping[str, str]) -> dict[str, Any]:
    signals = {
        signal: {"source": offer.kind, **wired.__dict__}
        for offer, found in plan.sources
        for signal, wired in found.items()
    }
    return {
        "command": "setup",
        "output": plan.args.output,
        "battery": plan.battery,
        "robot": plan.robot,
        "written": [*plan.files, plan.args.output],
        "backups": backups,
        "recognised": _found(plan),
        "signals": signals,
        "asked": plan.questions,
        "assumed": plan.notes,
        "unused": plan.unused,
    }


def _text(plan: SetupPlan, backups: Mapping[str, str]) -> str:
    found, asked = _found(plan), plan.questions
    head = f"{plan.args.output}: {len(found)} signals recognised, {len(asked)} asked"
    written = ", ".join([*plan.files, plan.args.output])
    before = "".join(f"; {path} of before is {backup}" for path, backup in backups.items())
    questions = [f"{q.text}  {q.option} {q.example}" for q in asked]
    options = shlex.join([word for q in asked for word in (q.option, q.example)])
    return paragraphs(
        head,
        "Recognised:\n" + fields(found) if found else "",
        bullets("Asked, each with the option that answers it", questions),
        f"All at once, with your answers: {options}" if asked else "",
        bullets("Assumed", plan.notes),
        bullets("Not used", [", ".join(plan.unused)] if plan.unused else []),
        f"Written: {written}{before}",
        f"Next: ohmward run --check {plan.args.output}; then ohmward run {plan.args.output} and http://127.0.0.1:8080",
    )
