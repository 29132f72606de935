"""One winch at a time, with little torque: its drive is led by SDO, and its brake is closed again whatever happens."""

from __future__ import annotations

import contextlib
import math

from cspr_drivers.canopen import cia402
from cspr_drivers.canopen.cia402 import State, Target
from cspr_drivers.canopen.nmt import NmtCommand
from cspr_drivers.canopen.object_entry import Parameter
from cspr_drivers.canopen.units import wrapped
from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.devices.device import CanopenDevice
from cspr_drivers.devices.position_unit import require_increments
from cspr_drivers.devices.settings import DRIVE_MODE, milliseconds
from cspr_drivers.errors import DeviceError

_STATUS_WORD = Parameter(0x6041, 0, 16, 0, "statusword")
_POSITION = Parameter(0x6064, 0, 32, 0, "position actual value", signed=True)
_ERROR_CODE = Parameter(0x603F, 0, 16, 0, "error code")

_PAUSE = 0.002  # s between two looks at the drive
_RAMP_TIME = 1.0  # s from no torque to the limit
_SPEED = 4.0 * math.pi  # rad/s of the motor: about 20 mm/s of cable
_STIFF = 1.0  # rad off its way at which the motor has all of the torque that it may have
_DAMPING = 0.1  # s; of a speed, by which the torque is reduced, in units of the way
_NEAR = 0.5  # rad that count as arrived: less than a millimetre of cable
_PATIENCE = 5.0  # s beyond the time of the way itself
_RUNAWAY = 3.0  # times the commanded travel


class SingleDrive:
    """A drive between `__enter__`, which prepares it with its brake closed, and `__exit__`, which closes the brake.

    The drive stops by itself, brake closed, when the heartbeat of the caller ends.

    Parameters
    ----------
    device
        The drive.
    config
        Times, node id of the heartbeat, bit of the open brake.
    torque_share
        Largest torque, in units of the motor's rated torque.
    """

    def __init__(self, device: CanopenDevice, config: CanConfig, torque_share: float) -> None:
        self._device = device
        self._config = config
        self._limit = max(1, round(1000.0 * torque_share))  # thousandths of the rated torque
        increments = device.read(Parameter(0x608F, 1, 32, 0, "encoder increments"))
        revolutions = device.read(Parameter(0x608F, 2, 32, 0, "motor revolutions"))
        if increments == 0 or revolutions == 0 or increments % revolutions:
            raise DeviceError(
                device.name, f"608Fh says {increments} increments in {revolutions} revolutions; set it first"
            )
        self.encoder_increments = increments // revolutions
        require_increments(device, self.encoder_increments)
        self.rated_torque = 1e-3 * device.read(Parameter(0x6076, 0, 32, 0, "motor rated torque, mN m"))
        if self.rated_torque <= 0.0:
            raise DeviceError(device.name, "6076h (motor rated torque) is 0: set the motor data first")

    def __enter__(self) -> SingleDrive:
        self._device.command(NmtCommand.ENTER_PRE_OPERATIONAL)
        self._lead(Target.AT_REST, State.SWITCH_ON_DISABLED)
        times = self._config.timeouts
        heartbeat = self._config.master_node_id << 16 | milliseconds(times.heartbeat_consumer)
        quick_stop = cia402.QUICK_STOP_THEN_SWITCH_ON_DISABLED
        for parameter in (
            Parameter(0x6007, 0, 16, cia402.QUICK_STOP_ON_LOST_CONNECTION, "abort connection", signed=True),
            Parameter(0x605A, 0, 16, quick_stop, "quick stop option", signed=True),
            Parameter(0x605C, 0, 16, 1, "disable operation option", signed=True),
            Parameter(0x1016, 1, 32, heartbeat, "consumer heartbeat time"),
            Parameter(0x6072, 0, 16, self._limit, "max torque, thousandths of the rated torque"),
            Parameter(0x6060, 0, 8, cia402.CYCLIC_SYNCHRONOUS_TORQUE, "modes of operation", signed=True),
        ):
            self._device.write(parameter)
        self._device.wait_for(DRIVE_MODE)
        return self

    def __exit__(self, kind: type[BaseException] | None, *_raised: object) -> None:
        if kind is None:
            self.close_brake()
        else:  # the first problem is the one reported; a drive that cannot be reached misses the heartbeat
            with contextlib.suppress(DeviceError):
                self.close_brake()

    def close_brake(self) -> None:
        """Close the brake and take the torque away.

        Raises
        ------
        DeviceError
            If the drive does not report in time that it has.
        """
        self._lead(Target.AT_REST, State.SWITCH_ON_DISABLED)
        if self.brake_open():
            raise DeviceError(self._device.name, "reports an open brake at rest: check brake_open_bit")

    def position(self) -> int:
        """Return the position value, in counts."""
        return self._device.read(_POSITION)

    def moved_since(self, begin: int) -> int:
        """Return how many counts the motor is from a position value."""
        return wrapped(self.position() - begin)

    def brake_open(self) -> bool:
        """Return whether the drive reports its brake open."""
        return self._config.brake_is_open(self._device.read(_STATUS_WORD))

    def nudge(self, revolutions: float) -> int:
        """Let the motor turn, with the least torque that does, and close the brake; return the counts it moved.

        The brake opens without torque. When the load does not move the shaft the torque grows to the limit in one
        direction, then in the other.

        Parameters
        ----------
        revolutions
            Of the motor at which the brake closes again.

        Raises
        ------
        DeviceError
            If the shaft does not move, or the drive does not do as it should.
        """
        begin = self.position()
        travel = round(revolutions * self.encoder_increments)
        self._release()
        try:
            for direction in (1, -1):
                start = self._device.clock.monotonic()
                while (elapsed := self._device.clock.monotonic() - start) < 1.5 * _RAMP_TIME:
                    self._apply(direction * min(1.0, elapsed / _RAMP_TIME) * self._limit)
                    if abs(self._moved_within(begin, travel)) >= travel:
                        break
                else:
                    continue
                break
        finally:
            self.close_brake()
        moved = self.moved_since(begin)
        if abs(moved) < 0.5 * travel:
            raise DeviceError(
                self._device.name,
                f"does not move with {self._limit / 1000.0 * self.rated_torque:g} N m: does its brake open, or is the "
                "cable caught? --torque allows more",
            )
        return moved

    def move(self, counts: int) -> bool:
        """Move slowly by a number of counts and close the brake; return whether the motor arrived."""
        begin = self.position()
        radian = self.encoder_increments / (2.0 * math.pi)
        way = abs(counts) / radian  # rad
        self._release()
        try:
            start = before = self._device.clock.monotonic()
            last = 0
            speed = 0.0
            while (now := self._device.clock.monotonic()) - start < way / _SPEED + _PATIENCE:
                reached = min(1.0, _SPEED * (now - start) / way) if way else 1.0
                moved = self._moved_within(begin, abs(counts))
                if now > before:
                    speed += 0.5 * ((moved - last) / radian / (now - before) - speed)
                last, before = moved, now
                error = (reached * counts - moved) / radian
                if reached == 1.0 and abs(error) < _NEAR and abs(speed) < 1.0:
                    return True
                self._apply((error - _DAMPING * speed) / _STIFF * self._limit)
            return False
        finally:
            self.close_brake()

    def slip(self, duration: float) -> float:
        """Return how far, in rad, the shaft moves in some time, s, with its brake closed."""
        begin = self.position()
        end = self._device.clock.monotonic() + duration
        largest = 0
        while self._device.clock.monotonic() < end:
            largest = max(largest, abs(self.moved_since(begin)))
            self._device.clock.sleep(0.05)
        return 2.0 * math.pi * largest / self.encoder_increments

    def _release(self) -> None:
        """Open the brake, without torque."""
        self._apply(0.0)
        self._lead(Target.OPERATION_ENABLED, State.OPERATION_ENABLED)

    def _apply(self, torque: float) -> None:
        """Set the torque, in thousandths of the rated torque, held within the limit."""
        value = max(-self._limit, min(self._limit, round(torque)))
        self._device.write(Parameter(0x6071, 0, 16, value, "target torque", signed=True))
        self._device.clock.sleep(_PAUSE)

    def _moved_within(self, begin: int, travel: int) -> int:
        moved = self.moved_since(begin)
        reach = _RUNAWAY * max(travel, self.encoder_increments)
        if abs(moved) > reach:
            raise DeviceError(
                self._device.name,
                f"has moved {abs(moved) / self.encoder_increments:.1f} revolutions instead of "
                f"{travel / self.encoder_increments:.1f}: the load is more than the torque limit can hold",
            )
        return moved

    def _lead(self, target: Target, end: State) -> None:
        """Lead the drive through its states until it reports the wanted one, with its brake as it should be."""
        times = self._config.timeouts
        deadline = self._device.clock.monotonic() + (
            times.enable if target is Target.OPERATION_ENABLED else times.stop
        )
        while True:
            word = self._device.read(_STATUS_WORD)
            state = cia402.decode_state(word)
            open_ = self._config.brake_is_open(word)
            if state is end and open_ == (target is Target.OPERATION_ENABLED):
                return
            if state in (State.FAULT, State.FAULT_REACTION_ACTIVE):
                code = self._device.read(_ERROR_CODE)
                raise DeviceError(self._device.name, f"is in fault (error code 0x{code:04X}): reset it first")
            if self._device.clock.monotonic() > deadline:
                brake = "open" if open_ else "closed"
                raise DeviceError(
                    self._device.name,
                    f"is in {state.value} with its brake {brake} instead of {end.value}; is brake_open_bit = "
                    f"{self._config.brake_open_bit} right?",
                )
            control = cia402.next_control_word(state, target)
            self._device.write(Parameter(0x6040, 0, 16, control, "controlword"))
            self._device.clock.sleep(_PAUSE)
