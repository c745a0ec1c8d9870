"""The lock alone decides what is installed, whatever has been released since it was made."""

import hashlib
import os
import re
import shlex
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]


def wheel(folder: Path, name: str, version: str, requirement: str = "") -> str:
    """Writes a wheel without code; returns its line of a lock."""
    path = folder / f"{name}-{version}-py3-none-any.whl"
    about = f"{name}-{version}.dist-info"
    requires = f"Requires-Dist: {requirement}\n" if requirement else ""
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(
            f"{about}/METADATA",
            f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\nProvides-Extra: toml\n{requires}",
        )
        archive.writestr(f"{about}/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n")
        archive.writestr(f"{about}/RECORD", "")
    return f"{name}=={version} --hash=sha256:{hashlib.sha256(path.read_bytes()).hexdigest()}\n"


def test_a_newer_release_of_a_package_with_extras_does_not_break_the_set_up(tmp_path):
    """pip 23 refuses `measured[toml]` from the lock as soon as a release newer than the locked one exists."""
    lock = tmp_path / "requirements.lock"
    lock.write_text(
        wheel(tmp_path, "measured", "1.0") + wheel(tmp_path, "wants", "1.0", "measured[toml]>=1.0")
    )
    wheel(tmp_path, "measured", "1.1")
    (tmp_path / "venv").symlink_to(
        sys.prefix
    )  # whose own path may have a blank, as that of `make setup` never has
    shown = subprocess.run(
        [
            "make",
            "--eval",
            "shown: ; @echo '$(PIP) $(FROM_LOCK)'",
            "shown",
            f"BIN={tmp_path / 'venv' / 'bin'}",
        ],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    command = [*shlex.split(shown), str(lock), "--no-index", "--find-links", str(tmp_path)]
    answer = subprocess.run(
        [*command, "--target", str(tmp_path / "installed")], capture_output=True, text=True, check=False
    )
    assert answer.returncode == 0, answer.stderr
    assert {path.name for path in (tmp_path / "installed").glob("*.dist-info")} == {
        "measured-1.0.dist-info",
        "wants-1.0.dist-info",
    }


@pytest.mark.parametrize("lock", ["requirements.lock", "requirements-dev.lock"])
def test_every_python_gets_the_same_version_of_a_package(lock: str) -> None:
    """With another version for newer Pythons, the tests here would say nothing about them."""
    names = re.findall(r"(?m)^([\w.-]+)(?:\[[^\]]*\])?==", (ROOT / lock).read_text())
    assert len(names) > 50
    assert [name for name in names if names.count(name) > 1] == []


def test_the_lock_of_the_tests_holds_what_the_other_installs() -> None:
    """Make installs that one alone where both are wanted."""
    held = [
        set(re.findall(r"(?m)^([^\s#]+==\S+)", (ROOT / name).read_text()))
        for name in ("requirements.lock", "requirements-dev.lock")
    ]
    assert held[0] - held[1] == set()


def test_a_target_in_a_persons_pip_settings_does_not_send_packages_elsewhere(tmp_path: Path) -> None:
    lines = [one for one in (ROOT / "Makefile").read_text().splitlines() if one.startswith("PIP := ")]
    options = [one for one in lines[0].split() if one in ("--target=", "--no-user")]
    venv.create(tmp_path / "venv", with_pip=False)
    wheel(tmp_path, "one", "1")
    (tmp_path / "pip.conf").write_text(f"[install]\ntarget = {tmp_path / 'elsewhere'}\nuser = true\n")
    python = tmp_path / "venv" / "bin" / "python"
    pip = [
        sys.executable,
        "-P",
        "-m",
        "pip",
        "--python",
        python,
        "install",
        *options,
        "--no-deps",
        "--no-index",
    ]
    environment = os.environ | {"PIP_CONFIG_FILE": str(tmp_path / "pip.conf")}
    subprocess.run([*pip, tmp_path / "one-1-py3-none-any.whl"], env=environment, cwd=tmp_path, check=True)
    assert [*tmp_path.glob("venv/lib/*/site-packages/one-1.dist-info")] != []
    assert not (tmp_path / "elsewhere").exists()
