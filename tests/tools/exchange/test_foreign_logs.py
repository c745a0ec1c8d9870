"""Foreign logs: hostile ones end soon with a sentence, unusual ones are imported or counted line by line."""

import json
import os
import struct
from pathlib import Path

import can
import numpy as np
import pytest
from hostile_logs import ASC, ASC_FRAME, GOOD, blf, blf_container, blf_object

from tools import cli
from tools.exchange.foreign_logs import clock_jumps, kind_of
from tools.exchange.reading import read_log
from tools.output import EXIT_NOTHING_RAN, EXIT_PASSED, BadInputError


def reading(folder: Path, name: str, content: str | bytes, tolerant: bool = True):
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return read_log(path, tolerant)


WRITERS = ["log", "asc", "blf", "trc"]


@pytest.mark.parametrize("kind", WRITERS)
def test_an_11_bit_frame_with_a_high_identifier_is_counted(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / f"bench.{kind}"
    if kind == "log":
        path.write_text(f"{GOOD}(1700000000.1) can0 800#00\n")
    elif kind == "trc":
        path.write_text(";\n;\n1) 100.0 000E 4 CD CC 4C 3D\n2) 200.0 0800 1 00\n")
    else:
        with can.Logger(path) as logger:
            for number, can_id in enumerate((0x00E, 0x800)):
                data = b"\xcd\xcc\x4c\x3d"
                message = can.Message(1.7e9 + number, can_id, is_extended_id=False, data=data, channel=0)
                logger.on_message_received(message)
    log = read_log(path)
    assert [one.kind for one in log.messages] == [None, "11-bit frame with an identifier above 0x7FF"]
    assert cli.run(["import", str(path), "--out", str(tmp_path / "run"), "--json"]) == EXIT_PASSED
    result = json.loads(capsys.readouterr().out)
    assert (result["frames"], list(result["skipped"].values())) == (1, [1])


def test_relative_times_of_asc_are_summed_over_all_events(tmp_path: Path) -> None:
    lines = ["0.5 1 00E Rx d 1 00", "0.25 1  Statistic: D 1", "0.25 1 00F Rx d 1 00", "0.5 2  ErrorFrame"]
    log = reading(tmp_path, "a.asc", "base hex  timestamps relative\n" + "\n".join(lines) + "\n")
    assert [one.t_s for one in log.messages] == [0.5, 1.0, 1.5]
    assert [line.number for line in log.ignored] == [3]


@pytest.mark.parametrize("base", ["absolute", "relative"])
def test_frames_before_the_trigger_of_asc_are_read(base: str, tmp_path: Path, capsys) -> None:
    times = [-1.5, -0.25, 0.0, 0.5] if base == "absolute" else [-1.5, 1.25, 0.25, 0.5]
    lines = [f"{t_s:.6f} 1 00E Rx d 4 CD CC 4C 3D" for t_s in times]
    content = f"base hex  timestamps {base}\n" + "\n".join(lines) + "\n"
    log = reading(tmp_path, "a.asc", content)
    assert [one.t_s for one in log.messages] == pytest.approx([-1.5, -0.25, 0.0, 0.5])
    assert log.ignored_count == 0
    assert (
        cli.run(["import", str(tmp_path / "a.asc"), "--out", str(tmp_path / "run"), "--json"]) == EXIT_PASSED
    )
    result = json.loads(capsys.readouterr().out)
    assert (result["frames"], result["duration_s"], result["trigger_s"]) == pytest.approx((4, 2.0, 1.5))


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.asc", "base hex  timestamps absolute\n-0,5 1 00E Rx d 1 00\n12,25 1 00E Rx d 1 00\n"),
        ("a.log", "(99,5) can0 00E#00\n(112,250000) can0 00E#00\n"),
        (
            "a.trc",
            ";$FILEVERSION=1.1\n;$STARTTIME=45244,9\n 1) 500,0 Rx 000E 1 00\n 2) 13250,0 Rx 000E 1 00\n",
        ),
        (
            "a.trc",
            ";$FILEVERSION=2.1\n;$STARTTIME=45244.9\n;$COLUMNS=N,O,T,B,I,d,R,L,D\n"
            " 1 500,000 DT 1 000E Rx - 1 00\n 2 13250,000 DT 1 000E Rx - 1 00\n",
        ),
    ],
)
def test_decimal_commas_are_read(name: str, content: str, tmp_path: Path) -> None:
    log = reading(tmp_path, name, content, tolerant=False)
    first, last = log.messages
    assert last.t_s - first.t_s == pytest.approx(12.75)
    assert log.ignored_count == 0


def test_trc_of_version_1_2_is_read(tmp_path: Path) -> None:
    """As PEAK describes it, with the warning, the error and the semicolon of its example."""
    lines = [
        ";$FILEVERSION=1.2 ",
        ";$STARTTIME=39878.6772258947; ",
        ";---+--   ----+------  +  --+--  ----+---  +  -+ -- -- -- -- -- -- -- ",
        "     1)      1059.900  1  Rx         0300  7  00 00 00 00 04 00 00 ",
        "     2)      1298.945  2  Tx         0400  2  00 01 ",
        "     3)      1346.834  1  Warng  FFFFFFFF  4  00 00 00 04  BUSLIGHT ",
        "     4)      1349.222  1  Error      0008  4  00 19 08 08 ",
        "     5)      1352.743  1  Rx         0100  3  RTR ",
    ]
    log = reading(tmp_path, "a.trc", "\r\n".join(lines) + "\r\n", tolerant=False)
    found = [(one.channel, one.can_id, one.data, one.kind) for one in log.messages]
    assert found == [
        ("1", 0x300, b"\0\0\0\0\x04\0\0", None),
        ("2", 0x400, b"\0\x01", None),
        ("1", 0x100, b"", "remote frame"),
    ]
    assert log.messages[1].t_s - log.messages[0].t_s == pytest.approx(0.239045)
    assert log.ignored_count == 2


def test_an_unknown_version_of_trc_is_named(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=r"version 3\.0; wanted one of 1\.0, .*: save it as version 1\.1"):
        reading(tmp_path, "a.trc", ";$FILEVERSION=3.0\n1 1.0 DT 1 18F Rx - 1 0B\n")


REQUESTED = (
    "{t} 1  00E             {dir} d 4 CD CC 4C 3D\n",
    "{t} CANFD   1 {dir}         17  0 0 2 2 CD CC 130000 130 0 0 0 0 0 0\n",
)


@pytest.mark.parametrize("kind", ["asc", "canfd", "blf", "blf-fd"])
def test_transmit_requests_are_no_frames(kind: str, tmp_path: Path, capsys) -> None:
    """Of three frames, the second was requested before it was sent."""
    if kind.startswith("blf"):
        path = tmp_path / "a.blf"
        classic, fd_64 = (1, "<HBBL8s"), (101, "<BBBBLLLLLLLHBBL64s")
        number, layout = fd_64 if kind == "blf-fd" else classic

        def body(direction: int) -> bytes:
            data = b"\xcd\xcc\x4c\x3d"
            if number == 1:
                return struct.pack(layout, 1, direction, 4, 0x00E, data)
            return struct.pack(layout, 1, 4, 4, 0, 0x00E, 0, 0, 0, 0, 0, 0, 0, direction, 0, 0, data)

        objects = [blf_object(kind=number, time_ns=10**6, body=body(direction)) for direction in (0, 2, 1, 0)]
        path.write_bytes(blf(blf_container(b"".join(objects))))
    else:
        path = tmp_path / "a.asc"
        line = REQUESTED[kind == "canfd"]
        path.write_text(ASC + "".join(line.format(t="0.5", dir=one) for one in ("Rx", "TxRq", "Tx", "Rx")))
    log = read_log(path)
    assert [one.kind for one in log.messages] == [None, "transmit request", None, None]
    assert cli.run(["import", str(path), "--out", str(tmp_path / "run"), "--json"]) == EXIT_PASSED
    result = json.loads(capsys.readouterr().out)
    assert (result["frames"], result["skipped"]) == (3, {"transmit request": 1})


@pytest.mark.parametrize(("ignored", "status"), [(1, EXIT_PASSED), (2, EXIT_NOTHING_RAN)])
def test_an_import_that_ignores_more_than_a_hundredth_is_not_judged(
    ignored: int, status: int, tmp_path: Path, capsys
) -> None:
    frames = "".join(ASC_FRAME.format(t=number * 1e-3, can_id="00E") for number in range(199 - ignored))
    (tmp_path / "a.asc").write_text(ASC + frames + "1.0 1  Statistic: D 1 R 0\n" * ignored)
    assert cli.run(["import", str(tmp_path / "a.asc"), "--out", str(tmp_path / "run"), "--json"]) == status
    doubts = json.loads(capsys.readouterr().out)["not_judged"]
    assert [doubt.partition(", more than 1%; ")[0] for doubt in doubts] == (
        ["2 lines, 1.0% of the log, were ignored"] if status else []
    )
    assert json.loads((tmp_path / "run" / "outcome.json").read_text())["not_judged"] == doubts


def test_a_first_message_right_after_the_base_is_read(tmp_path: Path) -> None:
    log = reading(tmp_path, "a.asc", "base dec  timestamps absolute\n0.5 1 16 Rx d 2 255 10\n")
    assert [(one.can_id, one.data) for one in log.messages] == [(16, b"\xff\x0a")]


@pytest.mark.parametrize("name", ["", "SomeName"])
@pytest.mark.parametrize(
    ("flags", "data", "expected"),
    [
        ("0", "CD CC", (None, b"\xcd\xcc")),
        ("0", "", (None, b"")),
        ("10", "", ("remote frame", b"")),
        ("1000", "CD CC", ("CAN FD", b"\xcd\xcc")),
        ("3000", "CD CC", ("CAN FD", b"\xcd\xcc")),
    ],
)
def test_classic_frames_in_canfd_notation(name: str, flags: str, data: str, expected, tmp_path: Path) -> None:
    length = len(data.split())
    stated = f"{length or 4} {length} {data} 130000 130 {flags} 0 0 0 0 0"
    line = f"1.0 CANFD   1 Rx         17 {name} 0 0 {stated}\n"
    log = reading(tmp_path, "a.asc", ASC + line)
    assert log.left_out == []
    assert [(one.kind, one.data, one.can_id, one.channel) for one in log.messages] == [(*expected, 0x17, "0")]


def test_a_header_in_cp1252_is_read(tmp_path: Path) -> None:
    content = ASC.replace("Nov", "Mär").encode("cp1252") + ASC_FRAME.format(t=0.1, can_id="E").encode()
    assert len(reading(tmp_path, "a.asc", content).messages) == 1


def test_every_line_is_a_message_or_counted(tmp_path: Path) -> None:
    lines = [
        *ASC.splitlines(),
        "// a comment",
        "0.1 1  00E             Rx   d 4 CD CC 4C 3D",
        "0.2 1  Statistic: D 1 R 0",
        "0.3 1  00E             Rx   d 4 CD CC",
        "nonsense",
        "0.4 1  00E             Rx   d 4 CD CC 4C GG",
        "0.5 1  00E             Rx   d 4 CD CC 4C 3D",
    ]
    log = reading(tmp_path, "a.asc", "\n".join(lines) + "\n")
    assert [one.place for one in log.messages] == [5, 10]
    assert [line.number for line in log.ignored] == [6, 8]
    assert [line.number for line in log.left_out] == [7, 9]


@pytest.mark.parametrize(
    ("name", "content", "messages", "counted"),
    [
        ("a.log", f"{GOOD}(1.0) can0 00E#CDC\n{GOOD}x\n(1.0) can0 00E#112233445566778899\n{GOOD}", 3, 3),
        (
            "a.trc",
            ";$FILEVERSION=1.1\n  1)  1.0  Rx  000E  1  00\n  2)  x  Rx  000E  1  00\n  3)  2.0\n",
            1,
            2,
        ),
        (
            "a.trc",
            ";$FILEVERSION=1.1\n  1)  1.0  Warng  FFFFFFFF  4  00 00 00 08\n  2) 2.0 Rx 000E 1 00\n",
            1,
            1,
        ),
    ],
)
def test_lines_add_up(name: str, content: str, messages: int, counted: int, tmp_path: Path) -> None:
    log = reading(tmp_path, name, content)
    assert (len(log.messages), len(log.left_out) + log.ignored_count) == (messages, counted)


def test_other_objects_of_blf_are_counted_and_damage_is_placed(tmp_path: Path) -> None:
    good = blf_object()
    content = blf(
        blf_container(good + blf_object(kind=72) + blf_object(version=0) + good + blf_object(size=3))
    )
    log = reading(tmp_path, "a.blf", content)
    assert len(log.messages) == 2
    assert log.other_objects == {"object type 72": 1, "header version 0": 1}
    assert "size 3" in str(log.truncated)
    with pytest.raises(BadInputError, match=r"size 3\) after 2 messages"):
        reading(tmp_path, "a.blf", content, tolerant=False)


@pytest.mark.parametrize("split", range(1, 100, 7))
def test_objects_of_blf_across_containers_are_read(split: int, tmp_path: Path) -> None:
    content = blf_object() * 20
    whole = blf(blf_container(content[:split]), blf_container(content[split:], method=0))
    assert len(reading(tmp_path, "a.blf", whole).messages) == 20


def test_jumps_of_the_clock_are_reported(tmp_path: Path) -> None:
    times = [0.0, 0.001, 6.0, 0.002, 0.0019, 0.003, 0.0001]
    lines = [f"({t:.6f}) can0 00E#CDCC4C3D\n" for t in times]
    jumps = clock_jumps(reading(tmp_path, "a.log", "".join(lines)).messages)
    assert [(jump.place, jump.from_s, jump.to_s) for jump in jumps] == [
        (3, 0.001, 6.0),
        (4, 6.0, 0.002),
        (7, 0.003, 0.0001),
    ]


def test_plain_candump_output_is_refused_with_the_option(tmp_path: Path) -> None:
    for line in (
        "  can0  00E   [4]  CD CC 4C 3D",
        " (1700000000.1)  can0  00E   [4]  CD CC 4C 3D",
        "can0  1F334455  [0]",
        " can0  RX - -  00E   [4]  CD CC 4C 3D",
        " (1700000000.123456)  can0  TX B E  00E   [4]  CD CC 4C 3D",
    ):
        with pytest.raises(BadInputError, match="candump -L"):
            reading(tmp_path, "a.log", f"{line}\n")


@pytest.mark.parametrize("kind", WRITERS)
def test_a_log_that_is_cut_or_changed_anywhere_is_read_or_refused(kind: str, tmp_path: Path) -> None:
    """Bytes of a good log are cut, doubled and changed at random: no other exception, no endless loop."""
    random = np.random.default_rng(39)
    path = tmp_path / f"good.{kind}"
    with can.Logger(path) as logger:
        for number in range(20):
            message = can.Message(
                1.7e9 + number * 1e-3, 0x00E, is_extended_id=False, data=bytes(4), channel=0
            )
            logger.on_message_received(message)
    good = path.read_bytes()
    for trial in range(150):
        content = bytearray(good)
        for _ in range(int(random.integers(1, 4))):
            at = int(random.integers(0, len(content)))
            change = trial % 3
            if change == 0:
                content[at] = int(random.choice([0, 1, 0xFF, int(random.integers(0, 256))]))
            elif change == 1:
                del content[at : at + int(random.integers(1, 40))]
            else:
                content[at:at] = content[at : at + int(random.integers(1, 40))]
            content = content or bytearray(b"x")
        try:
            log = reading(tmp_path, f"changed.{kind}", bytes(content))
        except BadInputError:
            continue
        assert len(log.messages) <= 60
        assert all(kind_of is not None and abs(one.t_s) < 9e9 for one in log.messages)


def test_no_path_of_this_machine_is_in_the_run(tmp_path: Path) -> None:
    folder = tmp_path / "somebody-secret"
    folder.mkdir()
    (folder / "bench.log").write_text(GOOD * 3)
    assert cli.run(["import", str(folder / "bench.log"), "--out", str(tmp_path / "run")]) == EXIT_PASSED
    for path in (tmp_path / "run").rglob("*"):
        if path.is_file():
            content = path.read_bytes()
            assert b"somebody-secret" not in content, path
            assert str(tmp_path).encode() not in content, path
            assert os.uname().nodename.encode() not in content or len(os.uname().nodename) < 4, path


def test_an_asc_log_of_another_base_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.asc").write_text("base oct  timestamps absolute\n 0.1 1 123 Rx d 1 00\n")
    with pytest.raises(BadInputError, match="numbers of base 'oct'; wanted base hex or base dec"):
        read_log(tmp_path / "a.asc")
