"""Errors of the kinematics, each with the data that explains it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


class KinematicsError(Exception):
    """Base class of all errors raised by this package; they can be pickled without losing their data."""

    def __reduce__(self) -> tuple[object, ...]:
        # Exceptions are unpickled from their message, which is not what the constructors here take.
        return _restored, (type(self), self.args, self.__dict__)


def _restored(
    kind: type[KinematicsError], args: tuple[object, ...], data: dict[str, object]
) -> KinematicsError:
    error = kind.__new__(kind, *args)
    error.__dict__.update(data)
    return error


class InvalidInputError(KinematicsError, ValueError):
    """A value that has no physical meaning, is not finite, or has the wrong shape.

    Attributes
    ----------
    name : str
        Name of the quantity.
    value : object
        The value as it was given.
    reason : str
        What is wrong with it.
    """

    def __init__(self, name: str, value: object, reason: str) -> None:
        self.name = name
        self.value = value
        self.reason = reason
        super().__init__(f"{name} = {_shown(value)}: {reason}")


class ConfigurationFileError(KinematicsError):
    """A configuration file that cannot be used.

    Attributes
    ----------
    source : str
        The file, or what else the configuration came from.
    key : str or None
        Dotted path of the offending key, None if the file as a whole is at fault.
    value : object
        The value found there, None if there is none.
    reason : str
        What is wrong, and what is expected.
    """

    def __init__(self, source: str, key: str | None, value: object, reason: str) -> None:
        self.source = source
        self.key = key
        self.value = value
        self.reason = reason
        where = source if key is None else f"{source}: {key}"
        shown = "" if value is None else f" = {_shown(value)}"
        super().__init__(f"{where}{shown}: {reason}")


class CableReachError(InvalidInputError):
    """A pose at which a cable has no path: its anchor point lies on its exit point, or inside its pulley.

    Attributes
    ----------
    fault : str
        Why.
    cable : int
        Number of the cable as on topics, 1..m; the first if there are several.
    position : numpy.ndarray, shape (3,)
        Position of the platform there, in base, m.
    rotation : numpy.ndarray, shape (3, 3)
        Rotation of the platform there.
    index : tuple of int
        Which member of the batch it is; () for a single pose.
    """

    def __init__(
        self,
        fault: str,
        cable: int,
        position: NDArray[np.float64],
        rotation: NDArray[np.float64],
        index: tuple[int, ...],
    ) -> None:
        self.fault = fault
        self.cable = cable
        self.position = position
        self.rotation = rotation
        self.index = index
        where = f" (pose {list(index)} of the batch)" if index else ""
        angles = f", rotation {_shown(rotation)}"
        super().__init__("pose", position, f"cable {cable}: {fault}{where}{angles}")


class SingularWrenchMatrixError(KinematicsError):
    """The cables cannot balance some wrench, or cannot prevent some motion to first order.

    Attributes
    ----------
    wrench_matrix : numpy.ndarray, shape (6, m)
        A.
    singular_values : numpy.ndarray, shape (6,)
        Its singular values, largest first.
    index : tuple of int
        Which member of the batch it is; () for a single one.
    """

    def __init__(
        self,
        reason: str,
        wrench_matrix: NDArray[np.float64],
        singular_values: NDArray[np.float64],
        index: tuple[int, ...] = (),
    ) -> None:
        self.wrench_matrix = wrench_matrix
        self.singular_values = singular_values
        self.index = index
        where = f", member {list(index)} of the batch" if index else ""
        super().__init__(
            f"singular wrench matrix{where}: {reason}; singular values {_shown(singular_values)}"
        )


class ForwardKinematicsError(KinematicsError):
    """No pose was found that fits the cable lengths.

    Attributes
    ----------
    residual : numpy.ndarray, shape (..., m)
        Cable lengths of the last iterate minus the given lengths, m.
    iterations : int
        Number of iterations made.
    converged : numpy.ndarray of bool, shape (...)
        Which members of the batch were solved.
    slack : numpy.ndarray, shape (..., m)
        By how much each slack cable is longer than its path, m; zero for the others. Where it cannot be told
        which cable is slack, every candidate has a value.
    """

    def __init__(
        self,
        reason: str,
        residual: NDArray[np.float64],
        iterations: int,
        converged: NDArray[np.bool_],
        slack: NDArray[np.float64] | None = None,
    ) -> None:
        self.residual = residual
        self.iterations = iterations
        self.converged = converged
        self.slack = np.zeros_like(residual) if slack is None else slack
        super().__init__(f"forward kinematics: {reason}")


def _shown(value: object) -> str:
    """Return `value` as short text on one line, so that a node can report the error in one; numbers to six digits."""
    if isinstance(value, float) and len(repr(value)) > 8:
        return f"{value:.6g}"
    if isinstance(value, list):
        return f"[{', '.join(map(_shown, value[:10]))}{', ...' if len(value) > 10 else ''}]"[:200]
    if type(value) is np.ndarray:
        return " ".join(
            np.array2string(value, precision=6, threshold=32, edgeitems=2, separator=", ").split()
        )
    text = " ".join(repr(value).split())
    return text if len(text) <= 200 else text[:197] + "..."
