"""Exceptions of the control package."""


class ControlError(Exception):
    """Root of every error that cspr_control raises on purpose."""


class TrajectoryError(ControlError):
    """A trajectory cannot be built, started or followed."""


class MeasurementError(ControlError):
    """A measurement cannot be used, for instance because it is not finite."""


class PayloadError(ControlError):
    """A payload is not one that the robot can carry."""


class SettingError(ControlError):
    """A setting has a value that the controller cannot work with."""


class StabilityError(ControlError):
    """The stability of the loop cannot be computed, or is not enough."""
