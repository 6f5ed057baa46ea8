"""The first minute of somebody who has never seen the studio, in a real browser."""

import json
import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from boxes_config import write_boxes

from focusjax.config import load_config

studio_browser = pytest.importorskip(
    "_studio_browser", reason="no Selenium, which drives the browser", exc_type=ImportError
)
pytest.importorskip("nicegui", reason="no NiceGUI, which makes the page")
chromium, server, Tab = studio_browser.chromium, studio_browser.server, studio_browser.Tab
pytestmark = pytest.mark.skipif(
    studio_browser.CHROMIUM is None or studio_browser.DRIVER is None,
    reason="no chromium and chromedriver (Debian: chromium, chromium-driver)",
)

CONFIGS = Path(__file__).parents[2] / "configs"
COW, LAMP, APPLE = (0.47, 0.55), (0.685, 0.17), (0.74, 0.78)


@pytest.fixture(scope="module")
def still_life(tmp_path_factory):
    """The still life, small, and without its wishes."""
    folder = tmp_path_factory.mktemp("studio")
    shutil.copytree(CONFIGS / "meshes", folder / "meshes")
    text = (CONFIGS / "still_life.toml").read_text().replace("[640, 480]", "[160, 120]")
    before, rest = text.split("[[focus]]", 1)
    file = folder / "still_life.toml"
    file.write_text(before + rest[rest.index("[solve]") :] + "\n[render]\nrays = 8\n")
    return file


@pytest.fixture(scope="module")
def browser():
    with chromium() as driver:
        yield driver


@pytest.fixture
def tab(still_life, browser):
    with server(still_life, programs=os.environ["FOCUSJAX_TESTS_PROGRAMS"]) as address:
        browser.get_log("browser")  # what it said of pages before
        opened = Tab(browser)
        opened.open(address)
        opened.wait(lambda: opened.text("state") in ("no lens yet", "refined"), why="the first picture")
        yield opened
        browser.get("about:blank")


def test_the_first_sixty_seconds(tab, still_life):
    # Something to look at, and a word on what to do.
    tab.wait(lambda: "Click on what should be sharp" in tab.body(), why="the sharp view")
    # Click the cow: sharp.
    tab.click(*COW)
    tab.wait(lambda: "spot" in tab.text("summary"), why="the cow's card")
    tab.settle()
    assert re.search(r"spot.* away, blur 0\.0 px\. Met\.", tab.text("summary"))
    # Click the lamp: blurred by at least so much.
    tab.click(*LAMP)
    tab.wait(lambda: "lamp" in tab.text("summary"), why="the lamp's card")
    tab.choose("kind", "at least")
    tab.wait(lambda: tab.all("pixels"), why="a field for the diameter")
    tab.type("pixels", "6")
    tab.wait(lambda: load_wishes(tab) == ["sharp ✓ met", "≥ 6 ✓ met"], why="two wishes that are met")
    # Restrict the f-number, and read which of them gives way.
    tab.type("low-f_number", "8")
    tab.wait(lambda: "✗ missed" in tab.text("wishes"), why="a wish that is missed")
    tab.wait(lambda: "widest aperture" in tab.text("way"), why="the limit in the way")
    assert "lamp" in tab.text("way")
    assert "f/8.0" in tab.text("value-f_number")
    tab.settle()
    # Save; a run of the file comes to the lens on the page.
    tab.push(".at-save")
    tab.wait(lambda: "Saved to" in tab.body(), why="the word that it is saved")
    config = load_config(still_life)
    assert [wish.name for wish in config.focus] == ["spot", "lamp"]
    report = solved(still_life)
    assert f"{100 * report['lens']['focus_distance_m']:.3g} cm" in tab.text("value-focus")
    assert report["lens"]["f_number"] == pytest.approx(8.0, rel=1e-6)
    assert tab.complaints() == []


def test_points_are_dragged_nudged_undone_and_deleted(tab):
    tab.wait(lambda: "Click on what should be sharp" in tab.body() or tab.text("state") == "refined")
    before = len(load_wishes(tab))
    tab.click(*APPLE)
    tab.wait(lambda: "apple" in tab.text("summary"), why="the apple's card")
    tab.press("\ue00c")  # Escape
    tab.drag(APPLE, COW)
    tab.wait(lambda: "spot" in tab.text("summary"), why="the point to be on the cow")
    assert len(load_wishes(tab)) == before + 1
    tab.press("\ue014")  # an arrow to the right
    tab.press_with_control("z")
    tab.press_with_control("z")
    tab.wait(lambda: len(load_wishes(tab)) == before + 1, why="the point to stay")
    tab.press_with_control("z")
    tab.wait(lambda: len(load_wishes(tab)) == before, why="the point to go")
    assert tab.complaints() == []


def test_overlays_wipe_and_view_from_above(tab):
    tab.click(*COW)
    tab.settle()
    for key, mark in (("b", "/studio/blur/"), ("d", "/studio/depth/"), (" ", "/studio/sharp/")):
        tab.press(key)
        tab.wait(lambda mark=mark: mark in tab.driver.page_source, why=mark)
    for part in ("polygon.zone", "polyline.focus"):
        assert tab.driver.find_elements("css selector", f".at-above {part}")
    assert tab.complaints() == []


def test_keys_after_a_click_on_a_button_and_in_fields(tab, still_life):
    tab.click(*COW)
    tab.wait(lambda: "spot" in tab.text("summary"), why="the cow's card")
    tab.settle()
    # The button does not take the space bar for itself.
    zoom = "button[aria-label^='Zoom']"
    for _ in range(4):
        tab.push(zoom)
        time.sleep(0.2)
    tab.press(" ")
    tab.wait(lambda: "/studio/sharp/" in tab.driver.page_source, 30, "the wipe")
    # What is refused does not stay in its field.
    tab.type("pixels" if tab.all("pixels") else "weight", "-5")
    tab.wait(lambda: any("weight" in each for each in tab.texts(".q-notification")), 30, "the refusal")
    tab.wait(lambda: value_of(tab, "weight") == "1", 30, "the weight that holds")
    # The page's keys work from fields, and keep what was typed.
    tab.type("name", "the cow")
    tab.press_with_control("s")
    tab.wait(lambda: 'name = "the cow"' in still_life.read_text(), 30, "the saved name")
    tab.type("name", "cow")
    tab.press("\ue00c")  # Escape
    tab.wait(lambda: not tab.shown("card"), 30, "the card to close")
    assert tab.complaints() == []


@pytest.mark.slow
def test_a_focal_surface_is_laid_through_the_wishes_and_control_points(tmp_path, browser):
    file = write_boxes(tmp_path)
    with server(file, programs=os.environ["FOCUSJAX_TESTS_PROGRAMS"]) as address:
        tab = Tab(browser)
        browser.get_log("browser")
        tab.open(address)
        tab.settle()
        tab.push(".at-surface")
        tab.wait(lambda: len(tab.all("control")) == 2, why="a control point for each wish")
        tab.click(0.5, 0.2, shift=True)
        tab.wait(lambda: len(tab.all("control")) == 3, why="one more")
        tab.wait(lambda: tab.all("surface-blur_px"), why="its fields")
        tab.type("surface-blur_px", "-3")
        tab.wait(lambda: "blur_px = -3" in tab.unsaved(file), why="its blur")
        assert len(browser.find_elements("css selector", ".control polygon.edge")) == 3
        tab.push("button[aria-label='Forget this control point']")
        tab.wait(lambda: len(tab.all("control")) == 2, why="the control point to go")
        tab.settle()
        tab.push(".at-surface")
        tab.wait(lambda: tab.shown("value-tilt"), why="the settings of a plane")
        tab.settle()
        assert tab.complaints() == []
        browser.get("about:blank")


@pytest.mark.slow
def test_a_config_with_errors_opens_with_its_errors_beside_the_text(tmp_path, browser):
    file = write_boxes(tmp_path)
    good = file.read_text()
    file.write_text(good.replace("f_number = 2.0", "f_numbr = 2.0"))
    with server(file) as address:
        tab = Tab(browser)
        tab.open(address)
        tab.wait(lambda: "did you mean f_number" in tab.text("problem"), 60, "the error")
        assert "f_numbr" in browser.find_element("css selector", "textarea").get_attribute("value")

        def used():
            """Give the page the good text, as often as it takes: the dialog may still be opening."""
            script = "const area = document.querySelector('textarea'); if (!area) return;"
            script += "area.value = arguments[0]; area.dispatchEvent(new Event('input'))"
            browser.execute_script(script, good)
            time.sleep(0.3)
            browser.execute_script("document.querySelector('.at-use')?.click()")
            time.sleep(0.7)
            return tab.text("state") != "stopped"

        tab.wait(used, 60, "the text to be taken")
        tab.settle()
        assert len(load_wishes(tab)) == 2


@pytest.mark.slow
def test_the_start_page_opens_a_config_and_unsaved_changes_outlive_the_command(tmp_path, browser):
    file = write_boxes(tmp_path)
    programs = os.environ["FOCUSJAX_TESTS_PROGRAMS"]
    with server(cwd=tmp_path, programs=programs) as address:
        tab = Tab(browser)
        tab.open(address)
        tab.wait(lambda: any("boxes.toml" in each for each in tab.texts(".at-thumb")), 60, "the config")
        tab.wait(lambda: browser.find_elements("css selector", ".at-thumb img"), 60, "its thumbnail")
        card = next(each for each in tab.all("thumb") if "boxes.toml" in each.text)
        card.click()
        tab.wait(lambda: tab.all("state"), 60, "the studio")
        tab.settle()
        tab.press("\ue007")  # Enter: a point in the middle
        tab.wait(lambda: len(load_wishes(tab)) == 3, 60, "a third wish")
        assert tab.complaints() == []
        # A page whose server has ended would say so.
        browser.get("about:blank")
    with server(file, programs=programs) as address:
        tab.open(address)
        tab.wait(lambda: "not saved last time" in tab.body(), 60, "the word that changes are here again")
        tab.wait(lambda: len(load_wishes(tab)) == 3, 120, "the third wish")
        assert tab.complaints() == []


def test_other_hosts_need_the_token_of_the_address(tmp_path, browser):
    with server(write_boxes(tmp_path), "--host", "127.0.0.1") as address:
        assert "?token=" in address
        Tab(browser).reach(address.split("?")[0])
        assert "not the studio's own page" in browser.find_element("tag name", "body").text
        browser.get(address)
        Tab(browser).wait(lambda: Tab(browser).all("state"), 60, "the page")


def value_of(tab, marker):
    field = tab.driver.find_element("css selector", f"input.at-{marker}, .at-{marker} input")
    return field.get_attribute("value")


def load_wishes(tab):
    """What the table says of each wish: wished, and the verdict."""
    lines = [[part for part in text.split("\n") if part] for text in tab.texts(".fj-wish[role=button]")]
    return [f"{line[2]} {line[-1]}" for line in lines if len(line) > 4]


def solved(config):
    """The report of `focusjax solve`."""
    out = config.parent / "out"
    command = [sys.executable, "-m", "focusjax.cli", "solve", str(config), "--out", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode in (0, 3), done.stderr
    return json.loads((out / "report.json").read_text())
