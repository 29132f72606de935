"""What `make` compiles is all that the programs need: nobody waits for a compiler at first use."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
PROGRAM = """
import runpy, sys

def compiled():
    modules = [module for name, module in sys.modules.items() if name.startswith("cspr_")]
    kernels = {each for module in modules for each in vars(module).values() if hasattr(each, "py_func")}
    return {(each.py_func.__name__, signature) for each in kernels for signature in each.overloads}

def run(module, *arguments):
    sys.argv = [module, *arguments]
    try:
        runpy.run_module(module, run_name="__main__")
    except SystemExit as end:
        assert not end.code, end.code

run("cspr_kinematics.warm_up", "config/robot.yaml")
COMMANDS
ready = compiled()
assert len(ready) > 10, ready
run("cspr_control.programs.workspace", *"--spacing 1 --payload 0 100 --at 0 0 1 --output OUT".split())
run("cspr_control.programs.closed_loop", *"--plant --trajectory smooth-18".split())
print("late:", sorted(compiled() - ready))
"""


def test_make_compiles_every_kernel_that_the_programs_use(tmp_path: Path) -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    commands = re.findall(r"python -c '(.*?)'", makefile.replace("\\\n", ""), re.DOTALL)
    making = [command.strip() for command in commands if "config/" in command]
    assert len(making) == 2
    assert "python -m cspr_kinematics.warm_up config/robot.yaml" in makefile
    program = PROGRAM.replace("COMMANDS", "\n".join(making)).replace("OUT", str(tmp_path / "space"))
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=False, timeout=600
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "late: []"
