"""The doctor says what the machine has, and a remedy for what it lacks."""

import shutil
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

from compilation.kernel_cache import KernelCacheError
from hil.kernel import user_mode_linux
from tools import doctor
from tools.runs import view


def test_every_check_has_a_name_a_finding_and_a_remedy() -> None:
    found = doctor.checks()
    assert len({check.name for check in found}) == len(found) == 14
    for check in found:
        assert check.detail, check
        assert check.remedy, check
        assert type(check.passed) is bool, check
    assert found[0].passed, found[0].detail


def test_an_installed_package_is_held_against_the_lock() -> None:
    numpy = version("numpy")
    lock = (
        f"numpy=={numpy} ; python_full_version < '3.12' \\\n    --hash=sha256:0\n"
        "numpy==0.1 ; python_full_version >= '3.12' \\\n    --hash=sha256:0\n"
        "only-elsewhere==1.0 ; sys_platform == 'win32' \\\n    --hash=sha256:0\n"
        "no-such-package==2.0 \\\n    --hash=sha256:0\n"
        "scipy==0.2 \\\n    --hash=sha256:0\n"
    )
    assert doctor.package_faults(lock, []) == [
        "no-such-package is not installed",
        f"scipy is {version('scipy')}, locked at 0.2",
    ]


def test_a_requirement_without_its_module_is_found_and_none_is_imported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "emptied").mkdir()
    monkeypatch.syspath_prepend(tmp_path)
    wanted = ["no-such-package>=1", "emptied", "antigravity", "python-can", "only-extra; extra == 'x'"]
    monkeypatch.setattr(doctor, "requires", lambda _: wanted)
    assert doctor.package_faults("", wanted) == [
        "no-such-package has no module no_such_package",
        "emptied has no module emptied",
    ]
    assert not doctor.packages().passed
    assert "antigravity" not in sys.modules


def test_modules_are_loaded_together_and_a_missing_modprobe_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda name, **_: f"/sbin/{name}")
    assert doctor.load_modules("can", "vcan") == "modprobe -a can vcan"
    monkeypatch.setattr(shutil, "which", lambda name, **_: None)
    assert "apt-get install kmod" in doctor.load_modules("vcan")


@pytest.mark.parametrize(
    ("load", "cores", "free"), [(0.9, 2, True), (1.1, 2, False), (6.0, 8, True), (7.0, 8, False)]
)
def test_a_loaded_machine_is_found(load: float, cores: int, free: bool) -> None:
    assert doctor.machine_load(load, cores).passed is free


def test_late_wake_ups_fail() -> None:
    assert doctor.wake_up([80.0] * 99 + [499.0]).passed
    assert not doctor.wake_up([80.0] * 98 + [900.0] * 2).passed


def test_a_cold_or_unwritable_cache_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "root", lambda: tmp_path)
    assert not doctor.kernels().passed
    (tmp_path / "kernel.nbc").touch()
    assert doctor.kernels().passed

    def refuse() -> Path:
        raise KernelCacheError("not writable")

    monkeypatch.setattr(doctor, "root", refuse)
    assert doctor.kernels() == doctor.DoctorCheck(
        "compiled kernels", False, doctor.kernels().remedy, "not writable"
    )


def test_missing_programs_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda name, **_: None)
    monkeypatch.setattr(user_mode_linux, "has_amx", lambda cpuinfo: False)
    check = next(one for one in doctor.checks() if one.name == "user-mode Linux")
    assert (check.passed, check.detail) == (False, "no linux.uml, no busybox")
    assert "apt-get install user-mode-linux busybox" in check.remedy


@pytest.mark.parametrize("display", ["", ":7"])
def test_the_viewer_works_where_view_opens_a_window(monkeypatch: pytest.MonkeyPatch, display: str) -> None:
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.delenv("DISPLAY", raising=False)
    if display:
        monkeypatch.setenv("DISPLAY", display)
    monkeypatch.setattr(doctor, "VULKAN_DRIVERS", (Path(__file__).parent,))
    monkeypatch.setattr(Path, "glob", lambda *_: iter([Path("driver.json")]))
    monkeypatch.setattr(doctor.shutil, "which", lambda *_, **__: "/usr/bin/xvfb-run")
    assert doctor.viewer().passed is view.has_display() is bool(display)
