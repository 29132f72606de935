"""The ROS domain of a demo: one of its own, also when several demos run on one machine."""

from __future__ import annotations

import errno
import os
import socket

from cspr_control.demo_scenario import DemoError

VARIABLE = "ROS_DOMAIN_ID"
DOMAINS = range(
    33, 13, -1
)  # that are chosen from; robots usually have lower ones, this project's tests higher ones


def claim_domain() -> socket.socket:
    """Set ROS_DOMAIN_ID to a domain that no other demo on this machine is in, or leave the one that is set.

    Two graphs in one domain would command each other's motors. The claim is an address of the kernel's (unix(7),
    abstract sockets), which is free again when the process has ended, however it ended.

    Returns
    -------
    The claim; it holds while the socket is open.

    Raises
    ------
    DemoError
        If the domain that is set, or every domain, is taken by another demo.
    """
    wanted = os.environ.get(VARIABLE)
    for domain in [wanted] if wanted else map(str, DOMAINS):
        claim = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            claim.bind(f"\0cspr-demo-domain-{domain}")
        except OSError as error:
            claim.close()
            if error.errno != errno.EADDRINUSE:
                raise
        else:
            os.environ[VARIABLE] = domain
            return claim
    taken = f"ROS domain {wanted}" if wanted else f"every ROS domain from {min(DOMAINS)} to {max(DOMAINS)}"
    raise DemoError(f"another demo runs in {taken}; wait for its end, or set {VARIABLE} to another number")
