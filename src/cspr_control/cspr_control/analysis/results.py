"""Everything that is written about analysed runs: metrics.json, the figures and the report."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from cspr_control.analysis.figures.all_figures import save_figures
from cspr_control.analysis.report import write_report
from cspr_control.analysis.run_analysis import RunAnalysis
from cspr_msgs_py.json_file import write_json

METRICS = "metrics.json"
REPORT = "report.html"
FIGURES = "figures"


def default_directory(bags: Sequence[Path]) -> Path:
    """Return where results go by default: beside the first bag."""
    return bags[0].resolve().parent / ("analysis" if len(bags) == 1 else "comparison")


def metrics_mapping(runs: Sequence[RunAnalysis]) -> dict[str, Any]:
    """Return what metrics.json holds."""
    return {"runs": [{"name": run.name, **run.metrics.as_mapping(), "remarks": run.remarks} for run in runs]}


def write_results(
    runs: Sequence[RunAnalysis],
    directory: Path,
    *,
    figures: bool = True,
    progress: Callable[[str], None] | None = None,
) -> list[Path]:
    """Write all results about runs into a directory; results of the same name there are replaced.

    Parameters
    ----------
    runs
        At least one.
    directory
        Made if it does not exist.
    figures
        Whether to draw pictures; they take longest.
    progress
        Called with the name of what is written next.

    Returns
    -------
    The pictures, PNG in `FIGURES`; an SVG lies beside each. The other results are `METRICS` and `REPORT`.

    Raises
    ------
    OSError
        If something cannot be written.
    """
    directory.mkdir(parents=True, exist_ok=True)
    write_json(directory / METRICS, metrics_mapping(runs))
    if progress is not None:
        progress(REPORT)
    write_report(runs, directory / REPORT)
    return save_figures(runs, directory / FIGURES, progress) if figures else []
