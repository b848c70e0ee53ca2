from dataclasses import dataclass, field

import pytest

from ohmward.battery.file import BATTERY_FILE
from ohmward.checks import require_positive
from ohmward.errors import InputError, OhmwardError
from ohmward.toml_file import TomlFile, noun_of, parse_toml


@dataclass(frozen=True)
class Circle:
    radius_m: float

    def __post_init__(self) -> None:
        require_positive("circle.radius_m", self.radius_m)


@dataclass(frozen=True)
class Box:
    sides_m: tuple[float, ...] = (1.0, 2.0)


@dataclass(frozen=True)
class Drawing:
    title: str
    frame: Box
    shapes: tuple[Circle | Box, ...] = ()
    stamp: Circle | None = None
    grid: tuple[tuple[float, ...], ...] = ()
    origin: Box = field(default_factory=Box)


FILE = TomlFile(Drawing, "ohmward-drawing/1", "# A drawing.", digits=3, kinds={Circle: "circle", Box: "box"})
DRAWING = Drawing("a", Box(), (Circle(1.0), Box((3.0,))), None, ((1.0, 2.0), ()))
TEXT = FILE.dump(DRAWING)


def test_what_is_saved_is_loaded(tmp_path):
    FILE.save(DRAWING, tmp_path / "a.toml")
    assert FILE.load(tmp_path / "a.toml") == DRAWING
    assert [p.name for p in tmp_path.iterdir()] == ["a.toml"]


def test_one_class_needs_no_kind():
    text = 'format = "ohmward-drawing/1"\ntitle = "b"\nframe = {}\nstamp = {radius_m = 2}'
    assert FILE.parse(text) == Drawing("b", Box(), stamp=Circle(2.0))


def test_the_text():
    long = tuple(float(i) for i in range(11))
    lines = FILE.dump(Drawing("c", Box(long), (Circle(1 / 3),))).splitlines()
    assert lines[:3] == ["# A drawing.", 'format = "ohmward-drawing/1"', 'title = "c"']
    assert lines[lines.index("sides_m = [") + 2] == "    10.0,"
    assert lines[lines.index("[[shapes]]") + 1 :][:2] == ['kind = "circle"', "radius_m = 0.333"]
    assert not any("stamp" in line for line in lines)


@pytest.mark.parametrize(
    "old, new, message",
    [
        ("ohmward-drawing/1", "ohmward-robot/1", "this is a robot file; give a drawing file, whose format is"),
        ("ohmward-drawing/1", "ohmward-drawing/2", "must be 'ohmward-drawing/1', got 'ohmward-drawing/2'; update"),
        ("ohmward-drawing/1", "svg", "format must be 'ohmward-drawing/1', got 'svg'; update"),
        ('format = "ohmward-drawing/1"', "", "format is missing; a drawing file starts with format = "),
        ('"box"', '"cone"', r"shapes\[1\].kind must be one of circle, box; got 'cone'"),
        ('"box"', '["box"]', r"shapes\[1\].kind must be one of circle, box; got \['box'\]"),
        ("radius_m = 1.0", 'radius_m = "1"', r"shapes\[0\].radius_m: expected `float`, got `str`, got '1'; correct it"),
        ("radius_m = 1.0", "radius_m = -1.0", r"shapes\[0\]: circle.radius_m must be > 0, got -1"),
        ("radius_m = 1.0", "", r"shapes\[0\].radius_m is missing; add it"),
        (
            "radius_m = 1.0",
            "radius_mm = 1.0",
            r"shapes\[0\].radius_mm is not a key of a drawing file; did you mean rad",
        ),
        (
            "radius_m = 1.0",
            'radius_m = 1.0\ntitle = "x"',
            r"shapes\[0\].title is not a key of a drawing file; title stands at",
        ),
        ("[1.0, 2.0],", "[1.0, true],", r"grid\[0\]\[1\]: expected `float`, got `bool`"),
    ],
)
def test_mistakes_are_named_with_their_place(old, new, message):
    assert old in TEXT
    with pytest.raises(InputError, match=message):
        FILE.parse(TEXT.replace(old, new, 1))


@pytest.mark.parametrize(
    "line, message",
    [
        ("frame = 3", r"frame must be a table \[frame\], got 3"),
        ("frame = {}\nshapes = 3", r"shapes must be a list of tables \[\[shapes\]\], got 3"),
        ('frame = {}\nshapes = ["circle"]', r"shapes\[0\].kind must be one of circle, box; got 'circle'"),
        ("frame = {}\ntitel = 1", "titel is not a key of a drawing file; did you mean title"),
    ],
)
def test_tables_that_are_none(line, message):
    with pytest.raises(InputError, match=message):
        FILE.parse(f'format = "ohmward-drawing/1"\ntitle = "b"\n{line}')


def test_a_long_value_is_shown_in_part():
    with pytest.raises(InputError) as caught:
        FILE.parse(f'format = "ohmward-drawing/1"\ntitle = {list(range(1000))}\nframe = {{}}')
    assert (
        str(caught.value).startswith("title: expected `str`, got `array`, got [0, 1, 2") and len(str(caught.value)) < 99
    )


def test_a_save_that_fails_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "a.toml"
    FILE.save(DRAWING, path)

    def full(*args, **kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OhmwardError, match="cannot be written"):
        FILE.save(Drawing("other", Box()), path)
    assert path.read_text() == TEXT and list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize("line_end", ["\n", "\r\n"])
def test_files_of_windows_are_read(encoding, line_end, tmp_path):
    """Notepad puts a mark before UTF-8, and the shell of Windows writes UTF-16."""
    path = tmp_path / "a drawing.toml"
    path.write_bytes(TEXT.replace("\n", line_end).encode(encoding))
    assert FILE.load(path) == FILE.load(path) == DRAWING
    assert noun_of(path) == "drawing"


def test_a_file_in_another_encoding_is_named(tmp_path):
    (tmp_path / "a.toml").write_bytes('title = "größer"'.encode("latin-1"))
    with pytest.raises(InputError, match=r"is not text in UTF-8; is it a drawing file\? Save it as UTF-8"):
        FILE.load(tmp_path / "a.toml")


def test_a_file_says_what_it_holds(tmp_path):
    FILE.save(DRAWING, tmp_path / "a.toml")
    (tmp_path / "b.toml").write_text("title = 1")
    (tmp_path / "c.toml").write_bytes(b"\xff\xfe")
    assert noun_of(tmp_path / "a.toml") == "drawing"
    assert [noun_of(tmp_path / name) for name in ("b.toml", "c.toml", "none.toml")] == [None, None, None]


@pytest.mark.parametrize("text", ['format.h = "ohmward-battery/3"', "format = [1]", "format = 3"])
def test_a_format_that_is_no_text_is_refused(text):
    with pytest.raises(InputError, match="format must be 'ohmward-battery/3', got "):
        BATTERY_FILE.parse(text)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("v = " + "[" * 100_000 + "]" * 100_000, "arrays or tables nested too deep"),
        ("v = " + "{a = " * 100_000 + "}" * 100_000, "arrays or tables nested too deep"),
        ("v = " + "9" * 100_000, "an integer of more than 4300 digits"),
        ("title = 'a'\n" + ".".join("a" * 50_000) + " = 1", "a key of more than 64 parts in line 2"),
        ("[" + " . ".join(['"a b"'] * 50_000) + "]", "a key of more than 64 parts in line 1"),
        ("v = {" + ".".join("a" * 50_000) + " = 1}", "a key of more than 64 parts in line 1"),
    ],
)
def test_a_text_made_to_break_the_parser_is_no_toml(tmp_path, text, reason):
    path = tmp_path / "drawing.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=f"drawing.toml: is not valid TOML: {reason}") as error:
        FILE.load(path)
    assert "\n" not in str(error.value) and len(str(error.value)) < 400
    assert noun_of(path) is None


def test_long_lines_of_numbers_and_texts_are_toml():
    """The search for long keys is quick, and takes neither decimals nor sentences for one."""
    numbers = ", ".join(["0.125"] * 20_000)
    assert len(parse_toml(f"v = [{numbers}]\nt = '{'a. b.c ' * 20_000}'\nw = '{'a' * 1_000_000}'")["v"]) == 20_000
