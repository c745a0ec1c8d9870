"""One word for one thing: pages, messages, docstrings and comments use the terms of the field."""

import io
import re
import tokenize
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[3]
FOLDERS = ("docs", "firmware_py", "hil", "plant_sim", "tools", "tests")
OLD_NAMES = REPOSITORY / "docs/changes.md"
"""The page of renamed and removed names, whose subject they are."""
ENDINGS = (".md", ".toml", ".html", ".dbc", ".svg")
"""Beside these Python's comments and strings; of pictures the texts, which matplotlib writes as comments."""

WORDS = {
    r"blows?|(?<!heel )(?<!heel-)\b(?:strikes?|struck|striking)": "impact",
    r"believ\w+|beliefs?": "nominal (parameters), estimated (state)",
    r"tells?|told|telling": "distinguish, report, say",
    r"draws|drawn (?:from|at random|anew|again|modules?|starts?|walks?)": "sample, trial, sampled module",
    r"(?:fresh|few|more|single|same) draws?": "sample, trial",
    r"hears?|heard": "receive",
    r"whirling|strange": "freewheel overspeed; implausible, gated",
    r"so (?:much|long|many)\b(?! as)": "the quantity by its name",
}
"""What is not to be written, and the word for it."""

IN_NAMES = {
    "impact": {"blow", "blows", "struck"},
    "nominal (parameters), estimated (state)": {"belief", "believed", "believes"},
    "distinguish, report": {"tell", "tells", "told", "telling"},
    "sample, trial, sampled module": {"draws"},
    "receive": {"hear", "hears", "heard"},
    "freewheel overspeed; implausible, gated, foreign": {"whirling", "strange"},
    "cost": {"price", "prices"},
    "highlight": {"moments"},
    "validation message": {"complaint", "complaints"},
}
"""Words that no name may have in it, by the words for them."""

NAMES_ALLOWED = {
    "_heel_struck": "heel strike is the term of gait",
    "moments": "of a filter's weight function, 1, s, s² …",
    "_moments": "the same",
    "_update_moments": "the same",
    "tell": "a method of files",
}
"""Names with the reason why they stand."""

ON_PAGES = {r"lanes?": "state timeline", r"prices?": "cost"}
"""The same on pages alone: in the code they are names of Rerun's layout and of modules."""

ALLOWED = {
    ("", "a-violent-kick-just-before-an-impact"): "a scenario's name",
    ("", "a-heavier-striker-than-believed"): "a scenario's name",
}
"""Beginning of the path and text around the word, with the reason why it stands."""


def lines_of(path: Path) -> list[tuple[int, str]]:
    """What people read of a file, with the lines' numbers."""
    text = path.read_text("utf-8")
    if path.suffix == ".svg":
        numbered = enumerate(text.splitlines(), 1)
        return [(number, line) for number, line in numbered if line.strip().startswith("<!--")]
    if path.suffix != ".py":
        return list(enumerate(text.splitlines(), 1))
    kinds = {tokenize.COMMENT, tokenize.STRING, getattr(tokenize, "FSTRING_MIDDLE", tokenize.STRING)}
    return [
        (token.start[0] + number, line)
        for token in tokenize.generate_tokens(io.StringIO(text).readline)
        if token.type in kinds
        for number, line in enumerate(token.string.splitlines())
    ]


def found_in(path: Path) -> list[str]:
    found = []
    name = path.relative_to(REPOSITORY).as_posix()
    words = WORDS | ON_PAGES if path.suffix == ".md" else WORDS
    if not re.search(rf"\b(?:{'|'.join(words)})\b", path.read_text("utf-8"), re.IGNORECASE):
        return []
    for number, line in lines_of(path):
        kept = line
        for (begins, text), _ in ALLOWED.items():
            if name.startswith(begins):
                kept = kept.replace(text, "")
        found += [
            f"{name}:{number}: {match[0]!r}; wanted: {word}"
            for pattern, word in words.items()
            for match in re.finditer(rf"\b(?:{pattern})\b", kept, re.IGNORECASE)
        ]
    return found


def names_in(path: Path) -> list[str]:
    """The names in a module and the module's own that have a word in them which is not to be written."""
    found = []
    name = path.relative_to(REPOSITORY).as_posix()
    text = path.read_text("utf-8")
    if not re.search("|".join(set().union(*IN_NAMES.values())), path.stem + text, re.IGNORECASE):
        return []
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    for text in {path.stem, *(token.string for token in tokens if token.type == tokenize.NAME)}:
        parts = set(re.sub(r"(?<=[a-z])(?=[A-Z])", "_", text).lower().split("_"))
        found += [
            f"{name}: {text}; wanted: {word}"
            for word, unwanted in IN_NAMES.items()
            if parts & unwanted and text not in NAMES_ALLOWED
        ]
    return sorted(found)


def files() -> list[Path]:
    own = [
        path
        for folder in FOLDERS
        for path in (REPOSITORY / folder).rglob("*")
        if path.suffix in (".py", *ENDINGS) and path != Path(__file__)
    ]
    return [REPOSITORY / "README.md", *(path for path in own if path != OLD_NAMES)]


def test_words_of_the_field() -> None:
    found = [one for path in files() for one in found_in(path)]
    assert not found, "\n".join(found)


@pytest.mark.parametrize("text", ["a hard blow", "two draws tell", "the striker strikes", "what is believed"])
def test_the_check_finds(text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("test_words.REPOSITORY", tmp_path)
    page = tmp_path / "page.md"
    page.write_text(f"At first {text}.")
    assert found_in(page)
    page.write_text("Each heel strike; as many as were sampled.")
    assert not found_in(page)


def test_names_of_the_field() -> None:
    found = [one for path in files() if path.suffix == ".py" for one in names_in(path)]
    assert not found, "\n".join(found)


@pytest.mark.parametrize("text", ["draws = 1", "def test_what_is_told(): ...", "class FrameHeard: ..."])
def test_the_check_finds_names(text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("test_words.REPOSITORY", tmp_path)
    module = tmp_path / "module.py"
    module.write_text(text)
    assert names_in(module)
    module.write_text("sampled = drawing.withdrawn")
    assert not names_in(module)
