"""What all tests have in common: a corner of the middleware of their own."""

import os
from collections.abc import Iterator

import pytest

from cspr_control.ros_domain import VARIABLE, claim_domain

DOMAINS = range(40, 90)  # none of those of demos


@pytest.fixture(scope="session", autouse=True)
def private_domain() -> Iterator[None]:
    """Keep the tests of this process on this machine, and away from any other graph and any other tests on it."""
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ.pop(VARIABLE, None)
    with claim_domain(DOMAINS):
        yield
