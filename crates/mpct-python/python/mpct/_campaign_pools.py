"""Where the runs of a campaign are done: processes of this machine, or a Dask cluster."""

from __future__ import annotations

import multiprocessing
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from ._campaign_work import OUTCOME, Task, Work, failure, ping, prepare_process, run_tasks
from ._errors import argument_type

Outcome = tuple[int, dict[str, Any]]

LARGEST_CHUNK = 16
"""Runs that go to a worker together: a design of a small plant takes less time than its way there."""
AHEAD = 3
"""Chunks handed out for each process, so that none waits for work."""


STRIKES = 2
"""A run that was alone each time its worker ended so often is recorded as lost. Once may be chance."""


def chunks(tasks: Sequence[Task], workers: int) -> deque[list[Task]]:
    size = max(1, min(LARGEST_CHUNK, len(tasks) // (8 * workers)))
    return deque(list(tasks[i : i + size]) for i in range(0, len(tasks), size))


def lost(task: Task, error: BaseException) -> Outcome:
    """The outcome of a run that took its worker with it."""
    told = {"error": "worker_lost", "message": f"the worker ended during this run: {failure(error)['message']}"}
    return task.index, {name: told.get(name) for name in OUTCOME}


def in_processes(work: Work, tasks: Sequence[Task], processes: int, method: str) -> Iterator[Outcome]:
    """Outcomes as they come, from processes of this machine.

    A worker that dies breaks the pool. The chunks it may have held are then done run by run, so that the run that
    kills its worker is found and recorded.
    """
    context = multiprocessing.get_context(method)

    def pool_of(count: int) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(count, mp_context=context, initializer=prepare_process)

    waiting = chunks(tasks, processes)
    suspects: deque[list[Task]] = deque()
    pool = pool_of(processes)
    running: dict[Future[list[Outcome]], list[Task]] = {}
    strikes: dict[int, int] = {}
    works = finished = False
    try:
        while waiting or suspects or running:
            # Suspects go alone: a pool that breaks then names the run.
            room = 1 if suspects else AHEAD * processes
            source = suspects if suspects else waiting
            broken: BaseException | None = None
            try:
                while source and len(running) < room:
                    chunk = source[0]
                    running[pool.submit(run_tasks, work, chunk)] = chunk
                    source.popleft()
            except BrokenProcessPool as error:
                broken = error
            done, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                chunk = running.pop(future)
                try:
                    outcomes = future.result()
                except BrokenProcessPool as error:
                    broken = error
                    alone = room == 1 and len(chunk) == 1
                    strikes[chunk[0].index] = strikes.get(chunk[0].index, 0) + alone
                    if strikes[chunk[0].index] >= STRIKES:
                        yield lost(chunk[0], error)
                    else:
                        suspects.extend([task] for task in chunk)
                    continue
                works = True
                yield from outcomes
            if broken is not None:
                for chunk in running.values():
                    suspects.extend([task] for task in chunk)
                running.clear()
                pool.shutdown(wait=False, cancel_futures=True)
                pool = pool_of(processes)
                if not works:
                    _must_answer(pool)
                    works = True
        finished = True
    finally:
        _end(pool, finished)


def _must_answer(pool: ProcessPoolExecutor) -> None:
    """Refuses to go on when no process can be started at all."""
    try:
        pool.submit(ping).result()
    except BrokenProcessPool as error:
        raise RuntimeError(
            "no worker process could be started. A script that calls mpct.campaign must do so below "
            "`if __name__ == '__main__':`, because each process imports the script; a program read from standard input "
            "can use processes=1"
        ) from error


def _end(pool: ProcessPoolExecutor, finished: bool) -> None:
    if finished:
        pool.shutdown()
        return
    # After Ctrl-C nobody waits for the runs under way.
    processes = list((getattr(pool, "_processes", None) or {}).values())
    pool.shutdown(wait=False, cancel_futures=True)
    for process in processes:
        process.terminate()
    for process in processes:
        process.join()


def check_client(client: Any) -> None:
    """Refuses what is no client of a Dask cluster."""
    try:
        from distributed import Client
    except ImportError as error:
        raise ImportError("campaigns on a cluster need distributed: pip install 'mpct[campaign]'") from error
    if not isinstance(client, Client):
        raise argument_type("client", "a distributed.Client", repr(client)[:200])


def on_cluster(work: Work, tasks: Sequence[Task], client: Any) -> Iterator[Outcome]:
    """Outcomes as they come, from the workers of a `distributed.Client`.

    Dask does the runs of a worker that was lost again elsewhere. A chunk that has lost several workers is done run by
    run, and the run that loses several alone is recorded.
    """
    from distributed import as_completed

    threads = sum(client.nthreads().values()) or 1
    # The work goes with each chunk: what is scattered is gone when the workers that hold it are.
    futures = {client.submit(run_tasks, work, chunk, pure=False): chunk for chunk in chunks(tasks, threads)}
    stream = as_completed(list(futures))
    try:
        for future in stream:
            chunk = futures.pop(future)
            try:
                outcomes = future.result()
            except Exception as failed:
                error = failed
            else:
                future.release()
                yield from outcomes
                continue
            if len(chunk) == 1:
                yield lost(chunk[0], error)
                continue
            for task in chunk:
                again = client.submit(run_tasks, work, [task], pure=False)
                futures[again] = [task]
                stream.add(again)
    finally:
        client.cancel(list(futures))
