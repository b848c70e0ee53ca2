"""The whole page, in little."""

import pytest

from scripts import script

pytest.importorskip("llvmlite")
speed = script("speed")


@pytest.mark.slow
def test_a_quick_run_shows_every_part_and_writes_nothing(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(speed, "PAGE", tmp_path / "speed.md")
    assert speed.main(["--quick"]) == 0
    printed = capsys.readouterr().out
    titles = [line[3:] for line in printed.splitlines() if line.startswith("## ")]
    wanted = ["One log: AUKF, 7 states", "Many logs: EKF, 3 states", "Battery packages", "The public filters"]
    assert [title for title in wanted if title not in titles] == []
    assert titles[-1] == "Goals"
    assert "another result" not in printed
    assert not list(tmp_path.iterdir())


def test_the_overview_has_a_row_for_each_way_and_nothing_where_there_is_none():
    header, timing = ("who", "how", "a step", "least to most", "over ours"), script("timing")
    first = [
        ("ours", "fast", "1 ns", "", "1 x"),
        ("theirs", "slow, points redrawn", "9 ns", "", "9 x"),
        ("none", "not installed", "", "", ""),
    ]
    second = [
        ("ours", "fast", "2 ns", "", "1 x"),
        ("ours", "plain", "4 ns", "", "2 x"),
        ("theirs", "slow", "8 ns", "", "4 x"),
    ]
    sections = [timing.Section(f"One log: {name}", "", header, rows) for name, rows in (("A", first), ("B", second))]
    lines = [line for line in speed.overviews(sections) if line.startswith("| ")]
    assert lines[0] == "| who | how | A | B |"
    assert lines[1:5] == [
        "| ours | fast | 1 ns (1 x) | 2 ns (1 x) |",
        "| ours | plain |  | 4 ns (2 x) |",
        "| theirs | slow | 9 ns (9 x) | 8 ns (4 x) |",
        "| none | not installed |  |  |",
    ]


def test_goals_of_all_sections_stand_in_one_table():
    timing = script("timing")
    goals = (timing.Goal("a", 1.0, 2.0), timing.Goal("b", 3.0, 2.0))
    lines = speed.goals_page(
        [timing.Section("t", "", ("h",), [], goals[:1]), timing.Section("u", "", (), [], goals[1:])]
    )
    assert "1 of 2 met." in lines
    assert "| b | 3 s | at most 2 s | **missed** |" in lines
