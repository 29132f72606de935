"""The RPDO of each drive: control word and torque in one frame, and what was last sent."""

from __future__ import annotations

from cspr_drivers.bus.can_bus import CanPort, CanPorts, CyclicFrame
from cspr_drivers.canopen.frame_table import CONTROL_WORD, TARGET_TORQUE, FunctionCode, cob_id
from cspr_drivers.config.can_config import CanConfig


class TorqueFrame:
    """RPDO of one drive. Not thread-safe: the caller serialises.

    Parameters
    ----------
    config
        Frame layout.
    port
        Bus of the drive.
    node_id
        Node id of the drive.

    Attributes
    ----------
    torque
        Torque to be sent, in thousandths of the rated torque.
    sent
        Whether a frame went out since this was last set to `False`.
    control_word
        Control word of the last frame, `None` before the first.
    """

    def __init__(self, config: CanConfig, port: CanPort, node_id: int) -> None:
        self.torque = 0
        self.sent = False
        self.control_word: int | None = None
        self._port = port
        self._layout = config.pdo.drive_rpdo
        self._word_place = self._layout.position(CONTROL_WORD)
        self._torque_place = self._layout.position(TARGET_TORQUE)
        self._values = [0, 0]
        self._frame = CyclicFrame(cob_id(FunctionCode.RPDO1, node_id))

    def send(self, control_word: int, deadline: float) -> bool:
        """Put control word and torque on the bus, until `deadline`, s; return whether that went well."""
        self._values[self._word_place] = control_word
        self._values[self._torque_place] = self.torque
        self._frame.assign(self._layout.encode(*self._values))
        self.sent = True
        self.control_word = control_word
        return self._port.send(self._frame, deadline)


def torque_frames(config: CanConfig, ports: CanPorts) -> list[TorqueFrame]:
    """Return the frame of each drive, in the order of the configuration."""
    return [TorqueFrame(config, ports[drive.bus], drive.node_id) for drive in config.drives]
