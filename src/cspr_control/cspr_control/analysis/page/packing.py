"""Samples as a page carries them: quantised to 16 bits, as differences, compressed, in text.

A block is a column of times and some columns of values at these times. Layout: 32 bits a time, then 16 bits a value,
column by column, little-endian, each as the difference to the one before (modulo its width), the first to zero.
``page/data.js`` reads it back.
"""

from __future__ import annotations

import base64
import gzip
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

TICK: Final = 1e-5
"""Resolution of times, s."""

NOTHING: Final = -32768
"""Stands for NaN."""

_LARGEST: Final = 32767
_ALIGNMENT: Final = 4


class Packer:
    """Collects blocks of samples."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._size = 0

    def add(self, time: Floats, values: Floats) -> dict[str, Any]:
        """Add a block and return what the page needs to find and read it.

        Parameters
        ----------
        time
            (n,), s; finite, within 5 hours of zero.
        values
            (n, k); NaN where there is nothing, infinities count as NaN.
        """
        ticks = np.rint(time / TICK).astype(np.int64)
        columns = []
        data = [np.diff(ticks, prepend=0).astype("<i4").tobytes()]
        for column in np.where(np.isfinite(values), values, np.nan).T:
            known = column[~np.isnan(column)]
            low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)
            offset, scale = 0.5 * (low + high), max(0.5 * (high - low), 1e-12) / _LARGEST
            levels = np.where(np.isnan(column), NOTHING, np.rint((np.nan_to_num(column) - offset) / scale))
            data.append(np.diff(levels.astype(np.int64), prepend=0).astype("<i2").tobytes())
            columns.append([scale, offset])
        block = b"".join(data)
        block += bytes(-len(block) % _ALIGNMENT)
        description = {"offset": self._size, "rows": int(time.size), "tick": TICK, "columns": columns}
        self._parts.append(block)
        self._size += len(block)
        return description

    def text(self) -> str:
        """Return all blocks as compressed base64; the same samples give the same text."""
        return base64.b64encode(gzip.compress(b"".join(self._parts), compresslevel=6, mtime=0)).decode()
