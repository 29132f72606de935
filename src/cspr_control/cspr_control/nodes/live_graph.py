"""A graph of processes on this computer, and the operator who works with it."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from cspr_control.demo.child_processes import ChildProcesses
from cspr_control.demo.graph_processes import graph_processes
from cspr_control.demo.ros_domain import claim_domain
from cspr_control.demo.scenario import DemoError, Scenario
from cspr_control.nodes.demo_operator import DemoClient, Operator, Progress, demo_client
from cspr_control.parameters.experiment import MEASURING
from cspr_msgs_py.security.discovery import stay
from cspr_msgs_py.vocabulary import RobotState, TrajectoryPhase

_PATIENCE = 60.0  # s


@dataclass(frozen=True)
class LiveGraph:
    """What an operator needs, and the processes."""

    operator: Operator
    client: DemoClient
    children: ChildProcesses
    progress: Progress

    def make_ready(self, moving: bool) -> None:
        """Reset what is latched, enable the robot, and let it follow its trajectory, where that is not so already."""
        operator, client = self.operator, self.client
        if client.robot_state == RobotState.FAULT:
            self._reset()
        if client.robot_state != RobotState.ENABLED:
            operator.enable(_PATIENCE)
            operator.pause("measuring the payload", MEASURING)
        if moving and client.phase != TrajectoryPhase.RUNNING:
            operator.call("/trajectory_publisher/start", 10.0)
            operator.wait(
                "moving to the start",
                lambda: client.phase == TrajectoryPhase.RUNNING,
                _PATIENCE,
                client.phase_text,
            )

    def _reset(self) -> None:
        self.client.trigger("/supervisor/reset")
        end = time.monotonic() + _PATIENCE
        while self.client.robot_state == RobotState.FAULT:
            if time.monotonic() > end:
                raise DemoError(f"the fault is not reset: {self.client.robot_message}")
            time.sleep(0.05)


@contextmanager
def live_graph(
    title: str, scenario: Scenario, source: Path, directory: Path, markers: bool = False
) -> Iterator[LiveGraph]:
    """Start the processes of a graph in this process' ROS domain; end them, brakes closed.

    Parameters
    ----------
    title
        Of the lines that tell how far it is.
    scenario
        What is run.
    source
        Directory of the configuration.
    directory
        Of the run: takes config/, bag/ and log/.
    markers
        Whether /robot_markers are published.

    Raises
    ------
    ControlError
        If a process ends, or not all of them come up.
    """
    processes = graph_processes(scenario, source, directory, markers)
    grace = 8.0 / scenario.speed  # the drives close their brakes in it
    with ChildProcesses(directory / "log", grace) as children, demo_client() as client:
        progress = Progress(title, client)
        operator = Operator(client, children, progress, scenario.speed)
        try:
            operator.begin(processes)
            yield LiveGraph(operator, client, children, progress)
        finally:
            operator.make_safe()
            progress.end()


@contextmanager
def passing_graph(title: str, scenario: Scenario, source: Path) -> Iterator[LiveGraph]:
    """Do so by itself on this computer, and keep neither bag nor logs; parameters and errors of `live_graph`."""
    stay(os.environ)
    with (
        tempfile.TemporaryDirectory(prefix="cspr-") as directory,
        claim_domain(),
        live_graph(title, scenario, source, Path(directory)) as graph,
    ):
        yield graph
