"""What README and docs tell a person to type: every command is one that there is, and the Python runs."""

import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import typer.core
import typer.main

from entoptic.services.cli import app

ROOT = Path(__file__).parents[2]
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
TYPED = re.compile(r"^(?: {4}|\$ )entoptic (.*?)(?: {3}.*| +#.*|\s*[&|].*)?$", re.MULTILINE)
COMMANDS = sorted({typed for page in PAGES for typed in TYPED.findall(page.read_text(encoding="utf-8"))})


def test_there_are_commands_to_try() -> None:
    assert len(COMMANDS) > 20


@pytest.mark.parametrize("typed", COMMANDS)
def test_a_command_is_understood(typed: str) -> None:
    command: Any = typer.main.get_command(app)
    context, words = None, shlex.split(typed)
    while isinstance(command, typer.core.TyperGroup) and words and not words[0].startswith("-"):
        context = command.context_class(command, parent=context)
        _, command, words = command.resolve_command(context, words)
    command.make_context("entoptic", words, parent=context)


def test_the_python_in_the_readme_runs(capsys: pytest.CaptureFixture[str]) -> None:
    (block,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    small = block.replace("(800, 720, 3)", "(80, 72, 3)").replace("[400, 360]", "[40, 36]")
    assert small != block
    exec(compile(small, "README.md", "exec"), {})
    assert "glare" in capsys.readouterr().out
