"""The types are consistent, and the stub is that of the compiled module."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("mypy")

SETTING = Path(__file__).resolve().parents[1] / "pyproject.toml"
USE = """
import mpct
import numpy as np

plant = mpct.Plant(np.eye(2), [[1, 0], [0, 1]])
problem = mpct.Problem(plant, state=(-3, 3), input=([1, 2], None), Q=1, R=[1, 2], O=1e4)
design: mpct.Design = problem.design(condition="sufficient")
H, f, G, b = problem.qp([0, 0], [1, 1])
run = mpct.simulate(design.controller(), [0, 0], [(0, [1.0, 2.0]), (3, [1.0, 2.0])], 10)
cost: float = mpct.simulate(design.controller(), [0, 0], [1, 2], 10).cumulative_cost
found = mpct.campaign(problem, {"scaling": [0.5], "Q": [1, [1, 2]]}, processes=1)
"""
WRONG = """
import mpct
mpct.example("drone").problem.design(condition="quick")
"""


def run(*arguments, cwd):
    environment = {**os.environ, "MYPY_CACHE_DIR": str(cwd / "cache")}
    return subprocess.run([sys.executable, "-m", *arguments], cwd=cwd, capture_output=True, text=True, env=environment)


def test_types(tmp_path):
    (tmp_path / "use.py").write_text(USE, encoding="utf-8")
    done = run("mypy", "--strict", "--config-file", str(SETTING), "use.py", cwd=tmp_path)
    assert done.returncode == 0, done.stdout
    (tmp_path / "wrong.py").write_text(WRONG, encoding="utf-8")
    done = run("mypy", "--config-file", str(SETTING), "wrong.py", cwd=tmp_path)
    assert done.returncode == 1 and "arg-type" in done.stdout
    done = run("mypy", "--config-file", str(SETTING), "-p", "mpct", cwd=tmp_path)
    assert done.returncode == 0, done.stdout


def test_stub(tmp_path):
    # __all__ is what PyO3 adds; the package has its own.
    (tmp_path / "allowed.txt").write_text("mpct._mpct.__all__\n", encoding="utf-8")
    arguments = ["mpct._mpct", "--allowlist", "allowed.txt", "--mypy-config-file", str(SETTING)]
    done = run("mypy.stubtest", *arguments, cwd=tmp_path)
    assert done.returncode == 0, done.stdout
