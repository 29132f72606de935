"""The one look of every figure, on paper and on the page: colours, sizes, and how a figure is stored.

Colours: those of Okabe and Ito (2008), "Color Universal Design", with the wine red of Paul Tol's "muted" scheme
in place of their yellow, which is too pale for a line on white. With protanopia, deuteranopia or tritanopia, too,
any two of them stay apart.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import matplotlib
from matplotlib.figure import Figure

from cspr_msgs_py.vocabulary import Controller, controller_label

COLOURS: Final = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#111111", "#882255")
"""One for each motor and its cable, in their order; from the ninth on they repeat, dashed."""

PDFF_EXACT: Final = controller_label(Controller.PDFF, exact_mass=True)

CONTROLLERS: Final[Mapping[str, tuple[str, str]]] = {
    Controller.PD: ("PD", COLOURS[6]),
    Controller.STATIC: ("PD + static", COLOURS[5]),
    Controller.PDFF: ("PDFF", COLOURS[1]),
    Controller.PDFF_MASS: ("PDFF + mass", COLOURS[0]),
    PDFF_EXACT: ("PDFF, exact mass", COLOURS[2]),
}
"""Title and colour of those that are compared (docs/model.md, section 5), by their names in the demo."""

DASHED_CONTROLLERS: Final = frozenset({Controller.PDFF, PDFF_EXACT})
"""Those that may coincide with another one: the other, drawn first, shows through their gaps."""

REFERENCE_COLOUR: Final = "#7a7a7a"
"""Of reference and true values beside measured ones."""

EVENT_COLOUR: Final = "#D55E00"
"""Of faults and sudden changes."""

WIDTH: Final = 7.2  # in, two columns of a journal

_STYLE: Final[Mapping[str, Any]] = {
    "figure.dpi": 100,
    "savefig.dpi": 160,
    "font.size": 9.0,
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same picture on every computer
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "grid.color": "#e2e2e2",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.1,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "svg.fonttype": "path",
    "svg.hashsalt": "cspr",  # the same figure gives the same bytes
    "path.simplify_threshold": 0.5,
}


@contextmanager
def house_style() -> Iterator[None]:
    """Draw and store figures in this style inside the block."""
    # whatever the user's own settings are
    parameters: dict[Any, Any] = {**matplotlib.rcParamsDefault, **_STYLE}
    with matplotlib.rc_context(parameters):
        yield


def motor_line(index: int) -> dict[str, str]:
    """Return colour and line style of the motor or cable with this index, counted from 0, for ``Axes.plot``."""
    dashed = index // len(COLOURS) % 2
    return {"color": COLOURS[index % len(COLOURS)], "linestyle": "--" if dashed else "-"}


def controller_colour(name: str, index: int) -> str:
    """Return the colour of a controller by its name, or of the `index`-th of those whose name is not known."""
    return CONTROLLERS[name][1] if name in CONTROLLERS else COLOURS[index % len(COLOURS)]


def controller_line(name: str, index: int) -> dict[str, Any]:
    """Return colour and line style of a controller, as `controller_colour` does, for ``Axes.plot``."""
    style: Any = (0.0, (4.0, 4.0)) if name in DASHED_CONTROLLERS else "-"
    return {"color": controller_colour(name, index), "linestyle": style}


def controller_title(name: str) -> str:
    """Return how a controller is written in a figure; what follows its name, such as a date, stays."""
    for known in sorted(CONTROLLERS, key=len, reverse=True):
        if name == known or name.startswith(f"{known} "):
            return CONTROLLERS[known][0] + name[len(known) :]
    return name


def save_figure(figure: Figure, directory: Path, name: str) -> tuple[Path, Path]:
    """Store a figure as ``NAME.png`` and ``NAME.svg`` and return both paths."""
    (directory / name).parent.mkdir(parents=True, exist_ok=True)
    picture, drawing = directory / f"{name}.png", directory / f"{name}.svg"
    layout = figure.get_layout_engine()
    if layout is not None:
        layout.execute(figure)  # once for both files
        figure.set_layout_engine("none")
    figure.savefig(picture, metadata={"Software": None})
    figure.savefig(drawing, metadata={"Date": None, "Creator": None})
    return picture, drawing
