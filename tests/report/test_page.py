"""The page is well-formed, complete in itself, safe and the same every time."""

import base64
import hashlib
import json
import re
import shutil
import subprocess
from html.parser import HTMLParser

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.report import TIME, Band, Figure, Marker, Page, Series, Span
from ohmward.report.page import embed
from ohmward_lab.cli.demo import with_chapter

EVIL = "</script><script>alert('x')</script><b>&amp; \u2028 \"quoted\" $title ${body}"
VOID = {"meta", "link", "br", "img", "hr", "input"}


class Document(HTMLParser):
    """Checks nesting, collects elements and texts."""

    def __init__(self, html):
        super().__init__()
        self.open: list[str] = []
        self.elements: list[tuple[str, dict]] = []
        self.texts: list[tuple[str, str]] = []
        self.feed(html)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attributes):
        self.elements.append((tag, dict(attributes)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.texts.append((self.open[-1] if self.open else "", data))

    def count(self, tag):
        return sum(name == tag for name, _ in self.elements)

    def scripts(self):
        kinds = [a.get("type") for t, a in self.elements if t == "script"]
        return list(zip(kinds, [text for tag, text in self.texts if tag == "script"], strict=True))


def figure(n=50, title="Voltage"):
    t = np.linspace(0, 600, n)
    v = 12 + np.random.default_rng(1).normal(size=n)
    return Figure(
        title,
        TIME,
        "Voltage [V]",
        [Series(t, v, "measured", "points", "background"), Series(t, v, "model")],
        [Band(t, v - 1, v + 1, "95 %")],
        [Marker(60.0, "pulse")],
        [Span(100.0, 200.0, "rest")],
    )


def full_page(text="plain"):
    return (
        Page(text, text, text)
        .heading(text)
        .text(f"{text}\n\nsecond paragraph")
        .callout("warning", text)
        .numbers({text: text, "Capacity": "3.02 Ah"})
        .table([text, "n"], [[text, 1.23456789], [None, 2]], text)
        .plot(figure(title=text), figure())
    )


@pytest.mark.parametrize("text", ["plain", EVIL])
def test_the_page_is_well_formed_and_has_every_block(text):
    document = Document(full_page(text).html())
    assert [document.count(t) for t in ("h1", "h2", "dl", "table", "figure", "tr")] == [1, 1, 1, 1, 2, 3]


def test_text_from_a_log_stays_text():
    document = Document(full_page(EVIL).html())
    assert [kind for kind, _ in document.scripts()] == ["application/json", None]
    assert "alert" not in document.scripts()[1][1]
    assert ("h1", EVIL) in [(tag, text) for tag, text in document.texts]


def test_embedded_data_is_strict_json_and_survives_hostile_labels():
    hostile = Figure("f", "x", "y", [Series(np.arange(3.0), np.array([1.0, np.nan, np.inf]), EVIL)])
    ((_, data), _) = Document(Page("p").plot(hostile).html()).scripts()
    stack = json.loads(data, parse_constant=pytest.fail)
    (series,) = stack["figures"][0]["series"]
    assert series["label"] == EVIL
    assert stack["columns"][series["y"][0]]["extremes"] == [1.0, 1.0]


def test_what_is_not_json_is_never_embedded():
    with pytest.raises(ValueError, match="not JSON compliant"):
        embed({"x": float("nan")})


def test_the_page_fetches_nothing_and_forbids_it():
    html = full_page().html()
    document = Document(html)
    assert not [a for _, a in document.elements if {"src", "srcset", "data", "poster"} & a.keys()]
    assert all(a["href"].startswith("#") for _, a in document.elements if "href" in a)
    assert not re.search(r"@import|url\(|\bfetch\(|XMLHttpRequest|import\(", html)
    policy = next(a["content"] for _, a in document.elements if a.get("http-equiv") == "Content-Security-Policy")
    assert policy.startswith("default-src 'none'; ")
    assert "'unsafe-inline'" not in policy.split("script-src")[1]


def test_the_policy_admits_exactly_the_code_of_the_page():
    html = full_page().html()
    code = Document(html).scripts()[1][1]
    digest = base64.b64encode(hashlib.sha256(code.encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'" in html


def test_the_licence_of_the_plotting_code_travels_with_it():
    assert "Permission is hereby granted, free of charge" in Page("p").html()


def test_equal_input_gives_equal_bytes_and_a_page_is_never_changed():
    page = Page("p").text("one")
    assert full_page().html() == full_page().html()
    before = page.html()
    page.text("two").plot(figure())
    assert page.html() == before


def test_a_page_grows_by_a_few_bytes_for_each_sample():
    small, large = (len(Page("p").plot(figure(n)).html()) for n in (10_000, 1_000_000))
    assert small < 250_000
    assert large < 16e6  # two noisy series and two edges of a band


def test_contents_link_to_the_headings():
    page = Page("p").heading("Same").heading("Same").heading("Größe & <b>")
    document = Document(page.html())
    anchors = [a["id"] for tag, a in document.elements if tag == "h2"]
    links = [a["href"] for tag, a in document.elements if tag == "a"]
    assert links == [f"#{a}" for a in anchors]
    assert len(set(anchors)) == 3


def test_a_chapter_shows_what_another_page_shows_first():
    other = Page("Other").numbers({"Capacity": "3 Ah"}).plot(figure()).heading("Result").text("a lot more")
    page = with_chapter(with_chapter(Page("All"), "One", other), "Two", other).text("the end")
    document = Document(page.html())
    assert page.headings == ("One", "Two")
    assert [text for tag, text in document.texts if tag == "h2"] == ["One", "Two"]
    assert document.count("figure") == 2 and document.count("h3") == 0
    assert "a lot more" not in page.html() and "the end" in page.html()


def test_a_chapter_may_take_sections_with_it():
    other = Page("Other").text("first").heading("Plan").text("a plan").heading("Result").text("a lot more")
    page = with_chapter(Page("All"), "One", other, sections=1).text("the end")
    titles = [(tag, text) for tag, text in Document(page.html()).texts if tag in ("h2", "h3")]
    assert titles == [("h2", "One"), ("h3", "Plan")]
    assert "a plan" in page.html() and "a lot more" not in page.html()


def test_numbers_are_large_and_units_small():
    html = Page("p").numbers({"a": "3.02 Ah ± 0.01", "b": "−41.7 %", "c": "not identified", "d": "1e-3 V"}).html()
    for part in (
        "<b>3.02 </b><span>Ah ± 0.01</span>",
        "<b>−41.7 %</b><span></span>",
        '<b class="word">not identified</b>',
        "<b>1e-3 </b><span>V</span>",
    ):
        assert part in html


def test_only_columns_of_numbers_are_aligned_right():
    html = (
        Page("p")
        .table(["name", "value", "text"], [["a", 1.0, "3 pairs"], ["b", None, "few"], ["c", "2.5", "x"]])
        .html()
    )
    assert re.findall(r"<th scope=\"col\"( class=\"number\")?>", html) == ["", ' class="number"', ""]
    assert '<td class="number">–</td>' in html


def test_a_table_without_rows_and_a_page_without_blocks_are_pages():
    Document(Page("p").table(["a"], []).html())
    Document(Page("p").html())


def test_a_wrong_level_and_a_short_row_are_refused():
    with pytest.raises(InputError, match="level must be one of info, warning, error, got 'loud'"):
        Page("p").callout("loud", "x")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="row 1 has 1 cells, the header has 2"):
        Page("p").table(["a", "b"], [[1, 2], [1]])
    with pytest.raises(InputError, match="at least one figure"):
        Page("p").plot()


def test_write_replaces_the_file_and_leaves_nothing_else(tmp_path):
    path = tmp_path / "report.html"
    path.write_text("old")
    full_page().write(path)
    assert path.read_text(encoding="utf-8") == full_page().html()
    assert [p.name for p in tmp_path.iterdir()] == ["report.html"]


def test_a_write_that_fails_leaves_the_old_file(tmp_path):
    path = tmp_path / "report.html"
    path.write_text("old")
    with pytest.raises(UnicodeEncodeError):
        Page("p").text("\ud800").write(path)
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["report.html"]


def odd_figures():
    """Figures that leave the drawing code little to hold on to."""
    x = np.arange(3.0)
    nothing = Series(np.empty(0), np.empty(0), "nothing")
    return [
        Figure("empty", TIME, "y"),
        Figure("no sample", TIME, "y", [nothing], log_y=True),
        Figure("only gaps", TIME, "y", [Series(x, np.full(3, np.nan), "gaps")], [Band(x, x * np.nan, x, "gap")]),
        Figure("lone samples", TIME, "y", [Series(x, np.array([1, np.nan, 2]), "lone"), Series(x[:1], x[:1], "one")]),
        Figure("right only", TIME, "", [Series(x, x, "r", axis="right")], right_label="r"),
        Figure("log limits", TIME, "y", [Series(x, 10**x, "s")], log_y=True, y_limits=(0.1, 1000.0)),
    ]


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("chromium") is None, reason="needs the program chromium to run the page's code")
def test_a_browser_draws_every_figure(tmp_path):
    path = tmp_path / "report.html"
    page = full_page(EVIL).plot(*odd_figures())
    for odd in odd_figures():
        page = page.plot(odd)
    page.write(path)
    options = ["--headless=new", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=3000", "--dump-dom"]
    run = subprocess.run(["chromium", *options, path.as_uri()], capture_output=True, text=True, timeout=60, check=True)
    assert run.stdout.count("<canvas") == run.stdout.count('class="legend"') == 2 + 2 * len(odd_figures())
    assert 'class="hint"' in run.stdout


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("chromium") is None, reason="needs the program chromium to run the page's code")
def test_a_page_that_is_loaded_has_its_figures(tmp_path):
    """As `chromium --print-to-pdf` takes it: at the end of loading, without waiting."""
    path = tmp_path / "report.html"
    full_page().write(path)
    options = ["--headless=new", "--no-sandbox", "--disable-gpu", "--dump-dom"]
    run = subprocess.run(["chromium", *options, path.as_uri()], capture_output=True, text=True, timeout=60, check=True)
    assert run.stdout.count("<canvas") == run.stdout.count('class="legend"') > 0
    assert 'aria-busy="false"' in run.stdout
