"""The doctor says what the machine has, and a remedy for what it lacks."""

import shutil
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

from plant_sim import kernels
from tools import doctor


def test_every_check_has_a_name_a_finding_and_a_remedy() -> None:
    found = doctor.checks()
    assert len({check.name for check in found}) == len(found) == 12
    for check in found:
        assert check.detail, check
        assert check.remedy, check
        assert type(check.passed) is bool, check
    python, packages = found[:2]
    assert python.passed
    assert packages.passed, packages.detail


def test_an_installed_package_is_held_against_the_lock() -> None:
    numpy = version("numpy")
    lock = (
        f"numpy=={numpy} ; python_full_version < '3.12' \\\n    --hash=sha256:0\n"
        "numpy==0.1 ; python_full_version >= '3.12' \\\n    --hash=sha256:0\n"
        "only-elsewhere==1.0 ; sys_platform == 'win32' \\\n    --hash=sha256:0\n"
        "no-such-package==2.0 \\\n    --hash=sha256:0\n"
        "scipy==0.2 \\\n    --hash=sha256:0\n"
    )
    assert doctor.version_faults(lock) == [
        "no-such-package is not installed",
        f"scipy is {version('scipy')}, locked at 0.2",
    ]


def test_late_wake_ups_fail() -> None:
    assert doctor._wake_up([80.0] * 99 + [499.0]).passed
    assert not doctor._wake_up([80.0] * 98 + [900.0] * 2).passed


def test_a_cold_or_unwritable_cache_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "cache_folder", lambda: tmp_path)
    assert not doctor._kernels().passed
    (tmp_path / "kernel.nbc").touch()
    assert doctor._kernels().passed

    def refuse() -> Path:
        raise kernels.KernelCacheError("not writable")

    monkeypatch.setattr(doctor, "cache_folder", refuse)
    assert doctor._kernels() == doctor.DoctorCheck(
        "compiled kernels", False, doctor._kernels().remedy, "not writable"
    )


def test_missing_programs_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: None)
    check = doctor._user_mode_linux()
    assert (check.passed, check.detail) == (False, "no linux.uml, no busybox")
    assert "apt-get install user-mode-linux busybox" in check.remedy


def test_an_old_python_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    assert doctor._python().passed
    monkeypatch.setattr(sys, "version_info", (3, 10, 12))
    assert not doctor._python().passed


def found_with(**passed: bool) -> list[doctor.DoctorCheck]:
    names = ("Python", "packages", "CAN in the kernel", *doctor.REST)
    return [doctor.DoctorCheck(name, passed.get(name, True), f"mend {name}", "found") for name in names]


def test_the_conclusion_says_what_runs_and_the_one_thing_that_is_missing() -> None:
    assert doctor.conclude(found_with()) == doctor.Conclusion(
        True,
        "Here you can run every scenario in lockstep and, in real time, on the local bus, and on SocketCAN; "
        "nothing is missing.",
    )
    poor = doctor.conclude(
        found_with(**{"CAN in the kernel": False, "user-mode Linux": False, "viewer": False})
    )
    assert poor.main_job_runs
    assert poor.sentence.endswith("on the local bus. For real SocketCAN: mend user-mode Linux.")
    guest = doctor.conclude(found_with(**{"CAN in the kernel": False, "viewer": False}))
    assert guest.sentence.endswith(
        "and on SocketCAN under `vibrohil kernel`. For the Rerun viewer: mend viewer."
    )
    with_can = doctor.conclude(found_with(**{"user-mode Linux": False}))
    assert with_can.sentence.endswith("and on SocketCAN; nothing is missing.")


def test_without_its_packages_the_bench_does_not_run() -> None:
    conclusion = doctor.conclude(found_with(packages=False))
    assert not conclusion.main_job_runs
    assert conclusion.sentence == "The bench cannot run here yet. packages: mend packages."
