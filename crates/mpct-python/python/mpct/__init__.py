"""Model predictive control for tracking, with a terminal set that scales.

>>> import mpct
>>> plant = mpct.Plant([[1, 1], [0, 1]], [[0, 0.5], [1, 0.5]])
>>> problem = mpct.Problem(plant, state=(-3, 3), input=(-2, 2), Q=10, R=100, O=1e4, horizon=10, scaling=0.9)
>>> design = problem.design()
>>> design.terminal_horizon
5
>>> controller = design.controller()
>>> step = controller.step([0, 0], [2, 0.5])
>>> step.admissible
True
>>> run = mpct.simulate(controller, [0, 0], [2, 0.5], steps=50)
>>> run.x.shape
(50, 2)
"""

from ._errors import DesignError, FileError, StepError
from ._mpct import AdmissibleSetPoint, Controller, Design, Plant, Problem, Step, __version__
from ._run import Run, simulate
from ._sweep import SweepPoint, sweep

__all__ = [
    "AdmissibleSetPoint",
    "Controller",
    "Design",
    "DesignError",
    "FileError",
    "Plant",
    "Problem",
    "Run",
    "Step",
    "StepError",
    "SweepPoint",
    "__version__",
    "simulate",
    "sweep",
]
