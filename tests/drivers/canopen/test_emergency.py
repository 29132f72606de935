"""Emergency messages; codes and meanings typed from CiA 301, section 7.2.7.1, and CiA 402-2, object 603Fh."""

import pytest

from cspr_drivers.canopen.emergency import EMERGENCY_CODES, Emergency, after, meaning, register_text


@pytest.mark.parametrize(
    ("code", "text"),
    [
        (0x8130, "life guard or heartbeat error"),
        (0x8250, "RPDO timeout"),
        (0x3210, "DC link overvoltage"),
        (0x3211, "DC link overvoltage"),  # no. 1 of them
        (0x7305, "incremental sensor 1 fault"),
        (0x8611, "following error"),
        (0x8FFF, "monitoring"),
        (0xFF42, "specific to the device"),
        (0xA000, "unknown error"),
    ],
)
def test_codes_in_words(code, text):
    assert meaning(code).text == text


def test_every_error_has_a_remedy():
    assert all(words.text and words.remedy for code, words in EMERGENCY_CODES.items() if code)


def test_error_register_in_words():
    assert register_text(0b1001_1001) == "generic, temperature, communication, manufacturer"
    assert register_text(0) == ""


def message(code, register, time=0.0, data=bytes(5)):
    return Emergency(code, register, data, time)


def test_errors_stay_until_they_are_taken_back():
    hot = message(0x4310, 0b1001)
    late = message(0x8250, 0b1_1001, time=1.0)
    active = after(after((), hot), late)
    assert active == (hot, late)
    again = message(0x4310, 0b1_1001, time=2.0)
    assert after(active, again) == (late, again)
    assert after(active, message(0x0000, 0b1001)) == (hot,)  # temperature is still there
    assert after(active, message(0x0000, 0)) == ()


def test_an_error_of_no_class_stays_while_the_register_is_not_empty():
    error = message(0x7305, 0b1)
    assert after((error,), message(0x0000, 0b1)) == (error,)


def test_a_message_in_words():
    assert str(message(0x2310, 0b11, data=bytes.fromhex("01 02 00 00 00"))) == (
        "continuous overcurrent of the motor (error code 0x2310), register 0x03 (generic, current), "
        "data 01 02 00 00 00"
    )
