"""Messages that are a header followed by doubles, as raw CDR: PoseStamped, InertiaStamped and WrenchStamped."""

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from cspr_msgs_py.wire.cdr import Bytes, Frame, Scanner, Template, pack_time

POSE: Final = {"position": 3, "quaternion_xyzw": 4}
"""Doubles of a PoseStamped."""
INERTIA: Final = {"mass": 1, "center_of_mass": 3, "moments": 6}
"""Doubles of an InertiaStamped; the moments of inertia are ixx, ixy, ixz, iyy, iyz, izz."""

WRENCH: Final = {"force": 3, "moment": 3}
"""Doubles of a WrenchStamped, which calls the moment torque."""


class StampedDoublesCodec(Frame):
    """The constant layout of a header with this ``frame_id``, and doubles behind it by their names and numbers."""

    def __init__(self, frame_id: str, fields: Mapping[str, int]) -> None:
        template = Template()
        template.place_time()
        template.string(frame_id)
        for name, number in fields.items():
            template.place_doubles(name, number)
        super().__init__(template)
        self.count = sum(fields.values())

    @classmethod
    def of(cls, buffer: Bytes, fields: Mapping[str, int]) -> "StampedDoublesCodec":
        """Return the codec for messages of the layout that `buffer` has.

        Raises
        ------
        ValueError
            If it is not a header and these doubles in little-endian CDR.
        """
        scanner = Scanner(buffer)
        scanner.time()
        codec = cls(scanner.string(), fields)
        if not codec.matches(buffer):
            raise ValueError(f"{len(buffer)} bytes are not a header and {codec.count} doubles")
        return codec

    def encode(self, stamp_ns: int, values: ArrayLike) -> bytes:
        """Return the message as CDR; its doubles are given one after the other.

        Raises
        ------
        ValueError
            If there are not as many values as the layout has, or the stamp does not fit the message.
        """
        array = np.asarray(values, dtype="<f8")
        if array.shape != (self.count,):
            raise ValueError(f"the message has {self.count} doubles after its header, not {array.shape}")
        return self.join(pack_time(stamp_ns), array.tobytes())
