"""The report in a real browser: it draws, moves, hides, zooms, and complains about nothing."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from cspr_control.analysis.report import write_report
from cspr_control.analysis.run_analysis import RunAnalysis, analyse_bags

from ..conftest import CONFIG
from .browser import Browser, find_chromium, running_browser

CHROMIUM = find_chromium()
pytestmark = pytest.mark.skipif(
    CHROMIUM is None,
    reason="no Chromium here, which shows whether the report works: apt-get install chromium",
)


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    assert CHROMIUM is not None
    with running_browser(CHROMIUM, tmp_path_factory.mktemp("profile")) as browser:
        yield browser


@pytest.fixture(scope="module")
def report(run: RunAnalysis, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("report") / "report.html"
    write_report([run], path)
    return path


@pytest.fixture
def page(browser: Browser, report: Path) -> Iterator[Browser]:
    """The report of one run, freshly loaded; at the end it must have been content."""
    browser.troubles.clear()
    browser.requests.clear()
    browser.open(report)
    yield browser
    assert browser.troubles == []


def picture(page: Browser, canvas: str) -> str:
    """Pixels of a canvas."""
    return str(page.evaluate(f"{canvas}.toDataURL()"))


def test_it_loads_from_a_file_and_asks_for_nothing_else(page: Browser, report: Path) -> None:
    assert page.evaluate("document.body.dataset.ready") == "true"
    assert page.evaluate("document.getElementById('failure').hidden")
    assert [url for url in page.requests if not url.startswith("data:")] == [report.resolve().as_uri()]
    assert page.evaluate("document.title") == "prototype: PDFF + mass"


def test_errors_of_a_page_are_noticed(browser: Browser, tmp_path: Path) -> None:
    bad = tmp_path / "bad.html"
    bad.write_text(
        "<body data-ready=true><script>console.error('first'); setTimeout(() => { throw new Error('second'); })"
        "</script><img src='nothing.png'></body>",
        encoding="utf-8",
    )
    browser.troubles.clear()
    browser.requests.clear()
    browser.open(bad)
    browser.wait("document.images[0].complete")
    browser.evaluate("new Promise((done) => setTimeout(done, 20))")
    found = " ".join(browser.troubles)
    assert "first" in found
    assert "second" in found
    assert any(url.endswith("nothing.png") for url in browser.requests)


def test_samples_arrive_as_they_were_recorded(page: Browser, run: RunAnalysis) -> None:
    tensions = run.recording.tensions
    assert tensions is not None
    time = run.recording.seconds(tensions.time_ns)
    for row in (0, 700, len(time) - 1):
        shown = page.evaluate(
            f"page.runs[0].blocks.tensions.columns.slice(0, 8).map((column) => column[{row}])"
        )
        assert shown == pytest.approx(tensions.effort[row].tolist(), abs=0.05)
        assert page.evaluate(f"page.runs[0].blocks.tensions.time[{row}]") == pytest.approx(
            time[row], abs=2e-5
        )


def test_the_slider_moves_the_platform(page: Browser) -> None:
    where = "page.scenes[0].platform.position"
    canvas = "page.scenes[0].canvas"
    move = """(() => { const slider = document.getElementById('time-slider');
        slider.value = '%s'; slider.dispatchEvent(new Event('input')); })()"""
    page.evaluate(move % "0")
    assert page.evaluate(where) == pytest.approx([0.0, 0.0, 1.0], abs=1e-4)
    before = picture(page, canvas)
    page.evaluate(move % "2")  # half of the swing: farthest along x, highest
    assert page.evaluate(where) == pytest.approx([0.3, 0.0, 1.15], abs=1e-4)
    assert picture(page, canvas) != before
    assert page.evaluate("document.getElementById('time-text').textContent") == "2.00 s"
    assert "payload 100 kg" in page.evaluate("page.scenes[0].caption.textContent")


def test_play_runs_to_the_end_and_stops(page: Browser) -> None:
    page.evaluate("document.getElementById('speed').value = '10'")
    page.evaluate("document.getElementById('play').click()")
    assert page.evaluate("page.playing")
    page.wait("!page.playing")
    assert page.evaluate("page.time") == pytest.approx(page.evaluate("page.whole[1]"))


def test_a_motor_can_be_hidden(page: Browser) -> None:
    chart = "page.charts.find((chart) => chart.id === 'position-errors')"
    page.evaluate(f"{chart}.element.scrollIntoView()")
    page.wait(f"{chart}.panels[0].range")
    names = f"{chart}.panels[0].shown.map((series) => series.name)"
    canvas = f"{chart}.panels[0].canvas"
    before, all_names = picture(page, canvas), page.evaluate(names)
    assert all_names == [f"motor {k}" for k in range(1, 9)]
    page.evaluate("document.querySelector('button.motor[data-motor=\"8\"]').click()")
    assert page.evaluate(names) == all_names[:-1]
    assert (
        page.evaluate("document.querySelector('[data-motor=\"8\"]').getAttribute('aria-pressed')") == "false"
    )
    # motor 8 has the largest error, 8 degrees: without it the scale ends at 7 and a margin
    assert page.evaluate(f"{chart}.panels[0].range[1]") < 8.0
    assert picture(page, canvas) != before
    page.evaluate("document.querySelector('button.motor[data-motor=\"8\"]').click()")
    assert page.evaluate(names) == all_names


def test_dragging_zooms_every_figure_and_hovering_tells_the_values(page: Browser) -> None:
    panel = "page.charts.find((chart) => chart.id === 'lengths').panels[0]"
    page.evaluate(f"{panel}.element.scrollIntoView({{block: 'center'}})")
    page.wait(f"{panel}.range")
    box = page.evaluate(f"(({{x, y}}) => [x, y])({panel}.overlay.getBoundingClientRect())")
    left, right = (box[0] + page.evaluate(f"{panel}.x({t})") for t in (1.0, 3.0))
    y = box[1] + 60
    page.mouse("mouseMoved", left, y)
    page.mouse("mousePressed", left, y, button="left", clickCount=1)
    page.mouse("mouseMoved", 0.5 * (left + right), y, button="left")
    page.mouse("mouseMoved", right, y, button="left")
    page.mouse("mouseReleased", right, y, button="left", clickCount=1)
    page.wait("page.view[0] > 0.5")
    assert page.evaluate("page.view") == pytest.approx([1.0, 3.0], abs=0.03)
    page.mouse("mouseMoved", 0.5 * (left + right), y)
    page.wait("!document.getElementById('tip').hidden")
    tip = page.evaluate("document.getElementById('tip').textContent")
    assert "cable 1: " in tip
    assert "cable 8: " in tip
    page.evaluate("document.getElementById('view-all').click()")
    assert page.evaluate("page.view") == page.evaluate("page.whole")


def test_events_and_configuration_are_there_as_text(page: Browser) -> None:
    events = page.evaluate("document.getElementById('events').textContent")
    assert "second </script> lift" in events
    assert "payload 50 kg to 100 kg" in events
    assert "cable_5 is slack" in events
    assert "exit_points" in page.evaluate("document.getElementById('configuration').textContent")
    assert page.evaluate("page.runs[0].events.filter((event) => event.kind === 'mark').map((event) => event.time)") \
        == pytest.approx([1.5], abs=0.001)  # fmt: skip


def test_two_runs_side_by_side(
    browser: Browser, recorded_bag: Path, record: Callable[..., Path], tmp_path: Path
) -> None:
    other = record("other", fault=True, duration=4.0, model="static", control_text="/**:\n  kp: 3.0\n")
    runs = analyse_bags([recorded_bag, other], configuration_directory=CONFIG)
    write_report(runs, tmp_path / "two.html")
    browser.troubles.clear()
    browser.open(tmp_path / "two.html")
    assert browser.evaluate("page.scenes.length") == 2
    columns = "[...document.querySelectorAll('#summary-table thead th')].map((cell) => cell.textContent)"
    assert browser.evaluate(columns) == ["", "PDFF + mass", "PD + static"]
    assert browser.evaluate("page.charts.find((chart) => chart.id === 'tensions').panels.length") == 2
    assert (
        browser.evaluate("page.charts.find((chart) => chart.id === 'motor-3').panels[0].series.length") == 2
    )
    assert "robot fault: cable 5 is slack" in browser.evaluate(
        "document.getElementById('events').textContent"
    )
    assert "kp" in browser.evaluate("document.querySelector('.difference').textContent")
    browser.evaluate("window.scrollTo(0, document.body.scrollHeight)")
    browser.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    assert browser.screenshot(tmp_path / "two.png").stat().st_size > 20_000
    assert browser.troubles == []


def test_the_figures_of_three_runs_have_the_whole_width(
    browser: Browser, recorded_bag: Path, tmp_path: Path
) -> None:
    widths = []
    for number in (1, 3):
        runs = analyse_bags([recorded_bag] * number, configuration_directory=CONFIG)
        write_report(runs, tmp_path / f"{number}.html")
        browser.troubles.clear()
        browser.open(tmp_path / f"{number}.html")
        widths.append(browser.evaluate("document.getElementById('tensions').clientWidth"))
        assert browser.evaluate("page.scenes.length") == number
        assert browser.evaluate("document.getElementById('remarks').hidden")
        assert browser.troubles == []
    assert widths[1] > 1.8 * widths[0]


def test_times_without_tensions_show_as_well(
    browser: Browser, record: Callable[..., Path], tmp_path: Path
) -> None:
    """Load cells that are silent at first, and again at the end."""
    runs = analyse_bags([record(silent_cells=0.3)], configuration_directory=CONFIG)
    write_report(runs, tmp_path / "silent.html")
    browser.troubles.clear()
    browser.open(tmp_path / "silent.html")
    for place in ("page.whole[0]", "page.whole[1]", "0.5"):
        browser.evaluate(f"page.setTime({place})")
        known = browser.evaluate("page.scenes[0].tensions.every(Number.isFinite)")
        assert known is (place == "0.5")
    assert browser.troubles == []


def test_a_run_that_lacks_nearly_everything_still_shows(
    browser: Browser, record: Callable[..., Path], tmp_path: Path
) -> None:
    kept = {"/motor_states"}
    every = {"/setpoint", "/cable_tensions", "/reference", "/platform_pose", "/payload", "/simulation/payload",
             "/robot_state", "/trajectory_state", "/diagnostics", "/motor_1/command", "/rosout", "/events"}  # fmt: skip
    runs = analyse_bags([record(omitted=tuple(every - kept))], configuration_directory=CONFIG)
    write_report(runs, tmp_path / "bare.html")
    browser.troubles.clear()
    browser.open(tmp_path / "bare.html")
    assert browser.evaluate("document.body.dataset.ready") == "true"
    assert browser.evaluate("page.scenes[0].caption.textContent") == "no pose recorded at this time"
    remarks = "document.getElementById('remarks')"
    assert "/cable_tensions" in browser.evaluate(f"{remarks}.textContent")
    assert len(runs[0].remarks) > 4
    assert browser.evaluate(f"{remarks}.firstChild.textContent") == f"{len(runs[0].remarks)} remarks"
    assert not browser.evaluate(f"{remarks}.open")
    browser.evaluate(f"{remarks}.firstChild.click()")
    assert browser.evaluate(f"{remarks}.open")
    assert browser.troubles == []
