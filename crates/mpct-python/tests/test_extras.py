"""What happens without the packages that are needed for a part only."""

import subprocess
import sys

import pytest

HEAD = """
import sys
for name in {blocked!r}:
    sys.modules[name] = None
import mpct
problem = mpct.example("academic").problem
controller = problem.design().controller()
run = mpct.simulate(controller, [0, 0], [2, 0.5], 5)
"""


def run(blocked, code):
    done = subprocess.run([sys.executable, "-c", HEAD.format(blocked=blocked) + code], capture_output=True, text=True)
    return done.returncode, done.stdout + done.stderr


@pytest.mark.parametrize(
    ("blocked", "code", "told"),
    [
        ("matplotlib", "run.plot()", "plots need matplotlib: pip install matplotlib"),
        ("pandas", "run.to_dataframe()", "Run.to_dataframe needs pandas: pip install pandas"),
        ("pandas", "mpct.campaign(problem, [], processes=1).to_dataframe()", "Campaign.to_dataframe needs pandas"),
        ("pyarrow", "mpct.campaign(problem, [], results='a.parquet')", "pip install 'mpct[campaign]'"),
        ("distributed", "mpct.campaign(problem, [], client=3)", "pip install 'mpct[campaign]'"),
    ],
)
def test_what_is_missing_is_named(blocked, code, told):
    returned, output = run([blocked], code)
    assert returned == 1 and output.splitlines()[-1].startswith("ImportError") and told in output


def test_the_rest_needs_numpy_alone():
    every = ["matplotlib", "pandas", "control", "distributed", "pyarrow", "scipy", "IPython"]
    code = """
assert run.report() and controller.qp([0, 0], [1, 0])
assert len(mpct.campaign(problem, {"scaling": [0.5]}, processes=1)) == 1
assert mpct.plots.trajectories.__doc__
assert mpct.DomainOfAttraction(controller).projection().area > 0
"""
    assert run(every, code) == (0, "")
