"""Errors of configuration files as errors of this package."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from cspr_drivers.errors import ConfigurationError
from cspr_kinematics.errors import ConfigurationFileError


@contextmanager
def as_configuration_error() -> Iterator[None]:
    """Turn what the reading of a file raises into a ConfigurationError with the same message."""
    try:
        yield
    except ConfigurationFileError as error:
        raise ConfigurationError(str(error)) from None
