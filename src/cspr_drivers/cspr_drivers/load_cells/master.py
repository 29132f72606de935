"""The driver of all load-cell amplifiers: the tensions of one cycle together, or not at all."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

from cspr_drivers.bus.can_bus import CanPorts
from cspr_drivers.canopen.cia404 import status_text
from cspr_drivers.canopen.emergency import ActiveErrors, Emergency, after
from cspr_drivers.canopen.frame_table import INPUT_STATUS, PROCESS_VALUE, FunctionCode, cob_id
from cspr_drivers.clock import Thread
from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.devices.device import CanopenDevice, NmtCommand
from cspr_drivers.devices.settings import load_cell_tare
from cspr_drivers.devices.setup import set_up_load_cell
from cspr_drivers.devices.setup_thread import Commissioning
from cspr_drivers.errors import DeviceError
from cspr_drivers.load_cells.cycle import TensionCycle, TensionStatistics
from cspr_drivers.load_cells.stuck_cells import StuckCells

_SATURATED = "at the end of its measuring range"

NO_SYNC = 1.0  # s without SYNC after which its absence is reported


@dataclass(frozen=True)
class LoadCellReport:
    """State of the driver at one moment.

    Attributes
    ----------
    sync_age
        Time since the last SYNC, s; `None` before the first.
    statistics
        Of the cycles since the driver started.
    not_configured
        Devices that are not configured, with the reason.
    problems
        What is wrong with a cell, in words; only cells with a problem, by name.
    errors
        Of each cell, that it has reported by emergency messages and not taken back.
    tare_result
        Outcome of the last taring, empty before it.
    """

    sync_age: float | None
    statistics: TensionStatistics
    not_configured: dict[str, str]
    problems: dict[str, str]
    errors: tuple[ActiveErrors, ...]
    tare_result: str


class LoadCellMaster:
    """Driver of the m load cells of a configuration.

    Parameters
    ----------
    config
        Buses, load cells, times.
    ports
        The open buses; they stay open when the driver stops.
    publish
        Given stamp (ns of ROS time) and tensions (m,), N, in the receiving thread, as soon as the last cell
        of a cycle has answered.
    report
        Given lines for the log.
    """

    def __init__(
        self,
        config: CanConfig,
        ports: CanPorts,
        publish: Callable[[int, tuple[float, ...]], None],
        report: Callable[[str], None],
    ) -> None:
        self._config = config
        self._ports = ports
        self._publish = publish
        self._report = report
        self._lock = threading.Lock()
        count = len(config.load_cells)
        self._cycle = TensionCycle([cell.name for cell in config.load_cells])
        self._stuck = StuckCells(count, config.load_cell_checks)
        self._heard = [-math.inf] * count
        self._status = [""] * count  # of the newest value of each cell, empty when it is valid
        self._spans: list[tuple[float, float]] = [(-math.inf, math.inf)] * count
        self._errors: list[ActiveErrors] = [()] * count
        self._sync_time: float | None = None
        self._tare_result = ""
        self._stopped = False
        self._taring: Thread | None = None
        self._value_place = config.pdo.load_cell_tpdo.position(PROCESS_VALUE)
        self._status_place = config.pdo.load_cell_tpdo.position(INPUT_STATUS)
        self._commissioning = Commissioning(
            [str(cell) for cell in config.load_cells], self._configure, lambda: True, report, ports.clock
        )
        self._devices = [
            CanopenDevice(
                str(cell),
                ports[cell.bus],
                cell.node_id,
                config.timeouts.sdo,
                on_boot=partial(self._commissioning.request, index, "restarted"),
                on_emergency=partial(self._emergency, index),
            )
            for index, cell in enumerate(config.load_cells)
        ]

    def start(self) -> None:
        """Begin to configure the amplifiers and to listen to them."""
        for index, cell in enumerate(self._config.load_cells):
            self._ports[cell.bus].subscribe(
                cob_id(FunctionCode.TPDO1, cell.node_id), partial(self._measured, index)
            )
        self._ports.on_sync(self._begin_cycle, self._lock)
        self._commissioning.start()

    def stop(self) -> None:
        """Leave the bus."""
        if self._stopped:
            return
        self._stopped = True
        self._commissioning.stop()
        if self._taring is not None:
            self._taring.join(timeout=2.0)
        for device in self._devices:
            try:
                device.command(NmtCommand.ENTER_PRE_OPERATIONAL)
            except DeviceError:
                break  # the bus takes no frames
        self._ports.off_sync(self._begin_cycle)
        for device, cell in zip(self._devices, self._config.load_cells, strict=True):
            device.release()
            self._ports[cell.bus].unsubscribe(cob_id(FunctionCode.TPDO1, cell.node_id))

    def tare(self, limit: float) -> str | None:
        """Begin to make the present tensions zero; return why not when that is refused.

        Parameters
        ----------
        limit
            Largest absolute tension, N, with which a cable still counts as slack.
        """
        if self._commissioning.problems:
            return f"not configured: {', '.join(self._commissioning.problems)}"
        with self._lock:
            refusal = self._cycle.tare_refusal(limit)
        if refusal is None and self._taring is not None and self._taring.is_alive():
            refusal = "taring is under way"
        if refusal is None:
            self._taring = self._ports.clock.start(self._tare, "tare")
        return refusal

    def watch(self, now: float) -> None:
        """Have amplifiers configured again that are silent or not operational. Called about once a second."""
        waiting = self._commissioning.problems
        times = self._config.timeouts
        for index, device in enumerate(self._devices):
            age = device.heartbeat_age(now)
            if device.name in waiting:
                continue
            if age > times.heartbeat_consumer:
                reason = f"no heartbeat for {1e3 * age:.0f} ms"
            elif state := device.not_operational(grace=times.heartbeat_producer):
                reason = f"left NMT operational, it is {state}"
            else:
                continue
            self._report(f"{device.name}: {reason}")
            self._commissioning.request(index, reason)

    def problems(self, now: float) -> dict[str, str]:
        """Return what is wrong with cells, by name; empty when all is well."""
        waiting = self._commissioning.problems
        silence = self._config.timeouts.feedback
        found = {}
        with self._lock:
            synchronous = self._sync_time is not None and now - self._sync_time < silence
            for index, cell in enumerate(self._config.load_cells):
                if (problem := waiting.get(str(cell))) is not None:
                    found[cell.name] = problem
                elif synchronous and now - self._heard[index] > silence:
                    found[cell.name] = "silent"
                elif self._status[index]:
                    found[cell.name] = self._status[index]
                elif index in self._stuck.stuck:
                    found[cell.name] = "stuck: its value does not change while others do"
                elif self._errors[index]:
                    found[cell.name] = f"reports {self._errors[index][-1].text}"
        return found

    def snapshot(self, now: float) -> LoadCellReport:
        """Return the present state."""
        problems = self.problems(now)
        with self._lock:
            return LoadCellReport(
                None if self._sync_time is None else now - self._sync_time,
                self._cycle.statistics(),
                self._commissioning.problems,
                problems,
                tuple(self._errors),
                self._tare_result,
            )

    def _begin_cycle(self, now: float, stamp_ns: int) -> None:
        self._sync_time = now
        self._cycle.sync(stamp_ns)

    def _measured(self, index: int, data: bytes | bytearray, now: float) -> None:
        values = self._config.pdo.load_cell_tpdo.decode(data)
        value, status = values[self._value_place], values[self._status_place]
        tension = self._config.load_cells[index].units.tension(value)
        low, high = self._spans[index]
        problem = status_text(status) if status else "" if low < value < high else _SATURATED
        with self._lock:
            self._heard[index] = now
            self._status[index] = problem
            complete = self._cycle.measured(index, tension, problem)
            if complete is not None:
                self._stuck.observe(now, complete.tensions)
        if complete is not None:
            self._publish(complete.stamp_ns, complete.tensions)

    def _configure(self, index: int) -> None:
        """Bring an amplifier from wherever it is to NMT operational; run by the commissioning thread."""
        facts = set_up_load_cell(self._devices[index], self._config, self._config.load_cells[index])
        low, high = facts.span
        self._spans[index] = (-math.inf if low is None else low, math.inf if high is None else high)

    def _emergency(self, index: int, code: int, register: int, data: bytes) -> None:
        with self._lock:
            message = Emergency(code, register, data, self._ports.clock.monotonic())
            self._errors[index] = after(self._errors[index], message)

    def _tare(self) -> None:
        result = "all load cells tared"
        for device in self._devices:
            try:
                device.write(load_cell_tare())
            except DeviceError as error:
                result = f"taring ended: {error}"
                break
        with self._lock:
            self._tare_result = result
        self._report(result)


def in_words(problems: Mapping[str, str]) -> str:
    """Return what is wrong with which device; those with the same problem together."""
    names: dict[str, list[str]] = {}
    for name, problem in problems.items():
        names.setdefault(problem, []).append(name)
    return "; ".join(f"{', '.join(concerned)}: {problem}" for problem, concerned in names.items())
