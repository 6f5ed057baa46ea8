"""The page without a browser: what its elements say and do."""

import asyncio
import contextlib
import socket

import pytest
from boxes_config import CONFIG, write_boxes
from typer.testing import CliRunner

from focusjax.cli import app as command_line
from focusjax.studio import Session, Studio, _command

nicegui = pytest.importorskip("nicegui", reason="no NiceGUI, which makes the page")
httpx, responses, simulation, guards, pages, serving = (
    pytest.importorskip(name)
    for name in (
        "httpx",
        "starlette.responses",
        "nicegui.testing.user_simulation",
        "focusjax.studio._guard",
        "focusjax.studio._page",
        "focusjax.studio._serve",
    )
)
NEAR = {"image_x": 8, "image_y": 15, "button": 0}
SKY = {"image_x": 20, "image_y": 2}


@pytest.fixture
def studio(tmp_path):
    made = Studio(Session(write_boxes(tmp_path)))
    assert made.wait(300)
    yield made
    made.close()


@contextlib.asynccontextmanager
async def opened(studio):
    async with simulation.user_simulation(root=lambda: pages.Page(studio)) as user:
        await user.open("/")
        yield user


def mouse(user, kind, **place):
    user.find(marker="picture").trigger("mouse", {"mouse_event_type": kind, **NEAR, **place})


async def settled(studio):
    """Wait without keeping the page from looking."""
    for _ in range(3000):
        await asyncio.sleep(0.02)
        if studio.wait(0) and studio.state.word in ("refined", "no lens", "problem"):
            await asyncio.sleep(0.15)
            return
    raise AssertionError(studio.state)


def test_a_click_sets_a_point_and_its_card_changes_it(studio):
    async def story():
        async with opened(studio) as user:
            await user.should_see("far box")
            mouse(user, "mousedown", **SKY)
            mouse(user, "mouseup", **SKY)
            await settled(studio)
            await user.should_see("background")
            user.find(marker="kind").elements.pop().value = "at_most"
            assert studio.session.config.focus[2].at_most_px == 1.2
            user.find(marker="weight").elements.pop().value = 5.0
            assert studio.session.config.focus[2].weight == 5.0
            user.find(marker="on").elements.pop().value = False
            await settled(studio)
            assert not studio.answer.wishes[2].counts
            user.find(marker="delete").click()
            assert len(studio.session.config.focus) == 2

    asyncio.run(story())


def test_a_point_is_dragged_and_that_undone_in_one(studio):
    async def story():
        async with opened(studio) as user:
            mouse(user, "mousedown", image_x=8, image_y=14.9)
            for x in (15, 22, 30):
                mouse(user, "mousemove", image_x=x)
            mouse(user, "mouseup", image_x=30)
            assert studio.session.config.focus[0].pixel == (30, 15)
            await settled(studio)
            studio.apply(lambda session: session.undo())
            assert studio.session.config.focus[0].pixel is None

    asyncio.run(story())


def test_a_setting_is_fixed_and_limited(studio):
    async def story():
        async with opened(studio) as user:
            user.find(marker="low-f_number").elements.pop().value = 4.0
            await settled(studio)
            await user.should_see("f/4.0")
            await user.should_see("widest aperture")
            user.find(marker="lock-f_number").click()
            assert studio.session.config.solve.free == ("focus",)
            user.find(marker="lock-focus").click()
            await user.should_see("one setting at least has to stay free")
            user.find(marker="fixed-f_number").elements.pop().value = 8.0
            await settled(studio)
            await user.should_see("f/8.0")

    asyncio.run(story())


def test_saving_says_so_and_where(studio):
    async def story():
        async with opened(studio) as user:
            studio.apply(lambda session: session.set_weight(0, 2.0))
            user.find(marker="save").click()
            await user.should_see("Saved to")
            assert "weight = 2" in studio.session.document.path.read_text()
            studio.session.document.path.write_text(CONFIG)
            studio.apply(lambda session: session.set_weight(0, 3.0))
            user.find(marker="save").click()
            await user.should_see("was changed by something else")
            assert studio.session.document.path.read_text() == CONFIG

    asyncio.run(story())


def test_two_tabs_show_one_session(studio):
    async def story():
        async with opened(studio) as user:
            studio.apply(lambda session: session.rename(0, "front of the box"))
            await settled(studio)
            await user.should_see("front of the box")
            await user.open("/")
            await user.should_see("front of the box")
            assert len(studio.session.config.focus) == 2

    asyncio.run(story())


def test_the_server_gives_the_sessions_pictures_and_nothing_else(studio):
    newest = studio.shown["picture"].number
    assert serving.picture_of(studio, "picture", newest).body[:3] == b"\xff\xd8\xff"
    assert serving.picture_of(studio, "blur", studio.shown["blur"].number).media_type == "image/webp"
    for kind, number in (("picture", newest + 99), ("../boxes.toml", 0), ("config", 0)):
        assert serving.picture_of(studio, kind, number).status_code == 404


@pytest.mark.parametrize(
    ("address", "headers", "status"),
    [
        ("/", {}, 200),
        ("/", {"origin": "http://127.0.0.1:8123"}, 200),
        ("/", {"origin": "http://elsewhere.example"}, 403),
        ("/", {"host": "elsewhere.example:8123"}, 403),
    ],
)
def test_pages_of_others_are_refused(address, headers, status):
    guard = guards.Guard(responses.PlainTextResponse("in"), hosts=("127.0.0.1:8123",))
    assert asked(guard, address, headers).status_code == status


def test_a_token_is_asked_for_once():
    guard = guards.Guard(responses.PlainTextResponse("in"), hosts=(), token="secret")
    assert asked(guard, "/", {}).status_code == 403
    assert asked(guard, "/?token=wrong", {}).status_code == 403
    first = asked(guard, "/?token=secret", {})
    assert (first.status_code, first.text) == (200, "in")
    cookie = first.headers["set-cookie"].split(";")[0]
    assert asked(guard, "/", {"cookie": cookie}).status_code == 200


def asked(guard, address, headers):
    async def ask():
        transport = httpx.ASGITransport(guard)
        async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1:8123") as client:
            return await client.get(address, headers=headers)

    return asyncio.run(ask())


def test_a_port_that_is_taken_is_refused(tmp_path):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        result = CliRunner().invoke(
            command_line, ["studio", str(write_boxes(tmp_path)), "--port", port], env={"COLUMNS": "200"}
        )
    assert result.exit_code == 2
    assert f"--port {port} at 127.0.0.1: cannot be listened to" in result.stderr


def test_without_nicegui_the_command_says_how_to_install_it(tmp_path, monkeypatch):
    monkeypatch.setattr(_command.importlib.util, "find_spec", lambda name: None)
    result = CliRunner().invoke(command_line, ["studio", str(write_boxes(tmp_path))], env={"COLUMNS": "200"})
    assert result.exit_code == 2
    assert "pip install 'focusjax[studio]'" in result.stderr


def test_a_config_that_is_not_there_is_named(tmp_path):
    result = CliRunner().invoke(command_line, ["studio", str(tmp_path / "no.toml")], env={"COLUMNS": "200"})
    assert result.exit_code == 2
    assert "no.toml: there is no such config file" in result.stderr


def test_every_control_has_help(studio):
    async def story():
        async with opened(studio) as user:
            mouse(user, "mousedown", **SKY)
            mouse(user, "mouseup", **SKY)
            buttons = user.find(kind=nicegui.ui.button).elements
            icons = [each for each in buttons if not each.text]
            assert len(icons) >= 7
            assert all("aria-label" in each.props for each in icons)

    asyncio.run(story())
