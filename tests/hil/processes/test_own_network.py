"""What listens in a network of its own is reached there alone; without one a shared machine is refused."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from hil.processes import own_network
from hil.processes.own_network import NetworkError
from hil.show.window import in_own_network

LISTENER = """
import socket, sys
with socket.create_server(("127.0.0.1", 0)) as server:
    port = server.getsockname()[1]
    socket.create_connection(("127.0.0.1", port)).close()
    print(port, flush=True)
    sys.stdin.read()
"""


def fail(*_: object) -> None:
    raise NetworkError("no namespace")


def test_a_port_in_an_own_network_is_seen_by_no_process_outside(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DISPLAY", ":0")
    command = in_own_network([sys.executable, "-P", "-c", LISTENER])
    with subprocess.Popen(command, stdin=-1, stdout=-1, stderr=-1, text=True) as inside:
        assert inside.stdin
        assert inside.stdout
        assert inside.stderr
        port = inside.stdout.readline().strip()
        if not port and "namespace" in (said := inside.stderr.read()):
            pytest.skip(f"this machine makes no network namespace: {said}")
        assert f":{int(port):04X} 00000000:0000 0A" not in Path("/proc/net/tcp").read_text()
        inside.stdin.close()
        assert inside.wait(20.0) == 0


@pytest.mark.parametrize("reason", ["display", "namespace"])
@pytest.mark.parametrize("others", [set(), {1234}])
def test_without_an_own_network_a_shared_machine_is_refused(
    reason: str, others: set[int], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    ran: list[str] = []
    monkeypatch.setattr(os, "execv", lambda program, _: ran.append(program))
    monkeypatch.setattr(sys, "argv", ["own_network", "/bin/true"])
    monkeypatch.setattr(own_network, "people", lambda: others)
    monkeypatch.setattr(own_network, "enter_own_network", fail)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setenv("DISPLAY", "localhost:10.0" if reason == "display" else ":0")
    if not others:
        own_network.main()
        assert ran == ["/bin/true"]
        return
    with pytest.raises(SystemExit) as ended:
        own_network.main()
    assert (ended.value.code, ran) == (4, [])
    assert reason in (said := capsys.readouterr().err)
    assert "user 1234 has processes here" in said
    assert "--web" in said


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can start a process of another user")
def test_a_process_of_another_person_is_found_and_that_of_a_service_is_not() -> None:
    for user, counts in ((23456, True), (65534, False), (101, False)):
        with subprocess.Popen(["sleep", "30"], user=user) as other:
            assert (user in own_network.people()) == counts
            other.kill()
