"""Tables and pages of the reference in Markdown, and the page of all commands with their options."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from tools.program import program

MADE = "<!-- made by `python -m tools.dev.reference`; change the code it is made from -->"

FEWEST_SECTIONS = 2
"""What has the same name and meaning in this number of sections or more is described once for all of them."""


def find_repeated(sections: Iterable[Mapping[str, str]]) -> dict[str, str]:
    """The meanings, by their names, that are described once: of a name the most frequent one."""
    counts = Counter(meaning for section in sections for meaning in section.items())
    rising = reversed(counts.most_common())
    return {name: meaning for (name, meaning), count in rising if count >= FEWEST_SECTIONS}


def row(*cells: Any) -> str:
    """One row of a Markdown table."""
    return "| " + " | ".join(str(cell).replace("|", "\\|").replace("\n", " ") for cell in cells) + " |"


def table(titles: Sequence[str], rows: Iterator[str]) -> str:
    """A Markdown table."""
    return "\n".join([row(*titles), "|" + "---|" * len(titles), *rows])


def page(title: str, *parts: str) -> str:
    """A page: its title, a note on its origin, and its parts."""
    return "\n\n".join([f"# {title}", MADE, *parts]) + "\n"


def every_command(group: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """All commands that the help lists, by their names; the commands of a group come after the group."""
    for name, command in group.commands.items():
        if command.hidden:
            continue
        yield f"{prefix}{name}", command
        if hasattr(command, "commands"):
            yield from every_command(command, f"{prefix}{name} ")


def options_of(command: Any) -> dict[str, str]:
    """The options and arguments of a command, by their names as written on the page, with their meanings."""
    found = {}
    for option in command.params:
        if option.name == "help" or "--json" in option.opts:
            continue
        every = (*option.opts, *option.secondary_opts)
        names = "/".join(f"`{one}`" for one in every) or f"`{option.name}`"
        shown = names if names.startswith("`--") else f"`{(option.metavar or option.name).upper()}`"
        found[shown] = getattr(option, "help", None) or ""
    return found


def switches(options: Mapping[str, str]) -> dict[str, str]:
    """The options among a command's options and arguments."""
    return {name: meaning for name, meaning in options.items() if name.startswith("`--")}


def option_table(options: Mapping[str, str]) -> str:
    """A table of options with their meanings."""
    return table(["option", "meaning"], (row(*option) for option in options.items()))


def name_users(options: Mapping[str, str], users: Mapping[str, Mapping[str, str]]) -> dict[str, str]:
    """Shared options with their meanings, of those that few commands have with these commands."""
    found = {}
    for option, meaning in options.items():
        names = [name for name, own in users.items() if own.get(option) == meaning]
        of = f" ({', '.join(f'`{name}`' for name in names)})" if len(names) <= FEWEST_SECTIONS else ""
        found[option] = f"{meaning}{of}"
    return found


def command_page() -> str:
    """Every command and its options."""
    whole = program()
    every_name = list(every_command(whole))
    without = [
        name
        for name, command in every_name
        if not hasattr(command, "commands") and not any("--json" in option.opts for option in command.params)
    ]
    names = ", ".join(f"`{name}`" for name in without)
    of_group = {
        group: find_repeated(map(switches, map(options_of, command.commands.values())))
        for group, command in every_name
        if hasattr(command, "commands")
    }
    described, left = {}, {}
    for name, command in every_name:
        group, _, is_member = name.partition(" ")
        above = of_group[group] if is_member else {}
        options = options_of(command)
        described[name] = [option for option in options if above.get(option) == options[option]]
        left[name] = {option: options[option] for option in options if option not in described[name]}
    of_all = find_repeated(map(switches, left.values()))
    parts = [
        "Every command describes itself with `--help`. With `--json` it prints one JSON object on standard "
        f"output ({names} do not have this option). All have the same "
        "[exit statuses](../how-to/run-in-ci.md#exit-statuses). Options of several commands are described "
        "once, here or at their group; each command names those that it has.",
        option_table(name_users(of_all, left)),
    ]
    for name, command in every_name:
        own = {option: meaning for option, meaning in left[name].items() if of_all.get(option) != meaning}
        shared = [option for option in left[name] if option not in own]
        parts.append(f"## vibrohil {name}\n\n{command.help or ''}")
        if own:
            parts.append(option_table(own))
        if shared:
            parts.append(f"[Also](#the-command-line): {', '.join(shared)}.")
        if described[name]:
            parts.append(f"[Also](#vibrohil-{name.partition(' ')[0]}): {', '.join(described[name])}.")
        if of_group.get(name):
            parts += ["Options of several of its commands:", option_table(of_group[name])]
    return page("The command line", *parts)
