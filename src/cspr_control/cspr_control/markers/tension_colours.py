"""One colour scale for cable tensions, in pictures, in the report and live."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

TENSION_COLOURS: Final = ("#0d0887", "#5e01a6", "#9e199d", "#cd4a76", "#ef7e50", "#feba2c")
"""From a slack to a heavily loaded cable: matplotlib's "plasma" without its palest end."""

UNKNOWN: Final = (0.6, 0.6, 0.6)
"""Red, green and blue of a cable whose tension is not known."""

_RGB = np.array([[int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5)] for colour in TENSION_COLOURS])


def tension_colours(tensions: ArrayLike, lowest: ArrayLike, highest: ArrayLike) -> NDArray[np.float64]:
    """Return the colours of tensions.

    Parameters
    ----------
    tensions
        (m,), N; NaN where it is not known.
    lowest, highest
        Tensions at the two ends of the scale, of all cables or of each (m,), N; what lies beyond has the colour of
        the end.

    Returns
    -------
    Red, green and blue (m, 3), each in [0, 1].
    """
    tensions = np.asarray(tensions, dtype=float)
    known = np.isfinite(tensions)
    low, high = np.asarray(lowest, dtype=float), np.asarray(highest, dtype=float)
    share = np.clip((np.where(known, tensions, low) - low) / (high - low), 0.0, 1.0)
    places = np.linspace(0.0, 1.0, len(_RGB))
    colours = np.stack([np.interp(share, places, _RGB[:, channel]) for channel in range(3)], axis=-1)
    return np.where(known[:, None], colours, UNKNOWN)
