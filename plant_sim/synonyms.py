"""Synonyms of the words of names, for searches."""

from collections.abc import Iterable

SYNONYMS = (
    ("stuck", "freeze", "frozen", "repeats"),
    ("silent", "dead", "mute", "unplugged", "lost"),
    ("late", "delay", "latency", "bundle", "pause"),
    ("kick", "shock", "knock", "bump"),
    ("killed", "crash", "restart", "reboot", "reset"),
    ("jam", "block", "stall"),
    ("hot", "temperature", "overheat"),
    ("supply", "voltage", "battery", "brown-out"),
    ("bias", "offset", "drift"),
    ("noisy", "noise"),
    ("babbling", "flood", "overload"),
    ("corrupt", "checksum", "crc"),
    ("e-stop", "emergency"),
    ("walk", "gait", "stride"),
)
"""Words of one meaning: those of the names, and their synonyms in searches."""


def with_synonyms(text: str) -> list[str]:
    """A text in lower case, and all words that mean the same as a word that begins with it.

    >>> "stuck" in with_synonyms("Freeze"), with_synonyms("encoder")
    (True, ['encoder'])
    """
    text = text.lower()
    same = [group for group in SYNONYMS if len(text) > 2 and any(word.startswith(text) for word in group)]
    return list(dict.fromkeys([text, *(word for group in same for word in group)]))


def synonymous(name: str, known: Iterable[str]) -> list[str]:
    """The known names that mean the same: with a synonym for one of the name's words, or by that word alone.

    >>> synonymous("sensor-frozen", ["frozen", "sensor-stuck", "sensor-wrong-sign", "torque-stuck"])
    ['frozen', 'sensor-stuck']
    >>> synonymous("latency", ["delayed", "dropped"])
    ['delayed']
    """
    words = name.lower().split("-")
    same = {word: with_synonyms(word) for word in words}
    whole = {
        "-".join([*words[:index], other, *words[index + 1 :]])
        for index, word in enumerate(words)
        for other in same[word]
    }
    alone = tuple(one for others in same.values() if len(others) > 1 for one in others)
    return [one for one in known if one in whole or ("-" not in one and one.startswith(alone))]
