"""The one place that knows numba: compiled kernels, their inputs and results, and their cache on disk."""

from __future__ import annotations

import functools
import hashlib
import logging
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numba import njit
from numba.core import event
from numpy.typing import NDArray

from cspr_kinematics.arrays import FloatArray

_Function = TypeVar("_Function", bound=Callable[..., Any])
_Scalar = TypeVar("_Scalar", bound=np.generic)
_PACKAGE = Path(__file__).parent
_IMPORT = re.compile(
    r"^from cspr_kinematics\.(\w+)\.(_\w+) import", re.MULTILINE
)  # kernels stand in _name.py

_without_cache: list[str] = []  # kernels that cannot be kept

logger = logging.getLogger("cspr_kinematics")


def kernel(function: _Function) -> _Function:
    """Compile a function on its first call, and keep the machine code on disk.

    The code follows IEEE 754 (no fast-math), divides by zero into infinity as numpy does, and runs without
    the interpreter lock. Arguments are numbers and C-contiguous arrays; `kernel_input` makes inputs of the
    one array type that all callers use, so that no second version is ever compiled.
    """
    compiled = njit(nogil=True, error_model="numpy", fastmath=False)(function)
    try:
        compiled.enable_caching()
        _stamp_with_sources(compiled)
    except RuntimeError:  # no writable directory
        if not _without_cache:
            logger.warning(
                "cspr_kinematics: its kernels will be compiled in every process, because neither %s nor the user's "
                "cache directory is writable; name one that is: NUMBA_CACHE_DIR=DIRECTORY",
                _PACKAGE,
            )
        _without_cache.append(function.__name__)
    # To the type checker, a kernel is the function that it was made from.
    return compiled  # type: ignore[no-any-return]


def kernel_input(array: FloatArray, *shape: int) -> FloatArray:
    """Return `array` with `shape`, C-contiguous and read-only, the one type for which kernels are compiled."""
    view = array.reshape(shape)
    flags = view.flags
    if flags.writeable or not flags.c_contiguous:
        view = np.ascontiguousarray(view).view()
        view.setflags(write=False)
    return view


def in_batch(array: NDArray[_Scalar], batch: tuple[int, ...]) -> NDArray[_Scalar]:
    """Return a result (n, ...) of a kernel with the batch axes `batch` in place of n, read-only."""
    # taking the only member is quicker than reshaping, but turns a vector into a number
    alone = not batch and array.ndim > 1
    result: NDArray[_Scalar] = array[0] if alone else array.reshape(batch + array.shape[1:])
    result.setflags(write=False)
    return result


@functools.cache
def _digest_of_sources(module: Path) -> str:
    """Digest of the sources of a kernel module and of all kernel modules that it imports from."""
    sources: dict[Path, str] = {}
    pending = [module]
    while pending:
        path = pending.pop()
        if path not in sources:
            sources[path] = path.read_text(encoding="utf-8")
            pending += [_PACKAGE / room / f"{name}.py" for room, name in _IMPORT.findall(sources[path])]
    return hashlib.sha256(repr(sorted(sources.values())).encode()).hexdigest()


def _stamp_with_sources(compiled: Any) -> None:
    """Invalidate the cached code of a kernel when a kernel that it calls changes.

    numba checks the kernel's own file only, and would keep using what it inlined from another one. It offers no
    public way to change that; should its internals differ from what is expected, its own rule applies.
    """
    cache_file = getattr(getattr(compiled, "_cache", None), "_cache_file", None)
    if cache_file is not None and hasattr(cache_file, "_source_stamp"):
        path = Path(compiled.py_func.__code__.co_filename)
        if path.exists():
            cache_file._source_stamp = (cache_file._source_stamp, _digest_of_sources(path))


class _CompilationNotice(event.Listener):  # type: ignore[misc]
    """Logs once that kernels are being compiled, because the first calls then take so long."""

    def __init__(self) -> None:
        self._said = False

    def on_start(self, event: Any) -> None:
        function = event.data["dispatcher"].py_func
        if not self._said and function.__module__.startswith("cspr_kinematics."):
            self._said = True
            when = "in every process" if _without_cache else "once after installation"
            later = "" if _without_cache else ", and later starts load them from the cache"
            logger.warning(
                "cspr_kinematics: compiling its kernels for this machine, %s; all of them take a minute or two%s",
                when,
                later,
            )

    def on_end(self, event: Any) -> None:
        """Do nothing; the base class requires it."""


event.register("numba:compile", _CompilationNotice())
