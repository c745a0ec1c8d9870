"""The rules that `vibro.dbc` has to keep, each broken once."""

import cantools.database
import pytest
from cantools.database.can import Database, Message

from firmware_py.interface.dbc import LayoutError, layout_of

KINDS = """
BA_DEF_ SG_ "SignalKind" ENUM "Quantity","Enumeration","Flags","Exact","Counter","Crc";
BA_DEF_DEF_ "SignalKind" "Quantity";
"""


def message(length: int, *signals: str, attributes: str = "") -> Message:
    lines = [f"BO_ 5 Sample: {length} Node", *(f" SG_ {signal} Node" for signal in signals)]
    text = 'VERSION ""\n\nBU_: Node\n\n' + "\n".join(lines) + "\n" + KINDS + attributes
    database = cantools.database.load_string(text, database_format="dbc", strict=False)
    assert isinstance(database, Database)
    return database.get_message_by_name("Sample")


def test_signals_by_place_and_range() -> None:
    layout = layout_of(
        message(
            8,
            'a : 0|16@1- (0.5,0) [-100|100] "m"',
            'b : 22|3@1+ (1,0) [0|7] ""',
            'd : 32|32@1+ (1,0) [0|9] ""',
        )
    )
    assert list(layout.signals) == ["a", "b", "d"]
    assert (layout.signals["a"].low_counts, layout.signals["a"].high_counts) == (-200, 200)
    assert (layout.signals["a"].low, layout.signals["a"].high) == (-100.0, 100.0)
    assert [(one.start, one.bits) for one in layout.signals.values()] == [(0, 16), (22, 3), (32, 32)]
    assert not layout.protected


@pytest.mark.parametrize(
    ("signal", "attributes", "wanted"),
    [
        ('a : 7|16@0- (1,0) [-9|9] ""', "", "byte order big_endian"),
        ('a : 0|16@1- (1,5) [-9|9] ""', "", "offset 5"),
        ('a : 0|16@1- (1,0) [0|0] ""', "", "no range"),
        ('a : 0|8@1- (1,0) [-129|127] ""', "", "does not fit 8 bits"),
        ('a : 0|8@1+ (1,0) [0|256] ""', "", "does not fit 8 bits"),
        ('a : 0|64@1- (1,0) [0|0] ""', "SIG_VALTYPE_ 5 a : 2;\n", "a float of 64 bits"),
        ('a : 0|16@1- (1,0) [0|0] ""', "SIG_VALTYPE_ 5 a : 1;\n", "a float of 16 bits"),
        ('a : 0|8@1+ (1,0) [0|3] ""', 'BA_ "SignalKind" SG_ 5 a 1;\n', "VAL_"),
    ],
)
def test_a_signal_the_codec_cannot_carry(signal: str, attributes: str, wanted: str) -> None:
    with pytest.raises(LayoutError, match=wanted):
        layout_of(message(8, signal, attributes=attributes))


@pytest.mark.parametrize(
    "signals",
    [
        ['crc : 8|8@1+ (1,0) [0|255] ""'],  # no counter
        ['n : 0|4@1+ (1,0) [0|15] ""', 'crc : 8|8@1+ (1,0) [0|255] ""'],  # not beside the CRC
    ],
)
def test_a_counter_or_crc_out_of_place(signals: list[str]) -> None:
    kinds = 'BA_ "SignalKind" SG_ 5 crc 5;\n' + ('BA_ "SignalKind" SG_ 5 n 4;\n' if len(signals) > 1 else "")
    with pytest.raises(LayoutError, match="Counter at"):
        layout_of(message(2, *signals, attributes=kinds))
