"""Damping the swing of a load that hangs on a sling: a small offset to the reference (docs/model.md, section 11)."""

from __future__ import annotations

import cmath
import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

from cspr_control.motors.swing_frequency import SwingFrequency

_NANOSECOND = 1e-9  # s
_LIGHTEST = 1.0  # kg, of a load that is observed
_OTHER_LOAD = (
    0.2  # share of the mass by which another load differs; a wide swing of 15 degrees changes it by 0.1
)
_OLD = 0.1  # s, age from which the pull is not answered, and gap after which it is observed anew
_LONGEST_STEP = 0.02  # s, of an offset
_FADE = 0.2  # s within which the answer comes and goes
_HALT = 0.05  # s, time constant with which the offset comes to rest when the robot stops
_NOTHING = 1e-5  # m and m/s: an offset below it ends
_FIRST_GUESS = 4.4  # rad/s: a sling of half a metre
_FOLLOW = 0.2  # of the way that omega goes to what was found last
_RETURN = 0.5  # times omega: the two poles with which the offset returns to zero
# Of the observer, times powers of omega, for poles at (-0.7, -0.7 +- 0.7 i) omega
_CORRECT_PULL, _CORRECT_RATE, _CORRECT_BIAS = 1.414, 0.96, 0.686
_MEMORY = 64  # references that are remembered


@dataclass(frozen=True)
class SwingSettings:
    """The parameters of `SwingDamping`, with meanings and units in `cspr_msgs_py.parameters.table`."""

    damping: float
    dead_zone: float
    reach: float
    acceleration: float
    delay: float

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> SwingSettings:
        """Take them from the feed-forward's parameters by name."""
        return cls(**{each.name: values[f"swing_{each.name}"] for each in fields(cls)})


class SwingOffset(NamedTuple):
    """What is added to the reference along x and y of base, as complex numbers: m, m/s and m/s^2."""

    position: complex
    velocity: complex
    acceleration: complex


_NO_OFFSET = SwingOffset(0j, 0j, 0j)


class _Hook(NamedTuple):
    """How the hook moves at a stamp, ns: its acceleration, m/s^2, and the offset in it."""

    stamp: int
    acceleration: complex
    offset: SwingOffset


_AT_REST = _Hook(0, 0j, _NO_OFFSET)


class SwingDamping:
    """Moves the platform by a small offset x so that a load on a sling stops swinging.

    Per unit of its mass a load pulls with w = omega^2 e at the distance e from the plumb line of its hook, and
    e'' = -omega^2 e - a if the hook has the acceleration a. What the payload does not explain, over its mass, is
    u = w + a: nothing for a rigid load, however it is moved. Of a hook with a = a_d + x'', where a_d is that of the
    path, p = u - x'' is what swings,

        p = omega^2 e + a_d,   p'' = -omega^2 (p + x'')   while a_d is constant:

    about where the load would hang if the hook went on like this. An observer follows p, r = p' / omega and a constant
    error of u; from it and from what x did since, p and r of now. They are answered by

        x'' = g (k_1 p + k_2 r) - k_3 omega^2 x - k_4 omega x',
        k_1 = 4 zeta c,   k_2 = 2 zeta (1 - c^2),   k_3 = c^2,   k_4 = 2 c + 2 zeta c^2.

    **Stability.** With 1 / omega as unit of time, p = -x'' / (s^2 + 1) leads to the characteristic polynomial

        s^2 (s^2 + 1) + g (k_1 + k_2 s) s^2 + (k_3 + k_4 s) (s^2 + 1),

    which is (s^2 + 2 zeta s + 1) (s + c)^2 for g = 1: the swing decays with the damping ratio zeta, the offset returns
    with c omega. For any other g > 0 all coefficients are positive, and so is the Hurwitz determinant,
    g k_4 (k_2 (1 - k_3) + k_1 k_4) + g^2 k_2 (k_1 k_4 - k_2 k_3), for zeta > 0 and 0 < c < 1. So less of the answer, as
    fading, dead zone and limits leave of it, damps less but does not excite. The observer is told x'' as it is: its
    errors decay by themselves, whatever g is. A rigid load has u = 0, which leaves observer and offset without an
    input, and they come to rest. An omega that is wrong by a factor of 0.7 to 1.6 leaves all this stable.

    Above omega the answer to u falls off with the third power of the frequency: 1 mm of a platform's bounce on its
    cables at 10 Hz, which is in u, comes back as a few hundredths of a millimetre.

    Vectors along x and y of base are complex numbers.

    Parameters
    ----------
    settings
        May be replaced at any time.

    Attributes
    ----------
    omega
        Angular frequency of the swing, rad/s; None while it is not known.
    offset
        The newest.
    """

    def __init__(self, settings: SwingSettings) -> None:
        self.settings = settings
        self.omega: float | None = None
        self._tuned = _FIRST_GUESS  # omega of observer and answer
        self._frequency = SwingFrequency()
        self._mass = 0.0
        self._seen = 0  # stamp of the newest pull, ns
        # p, r and the error of u, m/s^2, and the hook, all at the moment that the newest pull tells of
        self._pull = self._rate = self._bias = 0j
        self._then = _AT_REST
        self.reset()

    def reset(self) -> None:
        """End the offset at once, as while the motors do not follow."""
        self._share = 0.0  # of the answer that is given
        self._stamp = 0  # of the newest offset, ns
        self._place = self._speed = 0j  # of the offset before its reach bounds it
        self.offset = _NO_OFFSET
        self._past: deque[_Hook] = deque(maxlen=_MEMORY)

    @property
    def idle(self) -> bool:
        """Whether there is no offset, and will be none."""
        return self.settings.damping == 0.0 and self.offset.position == 0.0

    def observe(self, stamp: int, force: complex, mass: float) -> None:
        """Take what the payload does not explain; what is not finite counts as silence.

        Parameters
        ----------
        stamp
            Of the cycle, ns.
        force
            Horizontal, on the platform, N.
        mass
            Of the payload, kg.
        """
        if mass < _LIGHTEST or not cmath.isfinite(force):
            return
        step = (stamp - self._seen) * _NANOSECOND
        self._seen = stamp
        if abs(mass - self._mass) > _OTHER_LOAD * self._mass:
            self._mass, self.omega = mass, None
            self._frequency.clear()
        then = self._then = self._hook_at(stamp - round(self.settings.delay / _NANOSECOND))
        if not 0.0 < step <= _OLD:
            self._frequency.clear()
            self._pull = self._rate = self._bias = 0j
            return
        unexplained, smallest = force / mass, 0.5 * self.settings.dead_zone / mass
        found = self._frequency.update(
            stamp * _NANOSECOND, unexplained - then.acceleration, then.acceleration, smallest
        )
        if found is not None:
            self.omega = found if self.omega is None else self.omega + _FOLLOW * (found - self.omega)
            self._tuned = self.omega
        angle, pushed = self._tuned * step, then.offset.acceleration
        error = angle * (unexplained - pushed - self._pull - self._bias)
        pull, rate = _turned(self._pull, self._rate, angle)
        self._pull = pull + _CORRECT_PULL * error
        self._rate = rate - angle * pushed + _CORRECT_RATE * error
        self._bias += _CORRECT_BIAS * error

    def _hook_at(self, stamp: int) -> _Hook:
        """Return how the hook moved at a stamp, and forget what was before."""
        past = self._past
        while len(past) > 1 and past[1].stamp <= stamp:
            past.popleft()
        known = bool(past) and 0.0 <= (stamp - past[0].stamp) * _NANOSECOND <= _LONGEST_STEP
        return past[0] if known else _AT_REST

    def advance(self, stamp: int, hook: complex, acts: bool, halts: bool = False) -> SwingOffset:
        """Return the offset at the stamp of a reference.

        Parameters
        ----------
        stamp
            Of the reference, ns.
        hook
            Its acceleration, m/s^2.
        acts
            Whether the load may be answered.
        halts
            Whether the offset must come to rest where it is.
        """
        settings, omega, zeta, c = self.settings, self._tuned, self.settings.damping, _RETURN
        step = min(max((stamp - self._stamp) * _NANOSECOND, 0.0), _LONGEST_STEP)
        self._stamp = stamp
        fresh = (stamp - self._seen) * _NANOSECOND <= _OLD
        fading = step / _FADE
        self._share += fading if acts and fresh and self.omega is not None and zeta > 0.0 else -fading
        self._share = min(max(self._share, 0.0), 1.0)
        pull, rate = self._present(stamp)
        answer = self._share * self._fitting(math.hypot(abs(pull), abs(rate)))
        acceleration = (
            answer * (4.0 * zeta * c * pull + 2.0 * zeta * (1.0 - c * c) * rate)
            - (2.0 * c + 2.0 * zeta * c * c) * omega * self._speed
            - (c * omega) ** 2 * self._place
        )
        if halts:
            acceleration = -self._speed / _HALT
        acceleration = _within(acceleration, settings.acceleration)
        self._place += step * (self._speed + 0.5 * step * acceleration)
        self._speed += step * acceleration
        if answer == 0.0 and abs(self._place) < _NOTHING and abs(self._speed) < _NOTHING:
            self._place = self._speed = acceleration = 0j
        self.offset = _bounded(self._place, self._speed, acceleration, settings.reach)
        self._past.append(_Hook(stamp, hook + self.offset.acceleration, self.offset))
        return self.offset

    def _present(self, stamp: int) -> tuple[complex, complex]:
        """Return p and r at a stamp: as observed, and as they went on since, while the offset changed its speed."""
        late = min((stamp - self._seen) * _NANOSECOND, _OLD) + self.settings.delay
        pushed = self._tuned * (self.offset.velocity - self._then.offset.velocity)
        return _turned(self._pull, self._rate - pushed, self._tuned * late)

    def _fitting(self, amplitude: float) -> float:
        """Return the share of the answer to a pull of an amplitude, m/s^2, that dead zone and limits leave."""
        settings = self.settings
        if amplitude == 0.0:
            return 0.0
        above = min(max(self._mass * amplitude / settings.dead_zone - 1.0, 0.0), 1.0)
        largest = min(settings.acceleration, settings.reach * self._tuned**2)  # of the offset's acceleration
        return min(above, largest / (2.0 * settings.damping * amplitude)) if settings.damping > 0.0 else 0.0


def _turned(pull: complex, rate: complex, angle: float) -> tuple[complex, complex]:
    """Return p and r of an undisturbed swing after an angle of its phase, rad."""
    cosine, sine = math.cos(angle), math.sin(angle)
    return cosine * pull + sine * rate, cosine * rate - sine * pull


def _within(vector: complex, longest: float) -> complex:
    """Return a vector, shortened to a length if it is longer."""
    return vector if abs(vector) <= longest else cmath.rect(longest, cmath.phase(vector))


def _bounded(place: complex, speed: complex, acceleration: complex, reach: float) -> SwingOffset:
    """Return x = z / q, q^2 = 1 + |z|^2 / reach^2, which is always shorter than the reach, and its derivatives."""
    q = math.sqrt(1.0 + (abs(place) / reach) ** 2)
    growth = (place.conjugate() * speed).real / (q * reach**2)  # q'
    bend = (abs(speed) ** 2 + (place.conjugate() * acceleration).real) / reach**2
    position = place / q
    velocity = (speed - position * growth) / q
    return SwingOffset(
        position,
        velocity,
        (acceleration - 2.0 * velocity * growth - position * (bend - growth**2) / q) / q,
    )
