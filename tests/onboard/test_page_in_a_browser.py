"""The live page in headless Chromium: moving numbers, a phone, the keyboard, and what axe and schemathesis find."""

import subprocess
from collections import Counter

import pytest
from hypothesis import given, settings

from needs import CHROMIUM
from onboard.page_server import TOKEN, dashboard_with, drive, filled_dashboard, served, stored

SIZES = {"desk": (1280, 900), "phone": (390, 844)}


@pytest.fixture(scope="module")
def page_address():
    with served() as address:
        yield address


@pytest.fixture(params=SIZES)
def opened(request, browser, page_address):
    """The page, and what went wrong in it."""
    width, height = SIZES[request.param]
    page = browser.new_page(viewport={"width": width, "height": height})
    faults: list[str] = []
    page.on("console", lambda message: faults.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.on("requestfailed", lambda failed: faults.append(failed.url))
    page.goto(page_address)
    page.wait_for_function("() => document.getElementById('soc').textContent !== '–'", timeout=60_000)
    yield page, faults
    page.close()


def test_the_numbers_come_without_an_error_and_fit(opened):
    page, faults = opened
    page.wait_for_function("() => document.querySelectorAll('.plot canvas').length === 3")
    page.wait_for_selector("#map svg .ellipse", state="attached")
    assert page.inner_text("#robot") == "rover <1>"
    assert page.title() == "rover <1>"
    assert "%" in page.inner_text("#soc-sentence")
    assert "± " in page.inner_text("#capacity") and page.inner_text("#resistance") == "–"  # of a label alone
    assert page.inner_text("#wheels tr:first-child td:first-child") == "front left"
    assert "battery_voltage_V: reads 99" in page.inner_text("#alarm") and "<b>more</b>" in page.inner_text("#alarm")
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    assert faults == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing(opened, scheme):
    axe = pytest.importorskip("axe_core_python.sync_playwright").Axe()
    page, _ = opened
    page.emulate_media(color_scheme=scheme)
    page.click("summary")
    page.wait_for_selector("#sensors li")
    found = axe.run(page)["violations"]
    assert [(rule["id"], [node["html"] for node in rule["nodes"]]) for rule in found] == []


def test_the_keyboard_reaches_everything(opened):
    page, _ = opened
    reached = []
    for _ in range(6):
        page.keyboard.press("Tab")
        reached.append(page.evaluate("document.activeElement.textContent.trim()"))
    assert reached == ["To the estimates", "All of them", "JSON", "OpenAPI", "metrics", ""] or set(reached) >= {
        "To the estimates",
        "All of them",
        "JSON",
        "OpenAPI",
        "metrics",
    }


@pytest.mark.parametrize("size", SIZES)
def test_the_history_goes_back_as_far_as_the_store(browser, tmp_path, size):
    axe = pytest.importorskip("axe_core_python.sync_playwright").Axe()
    stored(tmp_path, 30.0)
    with served(dashboard=dashboard_with(tmp_path)) as address:
        width, height = SIZES[size]
        page, faults = browser.new_page(viewport={"width": width, "height": height}), []
        page.on("console", lambda message: faults.append(message.text) if message.type == "error" else None)
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.goto(address)
        page.wait_for_selector("#spans button")
        for name, hours in (("day", 24), ("week", 30), ("hour", 1)):
            page.focus(f"#spans [data-span={name}]")
            page.keyboard.press("Enter")
            page.wait_for_function(
                f"() => {{ const shown_s = history ? history.unix_s.at(-1) - history.unix_s[0] : NaN;"
                f" return {3600 * hours - 3100} < shown_s && shown_s < {3600 * hours + 60} }}"
            )
            assert page.inner_text("#history-title") == f"The last {name}"
            assert page.locator("#spans [aria-pressed=true]").inner_text().lower() == name
            assert page.get_attribute("#plot-soc", "aria-label") == f"charge over the last {name}"
        assert axe.run(page)["violations"] == []
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
        assert faults == []
        page.close()


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
def test_a_printer_without_a_window_comes_to_an_end(page_address, tmp_path):
    assert CHROMIUM is not None
    picture = tmp_path / "now.png"
    words = ["--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path}", f"--screenshot={picture}"]
    words += ["--virtual-time-budget=5000", f"{page_address}/?once"]
    subprocess.run([CHROMIUM, *words], timeout=120, check=True, capture_output=True)
    assert picture.stat().st_size > 20_000


def test_without_a_store_there_is_no_choice(opened):
    page, _ = opened
    assert not page.is_visible("#spans")


def test_numbers_move_and_silence_is_said(browser):
    dashboard = filled_dashboard()
    with served(dashboard=dashboard) as address:
        page = browser.new_page()
        page.goto(address)
        page.wait_for_function("() => document.getElementById('soc').textContent !== '–'")
        before = page.inner_text("#soc")
        state = drive()[-1]
        assert state.battery is not None
        dashboard.take([state._replace(time_s=state.time_s + 60.0, battery=state.battery._replace(soc=0.123))])
        page.wait_for_function("() => document.getElementById('soc').textContent === '12'")
        assert before != "12"
        assert "low" in page.evaluate("document.getElementById('soc').closest('.card').className")
        page.wait_for_function("() => document.getElementById('link').textContent === 'live'")
    page.wait_for_function("() => document.getElementById('link').textContent.startsWith('no news')", timeout=60_000)
    page.close()


def test_estimates_whose_sensors_are_silent_are_dashes_and_not_live(browser):
    dashboard = filled_dashboard()
    with served(dashboard=dashboard) as address:
        page = browser.new_page()
        page.goto(address)
        page.wait_for_function("() => document.getElementById('speed').textContent !== '–'")
        silent = drive()[-1]._replace(battery=None, cells=None, range=None, slip=None, pose=None, sample={})
        dashboard.take([silent._replace(time_s=silent.time_s + 90.0)])
        page.wait_for_function("() => document.getElementById('speed').textContent === '–'")
        assert [page.inner_text(f"#{name}") for name in ("soc", "range", "time-left")] == ["–"] * 3
        assert page.inner_text("#link") == (
            "stale: no news from the sensors of the battery for 2 min and of the wheels for 2 min"
        )
        assert page.get_attribute("#link-dot", "class") == "dot lost"
        dashboard.take([drive()[-1]._replace(time_s=silent.time_s + 100.0)])
        page.wait_for_function("() => document.getElementById('link').textContent === 'live'")
        page.close()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing_in_the_login(browser, monkeypatch, scheme):
    axe = pytest.importorskip("axe_core_python.sync_playwright").Axe()
    monkeypatch.setenv("OHMWARD_TEST_TOKEN", TOKEN)
    with served(token=TOKEN) as address:
        page = browser.new_page(viewport={"width": 390, "height": 844}, color_scheme=scheme)
        page.goto(address)
        assert page.url.endswith("/login")
        assert axe.run(page)["violations"] == []
        page.fill("input", "wrong")
        page.keyboard.press("Enter")
        page.wait_for_selector("text=That is not the token.")
        assert axe.run(page)["violations"] == []
        page.fill("input", TOKEN)
        page.keyboard.press("Enter")
        page.wait_for_selector("#soc")
        page.wait_for_function("() => document.getElementById('soc').textContent !== '–'")
        page.close()


def test_schemathesis_finds_nothing(page_address):
    schemathesis = pytest.importorskip("schemathesis")
    schema = schemathesis.openapi.from_url(f"{page_address}/openapi.json")
    tried: Counter[str] = Counter()

    def try_operation(operation):
        @settings(max_examples=20, deadline=None, database=None, derandomize=True)
        @given(case=operation.as_strategy())
        def run(case):
            case.call_and_validate()
            tried[operation.path] += 1

        run()

    for found in schema.get_all_operations():
        if found.ok().path != "/events":  # it does not end; its own test reads it
            try_operation(found.ok())
    assert set(tried) == {"/api/now", "/api/state", "/api/history", "/api/path", "/api/mission", "/metrics"}
    assert tried["/api/history"] >= 10  # the others take nothing, so that there is one case of them
