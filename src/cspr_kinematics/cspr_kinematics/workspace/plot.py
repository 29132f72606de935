"""Pictures of a workspace: slices through it, coloured by the margin."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cspr_kinematics.arrays import FloatArray
from cspr_kinematics.errors import KinematicsError
from cspr_kinematics.workspace.workspace import Workspace

_HORIZONTAL_SLICES = 4


class PlottingUnavailableError(KinematicsError):
    """Pictures need matplotlib, which is not installed."""

    def __init__(self) -> None:
        super().__init__("pictures need matplotlib, which is not installed here: pip install matplotlib")


def plot_workspace(workspace: Workspace, path: str | Path, title: str = "") -> None:
    """Draw horizontal slices and the two vertical ones through the middle into a picture file.

    Parameters
    ----------
    workspace : Workspace
    path : str or Path
        File to write; its suffix chooses the format (.png, .svg, .pdf).
    title : str

    Raises
    ------
    PlottingUnavailableError
        If matplotlib is not installed.
    """
    try:
        from matplotlib.colors import TwoSlopeNorm
        from matplotlib.figure import Figure
    except ImportError as error:
        raise PlottingUnavailableError from error
    x, y, z = workspace.x, workspace.y, workspace.z
    levels = np.unique(np.linspace(0, len(z) - 1, _HORIZONTAL_SLICES).round().astype(int))
    slices: list[tuple[str, str, str, FloatArray, FloatArray, FloatArray]] = [
        (f"z = {z[k]:.3g} m", "x, m", "y, m", x, y, workspace.margin[:, :, k]) for k in levels
    ]
    middle_x, middle_y = len(x) // 2, len(y) // 2
    slices.append((f"y = {y[middle_y]:.3g} m", "x, m", "z, m", x, z, workspace.margin[:, middle_y, :]))
    slices.append((f"x = {x[middle_x]:.3g} m", "y, m", "z, m", y, z, workspace.margin[middle_x, :, :]))
    finite = workspace.margin[np.isfinite(workspace.margin)]
    largest = max(1.0, float(finite.max())) if finite.size else 1.0
    norm = TwoSlopeNorm(0.0, -largest, largest)
    figure = Figure(figsize=(12.0, 7.5), layout="constrained")
    axes = figure.subplots(2, -(-len(slices) // 2), squeeze=False).ravel()
    for axis, (name, right, up, horizontal, vertical, margin) in zip(axes, slices, strict=False):
        shown = np.clip(margin, -largest, largest).T
        image = axis.pcolormesh(horizontal, vertical, shown, norm=norm, cmap="RdBu", shading="gouraud")
        if shown.min() < 0.0 < shown.max():
            axis.contour(horizontal, vertical, shown, levels=[0.0], colors="black", linewidths=1.5)
        axis.set(title=name, xlabel=right, ylabel=up, aspect="equal")
    for axis in axes[len(slices) :]:
        axis.set_visible(False)
    figure.colorbar(image, ax=list(axes), label="margin, N; negative: not feasible", shrink=0.8)
    if title:
        figure.suptitle(title)
    figure.savefig(path, dpi=120)
