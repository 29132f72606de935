# Targets: demo, test, soak (soak-graph, soak-draws), test-socketcan, lint, bench, paper, sensitivity, build, clean.
# Each makes what it needs, the virtual environment included.
#   make demo ARGS="--controller static --payload 200"     options of the demo: make demo ARGS=--help
#   make test ARGS="tests/kinematics -k jacobian"          arguments for pytest
#   make test SEED=7                                       other random examples; make soak-draws draws them for hours
#   make PYTHON=python3.12 VENV=.venv-3.12 test            another interpreter in an environment of its own
PYTHON ?= python3
VENV ?= .venv
REQUIREMENTS ?= requirements.txt
ARGS ?=
SEED ?=
ROUNDS ?= 100
PACKAGES := cspr_kinematics cspr_msgs_py cspr_control cspr_drivers
READY := $(VENV)/.ready
BENCH_READY := $(VENV)/.bench-ready
PYTEST := $(VENV)/bin/python -m pytest $(if $(SEED),--seed $(SEED))

# Nothing leaves this machine, and no robot in the same network hears it.
export ROS_AUTOMATIC_DISCOVERY_RANGE := LOCALHOST
unexport PYTHONPATH ROS_STATIC_PEERS ROS_DISCOVERY_SERVER

.PHONY: help hook demo test test-parts test-whole soak soak-graph soak-draws test-socketcan lint bench paper sensitivity build clean
help:
	@sed -n 's/^# \{0,1\}//p' Makefile | head -6

# Formats and lints what is committed; whoever has hooks of their own keeps them.
hook:
	@git config core.hooksPath > /dev/null 2>&1 || git config core.hooksPath .githooks 2> /dev/null || true

# The lock: environments that are made side by side would write the same files in src.
$(READY): $(REQUIREMENTS) $(PACKAGES:%=src/%/setup.py)
	@echo "== making the environment in $(VENV) (once; a few minutes)"
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "Python >= 3.11 is needed; name one with: make PYTHON=/path/to/python3.11 $(MAKECMDGOALS)"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check -r $(REQUIREMENTS)
	flock src $(VENV)/bin/python -m pip install --quiet --disable-pip-version-check --use-pep517 --no-build-isolation \
		--no-deps $(PACKAGES:%=-e src/%)
	$(VENV)/bin/python -m cspr_kinematics.warm_up config/robot.yaml
	$(VENV)/bin/python -c 'from cspr_drivers.simulation.plant.plant import Plant; \
		from cspr_drivers.simulation.simulation_config import SimulationConfig; \
		Plant(SimulationConfig.from_yaml("config/simulation.yaml"))'  # compiles the kernels of the plant
	$(VENV)/bin/python -c 'from cspr_control.graph import control_graph; \
		from cspr_control.parameters.control_settings import control_settings; \
		from cspr_kinematics import Robot; from cspr_msgs_py.parameters.file import ParameterFile; \
		robot = Robot.from_yaml("config/robot.yaml"); \
		control_graph(robot, control_settings(robot, ParameterFile.from_yaml("config/control.yaml")))'  # those of control
	@$(MAKE) --no-print-directory hook
	@touch $@

# One by one and without what they depend on: a solver that has no wheel here costs nobody else's.
$(BENCH_READY): requirements-bench.txt | $(READY)
	@echo "== solvers to compare with"
	@for solver in $$(grep -v '^#' $<); do \
		$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check --no-deps --only-binary :all: $$solver || \
			echo "   $$solver cannot be installed; the benchmarks will do without it"; done
	@touch $@

demo: $(READY)
	@echo "== demo: the whole graph on a simulated robot"
	@$(VENV)/bin/python -m cspr_control.programs.demo $(ARGS)

test: $(READY)
ifeq ($(strip $(ARGS)),)
	@$(MAKE) --no-print-directory test-parts
	@$(MAKE) --no-print-directory test-whole
else
	$(PYTEST) $(ARGS)
endif

# More workers than some machines have CPUs: many tests wait for other processes.
WHOLE := tests/graph/test_closed_loop.py tests/graph/test_frozen_reader.py
test-parts: $(READY)
	@echo "== tests"
	$(PYTEST) -q -n 4 --dist worksteal $(addprefix --ignore=,$(WHOLE)) $(ARGS)
test-whole: $(READY)
	@echo "== tests of the whole graph, which need the CPUs to themselves"
	$(PYTEST) -q $(WHOLE)

soak: soak-graph soak-draws

# What grows in a day's work: memory, descriptors, threads, shared memory.
soak-graph: $(READY)
	@echo "== soak: 20 minutes live, then an hour in simulated time"
	$(VENV)/bin/python -m benchmarks.soak

# Every test that draws random numbers, ROUNDS times as many of them, from SEED on.
soak-draws: $(READY)
	@echo "== soak: $(ROUNDS) rounds of every test that draws random numbers"
	$(PYTEST) -q -n auto --dist worksteal --rounds $(ROUNDS) $(ARGS)

# On the kernel's CAN; the interfaces are made where that is possible and they are missing.
CAN_INTERFACES := vcan0 vcan1
test-socketcan: $(READY)
	@echo "== tests on the kernel's CAN"
	@for name in $(CAN_INTERFACES); do \
		[ -e /sys/class/net/$$name ] || { modprobe -q vcan; ip link add $$name type vcan; } 2>/dev/null; \
		ip link set $$name up 2>/dev/null; \
		[ -e /sys/class/net/$$name ] || { \
			echo "There is no interface $$name here, and it could not be made. As root, on a kernel with CAN:"; \
			echo "  apt install can-utils linux-modules-extra-$$(uname -r)   # some distributions keep vcan apart"; \
			echo "  modprobe vcan && ip link add $$name type vcan && ip link set $$name up"; \
			exit 1; }; \
	done
	$(PYTEST) tests/socketcan $(ARGS)

lint: $(READY)
	@echo "== ruff and mypy"
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/mypy $(foreach p,$(PACKAGES) benchmarks studies,-p $(p))
	$(VENV)/bin/mypy docs/robot_picture.py

bench: $(READY) $(BENCH_READY)
	@echo "== benchmarks"
	$(VENV)/bin/python -m benchmarks $(ARGS)

paper: $(READY)
	@echo "== the paper's studies and figures, into runs/paper/"
	@$(VENV)/bin/python -m studies.paper $(ARGS)

sensitivity: $(READY)
	@echo "== how sensitive the closed loop is, into runs/sensitivity/: under ten minutes on two cores"
	@OMP_NUM_THREADS=1 $(VENV)/bin/python -m studies.sensitivity $(ARGS)

build: $(READY)
	@echo "== colcon build into install/, then every executable is started and stopped"
	PATH="$(abspath $(VENV))/bin:$$PATH" $(VENV)/bin/colcon --log-base build/log build --base-paths src \
		--build-base build/colcon --install-base install $(ARGS)
	$(PYTEST) -q tests/workspace

clean:
	rm -rf build install log $(VENV) .mypy_cache .ruff_cache .pytest_cache .hypothesis
