"""Arguments that several programs take."""

from __future__ import annotations

import argparse
import math

from cspr_control.demo.scenario import AddedPayload


def mass(text: str) -> float:
    """Read a mass, kg."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value >= 0.0):
        raise argparse.ArgumentTypeError(f"{text!r} is not a mass in kg of at least 0")
    return value


def added_payload(text: str) -> AddedPayload | None:
    """Read a change of the payload such as ``100@3``; None for ``none``."""
    if text == "none":
        return None
    kilograms, separator, moment = text.partition("@")
    try:
        change = AddedPayload(float(kilograms), float(moment))
    except ValueError:
        separator = ""
    if not separator or not math.isfinite(change.mass) or not 0.0 <= change.time < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form KG@S, such as 100@3, or none")
    return change
