import time

import pytest

from cspr_drivers.config.can_file import LoadCellChecks
from cspr_drivers.load_cells.master import LoadCellMaster
from cspr_drivers.load_cells.stuck_cells import StuckCells


class Rig:
    """A driver with its published tensions."""

    def __init__(self, config, ports):
        self.lines = []
        self.published = []
        self.ports = ports
        self.master = LoadCellMaster(
            config, ports, lambda *cycle: self.published.append(cycle), self.lines.append
        )

    def sync(self):
        self.ports.send_sync()

    def report(self):
        return self.master.snapshot(0.0)


@pytest.fixture
def rig(config, ports, far_end, wait_until):
    rig = Rig(config, ports)
    rig.master.start()
    wait_until(lambda: not rig.report().not_configured and all(cell.operational for cell in far_end.cells))
    yield rig
    rig.master.stop()


def test_amplifiers_are_configured_and_started(rig, far_end, wait_until):
    cell = far_end.cells[0]
    wait_until(lambda: all(cell.operational for cell in far_end.cells))
    assert cell.read(0x6131, 1) == 0x00210000
    assert cell.read(0x6132, 1) == 1
    assert cell.read(0x1017) == 30
    assert cell.read(0x1800, 1) == 0x4000_018B
    assert cell.read(0x1800, 2) == 1
    assert [cell.read(0x1A00, n) for n in (0, 1, 2)] == [2, 0x9130_0120, 0x6150_0108]


def test_tensions_of_one_sync_are_published_together(rig, wait_until):
    rig.sync()
    wait_until(lambda: rig.published)
    stamp, tensions = rig.published[0]
    assert tensions == pytest.approx([110.0, 120.0, 130.0, 140.0, 150.0, 160.0, 170.0, 180.0])
    rig.sync()
    wait_until(lambda: len(rig.published) == 2)
    assert rig.published[1][0] > stamp


def test_a_silent_cell_is_named_and_nothing_is_made_up(rig, far_end, wait_until):
    far_end.cells[2].answers_sync = False
    wait_until(lambda: rig.sync() or rig.report().statistics.problems == {"cable_3": "silent"})
    assert rig.published == []
    statistics = rig.report().statistics
    assert statistics.missing["cable_3"] == statistics.incomplete_cycles == statistics.cycles


def test_a_cell_in_overload_is_named_and_nothing_is_published(rig, far_end, wait_until):
    far_end.cells[0].status = 0x02
    expected = {"cable_1": "positive overload"}
    wait_until(lambda: rig.sync() or rig.report().statistics.problems == expected)
    assert rig.published == []


def test_a_frame_cut_short_is_counted_and_missing(rig, ports, far_end, wait_until):
    far_end.cells[1].answers_sync = False
    rig.sync()
    far_end.send(0x18C, bytes(4))
    wait_until(lambda: ports["main"].malformed_frames == 1)
    assert ports["main"].last_problem == "frame of COB-ID 0x18C: frame of 4 bytes where 5 were expected"
    assert rig.published == []


def test_sync_of_another_process_gives_the_stamp(rig, far_end, wait_until):
    far_end.send(0x080, b"")
    far_end._sync()
    wait_until(lambda: rig.published)
    assert rig.published[0][0] > 1e18


def test_tare_writes_autozero_to_slack_cells_only(rig, far_end, wait_until):
    assert rig.master.tare(1000.0) == "cable_1 gives no valid value"
    rig.sync()
    wait_until(lambda: rig.published)
    rig.sync()
    assert rig.master.tare(100.0) == "cable_1 carries 110 N: only slack cables, below 100 N, can be tared"
    assert rig.master.tare(1000.0) is None
    wait_until(lambda: rig.report().tare_result == "all load cells tared")
    assert all(cell.objects[0x6125, 1] == b"zero" for cell in far_end.cells)


def test_a_failed_tare_names_the_cell(rig, far_end, wait_until):
    far_end.cells[4].aborts[0x6125, 1] = 0x0800_0022
    rig.sync()
    wait_until(lambda: rig.published)
    rig.sync()
    wait_until(lambda: rig.master.tare(1000.0) is None)
    wait_until(lambda: rig.report().tare_result)
    assert rig.report().tare_result.startswith(
        "taring failed: cable_5 (node 15 on main): refuses 6125h:01 (AI autozero)"
    )


def test_a_cell_that_restarts_is_configured_again(rig, far_end, wait_until):
    cell = far_end.cells[6]
    cell.restart()
    far_end.send(0x711, [0])
    wait_until(lambda: cell.operational)
    assert cell.writes


def test_a_cell_without_heartbeat_is_reported_and_configured_again(rig, far_end, wait_until):
    far_end.cells[3].restart()
    rig.master.watch(1e9)
    assert "cable_4 (node 14 on main): no heartbeat for" in rig.lines[3]
    wait_until(lambda: far_end.cells[3].writes)


def test_an_answer_lost_while_taring_is_not_asked_for_again(rig, far_end, wait_until):
    far_end.cells[4].unanswered[0x6125, 1] = 1
    rig.sync()
    wait_until(lambda: rig.published)
    rig.sync()
    wait_until(lambda: rig.master.tare(1000.0) is None)
    wait_until(lambda: rig.report().tare_result)
    assert rig.report().tare_result == "taring failed: cable_5 (node 15 on main): does not answer"
    assert [write for write in far_end.cells[4].writes if write[0] == 0x6125] == [(0x6125, 1, b"zero")]


def problems(rig):
    return rig.master.problems(time.monotonic())


def test_what_is_wrong_with_a_cell_is_named(rig, far_end, wait_until):
    far_end.cells[2].answers_sync = False
    far_end.cells[5].status = 0x01
    expected = {"cable_3": "silent", "cable_6": "not valid"}
    wait_until(lambda: rig.sync() or problems(rig) == expected)
    far_end.cells[2].answers_sync = True
    far_end.cells[5].status = 0x00
    wait_until(lambda: rig.sync() or problems(rig) == {})


def test_a_cell_at_the_end_of_its_range_is_saturated_whatever_its_status_says(rig, far_end, wait_until):
    far_end.cells[3].value = 50_000  # 9149h of the scripted amplifiers
    expected = {"cable_4": "at the end of its measuring range"}
    wait_until(lambda: rig.sync() or problems(rig) == expected)
    published = len(rig.published)
    rig.sync()
    assert len(rig.published) == published


def test_the_errors_of_a_cell_are_named(rig, far_end, wait_until):
    far_end.send(0x08C, bytes.fromhex("00 50 81 00 00 00 00 00"))
    wait_until(
        lambda: rig.sync() or problems(rig) == {"cable_2": "reports device hardware (error code 0x5000)"}
    )
    far_end.send(0x08C, bytes(8))
    wait_until(lambda: rig.sync() or problems(rig) == {})


CHECKS = LoadCellChecks(stuck_time=1.0, stuck_span=20.0)


def test_a_cell_that_does_not_change_while_others_do_is_stuck():
    cells = StuckCells(3, CHECKS)
    for step in range(200):
        cells.observe(0.01 * step, (100.0 + step, 200.0, 300.0 + step % 2))
    assert cells.stuck == {1}
    cells.observe(2.0, (300.0, 200.1, 300.0))
    assert cells.stuck == frozenset()


def test_cells_that_show_the_same_because_nothing_moves_are_sound():
    cells = StuckCells(3, CHECKS)
    for step in range(400):
        cells.observe(0.01 * step, (100.0, 200.0, 300.0 + step % 2))
    assert cells.stuck == frozenset()


def test_a_cell_that_leaves_nmt_operational_is_started_again(rig, far_end, wait_until):
    cell = far_end.cells[1]
    cell.operational = False
    far_end.send(0x70C, [127])

    def started_again():
        far_end.send(0x70C, [5 if cell.operational else 127])
        rig.master.watch(time.monotonic())
        return cell.operational

    wait_until(started_again)
    assert "cable_2 (node 12 on main): left NMT operational, it is pre-operational" in rig.lines


@pytest.mark.parametrize("which", ["device set-up", "bus main"])
def test_a_thread_that_ends_is_a_problem_of_all_cells(rig, ports, far_end, wait_until, monkeypatch, which):
    ended = f"the driver's thread '{which}' has ended (RuntimeError: defect): start the driver again"

    def defect(index):
        raise RuntimeError("defect")

    if which == "bus main":
        ports["main"].ended = ended
    else:
        monkeypatch.setattr(rig.master._setup, "_allowed", defect)
        far_end.send(0x711, [0])
    wait_until(lambda: rig.master.problems(0.0) == {f"cable_{k + 1}": ended for k in range(8)})


def test_whatever_ends_a_taring_is_told(rig, wait_until, monkeypatch, capsys):
    rig.sync()
    wait_until(lambda: rig.published)
    rig.sync()
    monkeypatch.setattr(rig.master, "_devices", [None])
    assert rig.master.tare(1000.0) is None
    wait_until(lambda: rig.report().tare_result)
    assert rig.report().tare_result == "taring failed: 'NoneType' object has no attribute 'write'"
    assert "Traceback" in capsys.readouterr().err
    monkeypatch.undo()
