"""How far a command is, on a terminal and elsewhere, and how much it says of it."""

import io
import re

import pytest
import typer
from rich.console import Console
from typer.testing import CliRunner

from focusjax import _progress
from focusjax._carry_out import carry_out
from focusjax._console import Talk
from focusjax._progress import progress
from focusjax.cli import app


class Clock:
    """Seconds that pass when they are asked to."""

    def __init__(self, monkeypatch):
        self.now = 100.0
        monkeypatch.setattr(_progress.time, "monotonic", lambda: self.now)


@pytest.fixture
def clock(monkeypatch):
    return Clock(monkeypatch)


def said(clock, talk, terminal=False):
    """What is said of a run of 4 s of loading and 40 s of rendering."""
    out = io.StringIO()
    with progress(Console(file=out, force_terminal=terminal, width=80), talk) as report:
        report("load", None)
        clock.now += 4.0
        for quarter in range(5):
            report("render", quarter / 4)
            clock.now += 10.0 * (quarter < 4)
    return out.getvalue()


def test_elsewhere_than_on_a_terminal_it_is_plain_lines(clock):
    assert said(clock, Talk.NORMAL).splitlines() == [
        "Loading meshes",
        "Tracing rays",
        "Tracing rays: 25 %, 0:30 left",
        "Tracing rays: 50 %, 0:20 left",
        "Tracing rays: 75 %, 0:10 left",
        "Tracing rays: 100 %, 0:00 left",
    ]


def test_quiet_says_nothing(clock):
    assert said(clock, Talk.QUIET) == said(clock, Talk.QUIET, terminal=True) == ""


def test_verbose_says_how_long_each_stage_took(clock):
    lines = said(clock, Talk.VERBOSE).splitlines()
    assert (lines[0], lines[-1]) == ("Loading meshes: 4.0 s", "Tracing rays: 40.0 s")
    assert "Tracing rays: 40.0 s" in said(clock, Talk.VERBOSE, terminal=True)


def test_a_terminal_shows_the_time_left():
    out = io.StringIO()
    with progress(Console(file=out, force_terminal=True, width=80)) as report:
        report("render", 0.2)
        report("render", 0.5)
    assert "Tracing rays" in out.getvalue()
    assert re.search(r"\d:\d\d", out.getvalue())


def test_an_error_of_ours_shows_where_it_arose_when_verbose(tmp_path, capsys):
    def read():
        raise ZeroDivisionError("a slip")

    for talk, traced in ((Talk.NORMAL, False), (Talk.VERBOSE, True)):
        with pytest.raises(typer.Exit):
            carry_out(read, tmp_path / "out", solving=True, rendering=True, talk=talk)
        complaint = capsys.readouterr().err
        assert ("Traceback" in complaint) == traced
        assert "focusjax: internal error, please report it: ZeroDivisionError('a slip')" in complaint


def test_quiet_and_verbose_are_opposites():
    result = CliRunner().invoke(app, ["run", "any.toml", "--quiet", "--verbose"])
    assert result.exit_code == 2
    assert result.stderr == "focusjax: --quiet and --verbose are opposites; give one\n"
