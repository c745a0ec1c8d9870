"""The documentation holds: commands run as written, links lead somewhere, the reference is up to date."""

import re
import shlex
from pathlib import Path
from typing import NamedTuple

import pytest
import typer

from tools import cli, reference
from tools.output import EXIT_CHECK_FAILED, EXIT_PASSED

DOCS = Path(__file__).parents[2] / "docs"
BLOCK = re.compile(r"^```(\w+)([^\n]*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
LINK = re.compile(r"\]\(([^)#:]+)(?:#[^)]*)?\)")
IN_ORDER = (
    "tutorial.md",
    "how-to/write-a-scenario.md",
    "how-to/read-a-log.md",
    "how-to/compare-two-runs.md",
    "how-to/tune.md",
)
"""Pages whose examples build on one another."""


class Block(NamedTuple):
    """One fenced block: its language, the words after it, its text."""

    language: str
    marks: list[str]
    text: str


def blocks(page: Path) -> list[Block]:
    return [
        Block(language, marks.split(), text)
        for language, marks, text in BLOCK.findall(page.read_text("utf-8"))
    ]


def commands(block: Block) -> list[list[str]]:
    lines = [shlex.split(line) for line in block.text.splitlines() if line.strip()]
    return [line[line.index("vibrohil") + 1 :] for line in lines if "vibrohil" in line]


PAGES = sorted(DOCS.rglob("*.md"))


def test_what_is_shown_works(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    ran = 0
    for name in IN_ORDER:
        names: dict[str, object] = {}
        for block in blocks(DOCS / name):
            for mark in block.marks:
                if mark.startswith("file="):
                    (tmp_path / mark.removeprefix("file=")).write_text(block.text)
            if "run" not in block.marks:
                continue
            if block.language == "python":
                exec(compile(block.text, name, "exec"), names)
                ran += 1
            for command in commands(block):
                expected = EXIT_CHECK_FAILED if "fails" in block.marks else EXIT_PASSED
                status = cli.run(command)
                assert status == expected, f"{name}: vibrohil {' '.join(command)}: {capsys.readouterr()}"
                ran += 1
    assert ran >= 12


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(DOCS)))
def test_every_command_and_option_that_is_shown_is_there(page):
    program = typer.main.get_command(cli.app)
    for block in blocks(page):
        if block.language != "sh":
            continue
        for name, *words in commands(block):
            assert name in program.commands, f"{page.name}: vibrohil {name}"
            command = program.commands[name]
            if hasattr(command, "commands") and words[0] != "--help":
                assert words[0] in command.commands, f"{page.name}: vibrohil {name} {words[0]}"
                command = command.commands[words[0]]
            known = {
                option
                for parameter in command.params
                for option in (*parameter.opts, *parameter.secondary_opts)
            }
            shown = {word.partition("=")[0] for word in words if word.startswith("--") and len(word) > 2}
            assert shown <= known | {"--help"}, f"{page.name}: vibrohil {name} has no {shown - known}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(DOCS)))
def test_every_link_leads_somewhere(page):
    for target in LINK.findall(page.read_text("utf-8")):
        assert (page.parent / target).exists(), f"{page.name} links to {target}"


@pytest.mark.parametrize("name", reference.PAGES)
def test_the_reference_is_up_to_date(name):
    written = (DOCS / "reference" / name).read_text("utf-8")
    assert written == reference.PAGES[name](), f"{name} is old; run python -m tools.reference"
