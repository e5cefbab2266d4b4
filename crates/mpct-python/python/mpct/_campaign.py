"""Many designs or closed loops at once."""

from __future__ import annotations

import contextlib
import hashlib
import inspect
import itertools
import json
import os
import pickle
import time
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from . import _campaign_file, _campaign_pools, _progress
from ._campaign_work import OF_SIMULATION, Task, Work, run_tasks
from ._convert import instance
from ._errors import argument, argument_type
from ._mpct import Problem, __version__
from ._run import Simulation

if TYPE_CHECKING:
    import pandas

SAVE_EVERY = 5.0
"""Seconds between two writes of the results file."""
_OF_PROBLEM = tuple(n for n in inspect.signature(Problem.replace).parameters if n != "self")


@dataclass(eq=False, repr=False)
class Campaign:
    """The outcomes of many runs. Made by `campaign`.

    Attributes
    ----------
    rows : list of dict
        One for each run: ``run`` (its number), its parameters, ``seed``, ``terminal_horizon``, ``spectral_radius``,
        ``constraint_rows``, of a closed loop ``steps_done``, ``cumulative_cost``, ``worst_violation``, ``candidates``
        (steps without optimum), ``admissible`` (whether every set-point is) and ``final_state``, of a failed run
        ``error`` (its kind) and ``message``, and then times and the worker. What is not known is None.
    parameters : list of str
        Names of the parameters that runs change.
    results : pathlib.Path or None
        The results file.
    """

    rows: list[dict[str, Any]]
    parameters: list[str]
    results: Path | None

    @property
    def failed(self) -> list[dict[str, Any]]:
        """The rows of runs that failed."""
        return [row for row in self.rows if row["error"] is not None]

    def __len__(self) -> int:
        """Number of runs."""
        return len(self.rows)

    def __repr__(self) -> str:
        where = "" if self.results is None else f", results='{self.results}'"
        return f"Campaign(runs={len(self)}, failed={len(self.failed)}, parameters={self.parameters}{where})"

    def to_dataframe(self) -> pandas.DataFrame:
        """The runs as a table, one run a row.

        Returns
        -------
        pandas.DataFrame
        """
        try:
            import pandas
        except ImportError as error:
            raise ImportError("Campaign.to_dataframe needs pandas: pip install pandas") from error
        return pandas.DataFrame(self.rows).drop(columns="key", errors="ignore").set_index("run")


Campaign.__module__ = "mpct"


def _expand(runs: Any) -> list[dict[str, Any]]:
    """A grid or a list of samples as the parameters of each run."""
    if isinstance(runs, Mapping):
        for name, values in runs.items():
            if isinstance(values, (str, bytes, Mapping)) or not isinstance(values, Iterable):
                raise argument_type(f"runs[{name!r}]", "a list of values", repr(values))
        values = [list(v) for v in runs.values()]
        return [dict(zip(runs, chosen, strict=True)) for chosen in itertools.product(*values)]
    if isinstance(runs, (str, bytes)) or not isinstance(runs, Iterable):
        raise argument_type("runs", "a dictionary of lists (a grid) or a list of dictionaries (samples)", repr(type(runs)))
    samples = list(runs)
    for i, sample in enumerate(samples):
        if not isinstance(sample, Mapping):
            raise argument_type(f"runs[{i}]", "a dictionary of parameters", repr(sample))
    return [dict(sample) for sample in samples]


def _check_names(names: Iterable[str], simulated: bool) -> None:
    known = _OF_PROBLEM + (OF_SIMULATION if simulated else ())
    for name in names:
        if name in OF_SIMULATION and not simulated:
            raise argument("simulation", f"a Simulation, because runs change {name!r}", "none")
        if name not in known:
            raise argument("runs", f"parameters among {', '.join(known)}", repr(name))


def _check_options(condition: Any, max_horizon: Any, time_limit: Any) -> None:
    """Refuses before the work what every run would fail with."""
    if condition not in ("exact", "sufficient"):
        raise argument("condition", "'exact' or 'sufficient'", repr(condition))
    if _whole(max_horizon, "max_horizon") < 1:
        raise argument("max_horizon", "a whole number >= 1", repr(max_horizon))
    if time_limit is not None and not (isinstance(time_limit, (int, float, np.number)) and time_limit >= 0.0):
        raise argument("time_limit", "a number of seconds >= 0", repr(time_limit))


def _check_pickles(runs: Sequence[Mapping[str, Any]]) -> None:
    """Runs go to their workers as pickles."""
    for i, run in enumerate(runs):
        try:
            pickle.dumps(run)
        except Exception as error:
            raise argument_type(f"runs[{i}]", "values that can be pickled", f"one that cannot: {error}") from error


def _whole(value: Any, what: str) -> int:
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < 0:
        raise argument(what, "a whole number >= 0", repr(value))
    return int(value)


def _run_seed(value: Any, index: int) -> int:
    what = f"runs[{index}]['seed']"
    # Problem files hold signed 64-bit integers.
    if _whole(value, what) >= 2**63:
        raise argument(what, "a whole number below 2**63", repr(value))
    return int(value)


def _seed(seed: int, index: int) -> int:
    """The seed of a run, whichever worker does it."""
    return int(np.random.SeedSequence([seed, index]).generate_state(1, np.uint64)[0] >> np.uint64(1))


def campaign(
    problem: Problem,
    runs: Mapping[str, Any] | Iterable[Mapping[str, Any]],
    *,
    simulation: Simulation | None = None,
    condition: Literal["exact", "sufficient"] = "exact",
    max_horizon: int = 5000,
    time_limit: float | None = None,
    seed: int = 0,
    results: str | PathLike[str] | None = None,
    retry_failed: bool = False,
    processes: int | None = None,
    client: Any = None,
    start_method: str = "spawn",
    progress: Callable[[int, int, int], object] | bool | None = None,
) -> Campaign:
    """Runs many designs, or many closed loops, in processes or on a Dask cluster.

    Parameters
    ----------
    problem : Problem
        The problem.
    runs : dict of list, or iterable of dict
        A grid (every combination of the values) or samples (one dictionary a run). Names are those of
        `Problem.replace`, such as ``scaling``, ``horizon``, ``Q``, and with a simulation also ``x0``, ``set_points``,
        ``steps``, ``disturbance`` and ``seed``.
    simulation : Simulation, optional
        The closed loop of each run; without it runs are designs.
    condition, max_horizon, time_limit
        As in `Problem.design`, for each run.
    seed : int, default 0
        Each run has a seed of its own, made of this and its number, unless it states one.
    results : str or os.PathLike, optional
        A file for the outcomes, Parquet or CSV by its suffix; without suffix Parquet when pyarrow is there, else CSV.
        When it exists, the runs in it are not done again. It is always whole: written beside and renamed.
    retry_failed : bool, default False
        Whether runs that failed are done again. Runs that lost their worker always are.
    processes : int, optional
        Processes on this machine; one for each core unless stated. With 1 the runs are done in this process.
    client : distributed.Client, optional
        A Dask cluster that does the runs instead.
    start_method : {"spawn", "forkserver"}
        How processes are started.
    progress : callable or bool, optional
        Called with (runs done, runs in all, runs failed). True shows a progress bar, False none; unless stated, a
        terminal and a notebook show one.

    Returns
    -------
    Campaign
        In the order of the runs. The outcomes do not depend on where and when a run is done.

    Notes
    -----
    A run that fails is recorded and does not end the campaign; neither does a worker that is killed. After Ctrl-C the
    results file has what was done. A script that uses processes must call this below ``if __name__ == "__main__":``.

    Examples
    --------
    >>> import mpct
    >>> problem = mpct.example("academic").problem
    >>> found = mpct.campaign(problem, {"scaling": [0.5, 0.9], "horizon": [5, 10]}, processes=1)
    >>> [row["terminal_horizon"] for row in found.rows]
    [3, 3, 5, 5]
    """
    instance(problem, Problem, "problem")
    if simulation is not None:
        instance(simulation, Simulation, "simulation")
    _check_options(condition, max_horizon, time_limit)
    if start_method not in ("spawn", "forkserver"):
        raise argument("start_method", "'spawn' or 'forkserver', because threads do not survive a fork", repr(start_method))
    if processes is not None and _whole(processes, "processes") < 1:
        raise argument("processes", "a whole number >= 1", repr(processes))
    if client is not None:
        _campaign_pools.check_client(client)
    options = {"condition": condition, "max_horizon": max_horizon, "time_limit": time_limit}
    expanded = _expand(runs)
    names = list(dict.fromkeys(name for run in expanded for name in run))
    _check_names(names, simulation is not None)
    seed = _whole(seed, "seed")
    seeds = [_run_seed(run["seed"], i) if "seed" in run else _seed(seed, i) for i, run in enumerate(expanded)]
    _check_pickles(expanded)
    tasks = [Task(i, run, s) for i, (run, s) in enumerate(zip(expanded, seeds, strict=True))]
    work = Work(problem.to_toml(), simulation, options)
    shown = [name for name in names if name != "seed"]
    table = _Table(work, tasks, shown, None if results is None else _campaign_file.path_of(results), retry_failed)
    # A file that cannot be written is told before the work, not after it.
    table.save()
    bar = _progress.watcher(progress, "campaign", "{done}/{total} runs, {extra} failed")
    try:
        with contextlib.closing(_outcomes(work, table.left, processes, client, start_method)) as outcomes:
            for index, outcome in outcomes:
                table.take(index, outcome)
                if bar is not None:
                    bar(table.done, len(tasks), table.failures)
    finally:
        table.save()
        if bar is not None and hasattr(bar, "close"):
            bar.close()
    return Campaign(table.rows, shown, table.path)


def _outcomes(
    work: Work, tasks: Sequence[Task], processes: int | None, client: Any, start_method: str
) -> Generator[tuple[int, dict[str, Any]], None, None]:
    if not tasks:
        return
    if client is not None:
        yield from _campaign_pools.on_cluster(work, tasks, client)
        return
    available = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    processes = min(processes or available, len(tasks))
    if processes > 1:
        yield from _campaign_pools.in_processes(work, tasks, processes, start_method)
        return
    for task in tasks:
        yield from run_tasks(work, [task])


class _Table:
    """The rows of a campaign while they fill, and their file."""

    def __init__(self, work: Work, tasks: Sequence[Task], names: list[str], path: Path | None, retry: bool) -> None:
        self.path, self._names = path, names
        self.rows: list[dict[str, Any]] = []
        self.done = self.failures = 0
        self._saved = time.monotonic()
        known = _campaign_file.read(path) if path is not None and path.exists() else {}
        setting = None if work.simulation is None else _campaign_file.plain(vars(work.simulation))
        shared = json.dumps([work.problem, setting, work.options, __version__], sort_keys=True)
        self.left: list[Task] = []
        for task in tasks:
            parameters = _campaign_file.plain(task.parameters)
            spelled = json.dumps([shared, task.index, parameters, task.seed], sort_keys=True, default=repr)
            key = hashlib.sha256(spelled.encode()).hexdigest()[:16]
            row = {"run": task.index, **{name: parameters.get(name) for name in names}, "seed": task.seed}
            self.rows.append({**row, "key": key})
            outcome = known.pop(key, None)
            if outcome is None or outcome["error"] == "worker_lost" or (retry and outcome["error"] is not None):
                self.left.append(task)
            else:
                self._fill(task.index, outcome)
        if known:
            raise argument(
                "results",
                "a file of this campaign, or one that does not exist yet",
                f"{path}, of which {len(known)} runs are not of this campaign (another problem, list of runs, "
                "simulation, option or version)",
            )

    def _fill(self, index: int, outcome: dict[str, Any]) -> None:
        key = self.rows[index].pop("key")
        self.rows[index].update(outcome, key=key)
        self.done += 1
        self.failures += outcome["error"] is not None

    def take(self, index: int, outcome: dict[str, Any]) -> None:
        self._fill(index, outcome)
        if time.monotonic() - self._saved > SAVE_EVERY:
            self.save()

    def save(self) -> None:
        if self.path is not None:
            finished = [row for row in self.rows if "error" in row]
            _campaign_file.write(self.path, finished, self._names)
        self._saved = time.monotonic()
