"""What a campaign does in its workers: one design, and one closed loop when it is asked for."""

from __future__ import annotations

import functools
import json
import os
import socket
import threading
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from ._errors import Error
from ._mpct import Design, Problem
from ._run import Run, Simulation

OF_SIMULATION = ("x0", "set_points", "steps", "disturbance", "seed")
"""Parameters of a run that are those of its simulation; the others go to `Problem.replace`."""

OUTCOME: dict[str, type] = {
    "terminal_horizon": int,
    "spectral_radius": float,
    "constraint_rows": int,
    "steps_done": int,
    "cumulative_cost": float,
    "worst_violation": float,
    "candidates": int,
    "admissible": bool,
    "final_state": list,
    "error": str,
    "message": str,
    "design_seconds": float,
    "mean_solve_seconds": float,
    "max_solve_seconds": float,
    "worker": str,
}
"""What is recorded of a run. The last four differ from one execution to the next."""


@dataclass(frozen=True)
class Task:
    """One run: its number, what it changes, and its seed."""

    index: int
    parameters: dict[str, Any]
    seed: int


@dataclass(frozen=True)
class Work:
    """What all runs of a campaign share."""

    problem: str
    simulation: Simulation | None
    options: dict[str, Any] = field(default_factory=dict)


@functools.lru_cache(maxsize=8)
def _design(problem: str, changes: bytes, options: str) -> Design:
    import pickle

    changed = Problem.from_toml(problem).replace(**pickle.loads(changes))
    return changed.design(progress=False, **json.loads(options))


def _run(work: Work, task: Task) -> dict[str, Any]:
    import pickle

    changes = {k: v for k, v in task.parameters.items() if k not in OF_SIMULATION}
    # Runs that differ in their simulation alone share a design.
    design = _design(work.problem, pickle.dumps(changes), json.dumps(work.options))
    found: dict[str, Any] = {
        "terminal_horizon": design.terminal_horizon,
        "spectral_radius": design.spectral_radius,
        "constraint_rows": design.rows,
        "design_seconds": design.seconds,
    }
    if work.simulation is None:
        return found
    setting = {name: getattr(work.simulation, name) for name in OF_SIMULATION}
    setting.update({k: v for k, v in task.parameters.items() if k in OF_SIMULATION})
    setting["seed"] = task.seed
    run: Run | None
    try:
        run = Simulation(**setting).run(design.controller())
    except Error as error:
        # The design is known, and what was done before the failing step.
        found.update(failure(error))
        run = error.fields.get("run")
    if run is None or len(run) == 0:
        return found
    found.update(
        steps_done=len(run),
        cumulative_cost=run.cumulative_cost,
        worst_violation=run.worst_violation,
        candidates=sum(status != "optimal" for status in run.status),
        admissible=bool(run.admissible.all()),
        final_state=run.final_state.tolist(),
        mean_solve_seconds=float(run.solve_seconds.mean()),
        max_solve_seconds=float(run.solve_seconds.max()),
    )
    return found


def failure(error: BaseException) -> dict[str, str]:
    """How an error is recorded."""
    return {"error": getattr(error, "kind", type(error).__name__), "message": getattr(error, "message", str(error))}


def run_tasks(work: Work, tasks: Sequence[Task]) -> list[tuple[int, dict[str, Any]]]:
    """The outcomes of some runs. An error of one is its outcome and does not stop the others."""
    outcomes = []
    for task in tasks:
        try:
            found = _run(work, task)
        except (KeyboardInterrupt, SystemExit):
            raise
        except BaseException as error:  # a panic of the compiled half is no Exception
            found = failure(error)
        found["worker"] = f"{socket.gethostname()}:{os.getpid()}"
        outcomes.append((task.index, {name: found.get(name) for name in OUTCOME}))
    return outcomes


def prepare_process() -> None:
    """The first thing in a worker process of our own."""
    import multiprocessing
    import multiprocessing.connection
    import signal

    # Ctrl-C goes to the process that waits; it ends this one.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Runs are parallel already.
    os.environ.setdefault("RAYON_NUM_THREADS", "1")
    parent = multiprocessing.parent_process()

    def leave_with(sentinel: int) -> None:
        multiprocessing.connection.wait([sentinel])
        os._exit(1)

    if parent is not None:
        threading.Thread(target=leave_with, args=(parent.sentinel,), daemon=True).start()


def ping() -> int:
    """Tells that a worker is there."""
    return os.getpid()
