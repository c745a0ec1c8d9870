"""The compiled kernels on disk: numba's cache, for the kernels of the plant, the firmware and the bench.

numba itself keys a cached kernel by the file of the kernel's own function. After an edit of a callee in
another file, of the order of a record's fields or of an enum's value, it would run stale machine code. Here
the folder of a kernel is named by a digest of all modules of its package and of the packages below that one
(`LAYERS`), without comments and docstrings, and of the versions of numba and llvmlite. So an edit of the
bench or of a tool leaves the kernels of plant and firmware as they are.

numba unpickles what it finds in its cache and runs it. The cache therefore has mode 0700. A folder that
belongs to another user, or that others may write or exchange, is refused. A damaged file is compiled anew.
"""

import ast
import errno
import fcntl
import functools
import glob
import hashlib
import importlib.util
import os
import pickle
import re
import shutil
import stat
import sys
import tempfile
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from types import CodeType, SimpleNamespace
from typing import Any

import llvmlite
import numba
from numba.core import caching, runtime, serialize

from compilation import PACKAGES
from compilation.users import own_users
from text_input import RefusalError

LAYERS = {
    "compilation": PACKAGES[:1],
    "plant_sim": PACKAGES[:2],
    "firmware_py": ("compilation", "firmware_py"),
    "hil": PACKAGES[:4],
    "tools": PACKAGES,
}
"""The packages on whose modules the kernels of a package depend; those of a test depend on all packages."""

KEYED_FOLDER = re.compile(r"(?P<name>.+)-[0-9a-f]{16}")
MOST_KEYS = 16
"""Number of folders kept for each module of kernels: the versions of the sources that were used last."""
UNUSED_S = 30 * 86_400.0
"""A folder that no process has used for this long is removed."""
OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
MOST_LINKS = 40
"""Number of links on the way to the cache, as Linux follows in a path."""


class KernelCacheError(RefusalError, OSError):
    """The folder for compiled kernels cannot be written, or others may write it."""


class DamagedKernelError(ValueError):
    """A compiled kernel whose bytes are not those that were written."""


def root() -> Path:
    """The folder of all compiled kernels, made if needed: $VIBROHIL_CACHE_DIR, else in the user's cache.

    Raises KernelCacheError with the remedy if it cannot be written, or if it is not this user's alone.
    """
    user_cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return _private(Path(os.environ.get("VIBROHIL_CACHE_DIR") or user_cache / "vibrohil"))


@functools.cache
def _private(folder: Path) -> Path:
    """The folder, made with mode 0700 if needed, and found to be this user's alone to write or exchange."""
    try:
        found = _made_and_checked(folder)
        tempfile.TemporaryFile(dir=folder).close()
    except KernelCacheError:
        raise
    except OSError as error:
        raise KernelCacheError(
            f"compiled kernels are kept in {folder}, which cannot be written ({error.strerror}); "
            "set VIBROHIL_CACHE_DIR to a writable folder"
        ) from error
    if found.st_uid not in own_users():
        raise KernelCacheError(
            f"compiled kernels are kept in {folder}, which belongs to user {found.st_uid}, who could place "
            "code in it; set VIBROHIL_CACHE_DIR to a folder of your own"
        )
    if found.st_mode & OTHERS_WRITE:
        raise KernelCacheError(
            f"compiled kernels are kept in {folder}, which others may write (mode {found.st_mode & 0o777:o}) "
            "and place code in; remove it (its kernels are compiled anew), or set VIBROHIL_CACHE_DIR to a "
            "folder that only you may write"
        )
    return folder


def _made_and_checked(folder: Path) -> os.stat_result:
    """The status of a folder, made with those above it if needed, where no other user can exchange it.

    As ssh checks a file of keys: each folder and link on the way belongs to this user or to the system, and
    others write no folder on the way but a sticky one. The way is walked from the root down, so that
    what was found in a checked folder stays there. Raises KernelCacheError.
    """
    trusted = {0, os.stat("/").st_uid} | own_users()
    top, *names = folder.absolute().parts
    place, links = Path(top), 0
    while True:
        found = place.lstat()
        is_link = stat.S_ISLNK(found.st_mode)
        if found.st_uid not in trusted and (names or is_link):
            raise KernelCacheError(
                f"compiled kernels are kept in {folder}, below {place}, which belongs to user "
                f"{found.st_uid}, who could exchange it; set VIBROHIL_CACHE_DIR to a folder of your own"
            )
        if is_link:
            links += 1
            if links > MOST_LINKS:
                raise OSError(errno.ELOOP, os.strerror(errno.ELOOP))
            names = [*(place.parent / os.readlink(place)).parts[1:], *names]
            place = Path(top)
        elif names and found.st_mode & OTHERS_WRITE and not found.st_mode & stat.S_ISVTX:
            raise KernelCacheError(
                f"compiled kernels are kept in {folder}, below {place}, which others may write (mode "
                f"{found.st_mode & 0o777:o}) and in which they could exchange it; chmod go-w {place}, or set "
                "VIBROHIL_CACHE_DIR to another folder"
            )
        elif not names:
            return found
        name = names.pop(0)
        place = place.parent if name == ".." else place / name
        with suppress(FileExistsError):
            place.mkdir(mode=0o700)


@functools.cache
def folder_of(name: str, *also: Path) -> Path:
    """The folder of all that is compiled from a module, made if needed.

    name: the module's dotted name. also: files that count beside those of its layer.
    """
    return _folder(name, key(name.partition(".")[0], *also))


def _folder(name: str, digest: str) -> Path:
    """A folder named by a digest, made if needed, with the time of its last use."""
    folder = root() / f"{name}-{digest}"
    if not folder.exists():
        _remove_unused(root())
    _private(folder)
    os.utime(folder)
    return folder


def _remove_unused(cache: Path) -> None:
    """Remove folders that were not used for a month, and all but the last used ones of each module."""
    used: dict[str, list[tuple[float, Path]]] = {}
    for folder in cache.iterdir():
        if match := KEYED_FOLDER.fullmatch(folder.name):
            with suppress(FileNotFoundError):  # another process has just removed it
                used.setdefault(match["name"], []).append((folder.stat().st_mtime, folder))
    for folders in used.values():
        for rank, (last_s, folder) in enumerate(sorted(folders, reverse=True)):
            if rank >= MOST_KEYS - 1 or time.time() - last_s > UNUSED_S:
                with suppress(FileNotFoundError):
                    shutil.rmtree(folder)


# -- The sources of a kernel -------------------------------------------------------------------------------


@functools.cache
def key(layer: str, *also: Path) -> str:
    """A digest of the sources of a layer and of those below it, of other files, and of numba and llvmlite."""
    packages = [(package, _package_key(package).encode()) for package in LAYERS.get(layer, PACKAGES)]
    return _digest([*packages, *((path.name, path.read_bytes()) for path in also)])


def _package_key(package: str) -> str:
    """A digest of a package's sources without comments and docstrings.

    To parse them takes some tenths of a second, so the digest is kept under that of the sources as written
    and of this module, which parses them.
    """
    contents = [(path.name, path.read_bytes()) for path in sources(package)]
    as_written = [*contents, (__name__, Path(__file__).read_bytes())]

    def parsed() -> bytes:
        return _digest((name, without_comments(content)) for name, content in contents).encode()

    return kept_file(_folder(f"key.{package}", _digest(as_written)), "key.txt", parsed).read_text()


def _digest(contents: Iterable[tuple[str, bytes]]) -> str:
    """A digest of named contents, and of the versions of what compiles them."""
    versions = numba.__version__, llvmlite.__version__, sys.version_info[:2]
    digest = hashlib.sha256(repr(versions).encode())
    for name, content in contents:
        digest.update(f" {name} {len(content)} ".encode() + content)
    return digest.hexdigest()[:16]


class _WithoutTexts(ast.NodeTransformer):
    """Removes texts that stand alone: the docstrings of modules, classes, functions and attributes."""

    def visit_Expr(self, node: ast.Expr) -> ast.Expr | None:
        """The statement, unless it is a text."""
        is_text = isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
        return None if is_text else node


def without_comments(source: bytes) -> bytes:
    """The meaning of a module's source: its syntax tree without comments, docstrings, layout and lines."""
    try:
        return ast.dump(_WithoutTexts().visit(ast.parse(source))).encode()
    except (SyntaxError, ValueError):  # not Python
        return source


def sources(package: str) -> list[Path]:
    """The modules of a package."""
    found: list[Path] = []
    spec = importlib.util.find_spec(package)
    for place in (spec and spec.submodule_search_locations) or ():
        for folder, _, names in os.walk(place):
            found += (Path(folder, name) for name in names if name.endswith(".py"))
    return sorted(found)


# -- numba's cache ----------------------------------------------------------------------------------------


class _Locator:
    """Where numba keeps a kernel's machine code: numba's interface of a cache locator."""

    def __init__(self, function: Callable[..., Any], path: str) -> None:
        self._function = function
        is_known = function.__module__.partition(".")[0] in LAYERS
        self._folder = folder_of(function.__module__, *(() if is_known else (Path(path),)))

    def get_cache_path(self) -> str:
        """The folder, named by the sources."""
        return str(self._folder)

    def ensure_cache_path(self) -> None:
        """Make the folder anew if another process has removed it as unused."""
        self._folder.mkdir(mode=0o700, exist_ok=True)

    def get_source_stamp(self) -> str:
        """The stamp of the sources of a cached kernel."""
        return self._folder.name

    def get_disambiguator(self) -> str:
        """A name for functions of one module that have the same name, such as lambda; no line number."""
        code: CodeType = self._function.__code__
        constants = [
            constant
            for constant in code.co_consts
            if not isinstance(constant, CodeType) and constant != self._function.__doc__
        ]
        distinguished_by = repr((code.co_code, code.co_names, constants)).encode()
        return hashlib.sha256(distinguished_by).hexdigest()[:8]


class _Format(caching.CompileResultCacheImpl):  # type: ignore[misc]  # a base without types
    """How a compiled kernel is written: with a digest, as damaged machine code would crash the process."""

    _locator_classes = (SimpleNamespace(from_function=_Locator),)

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        if not isinstance(self.locator, _Locator):
            raise KernelCacheError(
                "NUMBA_CACHE_LOCATOR_CLASSES is set, and would run stale kernels; unset it"
            )

    def reduce(self, data: Any) -> tuple[bytes, bytes]:
        content: bytes = serialize.dumps(super().reduce(data))
        return hashlib.sha256(content).digest(), content

    def rebuild(self, target_context: Any, reduced_data: tuple[bytes, bytes]) -> Any:
        digest, content = reduced_data
        if hashlib.sha256(content).digest() != digest:
            raise DamagedKernelError("its digest is another")
        return super().rebuild(target_context, pickle.loads(content))


class KernelCache(caching.FunctionCache):  # type: ignore[misc]  # a base without types
    """numba's cache of one function. Damaged files are reported in one line and compiled anew."""

    _impl_class = _Format

    def load_overload(self, signature: Any, target_context: Any) -> Any:
        """The compiled code for a signature; None if there is none yet, or if its file is damaged.

        numba's own method first imports all that a compilation needs, which takes half a second. A
        compilation does so itself; loaded code needs numba's memory management alone.
        """
        runtime.rtsys.initialize(target_context)
        try:
            with self._guard_against_spurious_io_errors():
                return self._load_overload(signature, target_context)
        except Exception as error:  # unpickling damaged bytes may raise anything
            print(
                f"kernel cache: a file of {self._name} in {self.cache_path} is damaged "
                f"({type(error).__name__}); compiling it anew",
                file=sys.stderr,
                flush=True,
            )
            self._impl.locator.ensure_cache_path()
            self.flush()
            return None


class CacheOnUse:
    """A `KernelCache` that is made when it is first used, so that an import needs no writable folder."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function

    @functools.cached_property
    def _cache(self) -> KernelCache:
        return KernelCache(self._function)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._cache, name)


def keep(kernel: Any) -> None:
    """Cache a kernel (numba's dispatcher or C callback) that is not yet compiled."""
    kernel._cache = CacheOnUse(kernel.__wrapped__)  # numba has no public way to replace a damaged file


# -- Other files made from sources ------------------------------------------------------------------------


def kept_file(folder: Path, name: str, make: Callable[[], bytes]) -> Path:
    """The path of a file with what `make` returns, written once into a folder of this cache.

    Its own name holds the digest of its content: a damaged file is reported in one line and made anew. A
    process that needs the file while another one makes it waits for the other.
    """
    stem, _, suffix = name.rpartition(".")
    if path := _whole_file(folder, stem, suffix):
        return path
    folder.mkdir(mode=0o700, exist_ok=True)
    with (folder / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if path := _whole_file(folder, stem, suffix):
            return path
        content = make()
        path = folder / _named(stem, content, suffix)
        folder.mkdir(mode=0o700, exist_ok=True)  # another process may have removed it as unused
        with tempfile.NamedTemporaryFile(dir=folder, delete=False) as file:
            file.write(content)
        os.replace(file.name, path)
        return path


def _whole_file(folder: Path, stem: str, suffix: str) -> Path | None:
    """The path of the file, if there is an undamaged one; damaged ones are removed."""
    for path in folder.glob(f"{glob.escape(stem)}.????????????????.{suffix}"):
        if path.name == _named(stem, path.read_bytes(), suffix):
            return path
        print(f"kernel cache: {path} is damaged; making it anew", file=sys.stderr, flush=True)
        path.unlink(missing_ok=True)
    return None


def _named(stem: str, content: bytes, suffix: str) -> str:
    return f"{stem}.{hashlib.sha256(content).hexdigest()[:16]}.{suffix}"
