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

from . import plots as plots
from ._campaign import Campaign, campaign
from ._errors import (
    ArgumentError,
    ArgumentTypeError,
    DesignError,
    Error,
    FileError,
    SimulationError,
    StepError,
    VerifyError,
)
from ._figures import (
    ComparedFigure,
    ConstraintMargin,
    Performance,
    ScalingAdvice,
    ScalingNeed,
    Settling,
    compare,
    example,
    performance,
    reproduce,
    scaling_advice,
    scaling_need,
    verify,
)
from ._files import ProblemFile
from ._mpct import (
    AlphaBounds,
    Controller,
    Design,
    DomainOfAttraction,
    Plant,
    Problem,
    StabilityRegion,
    Step,
    __version__,
)
from ._results import (
    AdmissibleSetPoint,
    Assumption,
    Attraction,
    ConstraintRows,
    ImplicitTerminalCost,
    MaximalAdmissibleSet,
    Membership,
    Polygon,
    Reach,
    RuntimeTables,
    Verified,
    Volume,
)
from ._run import Run, Simulation, simulate
from ._sweep import SweepPoint, sweep

__all__ = [
    "AdmissibleSetPoint",
    "AlphaBounds",
    "ArgumentError",
    "ArgumentTypeError",
    "Assumption",
    "Attraction",
    "Campaign",
    "ComparedFigure",
    "ConstraintMargin",
    "ConstraintRows",
    "Controller",
    "Design",
    "DesignError",
    "DomainOfAttraction",
    "Error",
    "FileError",
    "ImplicitTerminalCost",
    "MaximalAdmissibleSet",
    "Membership",
    "Performance",
    "Plant",
    "Polygon",
    "Problem",
    "ProblemFile",
    "Reach",
    "Run",
    "RuntimeTables",
    "ScalingAdvice",
    "ScalingNeed",
    "Settling",
    "Simulation",
    "SimulationError",
    "StabilityRegion",
    "Step",
    "StepError",
    "SweepPoint",
    "Verified",
    "VerifyError",
    "Volume",
    "__version__",
    "campaign",
    "compare",
    "example",
    "performance",
    "reproduce",
    "scaling_advice",
    "scaling_need",
    "simulate",
    "sweep",
    "verify",
]
