"""What holds for all tests.

A ROS domain of its own for each process of the tests, whatever the shell has set: no robot hears a test.

What is drawn at random is the same in every run: one round, from seed 0. `--seed N` draws other examples, the same ones
for the same N, and `--rounds N` (`make soak-draws`) runs nothing but the tests that draw, N times as long.
"""

import os
import signal
import socket

import pytest
from hypothesis import settings
from hypothesis.internal.detection import is_hypothesis_test  # where both supported releases have it

from cspr_msgs_py.security.discovery import stay

# Clear of the default 0 and the demo's 33; from 102 on, other programs use the ports.
DOMAINS = range(50, 100)

EXAMPLES = 80  # of a property in one round

_claim = pytest.StashKey[socket.socket]()


def pytest_addoption(parser: pytest.Parser) -> None:
    """Say what is drawn at random, and for how long."""
    parser.addoption(
        "--seed", type=int, default=0, help="draw examples from this seed on; default: %(default)s"
    )
    parser.addoption(
        "--rounds", type=int, default=1, help="run only tests that draw, this many times as long"
    )


@pytest.hookimpl(tryfirst=True)  # before hypothesis reads its own option
def pytest_configure(config: pytest.Config) -> None:
    """Set what hypothesis draws and claim a ROS domain."""
    seed, rounds = config.getoption("seed"), config.getoption("rounds")
    settings.register_profile(
        "drawn", derandomize=not seed, database=None, deadline=None, max_examples=EXAMPLES * rounds
    )
    settings.load_profile("drawn")
    config.option.hypothesis_seed = config.option.hypothesis_seed or seed or None
    _claim_domain(config)


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Give a test that takes a `seed`, and does not say which, one for each round."""
    said = any(mark.args[0] == "seed" for mark in metafunc.definition.iter_markers("parametrize"))
    if "seed" in metafunc.fixturenames and not said:
        first, rounds = metafunc.config.getoption("seed"), metafunc.config.getoption("rounds")
        metafunc.parametrize("seed", range(first, first + rounds), scope="session")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out, of several rounds, what would do the same in each."""
    if config.getoption("rounds") > 1:
        drawing = {item: is_hypothesis_test(item.obj) or "seed" in item.fixturenames for item in items}
        config.hook.pytest_deselected(items=[item for item in items if not drawing[item]])
        items[:] = [item for item in items if drawing[item]]


def _claim_domain(config: pytest.Config) -> None:
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
        os.environ.pop("ROS_SECURITY_ENABLE", None)
        stay(os.environ)
        return
    raise pytest.UsageError(f"other tests have all ROS domains from {DOMAINS[0]} to {DOMAINS[-1]}")
