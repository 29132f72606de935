"""ROS domains that graphs on one computer do not share."""

from __future__ import annotations

import errno
import os
import socket
from collections.abc import Iterable

from cspr_control.errors import ControlError

VARIABLE = "ROS_DOMAIN_ID"
DEMO_DOMAINS = range(33, 13, -1)
"""Domains of demos; robots usually have lower ones."""


def claim_domain(domains: Iterable[int] = DEMO_DOMAINS) -> socket.socket:
    """Set ROS_DOMAIN_ID to a domain that nobody on this computer has claimed, unless it is set already.

    Two graphs in one domain would command each other's motors. The claim is an address of the kernel's (unix(7),
    abstract sockets), which is free again when the process has ended, however it ended.

    Parameters
    ----------
    domains
        To choose from, if ROS_DOMAIN_ID is not set.

    Returns
    -------
    The claim; it holds while the socket is open.

    Raises
    ------
    ControlError
        If the domain that is set, or every domain, has been claimed.
    """
    wanted = os.environ.get(VARIABLE)
    tried = [wanted] if wanted else list(map(str, domains))
    for domain in tried:
        claim = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            claim.bind(f"\0cspr-domain-{domain}")
        except OSError as error:
            claim.close()
            if error.errno != errno.EADDRINUSE:
                raise
        else:
            os.environ[VARIABLE] = domain
            return claim
    raise ControlError(
        f"ROS domain {', '.join(tried)} is taken by another graph on this computer; wait for its end, or set "
        f"{VARIABLE} to another number"
    )
