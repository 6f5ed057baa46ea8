"""The studio's server in a process of its own, and a real headless Chromium that looks at it."""

import contextlib
import os
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from selenium import webdriver
from selenium.common.exceptions import StaleElementReferenceException, WebDriverException
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

CHROMIUM, DRIVER = (shutil.which(name) for name in ("chromium", "chromedriver"))
"""None where there is none."""

_ARGUMENTS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--hide-scrollbars",
    "--force-device-scale-factor=1",
)


class Tab:
    """A browser's tab with the studio's page."""

    def __init__(self, driver: Any):
        self.driver = driver

    def open(self, address: str) -> None:
        """Open a studio's page, and wait until what is typed there reaches the server."""
        self.reach(address)
        self.wait(
            lambda: self.driver.execute_script("return window.did_handshake === true"), 60, "the server"
        )

    def reach(self, address: str) -> None:
        """Open a page as soon as the server listens."""
        self.wait(lambda: self._reached(address), 60, "the server to listen")

    def _reached(self, address: str) -> bool:
        """Whether the server answers: it prints its address just before it listens."""
        try:
            self.driver.get(address)
        except WebDriverException as error:
            if "ERR_CONNECTION_REFUSED" not in str(error):
                raise
            return False
        return True

    def all(self, marker: str) -> list[Any]:
        """Elements that the page has given that marker."""
        return self.driver.find_elements(By.CSS_SELECTOR, f".at-{marker}")

    def text(self, marker: str) -> str:
        found = self.texts(f".at-{marker}")
        return found[0] if found else ""

    def texts(self, selector: str) -> list[str]:
        """The texts of elements, all read at one moment: the page may replace them at the next."""
        script = "return Array.from(document.querySelectorAll(arguments[0]), each => each.innerText)"
        return self.driver.execute_script(script, selector)

    def wait(self, what: Callable[[], Any], seconds: float = 240.0, why: str = "") -> Any:
        """What a question answers as soon as that counts as true.

        The page may replace an element between the moment it is found and the moment it is asked.
        Then the question is asked again.
        """
        end = time.monotonic() + seconds
        while True:
            with contextlib.suppress(StaleElementReferenceException):
                if found := what():
                    return found
            if time.monotonic() > end:
                raise AssertionError(f"waited {seconds:g} s for {why or what}; the page says {self.body()!r}")
            time.sleep(0.02)

    def push(self, selector: str) -> None:
        """Click at the first element of a CSS selector, as soon as the page has it."""

        def clicked() -> bool:
            found = self.driver.find_elements(By.CSS_SELECTOR, selector)
            if found:
                found[0].click()
            return bool(found)

        self.wait(clicked, 30, selector)

    def shown(self, marker: str) -> bool:
        """Whether the page shows an element of that marker."""
        return any(each.is_displayed() for each in self.all(marker))

    def body(self) -> str:
        return self.driver.find_element(By.TAG_NAME, "body").text

    def settle(self, seconds: float = 240.0) -> None:
        """Wait for the refined picture."""
        self.wait(lambda: self.text("state") == "refined", seconds, "the refined picture")

    def click(self, x: float, y: float, *, shift: bool = False) -> None:
        """Click at shares of the picture's width and height."""
        if shift:
            ActionChains(self.driver).key_down(Keys.SHIFT).perform()
        self.actions(x, y).click().perform()
        if shift:
            ActionChains(self.driver).key_up(Keys.SHIFT).perform()

    def drag(self, start: tuple[float, float], end: tuple[float, float], steps: int = 5) -> None:
        actions = self.actions(*start).click_and_hold()
        size = self.picture().size
        for _ in range(steps):
            across, down = ((b - a) / steps for a, b in zip(start, end, strict=True))
            actions = actions.move_by_offset(round(across * size["width"]), round(down * size["height"]))
        actions.release().perform()

    def actions(self, x: float, y: float) -> Any:
        image = self.picture()
        size = image.size
        away = round((x - 0.5) * size["width"]), round((y - 0.5) * size["height"])
        return ActionChains(self.driver, duration=20).move_to_element_with_offset(image, *away)

    def picture(self) -> Any:
        return self.driver.find_element(By.CSS_SELECTOR, ".fj-frame img")

    def unsaved(self, config: Path) -> str:
        """The text that is kept beside a config until it is saved; empty without one."""
        kept = config.with_name(f".{config.name}.unsaved")
        return kept.read_text() if kept.exists() else ""

    def press(self, *keys: str) -> None:
        ActionChains(self.driver).send_keys(*keys).perform()

    def press_with_control(self, key: str) -> None:
        ActionChains(self.driver).key_down(Keys.CONTROL).send_keys(key).key_up(Keys.CONTROL).perform()

    def type(self, marker: str, text: str) -> None:
        """Replace what a field has."""
        field = self.driver.find_element(By.CSS_SELECTOR, f"input.at-{marker}, .at-{marker} input")
        field.click()
        field.send_keys(Keys.CONTROL, "a")
        field.send_keys(text)

    def choose(self, marker: str, text: str) -> None:
        """Press the button of that text within an element."""
        buttons = self.all(marker)[0].find_elements(By.TAG_NAME, "button")
        next(button for button in buttons if button.text == text).click()

    def complaints(self) -> list[str]:
        """What the browser's console calls severe, of the page that is open.

        A page that was left may go on for a moment and look for its server, which has ended.
        """
        origin = self.driver.execute_script("return location.origin")
        severe = [entry["message"] for entry in self.driver.get_log("browser") if entry["level"] == "SEVERE"]
        return [each for each in severe if each.startswith(origin) or not each.startswith("http://")]


@contextlib.contextmanager
def chromium(*, width: int = 1280, height: int = 720, dark: bool = False) -> Iterator[Any]:
    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    for argument in (*_ARGUMENTS, f"--window-size={width},{height}"):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(DRIVER))
    try:
        metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [scheme]})
        yield driver
    finally:
        driver.quit()


@contextlib.contextmanager
def server(
    config: Path | None = None, *options: str, programs: str | None = None, cwd: Path | None = None
) -> Iterator[str]:
    """The studio of a config, or its start page; the address that it printed."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    # NiceGUI serves nothing where it believes to be within pytest.
    outside = {key: value for key, value in os.environ.items() if not key.startswith("PYTEST")}
    environment = outside | {"PYTHONUNBUFFERED": "1"}
    if programs is not None:
        environment |= {
            "JAX_COMPILATION_CACHE_DIR": programs,
            "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
        }
    command = [sys.executable, "-m", "focusjax.cli", "studio", "--no-open", "--port", str(port)]
    command += [] if config is None else [str(config)]
    process = subprocess.Popen(
        [*command, *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=environment,
        cwd=cwd,
    )
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        assert line.startswith("Studio: http://"), line + process.stdout.read()
        yield line.split()[1]
    finally:
        process.terminate()
        process.communicate(timeout=60)
