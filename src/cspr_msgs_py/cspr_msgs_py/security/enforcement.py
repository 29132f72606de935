"""ROS's variables for security: none may be taken for protection where there is none."""

from __future__ import annotations

from collections.abc import Mapping, MutableMapping, Sequence
from itertools import pairwise
from pathlib import Path

from cspr_msgs_py.errors import StartError
from cspr_msgs_py.security.access import ENCLAVES

ENABLE, STRATEGY = "ROS_SECURITY_ENABLE", "ROS_SECURITY_STRATEGY"
KEYSTORE, OVERRIDE = "ROS_SECURITY_KEYSTORE", "ROS_SECURITY_ENCLAVE_OVERRIDE"
_ENFORCE, _PERMISSIVE = "Enforce", "Permissive"

NO_LIBRARY = (
    f"{ENABLE}=true, but the Fast DDS of this installation is built without security, as that of the Python wheels "
    f"is: nothing was started; use the ROS 2 Jazzy packages of Ubuntu, or unset {ENABLE} to run without protection "
    "(docs/security.md)"
)


def enforce(environment: MutableMapping[str, str], keystore: Path) -> None:
    """Let this process and those that it starts run only with security, each in the enclave of its name.

    Raises
    ------
    StartError
        If the directory has no keys for any of them.
    """
    _require_keys(str(keystore), ENCLAVES)
    environment.update({ENABLE: "true", STRATEGY: _ENFORCE, KEYSTORE: str(keystore.absolute())})
    environment.pop(OVERRIDE, None)


def enclave_arguments(environment: Mapping[str, str], arguments: Sequence[str], program: str) -> list[str]:
    """Return the arguments that put a process into the enclave of its name; none if it has another, or needs none.

    ROS takes any other spelling of ``true`` and ``Enforce`` for their contrary, and says nothing: here it is an error.

    Parameters
    ----------
    environment
        Of the process.
    arguments
        Its command line.
    program
        Its name.

    Raises
    ------
    StartError
        If a variable is misspelt, or there are no keys for what must be enforced.
    """
    enabled, strategy = environment.get(ENABLE) or "false", environment.get(STRATEGY) or _PERMISSIVE
    for name, value, known in (
        (ENABLE, enabled, ("true", "false")),
        (STRATEGY, strategy, (_ENFORCE, _PERMISSIVE)),
    ):
        if value not in known:
            raise StartError(
                f"{name}={value}: ROS knows {' and '.join(known)} only, and would run without protection"
            )
    if enabled == "false":
        return []
    given = environment.get(OVERRIDE) or _given_enclave(arguments)
    enclave = given or f"{ENCLAVES}/{program}"
    if strategy == _ENFORCE:
        _require_keys(environment.get(KEYSTORE, ""), enclave)
    return [] if given else ["--ros-args", "--enclave", enclave]


def unprotected(environment: Mapping[str, str]) -> str:
    """Return why a process runs without protection although security is enabled; empty where it would not."""
    if environment.get(ENABLE) != "true" or environment.get(STRATEGY) == _ENFORCE:
        return ""
    return f"{ENABLE}=true without {STRATEGY}={_ENFORCE}: a process without keys runs open to everybody"


def _require_keys(keystore: str, enclave: str) -> None:
    if not keystore:
        raise StartError(f"{ENABLE}=true, but {KEYSTORE} names no directory of keys (docs/security.md)")
    if not Path(keystore, "enclaves", enclave.lstrip("/")).is_dir():
        raise StartError(
            f"there are no keys for {enclave} in {keystore}; `ros2 security generate_artifacts -k "
            f"{keystore} -p config/security/*.xml` makes them (docs/security.md)"
        )


def _given_enclave(arguments: Sequence[str]) -> str:
    """Return the enclave that a command line names last; empty if none."""
    given = [value for option, value in pairwise(arguments) if option in ("-e", "--enclave")]
    return given[-1] if given else ""
