"""The driver of all load-cell amplifiers: the tensions of one cycle together, or not at all."""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from cspr_drivers.bus.can_ports import CanPorts
from cspr_drivers.canopen.emergency import ActiveErrors, Emergency
from cspr_drivers.canopen.frame_table import FunctionCode, cob_id
from cspr_drivers.clock import Thread
from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.devices.device import CanopenDevice, leave_operational
from cspr_drivers.devices.settings import LOAD_CELL_TARE
from cspr_drivers.devices.setup import set_up_load_cell
from cspr_drivers.devices.setup_thread import SetupThread
from cspr_drivers.errors import DeviceError
from cspr_drivers.load_cells.cycle import LoadCellCycle, TensionStatistics

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
        Of each cell, that it has reported by emergency messages and not withdrawn.
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

    Attributes
    ----------
    clock
        Clock of the machine, as of the buses.
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
        self.clock = ports.clock
        self._publish = publish
        self._report = report
        self._lock = threading.Lock()
        self._cycle = LoadCellCycle(config)
        self._tare_result = ""
        self._stopped = False
        self._taring: Thread | None = None
        self._defect = ""  # why this driver cannot be used until it is started again
        self._setup = SetupThread(
            [str(cell) for cell in config.load_cells],
            self._configure,
            lambda index: True,
            report,
            self.clock,
            on_end=partial(setattr, self, "_defect"),
        )
        self._devices = [
            CanopenDevice(
                str(cell),
                ports[cell.bus],
                cell.node_id,
                config.timeouts.sdo,
                on_boot=partial(self._setup.request, index, "restarted"),
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
        self._ports.on_sync(self._cycle.sync, self._lock)
        self._setup.start()

    def stop(self) -> None:
        """Leave the bus."""
        if self._stopped:
            return
        self._stopped = True
        self._setup.stop()
        if self._taring is not None:
            self._taring.join(timeout=2.0)
        leave_operational(self._devices)
        self._ports.off_sync(self._cycle.sync)
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
        if self._setup.problems:
            return f"not configured: {', '.join(self._setup.problems)}"
        with self._lock:
            refusal = self._cycle.tare_refusal(limit)
        if refusal is None and self._taring is not None and self._taring.is_alive():
            refusal = "taring is under way"
        if refusal is None:
            self._taring = self.clock.start(self._tare, "tare")
        return refusal

    def watch(self, now: float) -> None:
        """Have silent amplifiers, and those not operational, configured again. Called about once a second."""
        waiting = self._setup.problems
        for index, device in enumerate(self._devices):
            if device.name not in waiting and (problem := device.problem(now, self._config.timeouts)):
                self._report(f"{device.name}: {problem}")
                self._setup.request(index, problem)

    def problems(self, now: float) -> dict[str, str]:
        """Return what is wrong with cells, by name; empty when all is well."""
        if defect := next((port.ended for port in self._ports if port.ended), self._defect):
            return {cell.name: defect for cell in self._config.load_cells}
        waiting = self._setup.problems
        with self._lock:
            return self._cycle.problems(now, waiting)

    def snapshot(self, now: float) -> LoadCellReport:
        """Return the present state."""
        problems = self.problems(now)
        with self._lock:
            return LoadCellReport(
                None if self._cycle.sync_time is None else now - self._cycle.sync_time,
                self._cycle.statistics(),
                self._setup.problems,
                problems,
                tuple(self._cycle.errors),
                self._tare_result,
            )

    def _measured(self, index: int, data: bytes | bytearray, now: float) -> None:
        with self._lock:
            complete = self._cycle.measured(now, index, data)
        if complete is not None:
            self._publish(*complete)

    def _configure(self, index: int) -> None:
        """Bring an amplifier to NMT operational; run by the set-up thread."""
        span = set_up_load_cell(self._devices[index], self._config, self._config.load_cells[index])
        with self._lock:
            self._cycle.configured(index, span)

    def _emergency(self, index: int, code: int, register: int, data: bytes) -> None:
        with self._lock:
            self._cycle.emergency(index, Emergency(code, register, data, self.clock.monotonic()))

    def _tare(self) -> None:
        result = "all load cells tared"
        try:
            for device in self._devices:
                device.write(LOAD_CELL_TARE)
        except Exception as error:  # whatever ends this thread is told
            result = f"taring failed: {error}"
            if not isinstance(error, DeviceError):
                traceback.print_exception(error)
        with self._lock:
            self._tare_result = result
        self._report(result)
