"""A config in a folder of its own, for batches to be made of."""

import pytest
from boxes_config import write_boxes
from typer.testing import CliRunner

from focusjax.cli import app


@pytest.fixture
def boxes(tmp_path):
    (tmp_path / "scene").mkdir()
    return write_boxes(tmp_path / "scene")


@pytest.fixture(scope="session")
def batch():
    """`focusjax batch`, as a function that returns the exit status and what was printed."""

    def run(*arguments):
        words = ["batch", *(str(argument) for argument in arguments)]
        result = CliRunner().invoke(app, words, env={"COLUMNS": "200"})
        assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
        return result.exit_code, result.stdout, result.stderr

    return run
