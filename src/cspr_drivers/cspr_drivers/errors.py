"""Exceptions of the package, sorted by what the caller can do about them."""

from __future__ import annotations


class DriverError(Exception):
    """Root of every exception that this package raises on purpose."""


class ConfigurationError(DriverError):
    """A configuration file is missing, malformed, or asks for what cannot be done: correct the file.

    The message names the file, the path of the key inside it, and the value.
    """


class BusError(DriverError):
    """A CAN interface cannot be opened or no longer carries frames: check the interface."""


class FrameError(DriverError):
    """A frame does not have the form that its COB-ID promises; its content was not used."""


class DeviceError(DriverError):
    """A device on the bus does not answer, refuses an object, or is not the device that was expected.

    Parameters
    ----------
    device
        Name of the device with its bus and node id, such as ``motor_3 (node 3 on main)``.
    problem
        What happened, with the object concerned.
    """

    def __init__(self, device: str, problem: str) -> None:
        self.device = device
        self.problem = problem
        super().__init__(f"{device}: {problem}")


class WrongDeviceError(DeviceError):
    """Another device than the configured one has this node id: replace it, or correct the configuration."""
