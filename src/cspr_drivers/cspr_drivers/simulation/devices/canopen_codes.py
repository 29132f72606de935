"""Numbers of CiA 301 that emulated devices answer with: SDO abort codes, emergency codes."""

from __future__ import annotations

from enum import IntEnum


class SdoAbort(IntEnum):
    """SDO abort codes in use (CiA 301, section 7.2.4.3.17)."""

    WRITE_ONLY = 0x0601_0001
    READ_ONLY = 0x0601_0002
    NO_OBJECT = 0x0602_0000
    NOT_MAPPABLE = 0x0604_0041
    PDO_LENGTH_EXCEEDED = 0x0604_0042
    DATA_TOO_LONG = 0x0607_0012
    DATA_TOO_SHORT = 0x0607_0013
    NO_SUBINDEX = 0x0609_0011
    INVALID_VALUE = 0x0609_0030
    VALUE_TOO_HIGH = 0x0609_0031
    VALUE_TOO_LOW = 0x0609_0032
    CANNOT_BE_STORED = 0x0800_0020
    DEVICE_STATE = 0x0800_0022
    NO_DATA = 0x0800_0024


class EmergencyCode(IntEnum):
    """Emergency error codes in use (CiA 301, section 7.2.7.1; CiA 402-2, error code 603Fh)."""

    NO_ERROR = 0x0000
    UNDERVOLTAGE = 0x3220
    OVERTEMPERATURE = 0x4310
    COMMUNICATION = 0x8100
    HEARTBEAT = 0x8130
    PROTOCOL = 0x8200
    PDO_LENGTH = 0x8210
    RPDO_TIMEOUT = 0x8250
