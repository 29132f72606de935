"""Pictures: every figure is drawn, in a style that anybody can read."""

from __future__ import annotations

import itertools
import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text
from mpl_toolkits.mplot3d import Axes3D

from cspr_control.analysis.figures import all_figures as figures
from cspr_control.analysis.figures.all_figures import payload_change, save_figures
from cspr_control.analysis.figures.paper import (
    deviation_figure,
    motor_error_figure,
    motor_error_over_time_figure,
    payload_change_figure,
)
from cspr_control.analysis.figures.style import (
    COLOURS,
    controller_title,
    house_style,
    motor_line,
    save_figure,
)
from cspr_control.analysis.numbers.cycles import cycle_bins
from cspr_control.analysis.numbers.error_statistics import ErrorStatistics
from cspr_control.analysis.run_analysis import RunAnalysis, analyse_bags

_DOCUMENT = (Path(__file__).parents[4] / "docs" / "analysis.md").read_text(encoding="utf-8")
_ROWS = re.findall(r"^\|(.*?)\|", _DOCUMENT.split("\n## Figures\n")[1].split("\n## ")[0], re.MULTILINE)
DESCRIBED = {name for row in _ROWS for name in re.findall(r"`(\w+)`", row)}
# Machado, Oliveira and Fernandes (2009), "A Physiologically-based Model for Simulation of Color Vision Deficiency",
# severity 1, on linear RGB
VISION = {
    "normal": np.eye(3),
    "protanopia": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "deuteranopia": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
    "tritanopia": np.array(
        [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]]
    ),
}


def linear(colour: str) -> np.ndarray:
    """Linear RGB of a colour in sRGB (IEC 61966-2-1)."""
    channels = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255.0
    return np.where(channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4)


def lab(rgb: np.ndarray) -> np.ndarray:
    """CIE L*a*b* with white D65."""
    to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    x, y, z = to_xyz @ np.clip(rgb, 0.0, 1.0) / (0.9505, 1.0, 1.0888)
    f = [np.cbrt(v) if v > 0.008856 else 7.787 * v + 16.0 / 116.0 for v in (x, y, z)]
    return np.array([116.0 * f[1] - 16.0, 500.0 * (f[0] - f[1]), 200.0 * (f[1] - f[2])])


@pytest.mark.parametrize("vision", VISION)
def test_colours_stay_apart_with_any_colour_vision(vision: str) -> None:
    seen = {colour: lab(VISION[vision] @ linear(colour)) for colour in COLOURS}
    for (one, first), (other, second) in itertools.combinations(seen.items(), 2):
        assert np.linalg.norm(first - second) > 15.0, f"{one} and {other}"


def test_colours_can_be_seen_on_white() -> None:
    for colour in COLOURS:
        luminance = float(np.array([0.2126, 0.7152, 0.0722]) @ linear(colour))
        assert 1.05 / (luminance + 0.05) > 2.2, colour


def test_more_motors_than_colours_are_dashed() -> None:
    lines = [motor_line(k) for k in range(16)]
    assert len({tuple(line.values()) for line in lines}) == 16


def test_controllers_have_their_names_of_the_paper() -> None:
    assert controller_title("pdff-mass") == "PDFF + mass"
    assert controller_title("pdff (exact mass) 2026-01-01") == "PDFF, exact mass 2026-01-01"
    assert controller_title("kp 4") == "kp 4"


def test_every_figure_of_a_run_is_described_and_stored_as_png_and_svg(
    run: RunAnalysis, tmp_path: Path
) -> None:
    pictures = save_figures([run], tmp_path)
    assert {path.stem for path in pictures} == DESCRIBED
    for path in pictures:
        assert path.read_bytes().startswith(b"\x89PNG")
        assert path.stat().st_size > 5_000
        assert ElementTree.parse(path.with_suffix(".svg")).getroot().tag.endswith("svg")


def texts_that_overlap(figure: Figure) -> list[tuple[str, str]]:
    """Return pairs of texts in a figure that lie on one another by more than a pixel."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    hidden = {
        tick.label1
        for axes in figure.axes
        if not isinstance(axes, Axes3D)
        for axis in (axes.xaxis, axes.yaxis)
        for tick in (*axis.get_major_ticks(), *axis.get_minor_ticks())
        if not min(axis.get_view_interval()) - 1e-9 <= tick.get_loc() <= max(axis.get_view_interval()) + 1e-9
    }
    shown = [
        (text.get_text(), text.get_window_extent(canvas.get_renderer()).padded(-1.0))
        for text in figure.findobj(Text)
        if text.get_text().strip() and text.get_visible() and text not in hidden
    ]
    return [(a, b) for (a, one), (b, other) in itertools.combinations(shown, 2) if one.overlaps(other)]


def test_no_text_lies_on_another(
    run: RunAnalysis, recorded_bag: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    found: dict[str, list[tuple[str, str]]] = {}

    def look(figure: Figure, directory: Path, name: str) -> tuple[Path, Path]:
        found[name] = texts_that_overlap(figure)
        return directory / name, directory / name

    monkeypatch.setattr(figures, "save_figure", look)
    save_figures([run], tmp_path)
    save_figures(analyse_bags([recorded_bag, recorded_bag], ["kp 2", "kp 4"]), tmp_path)
    assert found.keys() > DESCRIBED
    assert {name: texts for name, texts in found.items() if texts} == {}


def test_overlapping_texts_are_noticed() -> None:
    figure = Figure()
    for x in (0.5, 0.52):
        figure.text(x, 0.5, "a word")
    assert texts_that_overlap(figure) == [("a word", "a word")]


def test_a_change_of_the_load_is_named_where_it_is_marked(run: RunAnalysis) -> None:
    (time, text), *others = run.load_changes().items()
    assert (time, text, others) == (pytest.approx(2.0, abs=0.03), "+50 kg", [])


def test_controllers_that_do_the_same_can_both_be_seen() -> None:
    names = ("pd", "static", "pdff", "pdff-mass", "pdff (exact mass)")
    time = np.arange(0.0, 5.0, 0.1)
    (axis,) = motor_error_over_time_figure({"100 kg": dict.fromkeys(names, (time, time))}).axes
    styles = [line.get_linestyle() for line in axis.lines]
    assert styles == ["-", "-", "--", "-", "--"]  # matplotlib's word for dashes of any length


def test_a_change_is_marked_in_the_panels_of_those_runs_alone_that_had_it() -> None:
    time = np.arange(0.0, 5.0, 0.1)
    errors = {load: {"static": (time, np.sin(time))} for load in ("100 kg", "100, then 200 kg")}
    constant, changed = motor_error_over_time_figure(errors, 3, {"100, then 200 kg": {3.0: "+100 kg"}}).axes
    assert [text.get_text() for text in changed.texts] == [" +100 kg"]
    assert not constant.texts
    assert len(changed.lines) == len(constant.lines) + 1


@pytest.mark.parametrize(
    ("longest", "most", "width"),
    [(0.0125, 120, 0.0002), (0.0458, 80, 0.001), (0.0041, 80, 0.0001), (3.0, 80, 0.05), (0.0, 80, 2e-8)],
)
def test_usual_periods_lie_in_the_middle_of_a_bin(longest: float, most: int, width: float) -> None:
    edges = cycle_bins(longest, most)
    assert len(edges) - 1 <= most
    np.testing.assert_allclose(np.diff(edges), width)
    assert edges[-1] > longest
    for period in (0.002, 0.004):
        if width < period < longest:
            counts, _ = np.histogram(period + np.array([-0.4, 0.0, 0.4]) * width, edges)
            assert sorted(counts)[-1] == 3


def test_figure_10_ends_where_the_acceleration_does(run: RunAnalysis) -> None:
    found = payload_change(run)
    assert found is not None
    change, time_ns, deviation = found
    assert (change.mass_before, change.mass) == (50.0, 100.0)
    time = run.recording.seconds(time_ns)
    assert time[0] == pytest.approx(0.0, abs=1e-6)
    assert time[-1] == pytest.approx(4.0, abs=0.005)
    assert deviation.shape == (time.size, 1)


def test_drawn_values_are_the_given_ones(tmp_path: Path) -> None:
    with house_style():
        errors = {"static": {200.0: np.arange(1.0, 9.0), 0.0: np.ones(8)}}
        (axis,) = motor_error_figure(errors).axes
        assert [label.get_text() for label in axis.get_xticklabels()] == ["0", "200"]
        heights = sorted(bar.get_height() for bar in axis.patches)
        np.testing.assert_allclose(heights, sorted([*np.ones(8), *np.arange(1.0, 9.0)]))
        assert axis.get_ylabel() == "RMS position error, deg"

        one = ErrorStatistics.of(np.array([[1.0, -2.0], [3.0, 2.0]]))
        maximum, median, rms = deviation_figure({"(18)": one}).axes
        for axis, values in ((maximum, one.maximum), (median, one.median), (rms, one.rms)):
            np.testing.assert_allclose([bar.get_height() for bar in axis.patches], values)

        time = np.arange(0.0, 5.0, 0.1)
        change = payload_change_figure(time, np.where(time < 3.0, 2.0, 5.0), 3.0)
        bars = [bar.get_height() for bar in change.axes[1].patches]
        np.testing.assert_allclose(bars, [2.0] * 3 + [5.0] * 3 + [-3.0] * 3)
        picture, drawing = save_figure(change, tmp_path, "fig10")
        again = payload_change_figure(time, np.where(time < 3.0, 2.0, 5.0), 3.0)
        assert save_figure(again, tmp_path / "again", "fig10")[1].read_bytes() == drawing.read_bytes()
        assert picture.name == "fig10.png"
