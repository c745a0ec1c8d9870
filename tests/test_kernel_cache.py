"""Kernels are keyed by their sources, kept where only this user writes, and rebuilt if damaged."""

import errno
import importlib.util
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from numba.core import types

from compilation import PACKAGES, kernel_cache
from compilation.kernel_cache import KernelCacheError
from hil.nodes import closed_loop
from hil.runs.job import Job
from hil.runs.recording import warm_lockstep
from hil.scenario.scenario import load_scenario
from plant_sim.solvers.adaptive import adaptive

CALLEE = """
from plant_sim.kernels import subroutine
@subroutine
def value(x):
    return 2.0 * x
"""
CALLER = """
from plant_sim.kernels import jit
from plant_sim.callee import value
@jit
def call(x):
    return value(x)
"""
PROGRAM = """
import sys
sys.path.insert(0, {root!r})
from plant_sim.caller import call
result = call(1.0)
print(result, sum(call.stats.cache_hits.values()))
"""


class Copy:
    """A package with a kernel and its callee, and a cache of its own."""

    def __init__(self, folder: Path) -> None:
        self.root = folder
        self.package = folder / "plant_sim"
        self.package.mkdir()
        (self.package / "__init__.py").touch()
        source = Path(str(sys.modules["plant_sim.kernels"].__file__))
        (self.package / source.name).write_text(source.read_text())
        self.write("callee", CALLEE)
        self.write("caller", CALLER)
        self.cache = folder / "cache"

    def write(self, module: str, text: str) -> None:
        (self.package / f"{module}.py").write_text(text)

    def call(self) -> tuple[float, bool, str]:
        """The kernel's result in a new process, whether it came from the cache, and the error output."""
        # Python itself takes an edit within the same second and of the same length for none: no bytecode.
        run = subprocess.run(
            [sys.executable, "-P", "-c", PROGRAM.format(root=str(self.root))],
            env=os.environ
            | {"VIBROHIL_CACHE_DIR": str(self.cache), "PYTHONPATH": "", "PYTHONDONTWRITEBYTECODE": "1"},
            capture_output=True,
            text=True,
            check=False,
        )
        assert run.returncode == 0, run.stderr
        result, hits = run.stdout.split()
        return float(result), hits == "1", run.stderr


@pytest.fixture
def copy(tmp_path: Path) -> Copy:
    return Copy(tmp_path)


def test_an_edited_callee_in_another_file_is_never_run_stale(copy: Copy) -> None:
    assert copy.call() == (2.0, False, "")
    copy.write("callee", CALLEE.replace("2.0", "3.0"))
    assert copy.call() == (3.0, False, "")
    assert copy.call() == (3.0, True, "")


def test_what_callees_import_counts_too(copy: Copy) -> None:
    copy.write("factor", "FACTOR = 2.0\n")
    copy.write("callee", f"from plant_sim import factor{CALLEE.replace('2.0', 'factor.FACTOR')}")
    assert copy.call() == (2.0, False, "")
    copy.write("factor", "FACTOR = 3.0\n")
    assert copy.call() == (3.0, False, "")


def changed_in_the_middle(content: bytes) -> bytes:
    middle = len(content) // 2
    return content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]


def test_a_damaged_file_is_reported_in_one_line_and_compiled_anew(copy: Copy) -> None:
    copy.call()
    damages: list[tuple[str, Callable[[bytes], bytes]]] = [
        ("*.nbi", lambda _: b""),
        ("*.nbi", lambda content: content[:30]),
        ("*.nbc", lambda content: content[:100]),
        ("*.nbc", lambda content: content[:-1]),
        ("*.nbc", changed_in_the_middle),
    ]
    for pattern, damage in damages:
        (damaged,) = copy.cache.rglob(pattern)
        damaged.write_bytes(damage(damaged.read_bytes()))
        result, hit, message = copy.call()
        assert (result, hit, message.count("\n")) == (2.0, False, 1)
        assert "is damaged" in message
        assert ("DamagedKernelError" in message) == (damage is changed_in_the_middle)
        assert str(damaged.parent) in message
        assert "compiling it anew" in message
    assert copy.call() == (2.0, True, "")


def test_the_cache_is_made_for_its_user_alone(copy: Copy) -> None:
    copy.call()
    folders = [copy.cache, *(path for path in copy.cache.rglob("*") if path.is_dir())]
    assert len(folders) >= 2
    assert {folder.stat().st_mode & 0o777 for folder in folders} == {0o700}


@pytest.mark.parametrize("mode", [0o770, 0o702, 0o777, 0o1777])
def test_a_cache_that_others_may_write_is_refused_with_the_remedy(tmp_path: Path, mode: int) -> None:
    tmp_path.chmod(mode)
    with pytest.raises(KernelCacheError, match=r"which others may write \(mode .*\).*; remove it"):
        kernel_cache._private.__wrapped__(tmp_path)


@pytest.mark.parametrize("mode", [0o770, 0o702, 0o777])
@pytest.mark.parametrize("link", ["", "above", "chain"])
def test_a_cache_that_others_may_exchange_is_refused_with_the_remedy(
    tmp_path: Path, mode: int, link: str
) -> None:
    """Whoever may write a folder above the cache, or one that a link leads through, may exchange it."""
    open_folder = tmp_path / "open"
    (open_folder / "mine" / "cache").mkdir(parents=True, mode=0o700)
    cache = open_folder / "mine" / "cache"
    if link == "above":
        (tmp_path / "link").symlink_to("open/mine")
        cache = tmp_path / "link" / "cache"
    if link == "chain":
        (tmp_path / "target").mkdir(mode=0o700)
        (open_folder / "second").symlink_to(tmp_path / "target")
        (tmp_path / "first").symlink_to(open_folder / "second")
        cache = tmp_path / "first"
    open_folder.chmod(mode)
    with pytest.raises(
        KernelCacheError, match=rf"below {open_folder}, which others may write .*; chmod go-w"
    ):
        kernel_cache._private.__wrapped__(cache)
    open_folder.chmod(0o1777)  # as /tmp: nobody but the owner moves what is in it
    assert kernel_cache._private.__wrapped__(cache) == cache


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can make a folder of another user")
@pytest.mark.parametrize("kind", ["folder", "link"])
def test_a_cache_below_another_users_folder_or_link_is_refused(tmp_path: Path, kind: str) -> None:
    (tmp_path / "mine").mkdir(mode=0o700)
    other = tmp_path / "other"
    other.mkdir() if kind == "folder" else other.symlink_to("mine")
    os.lchown(other, 12345, 12345)
    for cache in (other / "cache", *([other] if kind == "link" else [])):
        with pytest.raises(KernelCacheError, match=rf"below {other}, which belongs to user 12345"):
            kernel_cache._private.__wrapped__(cache)


def test_folders_above_the_cache_are_made_for_its_user_alone_and_a_circle_of_links_ends(
    tmp_path: Path,
) -> None:
    kernel_cache._private.__wrapped__(tmp_path / "a" / "b" / "cache")
    assert {(tmp_path / name).stat().st_mode & 0o777 for name in ("a", "a/b", "a/b/cache")} == {0o700}
    (tmp_path / "circle").symlink_to("circle")
    with pytest.raises(KernelCacheError, match="cannot be written"):
        kernel_cache._private.__wrapped__(tmp_path / "circle" / "cache")


def test_another_users_cache_is_refused_with_the_remedy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: tmp_path.stat().st_uid + 1)
    with pytest.raises(KernelCacheError, match=r"belongs to user .*; set VIBROHIL_CACHE_DIR to a"):
        kernel_cache._private.__wrapped__(tmp_path)
    # Under user-mode Linux this user's files belong to the user outside.
    monkeypatch.setenv("VIBROHIL_OUTER_USER", str(tmp_path.stat().st_uid))
    assert kernel_cache._private.__wrapped__(tmp_path) == tmp_path


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.touch()
    with pytest.raises(KernelCacheError, match="set VIBROHIL_CACHE_DIR to a writable folder"):
        kernel_cache._private.__wrapped__(blocked / "cache")


def test_an_existing_folder_that_cannot_be_written_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(**_: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(tempfile, "TemporaryFile", refuse)  # root may write anywhere
    with pytest.raises(KernelCacheError, match=r"cannot be written \(Permission denied\); set"):
        kernel_cache._private.__wrapped__(tmp_path)


def test_folders_that_are_no_longer_used_are_removed(tmp_path: Path) -> None:
    now_s = time.time()
    folders = [tmp_path / f"plant-{index:016x}" for index in range(20)]
    for index, folder in enumerate(folders):
        folder.mkdir()
        os.utime(folder, (now_s - index, now_s - index))
    old, foreign = tmp_path / f"firmware-{0:016x}", tmp_path / "a-folder-of-the-user"
    for folder in (old, foreign):
        folder.mkdir()
        os.utime(folder, (0, 0))
    kernel_cache._remove_unused(tmp_path)
    assert set(tmp_path.iterdir()) == {*folders[: kernel_cache.MOST_KEYS - 1], foreign}


def test_a_kept_file_is_made_once_and_anew_if_damaged(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = []

    def make() -> bytes:
        made.append(1)
        return b"content"

    path = kernel_cache.kept_file(tmp_path, "host.o", make)
    assert kernel_cache.kept_file(tmp_path, "host.o", make) == path
    assert (path.read_bytes(), path.suffix, len(made)) == (b"content", ".o", 1)
    path.write_bytes(b"cont")
    assert kernel_cache.kept_file(tmp_path, "host.o", make).read_bytes() == b"content"
    assert (len(made), capsys.readouterr().err) == (
        2,
        f"kernel cache: {path} is damaged; making it anew\n",
    )


def test_a_kept_file_that_two_need_at_once_is_made_by_one(tmp_path: Path) -> None:
    made = []
    begun = threading.Event()

    def make() -> bytes:
        begun.set()
        time.sleep(0.2)
        made.append(len(made))
        return bytes(made)

    with ThreadPoolExecutor(1) as other:
        first = other.submit(kernel_cache.kept_file, tmp_path, "host.o", make)
        assert begun.wait(10.0)
        assert kernel_cache.kept_file(tmp_path, "host.o", make) == first.result()
    assert made == [0]


def records(kind: Any) -> set[type]:
    """The Python classes of the records and enums within a compiled type."""
    own = getattr(kind, "instance_class", None)
    within = kind.types if isinstance(kind, types.BaseTuple) else ()
    return ({own} if own else set()).union(*map(records, within))


def test_kernels_take_records_of_their_own_layer_or_below(tmp_path: Path) -> None:
    """So that a change of a record compiles them anew."""
    warm_lockstep(Job(load_scenario("soft-start-multistable"), 1))
    for kernel in (adaptive.advance, closed_loop.run):
        layer = kernel_cache.LAYERS[kernel.__wrapped__.__module__.partition(".")[0]]
        classes = set().union(*(records(kind) for signature in kernel.overloads for kind in signature))
        own = {kind.__module__.partition(".")[0] for kind in classes} & set(PACKAGES)
        assert own
        assert own <= set(layer)


def edited(folder: Path, package: str, monkeypatch: pytest.MonkeyPatch, source: str = "x = 2\n") -> set[str]:
    """The layers whose kernels are compiled anew after an edit of a module, with an empty cache."""
    monkeypatch.setenv("VIBROHIL_CACHE_DIR", str(folder / "cache"))
    layers = {*kernel_cache.LAYERS, "tests"}
    for name in PACKAGES:
        (folder / name).mkdir()
        (folder / name / "module.py").write_text("x = 1\n")
    places = {name: SimpleNamespace(submodule_search_locations=[str(folder / name)]) for name in layers}
    monkeypatch.setattr(importlib.util, "find_spec", places.get)
    before = {layer: kernel_cache.key.__wrapped__(layer) for layer in layers}
    (folder / package / "module.py").write_text(source)
    return {layer for layer in layers if kernel_cache.key.__wrapped__(layer) != before[layer]}


@pytest.mark.parametrize(
    ("package", "compiled_anew"),
    [
        ("compilation", {"compilation", "plant_sim", "firmware_py", "hil", "tools", "tests"}),
        ("plant_sim", {"plant_sim", "hil", "tools", "tests"}),
        ("firmware_py", {"firmware_py", "hil", "tools", "tests"}),
        ("hil", {"hil", "tools", "tests"}),
        ("tools", {"tools", "tests"}),
    ],
)
def test_an_edit_compiles_its_layer_and_those_above_it_anew(
    package: str, compiled_anew: set[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert edited(tmp_path, package, monkeypatch) == compiled_anew


@pytest.mark.parametrize(
    ("source", "compiles_anew"),
    [
        ('"""What it is."""\n\nx = 1  # m\n"""Its length."""\n', False),
        ("x = (\n    1\n)\n", False),
        ("x = 1.0\n", True),
        ("x = '# 1'\n", True),
        ('x = 1\nf("""text""")\n', True),
        ("x = 1 +\n", True),
    ],
)
def test_an_edit_of_comments_and_docstrings_compiles_nothing(
    source: str, compiles_anew: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert bool(edited(tmp_path, "plant_sim", monkeypatch, source)) == compiles_anew
