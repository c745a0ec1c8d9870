"""Measurement and calibration of a running module, on emulated boards too: pyXCP, unmodified, and our master.

On the bus `local`, and on the kernel's own CAN, which pyXCP joins by itself. Where the machine's kernel has
no CAN, `test_kernel_can.py` runs the latter under user-mode Linux.
"""

import json
import struct
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, cast

import can
import numpy as np
import pytest
from closed_loop import Bench
from kernel_interface import made_interface, needs_kernel_can
from pya2l.parser import A2lParser
from pyxcp.config import create_application_from_config, set_application
from pyxcp.cpp_ext.cpp_ext import DaqList
from pyxcp.daq_stim import DaqOnlinePolicy
from pyxcp.master import Master
from pyxcp.master.errorhandler import UnrecoverableError
from pyxcp.types import XcpResponseError

from firmware_py.builds import board_tools
from firmware_py.builds.a2l import a2l, a2l_name, unit_text
from firmware_py.builds.flat import from_flat
from firmware_py.core.config import commit
from firmware_py.interface.addresses import DEFAULT, Addresses
from firmware_py.interface.enums import Mode, XcpCommandCode
from firmware_py.interface.float32 import float32_bits
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated import kinds
from firmware_py.interface.parameter_table import INDEX, TABLE, Parameter
from firmware_py.node import elements, xcp
from firmware_py.node.tick import NodeState
from firmware_py.shell.builds import Build
from firmware_py.shell.flat_node import FlatNode
from firmware_py.shell.node import FirmwareNode
from firmware_py.shell.parameters import parameters_of, round_to_float32, values_of
from hil.bus import join, provide
from hil.processes.child import READY_TIMEOUT_S
from hil.scenario.parameter_file import read_parameters
from tools import cli
from tools.output import EXIT_BAD_INPUT
from tools.xcp_master import ACCEPTED_IDS, RefusedError, Sampled, SessionError, XcpMaster, XcpMasterError

FLOATS = [place.name for place in elements.ALL if place.kind is float and place.name.startswith("state.")]
SAMPLES, LONGEST_S = 12, 60.0
"""Samples of each list, and the longest time that they may take on a busy machine."""
MOVING = ("state.crank.omega_rad_s", "state.estimator.x_m", "state.estimator.v_m_s", "outputs.torque_n_m")


INTERFACE = "xcp0"
needs_board = pytest.mark.skipif(
    bool(board_tools.find_missing_tools()), reason=f"no emulated board; {board_tools.REMEDY}"
)


def with_more(arrived: list[Frame], _: int, frames: list[Frame]) -> list[Frame]:
    """The frames of plant and operator, and those that have arrived from the bus."""
    return frames + arrived


class Running:
    """A module with its firmware as a node of a bus, and the firmware's memory after each tick."""

    def __init__(self, address: str, build: Build, is_moving: bool = True) -> None:
        self.address = address
        self.bench = Bench(build=build)
        if is_moving:
            self.bench.started()
        self.bench.run(1.0, keep=False)
        assert self.bench.mode == (Mode.SOFT_START if is_moving else Mode.READY)
        self.states: dict[int, Any] = {}
        self._stops = threading.Event()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self) -> None:
        bus = join(self.address, (kinds.XCP_COMMAND.can_id,))
        node = self.bench.node
        while not self._stops.is_set():
            arrived = bus.receive()
            self.bench.change = partial(with_more, arrived)
            self.bench.run(0.001, keep=False)
            state = node.memory.copy() if isinstance(node, FlatNode) else cast(FirmwareNode, node)._state
            self.states[self.bench.tick] = state
            bus.send_all([frame for frame in self.bench.sent if frame.can_id == kinds.XCP_RESPONSE.can_id])
            time.sleep(0.0005)
        bus.close()

    def word(self, tick: int, name: str) -> int:
        """The 32 bits of a measurement after a tick."""
        state = self.states[tick]
        if isinstance(state, np.ndarray):
            state = from_flat(NodeState, state[0].item())
        return elements.word_at(state, elements.INDEX[name])

    def tick_of(self, names: Sequence[str], values: Sequence[float]) -> int:
        """The tick after which the measurements had these values; pyXCP's times begin at the first sample."""
        words = [float32_bits(value) for value in values]
        return next(tick for tick in list(self.states) if words == [self.word(tick, name) for name in names])

    def close(self) -> None:
        """End the thread."""
        self._stops.set()
        self._thread.join()


@contextmanager
def address_of(bus: str) -> Iterator[str]:
    """The address of a new bus: `local`, or `vcan`, an interface of the kernel."""
    if bus == "local":
        with provide("local") as provided:
            yield provided.address
    else:
        with made_interface(INTERFACE):
            yield f"socketcan:{INTERFACE}"


@contextmanager
def moving(bus: str, build: Build) -> Iterator[Running]:
    """A module in motion."""
    with address_of(bus) as address:
        one = Running(address, build)
        yield one
        one.close()


@pytest.fixture(
    scope="module",
    params=["compiled", pytest.param("cortex-m4f", marks=needs_board)],
)
def running(request: pytest.FixtureRequest) -> Iterator[Running]:
    """States of both layouts; the other builds answer as `compiled` does."""
    with moving("local", request.param) as one:
        yield one


@pytest.fixture(scope="module")
def compiled() -> Iterator[Running]:
    """For what is our master's or the commands' own."""
    with moving("local", "compiled") as one:
        yield one


@pytest.fixture(params=["compiled", pytest.param("cortex-m4f", marks=needs_board)])
def resting(request: pytest.FixtureRequest) -> Iterator[Running]:
    """A module at rest."""
    with provide("local") as provided:
        one = Running(provided.address, request.param, is_moving=False)
        yield one
        one.close()


@pytest.fixture(scope="module", autouse=True)
def known_time_zone() -> Iterator[None]:
    """pyXCP looks up the zone's abbreviation, and its library knows UTC, but not IST."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TZ", "UTC")
        time.tzset()
        yield
    time.tzset()


@pytest.fixture(scope="module")
def description() -> Any:
    """The A2L file's module, as pya2l reads it."""
    with A2lParser() as parser:
        return parser.tree_from_a2l(a2l().encode()).PROJECT.MODULE[0]


class Collected(DaqOnlinePolicy):  # type: ignore[misc]  # pyXCP is not typed
    """A measurement of pyXCP that is kept: `(list, time stamp in ns, values)`."""

    def __init__(self, lists: Sequence[DaqList]) -> None:
        settings_of_pyxcp()
        super().__init__(lists)
        self.rows: list[tuple[int, int, list[float]]] = []

    def on_daq_list(self, daq_list: int, timestamp0: int, timestamp1: int, payload: list[float]) -> None:
        self.rows.append((daq_list, timestamp1, payload))


def settings_of_pyxcp(address: str = "") -> Any:
    """pyXCP's settings, as the A2L file states them; it joins an interface of the kernel by itself."""
    interface, _, channel = address.partition(":")
    is_kernels = interface == "socketcan"
    settings = {
        "interface": interface if is_kernels else "custom",
        "channel": channel if is_kernels else None,
        "can_id_master": kinds.XCP_COMMAND.can_id,
        "can_id_slave": kinds.XCP_RESPONSE.can_id,
        "max_dlc_required": True,
    }
    application = create_application_from_config({"Transport": {"CAN": settings}})
    application.transport.layer = "CAN"
    application.general.disable_error_handling = True
    set_application(application)
    return application


def master_on(running: Running, policy: Any = None) -> Any:
    """pyXCP's master on the bus of the running module."""
    kind, _, place = running.address.partition(":")
    bus = can.Bus(interface="vibrohil", channel=place) if kind == "local" else None
    return Master("can", settings_of_pyxcp(running.address), policy, bus)


def addresses_of(description: Any) -> Mapping[str, int]:
    """The addresses of the measurements in the A2L file."""
    return {one.Name.Value: one.ECU_ADDRESS.Address.Value for one in description.MEASUREMENT}


def test_the_a2l_file_has_one_conversion_for_each_unit(description: Any) -> None:
    units = {one.Name.Value: one.Unit.Value for one in description.COMPU_METHOD}
    assert len(units) == len(description.COMPU_METHOD), "a name stands for two units"
    found = {one.Name.Value: units[one.Conversion.Value] for one in description.CHARACTERISTIC}
    assert found == {one.name: unit_text(one) for one in TABLE} | {"calibration.commit": ""}
    measured = {one.Name.Value: units[one.Conversion.Value] for one in description.MEASUREMENT}
    assert measured["state.hold.trim_rate_1_s"] == "1/s"
    assert measured["outputs.torque_n_m"] == "N m"


def test_the_a2l_file_of_another_module_has_its_identifiers() -> None:
    for places_on_bus, command, response in (
        (DEFAULT, "0x049", "0x07E"),
        (Addresses(0, 5), "0x0C9", "0x0FE"),
    ):
        text = a2l(places_on_bus)
        assert f"CAN_ID_MASTER {command}" in text
        assert f"CAN_ID_SLAVE {response}" in text


def test_the_a2l_file_lists_every_measurement_and_parameter(description: Any) -> None:
    assert addresses_of(description) == {a2l_name(one.name): 4 * k for k, one in enumerate(elements.ALL)}
    found = {one.Name.Value: one for one in description.CHARACTERISTIC}
    assert set(found) == {one.name for one in TABLE} | {"calibration.commit"}
    for index, parameter in enumerate(TABLE):
        one = found[parameter.name]
        assert (one.Address.Value, one.LowerLimit.Value) == (4 * index, parameter.low), parameter.name
        assert one.READ_ONLY.is_none == parameter.is_calibrated, parameter.name


def test_pyxcp_uploads_what_the_a2l_file_names(running: Running, description: Any) -> None:
    with master_on(running) as master:
        master.connect()
        assert master.identifier(1).startswith("vibro_")
        addresses = addresses_of(description)
        for name in ("received.drive_supply.voltage_v", "outputs.mode"):
            first = min(running.states)
            data = master.shortUpload(4, addresses[a2l_name(name)], xcp.MEASUREMENTS)
            assert int.from_bytes(data[:4], "little") in {
                running.word(tick, name)
                for tick in range(max(first, max(running.states) - 50), max(running.states))
            }
        master.setMta(0, xcp.CHARACTERISTICS)
        page = master.fetch(4 * len(TABLE))
        assert page == struct.pack(f"<{len(TABLE)}f", *running.bench.node.values.values())
        master.setMta(0, xcp.CHARACTERISTICS)
        summed = master.buildChecksum(64)
        assert summed.checksum == sum(struct.unpack("<16I", page[:64])) & 0xFFFFFFFF
        master.disconnect()


Lists = Sequence[tuple[Sequence[str], int]]
"""Names of measurements and the prescaler of each list."""
MIXED: Lists = [(MOVING[:2], 4), (FLOATS[:20], 50)]


@pytest.mark.parametrize("lists", [[(FLOATS[:40], 40)], MIXED], ids=["forty at 25 Hz", "mixed"])
def test_pyxcp_measures_what_the_state_was(running: Running, description: Any, lists: Lists) -> None:
    check_measurement(running, description, lists)


@needs_kernel_can
def test_pyxcp_joins_a_vcan_by_itself_and_measures_there(description: Any) -> None:
    with moving("vcan", "compiled") as one:
        check_measurement(one, description, MIXED)


def check_measurement(running: Running, description: Any, lists: Lists) -> None:
    """What pyXCP measures is what the state was."""
    addresses = addresses_of(description)
    wanted = [
        DaqList(
            name=f"list_{prescaler}",
            event_num=0,
            stim=False,
            enable_timestamps=True,
            measurements=[(name, addresses[a2l_name(name)], xcp.MEASUREMENTS, "F32") for name in names],
            priority=0,
            prescaler=prescaler,
        )
        for names, prescaler in lists
    ]
    policy = Collected(wanted)
    with master_on(running, policy) as master:
        master.connect()
        policy.setup()
        policy.start()
        until_s = time.monotonic() + LONGEST_S
        while any(sum(row[0] == k for row in policy.rows) <= SAMPLES for k in range(len(lists))):
            assert time.monotonic() < until_s, f"{len(policy.rows)} samples within {LONGEST_S} s"
            time.sleep(0.1)
        policy.stop()
        master.disconnect()
    which, stamp, values = policy.rows[0]
    started = running.tick_of(lists[which][0], values) - stamp // 1_000_000
    rows = [(which, started + stamp // 1_000_000, values) for which, stamp, values in policy.rows]
    check_rows(running, lists, rows)


def check_rows(running: Running, lists: Lists, rows: Sequence[tuple[int, int, Sequence[float]]]) -> None:
    """Every sample equals the firmware's memory after its tick; a list's samples follow its prescaler."""
    for number, (names, prescaler) in enumerate(lists):
        found = [(tick, values) for which, tick, values in rows if which == number]
        assert len(found) >= SAMPLES
        stamps = [tick for tick, _ in found]
        assert set(np.diff(stamps) % (1 << 16)) == {prescaler}
        newest = max(running.states)
        for stamp, values in found:
            tick = newest - (newest - stamp) % (1 << 16)
            for name, value in zip(names, values, strict=True):
                assert float32_bits(value) == running.word(tick, name), (tick, name)


def refused_by(master: Any, place: int, data: bytes) -> str:
    """The error by which pyXCP's write is refused; "" if it is not."""
    try:
        master.setMta(4 * place, xcp.CHARACTERISTICS)
        master.download(data)
    except (XcpResponseError, UnrecoverableError) as error:
        return str(error.args[0] if error.args else error)
    return ""


def test_pyxcp_writes_only_what_may_change_in_motion(running: Running) -> None:
    """In motion, those of `while_running` accept their value; all others are write-protected."""
    with master_on(running) as master:
        master.connect()
        for parameter in TABLE:
            error = refused_by(master, INDEX[parameter.name], struct.pack("<f", parameter.default))
            if parameter.is_calibrated and parameter.while_running:
                assert error == "", parameter.name
                error = refused_by(
                    master, INDEX[parameter.name], struct.pack("<f", 2.0 * parameter.high + 1.0)
                )
                assert "OUT_OF_RANGE" in error, (parameter.name, error)
            else:
                assert "WRITE_PROTECTED" in error, (parameter.name, error)
        master.disconnect()


def near(parameter: Parameter) -> float:
    """Another value of a parameter, near its default."""
    if parameter.whole:
        return parameter.default + (1.0 if parameter.default < parameter.high else -1.0)
    step = 0.001 * (parameter.default or parameter.high)
    return round_to_float32(
        parameter.default + (step if parameter.default + step <= parameter.high else -step)
    )


def test_pyxcp_writes_every_tuning_parameter_at_rest_and_no_other(resting: Running) -> None:
    """One commit changes them all together, and every constant that follows from them."""
    node = resting.bench.node
    before, values = node.config, dict(node.values)
    with master_on(resting) as master:
        master.connect()
        for parameter in TABLE:
            error = refused_by(master, INDEX[parameter.name], struct.pack("<f", near(parameter)))
            assert parameter.is_calibrated == (error == ""), (parameter.name, error)
            assert parameter.is_calibrated or "WRITE_PROTECTED" in error, (parameter.name, error)
            values[parameter.name] = near(parameter) if parameter.is_calibrated else values[parameter.name]
        assert list(map(round_to_float32, node.values.values())) == list(
            map(round_to_float32, values_of(before.p).values())
        )
        assert refused_by(master, xcp.COMMIT, struct.pack("<I", 1)) == ""
        master.disconnect()
    expected = commit(before, parameters_of(values))
    if resting.bench.build == "cortex-m4f":  # its constants are those of single precision
        assert list(map(round_to_float32, node.values.values())) == list(
            map(round_to_float32, values.values())
        )
        assert node.config.crank.tracker.gains == pytest.approx(expected.crank.tracker.gains, rel=1e-5)
        assert tuple(node.config.gate) == tuple(map(round_to_float32, before.gate))
    else:
        assert node.values == values
        assert node.config == expected
    resting.close()
    resting.bench.run(0.1, keep=False)
    assert resting.bench.mode == Mode.READY


def test_a_gain_changes_in_motion_by_a_commit(running: Running) -> None:
    bus = join(running.address, ACCEPTED_IDS)
    master = XcpMaster(bus)
    master.connect()
    master.write("speed.gain_p_n_m_s", 0.06)
    assert running.bench.node.values["speed.gain_p_n_m_s"] == pytest.approx(0.05, abs=1e-8)
    master.commit()
    assert running.bench.node.values["speed.gain_p_n_m_s"] == pytest.approx(0.06, abs=1e-8)
    with pytest.raises(RefusedError, match="WRITE_PROTECTED"):
        master.write("limit.speed_rad_s", 10.0)
    lists = [Sampled(MOVING, 10)]
    master.start(lists)
    found = []
    for one in master.samples(lists):
        if one is not None:
            found.append((one.list_number, one.tick, one.values))
        if len(found) == 50:
            break
    master.disconnect()
    bus.close()
    check_rows(running, [(MOVING, 10)], found)


def test_errors_of_our_master_name_what_is_missing() -> None:
    with provide("local") as empty:
        bus = join(empty.address, ACCEPTED_IDS)
        with pytest.raises(XcpMasterError, match="no answer to CONNECT within"):
            XcpMaster(bus, 0.05).connect()
        bus.close()


def test_a_second_master_is_refused_while_a_session_is_open(
    compiled: Running, capsys: pytest.CaptureFixture[str]
) -> None:
    bus, other_bus = (join(compiled.address, ACCEPTED_IDS) for _ in range(2))
    first, second = XcpMaster(bus), XcpMaster(other_bus)
    first.connect()
    with pytest.raises(SessionError, match="another master has a session with this firmware"):
        second.connect()
    second.disconnect()
    wanted = ["calibrate", "speed.gain_i_n_m=0.5", "--bus", compiled.address]
    assert cli.run(wanted) == EXIT_BAD_INPUT
    assert "another master has a session" in " ".join(capsys.readouterr().err.split())
    assert first.read("outputs.mode") == compiled.bench.mode.value
    first.disconnect()
    second.connect()
    second.disconnect()
    for one in (bus, other_bus):
        one.close()


def test_a_master_notices_that_another_has_taken_or_ended_its_session(compiled: Running) -> None:
    """Another tool does not ask first: its CONNECT ends the session, as the standard has it."""
    bus, other_bus = (join(compiled.address, ACCEPTED_IDS) for _ in range(2))
    first, other = XcpMaster(bus), XcpMaster(other_bus)
    lists = [Sampled(MOVING, 10)]
    first.connect()
    first.start(lists)
    other.request(XcpCommandCode.CONNECT)
    other.start(lists)
    with pytest.raises(SessionError, match="has ended this one"):
        list(first.samples(lists))
    first.disconnect()
    assert other.request(XcpCommandCode.GET_STATUS) == (xcp.RUNNING, 0)
    other.request(XcpCommandCode.DISCONNECT)
    first.connect()
    first.write("speed.gain_i_n_m", 0.5)
    other.request(XcpCommandCode.CONNECT)
    bus.wait(READY_TIMEOUT_S)  # until the answer to the other is here, too
    with pytest.raises(SessionError, match="has ended this one"):
        first.commit()
    other.request(XcpCommandCode.DISCONNECT)
    first.connect()
    other.request(XcpCommandCode.DISCONNECT)
    bus.wait(READY_TIMEOUT_S)
    with pytest.raises(SessionError, match="another master has ended this session"):
        first.disconnect()
    for one in (bus, other_bus):
        one.close()


def test_a_master_that_refuses_the_firmware_leaves_no_session(
    compiled: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    bus = join(compiled.address, ACCEPTED_IDS)
    master = XcpMaster(bus)
    monkeypatch.setattr("tools.xcp_master.file_name", lambda: "another.a2l")
    for _ in range(2):
        with pytest.raises(XcpMasterError, match="build and flash it"):
            master.connect()
    bus.close()


def test_the_commands_measure_and_calibrate(
    compiled: Running, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    where = ["--bus", compiled.address, "--json"]
    names = [*MOVING[:2], "outputs.mode"]
    mode_before = compiled.bench.mode
    assert cli.run(["measure", *names, *where, "--rate", "50", "--until", "1", "--out", str(tmp_path)]) == 0
    found = json.loads(capsys.readouterr().out)["signals"]
    assert list(found) == names
    assert found["state.crank.omega_rad_s"]["unit"] == "rad/s"
    # The module goes on meanwhile, and may have reached RUN after the last sample.
    assert found["outputs.mode"]["last"] in (mode_before.value, compiled.bench.mode.value)
    log = tmp_path / "measured.rrd"
    content = log.read_bytes()
    assert cli.run(["measure", *names, *where, "--until", "1", "--out", str(tmp_path)]) == EXIT_BAD_INPUT
    assert "measured.rrd exists" in json.loads(capsys.readouterr().out)["error"]
    assert log.read_bytes() == content
    assert cli.run(["inspect", str(log), "--json"]) == EXIT_BAD_INPUT
    assert "holds signals of `vibrohil measure`, no run" in json.loads(capsys.readouterr().out)["error"]
    assert cli.run(["measure", *names, *where, "--rate", "1000", "--until", "1"]) == EXIT_BAD_INPUT
    error = json.loads(capsys.readouterr().out)["error"]
    assert "the firmware has no room for 3 signals at 1000 Hz; lower --rate, or name fewer signals" in error

    saved = tmp_path / "gains.toml"
    assert cli.run(["calibrate", "speed.gain_i_n_m=0.75", *where, "--save", str(saved)]) == 0
    assert compiled.bench.node.values["speed.gain_i_n_m"] == 0.75
    assert read_parameters(saved) == {"speed": {"gain_i_n_m": 0.75}}

    capsys.readouterr()
    refused = ["calibrate", "speed.gain_i_n_m=0.5", "limit.force_n=100", "start.rise_s=5", *where]
    assert cli.run(refused) == 1
    found = json.loads(capsys.readouterr().out)["refused"]
    assert [one["key"] for one in found] == ["limit.force_n", "start.rise_s"]
    assert "never changes over the bus" in found[0]["why"]
    assert "changes only at rest" in found[1]["why"]
    assert compiled.bench.node.values["speed.gain_i_n_m"] == 0.75


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["measure", "state.crank.omega"], "did you mean state.crank.omega_rad_s"),
        (["calibrate", "speed.gain_q=1"], "there is no firmware parameter 'speed.gain_q'"),
        (["calibrate", "speed.gain_p_n_m_s=much"], "wanted KEY=NUMBER"),
        (["calibrate", "start.rise_s=5", "start.rise_s=6"], "start.rise_s is given twice"),
    ],
)
def test_a_wrong_name_or_value_is_bad_input(
    compiled: Running, capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    assert cli.run([*arguments, "--bus", compiled.address]) == EXIT_BAD_INPUT
    assert message in " ".join(capsys.readouterr().err.split())
