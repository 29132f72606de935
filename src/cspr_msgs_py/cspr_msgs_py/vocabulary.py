"""The words that nodes, programs and bags have in common: states, phases, levels, models and controllers.

Each is the text of a message or the value of a parameter, and so is its own name on topics, in files and on the command
line. Nothing of ROS is imported.
"""

from __future__ import annotations

from enum import IntEnum, StrEnum


class Level(IntEnum):
    """Severity of a diagnostic status, in the order of diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


class HealthKey(StrEnum):
    """Keys of values in ``/diagnostics`` that other nodes read.

    - FAILURE: what went wrong in a node that must not, a defect; the supervisor stops the robot.
    - CELLS_UNEXPLAINED: by `mass_estimator`, how much of the load cells' sum no payload explains, as a multiple of what
      is allowed; empty while nothing is compared.
    """

    FAILURE = "failure"
    CELLS_UNEXPLAINED = "cells_unexplained"


class CellCheck(StrEnum):
    """What balance and motors say of the load cells.

    - SOUND: all of them are believed.
    - EXCLUDED: one is left out of the estimate of the payload.
    """

    SOUND = "sound"
    EXCLUDED = "excluded"


class RobotState(StrEnum):
    """State of the robot as a whole, as the supervisor publishes it.

    - DISABLED: brakes closed, the reference follows the measured pose.
    - ENABLING: the drives were told to enable.
    - ENABLED: the motors follow their set-points.
    - STOPPING: the trajectory comes to rest, then the brakes close; after a fault, FAULT follows.
    - HELD_BY_DRIVES: a brake does not hold: brakes closed, and the drives keep their torque.
    - FAULT: the drives were stopped; the cause is latched until the operator resets it.
    """

    DISABLED = "disabled"
    ENABLING = "enabling"
    ENABLED = "enabled"
    STOPPING = "stopping"
    HELD_BY_DRIVES = "held by drives"
    FAULT = "fault"


FOLLOWING = frozenset(
    {RobotState.ENABLING, RobotState.ENABLED, RobotState.STOPPING, RobotState.HELD_BY_DRIVES}
)
"""States in which the motors follow, or are about to follow, the reference."""

UNDER_TORQUE = frozenset({RobotState.ENABLED, RobotState.STOPPING, RobotState.HELD_BY_DRIVES})
"""States in which the motors carry the cables: brakes open, or closing under torque."""


class DriverState(StrEnum):
    """State of the drives taken together, as their driver reports it.

    - NOT_READY: a drive is missing or not at rest.
    - DISABLED: all drives at rest, brakes closed.
    - WINDING: one winch is wound for a moment, at the operator's command, all others braked.
    - ENABLING: on the way to enabled; the brakes open last, and together.
    - ENABLED: brakes open, torque at the shafts, of all drives or of those enabled singly.
    - STOPPING: brakes are closing, under torque, and are tested where the host commands them.
    - HELD_BY_DRIVES: a brake has failed its test: brakes closed, and all drives keep their torque.
    - FAULT: quick stop, latched until reset.
    """

    NOT_READY = "not_ready"
    DISABLED = "disabled"
    WINDING = "winding"
    ENABLING = "enabling"
    ENABLED = "enabled"
    STOPPING = "stopping"
    HELD_BY_DRIVES = "held by drives"
    FAULT = "fault"


class TrajectoryName(StrEnum):
    """Names of the trajectories, each described in docs/operation.md."""

    HOLD = "hold"
    MOVE = "move"
    PAPER_18 = "paper-18"
    PAPER_19 = "paper-19"
    PAPER_19_TILT = "paper-19-tilt"
    SMOOTH_18 = "smooth-18"
    SMOOTH_19 = "smooth-19"
    SMOOTH_19_TILT = "smooth-19-tilt"
    STROKES_Z = "strokes-z"


class TrajectoryPhase(StrEnum):
    """What the reference does.

    - IDLE: no pose is known, there is no reference.
    - HOLD: the reference stays at one pose.
    - APPROACH: on the way from the held pose to the start of a trajectory, or waiting there for its start
    time.
    - RUNNING: along the trajectory.
    - STOPPING: slowing down along the path.
    - FINISHED: the reference stays at the end of the trajectory.
    """

    IDLE = "idle"
    HOLD = "hold"
    APPROACH = "approach"
    RUNNING = "running"
    STOPPING = "stopping"
    FINISHED = "finished"

    @property
    def at_rest(self) -> bool:
        """Whether the reference does not move."""
        return self in (TrajectoryPhase.IDLE, TrajectoryPhase.HOLD, TrajectoryPhase.FINISHED)


UNDER_WAY = frozenset({TrajectoryPhase.APPROACH, TrajectoryPhase.RUNNING})
"""Phases in which a trajectory that was started has neither ended nor been stopped."""


class FeedforwardModel(StrEnum):
    """How much of the robot's dynamics the torque anticipates.

    - NONE: nothing, the PD controllers do all the work.
    - STATIC: the weight.
    - DYNAMIC: weight, inertia and centrifugal wrench (docs/model.md, section 4); and, unless it is told not to, what
      accelerates the winches (section 3).
    """

    NONE = "none"
    STATIC = "static"
    DYNAMIC = "dynamic"


class PayloadSource(StrEnum):
    """Which payload the model counts on."""

    NOMINAL = "nominal"
    ESTIMATED = "estimated"


class PayloadMethod(StrEnum):
    """How the payload is estimated (docs/model.md, section 10).

    - MOTION: from the whole balance, in any motion of the platform.
    - STATIC: from the weight alone, as the paper does: while the platform moves slowly.
    """

    MOTION = "motion"
    STATIC = "static"


class PayloadStatus(StrEnum):
    """Where the payload of a set-point comes from.

    - NOMINAL: from the settings, as configured.
    - ESTIMATED: from the newest estimate.
    - HELD: from the last estimate, which is older than the limit.
    - AWAITED: from the settings, because no estimate has arrived yet.
    """

    NOMINAL = "nominal"
    ESTIMATED = "estimated"
    HELD = "held"
    AWAITED = "awaited"


class Controller(StrEnum):
    """The controllers that the paper compares: PD control of the motors with more and more feed-forward."""

    PD = "pd"
    STATIC = "static"
    PDFF = "pdff"
    PDFF_MASS = "pdff-mass"

    @property
    def model(self) -> FeedforwardModel:
        """What its feed-forward anticipates."""
        named = {Controller.PD: FeedforwardModel.NONE, Controller.STATIC: FeedforwardModel.STATIC}
        return named.get(self, FeedforwardModel.DYNAMIC)

    @property
    def payload_source(self) -> PayloadSource:
        """The payload that its feed-forward counts on."""
        return PayloadSource.ESTIMATED if self is Controller.PDFF_MASS else PayloadSource.NOMINAL

    @staticmethod
    def of(model: str, payload_source: str) -> Controller | None:
        """Return the controller that a feed-forward's settings make; None if there is none of that model."""
        for controller in reversed(Controller):  # the weight alone is "static" whatever payload it counts on
            if controller.model == model and controller.payload_source in (payload_source, "nominal"):
                return controller
        return None


def controller_label(controller: str, exact_mass: bool) -> str:
    """Return a controller's name, with a note when it is given the true mass."""
    return f"{controller} (exact mass)" if exact_mass else controller
