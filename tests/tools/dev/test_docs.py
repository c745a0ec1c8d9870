"""The documentation holds: commands run as written, links lead somewhere, the reference is up to date."""

import re
import shlex
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import NamedTuple, get_type_hints

import pytest

from firmware_py.core.state import State
from firmware_py.interface.parameter_table import TABLE
from hil.figures.records import CATALOGUE
from hil.scenario.files import scenario_names
from hil.scenario.scenario import load_scenario
from plant_sim.scene import scene_names
from tools import cli
from tools.dev import reference
from tools.dev.command_page import every_command, options_of
from tools.examples import EXAMPLES
from tools.output import EXIT_CHECK_FAILED, EXIT_PASSED
from tools.program import program
from tools.tuning.identification import identify

DOCS = Path(__file__).parents[3] / "docs"
BLOCK = re.compile(r"^```(\w+)([^\n]*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
LINK = re.compile(r"\]\(([^)#:]+)(?:#[^)]*)?\)")
SECTION_LINK = re.compile(r"\]\(([^)#:]*\.md|)#([^)]*)\)")
IN_ORDER = {
    "a run": (
        "tutorial.md",
        "how-to/use-from-python.md",
        "how-to/write-a-scenario.md",
        "how-to/read-a-log.md",
        "how-to/write-tests.md",
        "how-to/compare-two-runs.md",
    ),
    "a tuning": ("how-to/tune.md",),
}
"""Pages whose examples build on one another."""
DEV_PROGRAMS = (
    "builds",
    "lowest",
    "mutation",
    "parameter_sweep",
    "reactions",
    "reference",
    "walkthrough",
    "warm",
    "worst_cases",
)


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


README = DOCS.parent / "README.md"
PAGES = [README, *sorted(DOCS.rglob("*.md"))]
INLINE = re.compile(r"`(vibrohil [^`]+)`")
INDENTED = re.compile(r"^    (vibrohil .*?)(?: +#.*)?$", re.MULTILINE)
GROUPS = "|".join(sorted({one.name.partition(".")[0] for one in TABLE}))
PARAMETER = re.compile(rf"`((?:{GROUPS})\.(?!py`)[a-z][a-z0-9_.]*)`")


def shown_on(page: Path) -> list[list[str]]:
    """The commands that a page shows, in blocks or within its text, without `vibrohil`."""
    text = page.read_text("utf-8")
    loose = [
        shlex.split(line.replace("…", ""))[1:] for line in (*INDENTED.findall(text), *INLINE.findall(text))
    ]
    return [command for block in blocks(page) if block.language == "sh" for command in commands(block)] + [
        command for command in loose if command
    ]


def test_every_picture_is_shown_on_a_page() -> None:
    pages = [DOCS.parent / "README.md", *DOCS.rglob("*.md")]
    text = "".join(page.read_text("utf-8") for page in pages)
    pictures = [path for place in ("explanation", "pictures") for path in (DOCS / place).glob("*.[sp][vn]g")]
    assert pictures
    assert [path.name for path in pictures if f"{path.name})" not in text] == []


@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize("about", IN_ORDER)
def test_what_is_shown_works(about, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(identify, "tune_identify", cache(identify.tune_identify))  # of one log, shown twice
    ran = 0
    for name in IN_ORDER[about]:
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
    assert ran >= 8, "the pages show fewer commands than they did: is a block no longer marked?"


EXAMPLES_SHOWN = [shlex.split(example)[1:] for example in EXAMPLES.values()]


@pytest.mark.parametrize(
    ("place", "shown"),
    [*((page.name, shown_on(page)) for page in PAGES), ("examples.py", EXAMPLES_SHOWN)],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_every_command_and_option_that_is_shown_is_there(place, shown):
    commands = program().commands
    for name, *words in shown:
        if name.startswith("--"):
            continue
        assert name in commands, f"{place}: vibrohil {name}"
        command = commands[name]
        runs_alone = getattr(command, "invoke_without_command", False) and words and words[0].startswith("--")
        if hasattr(command, "commands") and words and words[0] != "--help" and not runs_alone:
            named = words[0] if words[0] in command.commands else getattr(command, "unnamed", words[0])
            assert named in command.commands, f"{place}: vibrohil {name} {words[0]}"
            command = command.commands[named]
        argument = next(iter(words[1:] if words[:1] == [command.name] else words), "")
        first = command.params[0].name if command.params else ""
        names = {"scenario": scenario_names, "scene": scene_names}.get(first)
        if names is not None and re.fullmatch(r"[a-z][a-z0-9-]+", argument):
            assert argument in names(), f"{place}: vibrohil {name} {argument}"
        known = {
            option for parameter in command.params for option in (*parameter.opts, *parameter.secondary_opts)
        }
        own = words[: words.index("--")] if "--" in words else words
        options = {word.partition("=")[0] for word in own if word.startswith("--")}
        assert options <= known | {"--help"}, f"{place}: vibrohil {name} has no {options - known}"


def test_the_readme_shows_ten_commands_and_the_documentation_names_every_one():
    assert len(INDENTED.findall(README.read_text("utf-8"))) == 10
    assert {name for name, *_ in shown_on(DOCS / "README.md")} == {
        name for name, _ in every_command(program()) if " " not in name
    }


def test_every_setting_that_is_shown_can_be_made():
    for page in PAGES:
        for name, *words in shown_on(page):
            settings = [words[place + 1] for place, word in enumerate(words[:-1]) if word == "--set"]
            given = [setting for setting in settings if "NAME" not in setting]
            if name == "run" and given and not words[0].endswith(".toml"):
                load_scenario(words[0], given)


def test_every_parameter_that_is_named_is_one():
    for page in PAGES:
        known = {one.name for one in TABLE} | set(CATALOGUE)
        text = page.read_text("utf-8")
        if page.name == "changes.md":  # its tables have the old name before the new one
            text = "\n".join(line.rsplit("|", 2)[1] for line in text.splitlines() if line.startswith("|"))
        if page.name == "export-an-fmu.md":
            known |= {"motor.torque_n_m", "stop.law"}  # an input of the unit; a key of scenes that it lacks
        named = set(PARAMETER.findall(text))
        assert named <= known, f"{page.name} names {named - known}"


def test_every_link_leads_somewhere():
    for page in PAGES:
        for target in LINK.findall(page.read_text("utf-8")):
            assert (page.parent / target).exists(), f"{page.name} links to {target}"


def anchors_of(page: Path) -> set[str]:
    """The names of a page's sections, as GitHub makes them from the headings, and of its own anchors."""
    text = page.read_text("utf-8")
    headings = re.findall(r"^#+ (.*)$", BLOCK.sub("", text), re.MULTILINE)
    plain = (re.sub(r"[^\w\- ]", "", heading.lower()) for heading in headings)
    return {name.replace(" ", "-") for name in plain} | set(re.findall(r'<a id="(.*?)">', text))


def test_every_link_to_a_section_finds_it():
    for page in PAGES:
        for target, anchor in SECTION_LINK.findall(page.read_text("utf-8")):
            there = page.parent / target if target else page
            assert anchor in anchors_of(there), f"{page.name} links to {target}#{anchor}"


@pytest.mark.parametrize("name", reference.PAGES)
def test_the_reference_is_up_to_date(name):
    written = (DOCS / "reference" / name).read_text("utf-8")
    assert written == reference.PAGES[name](), f"{name} is old; run python -m tools.dev.reference"


@pytest.mark.parametrize(
    "module", ["firmware_py.interface.generate", *(f"tools.dev.{name}" for name in DEV_PROGRAMS)]
)
def test_a_developers_program_asked_for_help_only_answers(module, tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", module, "--help"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith(f"usage: python -m {module} ")
    assert not list(tmp_path.iterdir())


def words_of(kind: type) -> int:
    """Numbers in a record and in the records within it."""
    fields = get_type_hints(kind) if hasattr(kind, "_fields") else {}
    return sum(words_of(one) for one in fields.values()) or 1


def test_the_sizes_of_the_blocks_states_are_those_of_the_code():
    page = (DOCS / "firmware.md").read_text("utf-8")
    said = {
        name: int(words) for name, words in re.findall(r"^\| `(\w+)` \|.*\| (\d+) \|$", page, re.MULTILINE)
    }
    states = {name: words_of(kind) for name, kind in get_type_hints(State).items()}
    assert said == {name: states[name] for name in said}
    assert set(states) - set(said) == {"drive_link", "proof"}  # docs/safety.md describes them


def test_the_help_shows_every_word_that_stands_in_the_code(monkeypatch, capsys):
    """As [[search]] would be taken for markup, and a line of a docstring for one of the page."""
    monkeypatch.setenv("COLUMNS", "1000")
    for name, command in every_command(program()):
        cli.run([*name.split(), "--help"])
        shown = re.sub(r"[\s│]+", " ", capsys.readouterr().out)
        options = [one for one in command.params if not getattr(one, "hidden", False)]
        for text in (command.help, *(one.help for one in options)):
            assert text, f"vibrohil {name} has an option without a help"
            assert " ".join(text.split()) in shown, f"vibrohil {name} --help"


def test_every_option_is_in_the_section_of_its_command():
    page = (DOCS / "reference" / "command-line.md").read_text("utf-8")
    sections = dict(re.findall(r"^## vibrohil (.*?)\n(.*?)(?=^## |\Z)", page, re.DOTALL | re.MULTILINE))
    for name, command in every_command(program()):
        for option in options_of(command):
            assert option.replace("|", "\\|") in sections[name], f"vibrohil {name} has {option}"


def test_every_shared_option_is_described_where_its_command_links_to():
    page = (DOCS / "reference" / "command-line.md").read_text("utf-8")
    places = {"the-command-line": page.partition("\n## ")[0]}
    for heading, text in re.findall(r"^## (.*?)\n(.*?)(?=^## |\Z)", page, re.DOTALL | re.MULTILINE):
        places[heading.replace(" ", "-")] = text
    links = re.findall(r"^\[Also\]\(#(.*?)\): (.*)\.$", page, re.MULTILINE)
    assert links
    for anchor, options in links:
        for option in options.split(", "):
            assert f"| {option} |" in places[anchor], f"{option} is not described at {anchor}"
