"""What holds for all tests.

A ROS domain of its own for each process of the tests, whatever the shell has set: no robot hears a test. Property tests
draw the same examples in every run; others with `pytest --hypothesis-profile=default`.
"""

import os
import signal
import socket

import pytest
from hypothesis import settings

# Clear of the default 0 and the demo's 33; from 102 on, other programs use the ports.
DOMAINS = range(50, 100)

_claim = pytest.StashKey[socket.socket]()


settings.register_profile("repeatable", derandomize=True, database=None)
settings.load_profile("repeatable")


def pytest_configure(config: pytest.Config) -> None:
    """Take a domain that no other process of tests on this machine has; it is free again when the process ends.

    Programs that tests start hear SIGINT, also where a shell started the tests in the background and ignores it.
    """
    signal.signal(signal.SIGINT, signal.default_int_handler)
    claim = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    for domain in DOMAINS:
        try:
            claim.bind(f"\0cspr tests, ROS domain {domain}")  # a name without a file
        except OSError:
            continue
        config.stash[_claim] = claim
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        return
    raise pytest.UsageError(f"other tests have all ROS domains from {DOMAINS[0]} to {DOMAINS[-1]}")
