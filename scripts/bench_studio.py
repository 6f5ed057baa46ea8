"""How long the studio takes from a click to numbers, to a draft and to the refined picture.

A headless Chromium (Debian: chromium, chromium-driver; Python: selenium) opens the page of a config and sets
a point at a random place, again and again, taking it back between. Times are seen by the page itself: from
the press of the mouse to the elements that change. Median and 95th percentile, in milliseconds. Before that,
the seconds from the command to the page, the first picture, the lens and the refined picture; a second run
finds the compiled programs of the first:

    python scripts/bench_studio.py configs/still_life.toml configs/town.toml --events 50

Of a config with a shot it steps through all frames twice, and times from the key to the frame's draft:

    python scripts/bench_studio.py configs/rack_focus.toml
"""

import argparse
import contextlib
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from _studio_browser import Tab, chromium, server

from focusjax.config import load_config
from focusjax.studio._kept import kept_file

# Notes the time of the press, of the first change of the numbers, and of every picture that is loaded.
_WATCH = """
window.seen = {};
const image = document.querySelector('.fj-frame img');
image.addEventListener('mousedown', () => { window.seen = {start: performance.now()}; }, true);
image.addEventListener('load', () => {
  if (!window.seen.draft) window.seen.draft = performance.now();
});
new MutationObserver(() => {
  if (!window.seen.numbers) window.seen.numbers = performance.now();
}).observe(document.querySelector('.at-wishes'), {subtree: true, childList: true, characterData: true});
new MutationObserver(() => {
  const word = document.querySelector('.at-state').innerText;
  if (word !== 'refined') window.seen.changed = true;
  if (word === 'refined' && window.seen.changed && !window.seen.refined) {
    window.seen.refined = performance.now();
  }
}).observe(document.querySelector('.at-state'), {subtree: true, childList: true, characterData: true});
"""
_STAGES = ("numbers", "draft", "refined")


_LOADED = "const i = document.querySelector('.fj-frame img'); return i !== null && i.naturalWidth > 0"


@contextlib.contextmanager
def _opened(config: Path, driver: Any) -> Iterator[Tab]:
    """The studio in a process of its own; how long it takes from the command to each stage is printed."""
    began = time.perf_counter()
    with server(config) as address:
        tab, stages = Tab(driver), {}
        tab.open(address)
        tab.wait(lambda: tab.all("state"), 600)
        stages["page"] = time.perf_counter() - began
        tab.wait(lambda: driver.execute_script(_LOADED), 1800)
        stages["something to look at"] = time.perf_counter() - began
        tab.wait(lambda: tab.text("state") in ("draft", "no lens yet") or "refin" in tab.text("state"), 1800)
        stages["lens and draft"] = time.perf_counter() - began
        tab.wait(lambda: tab.text("state") in ("refined", "no lens yet"), 1800)
        stages["refined"] = time.perf_counter() - began
        words = ", ".join(f"{stage} {seconds:.1f} s" for stage, seconds in stages.items())
        print(f"{config.stem}: from the command: {words}", flush=True)
        yield tab
    # Clicks that were taken back are nobody's unsaved changes.
    kept_file(config).unlink(missing_ok=True)


def measured(config: Path, events: int, seed: int) -> dict[str, np.ndarray]:
    """Milliseconds from press to each stage, of all events."""
    random = np.random.default_rng(seed)
    times: dict[str, list[float]] = {stage: [] for stage in _STAGES}
    before = config.read_text()
    with chromium() as driver, _opened(config, driver) as tab:
        for place in ((0.3, 0.3), (0.6, 0.6)):
            # Everything is compiled once.
            tab.click(*place)
            time.sleep(0.5)
            tab.settle(1800)
        tab.press("\ue00c")
        driver.execute_script(_WATCH)
        for _ in range(events):
            tab.click(*random.uniform(0.1, 0.9, 2))
            seen = tab.wait(lambda: _all_seen(driver), 120, "the refined picture")
            for stage in _STAGES:
                times[stage].append(seen[stage] - seen["start"])
            # The point goes again, so that all events are alike.
            tab.press_with_control("z")
            time.sleep(0.3)
            tab.settle(120)
    assert config.read_text() == before, "the config is not written"
    return {stage: np.array(each) for stage, each in times.items()}


_WATCH_FRAMES = """
window.seen = {};
window.addEventListener('keydown', () => { window.seen = {start: performance.now()}; }, true);
document.querySelector('.fj-frame img').addEventListener('load', () => {
  if (window.seen.start && !window.seen.frame) window.seen.frame = performance.now();
});
"""


_SEEN = "return window.seen.frame ? window.seen.frame - window.seen.start : 0"


def scrubbed(config: Path) -> dict[str, np.ndarray]:
    """Milliseconds from a key to the draft of the next frame, the first time and the second."""
    times: dict[str, list[float]] = {"first pass": [], "second pass": []}
    with chromium() as driver, _opened(config, driver) as tab:
        count = int(tab.text("frame").split("/")[1])
        driver.execute_script(_WATCH_FRAMES)
        for name, key in (("first pass", "."), ("second pass", ",")):
            for _ in range(count - 1):
                tab.press(key)
                times[name].append(tab.wait(lambda: driver.execute_script(_SEEN), 120, "the frame"))
    return {name: np.array(each) for name, each in times.items()}


def _all_seen(driver) -> dict[str, float] | None:
    seen = driver.execute_script("return window.seen")
    return seen if all(stage in seen for stage in _STAGES) else None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("configs", nargs="+", type=Path)
    parser.add_argument("--events", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    for config in given.configs:
        has_shot = load_config(config).shot is not None
        found = scrubbed(config) if has_shot else measured(config, given.events, given.seed)
        for stage, each in found.items():
            middle, late = np.percentile(each, [50, 95])
            print(
                f"{config.stem:16} {stage:11} median {middle:7.0f} ms   95 % within {late:7.0f} ms",
                flush=True,
            )


if __name__ == "__main__":
    main()
