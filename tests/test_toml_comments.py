import ohmward as ow
from ohmward.battery.file import BATTERY_FILE
from ohmward.toml_file import with_comments

OLD = """\
# head of every file
format = "x/1"  # do not touch

# measured by Anna, 2026-03-02
a = 1.0  # V, see "#3"
b = [
    # the first
    1.0, 2.0,
]
[t]  # a table
c = "no # comment"
# the second robot
[[t.r]]
d = 1
[[t.r]]
d = 2  # of the second
# at the end
"""
NEW = """\
# head of every file
format = "x/1"
a = 2.0
b = [
    3.0,
]
[t]
c = "other # text"
[[t.r]]
d = 3
[[t.r]]
d = 4
"""


def test_comments_stay_with_their_keys():
    assert (
        with_comments(NEW, OLD)
        == """\
# head of every file
format = "x/1"  # do not touch
# measured by Anna, 2026-03-02
a = 2.0  # V, see "#3"
# the first
b = [
    3.0,
]
[t]  # a table
c = "other # text"
# the second robot
[[t.r]]
d = 3
[[t.r]]
d = 4  # of the second

# at the end
"""
    )


def test_a_comment_whose_key_is_gone_stands_at_the_end():
    assert with_comments("b = 1\n", "# why\na = 1  # this\n# more\nb = 2\n") == "# more\nb = 1\n\n# why\n# this\n"


def test_without_comments_nothing_changes():
    assert with_comments(NEW, NEW) == NEW
    assert with_comments(NEW, "") == NEW


def test_a_battery_that_is_written_again_keeps_what_people_wrote(tmp_path):
    path = tmp_path / "battery.toml"
    battery = ow.generic_battery("lfp", 12.0, n_series=4)
    ow.save_battery(battery, path)
    plain = path.read_text(encoding="utf-8")
    edited = plain.replace("capacity_Ah = 12.0", "# on the bench, Monday\ncapacity_Ah = 12.0  # of the label")
    path.write_text(edited, encoding="utf-8")
    ow.save_battery(ow.load_battery(path), path)
    assert path.read_text(encoding="utf-8") == edited
    path.write_text("no battery # at all\n[", encoding="utf-8")
    ow.save_battery(battery, path)
    assert path.read_text(encoding="utf-8") == plain == BATTERY_FILE.dump(battery)
