"""How a process joins the network of ROS: within this computer, and into its enclave, where security is enabled."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import rclpy
from rclpy.signals import SignalHandlerOptions

from cspr_msgs_py.errors import StartError
from cspr_msgs_py.security.discovery import stay_by_default
from cspr_msgs_py.security.enforcement import NO_LIBRARY, enclave_arguments

_RMW_WITHOUT_SECURITY = "doesn't have the security libraries"


def init_ros(arguments: Sequence[str], program: str) -> None:
    """Initialise rclpy, without its signal handlers.

    Parameters
    ----------
    arguments
        Command line, the name of the program first.
    program
        Its name: with security enabled, that of its enclave, unless another one is given.

    Raises
    ------
    StartError
        If the process would be without a protection that ROS's variables ask for.
    """
    stay_by_default(os.environ)
    enclave = enclave_arguments(os.environ, arguments, program)
    rclpy.init(args=[*arguments, *enclave], signal_handler_options=SignalHandlerOptions.NO)


@contextmanager
def creating_nodes() -> Iterator[None]:
    """Say what is missing where the middleware can create no node because it knows no security.

    Raises
    ------
    StartError
        In place of rclpy's error.
    """
    with warnings.catch_warnings():
        # rclpy's, where a node could not be created: why is in the error
        warnings.filterwarnings("ignore", "Failed to fini rosout publisher")
        try:
            yield
        except Exception as error:
            if _RMW_WITHOUT_SECURITY in str(error):
                raise StartError(NO_LIBRARY) from error
            raise
