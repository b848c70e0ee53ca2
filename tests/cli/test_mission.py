import json
import shutil

import numpy as np
import pytest

from cli.mission_examples import FORCE_N, IDLE_W, PLAN, drive, write_mission_files
from markdown_pages import ROOT
from ohmward.cli.main import main
from ohmward.energy import load_consumption
from ohmward.logs.read import open_table

KEYS = {
    "command", "log", "battery", "robot", "drive", "terrains", "idle_W", "idle_std_W", "soc", "soc_std", "reserve_soc",
    "usable_J", "range_m", "time_left_s", "energy_J_per_m", "power_W", "probability", "plan", "advice", "notes",
    "output", "report",
}  # fmt: skip
LOG = ("mission", "drive.csv", "--mass-kg", "40", "--battery", "battery.toml", "--initial-soc", "0.9")
AHEAD = ("mission", "--plan", "plan.toml", "--battery", "battery.toml", "--soc", "0.6")


@pytest.fixture(scope="module")
def mission_files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("mission")
    write_mission_files(folder)
    return folder


@pytest.fixture
def there(here, mission_files):
    for file in mission_files.iterdir():
        shutil.copy(file, here)
    return here


@pytest.fixture
def table(there, capsys):
    assert main([*LOG, "-o", "table.toml"]) == 0
    capsys.readouterr()
    return "table.toml"


def test_keys_are_always_the_same(there, as_json):
    assert set(as_json(*LOG)) == KEYS
    assert set(as_json(*AHEAD, "--robot", "rlma")) == KEYS


def test_what_a_log_teaches(there, as_json):
    found, truth = as_json(*LOG), drive()
    distance_m = np.trapezoid(truth["speed_m_s"], truth["time_s"])
    energy_J = np.trapezoid(-truth["voltage_V"] * truth["current_A"], truth["time_s"])
    assert found["drive"]["distance_m"] == pytest.approx(distance_m, rel=0.01)
    assert found["drive"]["energy_J"] == pytest.approx(energy_J, rel=1e-3)
    assert found["drive"]["cost_of_transport"] == pytest.approx(energy_J / (40 * 9.80665 * distance_m), rel=0.01)
    # the voltage is not the 11 V that the drive was made with
    scale = np.mean(truth["voltage_V"]) / 11.0
    assert found["idle_W"] == pytest.approx(scale * IDLE_W, rel=0.05)
    for name, force_N in FORCE_N.items():
        at_speed = found["terrains"][name]["force_N"]
        assert abs(at_speed - scale * force_N) < 3 * found["terrains"][name]["force_std_N"]
    assert found["soc"] == pytest.approx(truth["soc_true"][-1], abs=0.02)
    assert found["range_m"]["p10"] < found["range_m"]["p50"] < found["range_m"]["p90"]


def test_the_range_is_that_of_the_same_drive_again(there, as_json):
    found = as_json(*LOG, "--soc", "0.5", "--soc-std", "0.001", "--reserve-soc", "0.1")
    drive_ = found["drive"]
    by_hand = found["usable_J"]["p50"] / drive_["energy_J_per_m"]
    assert found["range_m"]["p50"] == pytest.approx(by_hand, rel=0.02)
    assert found["time_left_s"]["p50"] == pytest.approx(by_hand * drive_["used_s"] / drive_["distance_m"], rel=0.02)


def test_a_plan_with_what_was_learned(table, as_json):
    found = as_json(*AHEAD, "--consumption", table)
    whole = found["plan"]["energy_J"]["p50"]
    assert whole == pytest.approx(13.5 * 60 + 13.5 * (2000 + 1250) + 33 * 1000 + (17 + 5) * 500, rel=0.15)
    assert found["probability"] == found["plan"]["probability"] == found["plan"]["milestones"][-1]["probability"]
    assert found["probability"] > 0.9
    assert as_json(*AHEAD, "--consumption", table, "--reserve-soc", "0.55")["probability"] < 0.2


def test_a_plan_without_a_table_is_broad(table, as_json):
    guessed, known = (
        as_json(*AHEAD, *words)["plan"]["energy_J"] for words in (("--robot", "rlma"), ("--consumption", table))
    )
    assert guessed["p90"] - guessed["p10"] > 2 * (known["p90"] - known["p10"])


def test_a_second_drive_makes_surer(table, as_json):
    first = load_consumption(table)
    as_json(*LOG[:2], *LOG[4:], "--consumption", table, "-o", "again.toml")
    second = load_consumption("again.toml")
    assert [v.drives for v in second.visits] == [2, 2]
    k = first.force_index("grass")
    assert second.cov[k, k] < first.cov[k, k]


def test_after_a_log_the_plan_begins_where_it_ends(there, as_json):
    found = as_json(*LOG, "--plan", "plan.toml")
    assert found["plan"]["milestones"][-1]["soc"]["p50"] < found["soc"]
    assert found["drive"] is not None and found["probability"] is not None


@pytest.mark.slow
def test_wheels_and_motors_give_a_split_that_adds_up(there, capsys, as_json):
    hill = (ROOT / "lab/ohmward_lab/simulate/scenarios/hill.toml").read_text()
    half = hill.replace("duration_s = 20.0", "duration_s = 6.0").replace("from_s = 10.0", "from_s = 4.0")
    (there / "half.toml").write_text(half)
    assert main(["simulate", "half.toml", "-o", "hill.csv"]) == 0
    assert main(["generic", "--chemistry", "lead-acid", "--capacity-ah", "12", "--n-series", "6", "-o", "la.toml"]) == 0
    capsys.readouterr()
    found = as_json("mission", "hill.csv", "--robot", "rlma", "--battery", "la.toml", "--terrain", "dry asphalt")
    split = found["drive"]["split_J"]
    whole = split.pop("battery")
    assert sum(split.values()) == pytest.approx(whole, rel=1e-9)
    assert whole == pytest.approx(found["drive"]["energy_J"], rel=0.02)
    assert min(split[name] for name in ("copper", "drive", "slip", "rolling")) >= 0.0
    assert set(found["drive"]["split_std_J"]) == {"slip", "climb"}


def test_a_log_that_ends_below_the_reserve_is_read_all_the_same(there, as_json):
    (there / "capital.csv").write_text((there / "drive.csv").read_text().replace("terrain", "Terrain", 1))
    found = as_json(*("capital.csv" if word == "drive.csv" else word for word in LOG), "--soc", "0.05")
    assert found["reserve_soc"] == 0.0
    assert any("ends below the usual reserve" in note for note in found["notes"])
    assert any("ground from column 'Terrain': grass, gravel" in note for note in found["notes"])


def test_the_example_of_a_plan_is_a_plan(there, capsys, as_json):
    assert main(["mission", "--plan-example"]) == 0
    text = capsys.readouterr().out
    (there / "mine.toml").write_text(text)
    found = as_json("mission", "--plan", "mine.toml", "--battery", "battery.toml", "--soc", "0.9", "--mass-kg", "40")
    assert found["plan"]["distance_m"] == 800.0


def test_text_and_page(there, capsys):
    assert main([*LOG, "--plan", "plan.toml", "--report", "page.html"]) == 0
    text = capsys.readouterr().out
    for words in ("range left", "probability", "grass", "point of return", "Assumed"):
        assert words in text
    assert "std" not in text and "e+0" not in text
    assert not [line for line in text.splitlines() if line.endswith(" ")]
    html = (there / "page.html").read_text(encoding="utf-8")
    for words in ("State of charge", "On grass", "On gravel", "Probability of arriving"):
        assert words in html


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("mission",), "nothing to do: give a LOG, or --plan"),
        (("mission", "drive.csv", "--mass-kg", "40"), "--battery FILE.toml is needed"),
        (("mission", "--plan", "plan.toml", "--battery", "battery.toml", "--mass-kg", "4"), "--soc S is needed"),
        (("mission", "drive.csv", "--battery", "battery.toml"), "the robot is unknown"),
        ((*AHEAD[:-1], "60", "--mass-kg", "4"), "for 60 % write 0.6"),
        ((*AHEAD, "--mass-kg", "40", "--reserve-soc", "0.7"), "reserve_soc must be below soc = 0.6"),
        ((*AHEAD, "--mass-kg", "-4"), "must be above 0"),
        (("mission", "no_speed.csv", *LOG[2:]), "there is no speed"),
        ((*LOG, "--payload-kg", "-3"), "--payload-kg must be >= 0"),
        ((*LOG, "-o", "drive.toml", "--consumption", "none.toml"), "cannot be read"),
    ],
)
def test_bad_requests(words, message, there, refused):
    assert message in refused(*words)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("distance_m = 1000.0", "distance_m = -5.0"), "leg[0]: leg.distance_m must be >= 0, got -5"),
        (("distance_m = 1000.0", "distance_km = 1.0"), "did you mean distance_m? Units are part of the names"),
        (("speed_m_s = 0.4", ""), "leg[1].speed_m_s is missing"),
        (("reserve_soc = 0.1", "reserve_soc = 10"), "reserve_soc must be between 0 and 0.99"),
        (("reserve_soc = 0.1", 'reserve_soc = "little"'), "reserve_soc: expected `float"),
        (("ohmward-plan/1", "plan"), "format must be"),
        (("speed_m_s = 0.5", "speed_m_s = 0"), "leg.speed_m_s must be > 0"),
        (("speed_m_s = 0.5", "speed_m_s = 500"), "leg.speed_m_s must be between 0 and 50"),
        (("reserve_soc = 0.1", "cutoff_V = 9000"), "the voltage of the full battery at rest, got 9000 (volts, not"),
        (("[[leg]]", "[leg]"), "plan.toml"),
    ],
)
def test_bad_plans(change, message, table, there, refused):
    (there / "plan.toml").write_text(PLAN.replace(*change))
    assert message in refused(*AHEAD, "--consumption", table)


def test_a_terrain_that_is_not_in_the_table_keeps_its_prior(table, there, as_json):
    known = as_json(*AHEAD, "--consumption", table)
    (there / "plan.toml").write_text(PLAN.replace('terrain = "gravel"', 'terrain = "clinker"'))
    found = as_json(*AHEAD, "--consumption", table)
    note = "warning: nobody has driven on 'clinker': its resistance is a broad guess; the table knows grass, gravel"
    assert note in found["notes"]
    widths = [r["range_m"]["p90"] / r["range_m"]["p10"] for r in (known, found)]
    assert widths[1] > widths[0]


def test_the_file_is_read_once(there, as_json, monkeypatch):
    loads = []

    def counted(*source):
        file = open_table(*source)

        def load(*names):
            loads.append(names)
            return file.load(*names)

        return file._replace(load=load)

    monkeypatch.setattr("ohmward.cli.mission.open_table", counted)
    as_json(*LOG)
    assert len(loads) == 1


def test_json_has_no_infinity(there, as_json):
    text = json.dumps(as_json(*LOG))
    assert "Infinity" not in text and "NaN" not in text
