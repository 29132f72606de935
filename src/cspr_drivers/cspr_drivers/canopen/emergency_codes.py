"""Emergency error codes in words, with what to do about each.

Sources: CiA 301, section 7.2.7.1 (table of emergency error codes) and section 7.5.2.2 (error register); CiA 402-2 /
IEC 61800-7-201, object 603Fh (table of error codes). The codes form a tree: a code that is not listed means at least
what the code with its last digits zero means.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class EmergencyMeaning:
    """What an emergency error code means: a text, and what to do about it."""

    text: str
    remedy: str


_MOTOR_CABLE = "check the motor cable and the motor's insulation"
_LOAD = "blocked winch, overload, closed brake, or gains too high"
_MAINS = "check the supply, its fuses and phases"
_COOLING = "let it cool down; check load, fan and cabinet"
_SERVICE = "switch the drive off and on; if it comes back, exchange the drive"
_PARAMETERS = "reload the drive's parameters with the manufacturer's software"
_ENCODER = "check encoder, its cable and shield"
_BUS = "check CAN cable, termination, bit rate and the load of the bus"
_DRIVER = "is the driver running, and the machine not overloaded?"
_MANUAL = "see the device's manual"

# CiA 301, section 7.2.7.1.
_CIA_301 = {
    0x0000: ("no error", ""),
    0x1000: ("generic error", _MANUAL),
    0x2000: ("current", _MANUAL),
    0x2100: ("current at the input side", _MAINS),
    0x2200: ("current inside the device", _LOAD),
    0x2300: ("current at the output side", _MOTOR_CABLE),
    0x3000: ("voltage", _MAINS),
    0x3100: ("mains voltage", _MAINS),
    0x3200: ("voltage inside the device", _MAINS),
    0x3300: ("output voltage", _MOTOR_CABLE),
    0x4000: ("temperature", _COOLING),
    0x4100: ("ambient temperature", _COOLING),
    0x4200: ("device temperature", _COOLING),
    0x5000: ("device hardware", _SERVICE),
    0x6000: ("device software", _SERVICE),
    0x6100: ("internal software", _SERVICE),
    0x6200: ("user software", _MANUAL),
    0x6300: ("data set", _PARAMETERS),
    0x7000: ("additional modules", _MANUAL),
    0x8000: ("monitoring", _MANUAL),
    0x8100: ("communication", _BUS),
    0x8110: ("CAN overrun, objects lost", _BUS),
    0x8120: ("CAN controller in error passive mode", _BUS),
    0x8130: ("life guard or heartbeat error", _DRIVER),
    0x8140: ("recovered from bus-off", _BUS),
    0x8150: ("CAN-ID collision", "two devices have the same node id"),
    0x8200: ("protocol error", _BUS),
    0x8210: ("PDO not processed because it is too short", "is another master on the bus?"),
    0x8220: ("PDO longer than its mapping", "is another master on the bus?"),
    0x8230: ("multiplexed PDO not processed", "is another master on the bus?"),
    0x8240: ("SYNC of unexpected length", "is another producer of SYNC on the bus?"),
    0x8250: ("RPDO timeout", _DRIVER),
    0x9000: ("external error", "emergency stop, safe torque off or another input of the device"),
    0xF000: ("additional functions", _MANUAL),
    0xFF00: ("specific to the device", _MANUAL),
}

# CiA 402-2, object 603Fh.
_CIA_402 = {
    0x2110: ("short circuit or earth leakage at the input", _MAINS),
    0x2120: ("earth leakage at the input", _MAINS),
    0x2130: ("short circuit at the input", _MAINS),
    0x2211: ("internal current no. 1", _LOAD),
    0x2212: ("internal current no. 2", _LOAD),
    0x2213: ("overcurrent in the ramp function", _LOAD),
    0x2214: ("overcurrent in the sequence", _LOAD),
    0x2220: ("continuous overcurrent inside the device", _LOAD),
    0x2230: ("short circuit or earth leakage inside the device", _SERVICE),
    0x2240: ("earth leakage inside the device", _SERVICE),
    0x2250: ("short circuit inside the device", _SERVICE),
    0x2310: ("continuous overcurrent of the motor", _LOAD),
    0x2320: ("short circuit or earth leakage of the motor", _MOTOR_CABLE),
    0x2330: ("earth leakage of the motor", _MOTOR_CABLE),
    0x2340: ("short circuit of the motor", _MOTOR_CABLE),
    0x3110: ("mains overvoltage", _MAINS),
    0x3120: ("mains undervoltage", _MAINS),
    0x3130: ("phase failure", _MAINS),
    0x3134: ("phase sequence", _MAINS),
    0x3140: ("mains frequency", _MAINS),
    0x3210: ("DC link overvoltage", "braking energy: check the brake resistor; slow down"),
    0x3220: ("DC link undervoltage", _MAINS),
    0x3230: ("load error", _LOAD),
    0x3310: ("output overvoltage", _MOTOR_CABLE),
    0x3320: ("armature circuit", _MOTOR_CABLE),
    0x3330: ("field circuit", _MOTOR_CABLE),
    0x4110: ("ambient temperature too high", _COOLING),
    0x4120: ("ambient temperature too low", "warm the cabinet up"),
    0x4130: ("temperature of the supply air", _COOLING),
    0x4140: ("temperature of the air outlet", _COOLING),
    0x4210: ("device temperature too high", _COOLING),
    0x4220: ("device temperature too low", "warm the cabinet up"),
    0x4310: ("drive or motor temperature too high", _COOLING),
    0x4320: ("drive or motor temperature too low", "warm the machine up"),
    0x4410: ("supply temperature too high", _COOLING),
    0x4420: ("supply temperature too low", "warm the cabinet up"),
    0x5110: ("low supply voltage of the electronics", _MAINS),
    0x5120: ("supply of the intermediate circuit", _MAINS),
    0x5210: ("measurement circuit", _SERVICE),
    0x5220: ("computing circuit", _SERVICE),
    0x5300: ("operating unit", _SERVICE),
    0x5400: ("power section", _SERVICE),
    0x5410: ("output stages", _SERVICE),
    0x5420: ("brake chopper", "check the brake resistor"),
    0x5430: ("input stages", _SERVICE),
    0x5440: ("contacts", "check contactors and the emergency stop chain"),
    0x5450: ("fuses", _MAINS),
    0x5510: ("working memory", _SERVICE),
    0x5520: ("program memory", _SERVICE),
    0x5530: ("parameter memory", _PARAMETERS),
    0x6010: ("software reset by the watchdog", _SERVICE),
    0x6301: ("data record no. 1", _PARAMETERS),
    0x6310: ("parameters lost", _PARAMETERS),
    0x6320: ("parameter error", _PARAMETERS),
    0x7110: ("brake chopper", "check the brake resistor"),
    0x7111: ("failure of the brake chopper", "check the brake resistor"),
    0x7112: ("overcurrent of the brake chopper", "check the brake resistor"),
    0x7113: ("protective circuit of the brake chopper", "check the brake resistor"),
    0x7120: ("motor", _MOTOR_CABLE),
    0x7121: ("motor blocked", "is the holding brake supplied, the winch free?"),
    0x7122: ("motor error or commutation fault", "check encoder offset and motor phases"),
    0x7123: ("motor tilted", _LOAD),
    0x7200: ("measurement circuit", _SERVICE),
    0x7300: ("sensor", _ENCODER),
    0x7301: ("tachometer fault", _ENCODER),
    0x7302: ("tachometer, wrong polarity", _ENCODER),
    0x7303: ("resolver 1 fault", _ENCODER),
    0x7304: ("resolver 2 fault", _ENCODER),
    0x7305: ("incremental sensor 1 fault", _ENCODER),
    0x7306: ("incremental sensor 2 fault", _ENCODER),
    0x7307: ("incremental sensor 3 fault", _ENCODER),
    0x7310: ("speed", "overspeed: check encoder, load and trajectory"),
    0x7320: ("position", _ENCODER),
    0x7400: ("computation circuit", _SERVICE),
    0x7500: ("communication", _BUS),
    0x7600: ("data storage", _PARAMETERS),
    0x8311: ("excess torque", _LOAD),
    0x8312: ("difficult start up", _LOAD),
    0x8313: ("standstill torque", _LOAD),
    0x8321: ("insufficient torque", _LOAD),
    0x8331: ("torque fault", _LOAD),
    0x8400: ("velocity speed controller", _LOAD),
    0x8500: ("position controller", _LOAD),
    0x8600: ("positioning controller", _LOAD),
    0x8611: ("following error", _LOAD),
    0x8612: ("reference limit", "check the position limits in the drive"),
    0x8700: ("synchronisation controller", _BUS),
    0x8800: ("winding controller", _LOAD),
    0x8900: ("process data monitoring", _DRIVER),
    0x8A00: ("control", _MANUAL),
    0xF001: ("deceleration", _LOAD),
    0xF002: ("sub-synchronous run", _LOAD),
    0xF003: ("stroke operation", _LOAD),
    0xF004: ("control", _MANUAL),
}

EMERGENCY_CODES = {code: EmergencyMeaning(*words) for code, words in (_CIA_301 | _CIA_402).items()}

# Error register, object 1001h (CiA 301, section 7.5.2.2).
ERROR_REGISTER_BITS = {
    0: "generic",
    1: "current",
    2: "voltage",
    3: "temperature",
    4: "communication",
    5: "device profile",
    7: "manufacturer",
}

# Bit of the error register that goes with the first digit of a code.
_REGISTER_BIT = {0x2: 1, 0x3: 2, 0x4: 3, 0x8: 4}


def meaning(code: int) -> EmergencyMeaning:
    """Return what an emergency error code means, from the nearest code of the tree that is listed."""
    for mask in (0xFFFF, 0xFFF0, 0xFF00, 0xF000):
        if found := EMERGENCY_CODES.get(code & mask):
            return found
    return EmergencyMeaning("unknown error", _MANUAL)


def is_error(code: int) -> bool:
    """Return whether a code reports an error; codes 00xxh say that one is gone."""
    return bool(code & 0xFF00)


def in_register(code: int, register: int) -> bool:
    """Return whether an error of this code may still be present while the error register has this value."""
    bit = _REGISTER_BIT.get(code >> 12)
    return bool(register) if bit is None else bool(register & 1 << bit)


def register_text(register: int) -> str:
    """Return the error register in words, such as ``generic, temperature``; empty when it is 0."""
    return ", ".join(word for bit, word in ERROR_REGISTER_BITS.items() if register & 1 << bit)
