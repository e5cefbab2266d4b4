"""Campaigns: the same outcomes wherever they are done, resumable, and not ended by a run or a worker that fails."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from conftest import academic_problem

import mpct
from mpct._campaign_work import OUTCOME

VARYING = ("design_seconds", "mean_solve_seconds", "max_solve_seconds", "worker")
SETTING = mpct.Simulation([0, 0], [(0, [2, 0.5]), (10, [-2, -0.5])], 20)


def same(campaign):
    return [{k: v for k, v in row.items() if k not in VARYING} for row in campaign.rows]


def loops(count=24):
    random = np.random.default_rng(1)
    return [
        {"x0": random.uniform(-1, 1, 2), "disturbance": [0.01, 0.01], "scaling": 0.5 + 0.4 * (i % 2), "R": [100, 50 + i]}
        for i in range(count)
    ]


def test_grid_of_designs():
    found = mpct.campaign(academic_problem(), {"scaling": [0.5, 0.9], "horizon": [5, 10]}, processes=1)
    assert [(r["scaling"], r["horizon"]) for r in found.rows] == [(0.5, 5), (0.5, 10), (0.9, 5), (0.9, 10)]
    expected = [academic_problem(scaling=s).design().terminal_horizon for s in (0.5, 0.5, 0.9, 0.9)]
    assert [r["terminal_horizon"] for r in found.rows] == expected
    assert not found.failed and found.rows[0]["cumulative_cost"] is None
    frame = found.to_dataframe()
    assert frame.shape[0] == 4 and "key" not in frame
    assert "runs=4" in repr(found)


def test_processes_give_what_one_process_gives():
    first = mpct.campaign(academic_problem(), loops(), simulation=SETTING, processes=1)
    second = mpct.campaign(academic_problem(), loops(), simulation=SETTING, processes=2)
    assert same(first) == same(second)
    assert len({row["seed"] for row in first.rows}) == 24
    other = mpct.campaign(academic_problem(), loops(2), simulation=SETTING, processes=1, seed=1)
    assert other.rows[0]["final_state"] != first.rows[0]["final_state"]


def test_run_equals_the_closed_loop_alone():
    row = mpct.campaign(academic_problem(), loops(1), simulation=SETTING, processes=1).rows[0]
    controller = academic_problem(scaling=0.5, R=[100, 50]).design().controller()
    alone = mpct.simulate(
        controller, loops(1)[0]["x0"], SETTING.set_points, 20, disturbance=[0.01, 0.01], seed=row["seed"]
    )
    assert row["final_state"] == alone.final_state.tolist()
    assert row["cumulative_cost"] == alone.cumulative_cost


def test_a_campaign_of_200_designs_uses_two_processes():
    scalings = np.linspace(0.1, 0.999, 200)
    found = mpct.campaign(academic_problem(), {"scaling": scalings}, processes=2)
    assert len(found) == 200 and not found.failed
    assert len({row["worker"] for row in found.rows}) == 2
    horizons = [row["terminal_horizon"] for row in found.rows]
    assert horizons == sorted(horizons)


def test_failed_runs_are_recorded():
    runs = [{"scaling": 0.9}, {"scaling": 1.5}, {"Q": "heavy"}, {"x0": [9, 9]}, {"disturbance": [1.5, 1.5], "steps": 500}]
    found = mpct.campaign(academic_problem(), runs, simulation=SETTING, processes=1)
    assert [r["error"] for r in found.rows] == [None, "out_of_range", "argument", "initial_state", "infeasible"]
    assert "scaling" in found.rows[1]["message"]
    # What was known before the failure stays.
    assert found.rows[3]["terminal_horizon"] == 5 and found.rows[3]["steps_done"] is None
    assert found.rows[4]["steps_done"] > 0
    assert len(found.failed) == 4


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_resumes_from_its_file(tmp_path, suffix):
    if suffix == "parquet":
        pytest.importorskip("pyarrow")
    path = tmp_path / f"results.{suffix}"
    runs = [*loops(6), {"scaling": 1.5}]
    whole = mpct.campaign(academic_problem(), runs, simulation=SETTING, processes=1)
    again = mpct.campaign(academic_problem(), runs, simulation=SETTING, processes=1, results=path)
    assert same(again) == same(whole)
    # Half of the runs are forgotten.
    from mpct import _campaign_file

    kept = [row for row in again.rows if row["run"] % 2 == 0]
    _campaign_file.write(path, kept, again.parameters)
    seen = []
    resumed = mpct.campaign(
        academic_problem(), runs, simulation=SETTING, processes=1, results=path, progress=lambda *p: seen.append(p)
    )
    assert same(resumed) == same(whole)
    assert [p[0] for p in seen] == [5, 6, 7] and seen[-1] == (7, 7, 1)
    # What was kept was not done again: its times are those of the file.
    assert [resumed.rows[i]["max_solve_seconds"] for i in (0, 2, 4)] == [again.rows[i]["max_solve_seconds"] for i in (0, 2, 4)]
    assert mpct.campaign(academic_problem(), runs, simulation=SETTING, processes=1, results=path, progress=seen.append)
    with pytest.raises(mpct.ArgumentError, match="not of this campaign"):
        mpct.campaign(academic_problem(R=1), runs, simulation=SETTING, processes=1, results=path)
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_results_files_are_readable(tmp_path):
    pytest.importorskip("pyarrow")
    import pandas

    runs = {"scaling": [0.5, 0.9], "Q": [10, [1.0, 2.0]]}
    found = mpct.campaign(academic_problem(), runs, processes=1, results=tmp_path / "plain")
    assert found.results.suffix == ".parquet"
    assert pandas.read_parquet(found.results)["terminal_horizon"].tolist() == [r["terminal_horizon"] for r in found.rows]
    found = mpct.campaign(academic_problem(), runs, processes=1, results=tmp_path / "a.csv")
    assert pandas.read_csv(found.results)["scaling"].tolist() == [0.5, 0.5, 0.9, 0.9]
    with pytest.raises(mpct.ArgumentError, match="parquet or .csv"):
        mpct.campaign(academic_problem(), runs, results=tmp_path / "a.xlsx")
    (tmp_path / "b.csv").write_text("something else\n1\n")
    with pytest.raises(mpct.ArgumentError, match="results file of a campaign"):
        mpct.campaign(academic_problem(), runs, results=tmp_path / "b.csv")


@pytest.mark.parametrize(
    ("runs", "options", "message"),
    [
        ({"lambda": [0.5]}, {}, "parameters among"),
        ({"x0": [[0, 0]]}, {}, "simulation"),
        ({"scaling": 0.5}, {}, "a list of values"),
        ([0.5], {}, "a dictionary of parameters"),
        (3, {}, "a dictionary of lists"),
        ({"scaling": [0.5]}, {"processes": 0}, "processes"),
        ({"scaling": [0.5]}, {"start_method": "fork"}, "fork"),
        ({"scaling": [0.5]}, {"seed": -1}, "seed: expected a whole number >= 0"),
        ({"seed": ["x"]}, {"simulation": SETTING}, r"runs\[0\]\['seed'\]"),
        ({"seed": [2**63]}, {"simulation": SETTING}, r"runs\[0\]\['seed'\]: expected a whole number below"),
    ],
)
def test_refused(runs, options, message):
    with pytest.raises(mpct.ArgumentError, match=message):
        mpct.campaign(academic_problem(), runs, **options)


def test_a_file_that_cannot_be_written_is_told_before_the_work(tmp_path):
    seen = []
    with pytest.raises(FileNotFoundError):
        mpct.campaign(
            academic_problem(), {"scaling": [0.5]}, processes=1, results=tmp_path / "none" / "r.csv", progress=lambda *p: seen.append(p)
        )
    assert not seen


def test_a_failing_watcher_ends_the_workers():
    import multiprocessing

    def watch(done, total, failed):
        raise RuntimeError("seen enough")

    runs = [{"x0": [0.001 * i, 0]} for i in range(64)]
    with pytest.raises(RuntimeError, match="seen enough"):
        mpct.campaign(academic_problem(), runs, simulation=SETTING, processes=2, progress=watch)
    # The pool's own thread may be the one that is told of their end.
    patience = time.monotonic() + 10
    while multiprocessing.active_children() and time.monotonic() < patience:
        time.sleep(0.01)
    assert not multiprocessing.active_children()


@pytest.mark.parametrize("text", ["notes\n", "", "\0\0", "run,scaling\n0,0.5\n"])
def test_a_file_that_is_none_of_a_campaign_stays(tmp_path, text):
    path = tmp_path / "notes.csv"
    path.write_text(text)
    with pytest.raises(mpct.ArgumentError, match="results: expected a results file of a campaign"):
        mpct.campaign(academic_problem(), {"scaling": [0.5]}, processes=1, results=path)
    assert path.read_text() == text


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_a_parameter_of_any_size_is_written(tmp_path, suffix):
    if suffix == "parquet":
        pytest.importorskip("pyarrow")
    runs = [{"horizon": 2**70}, {"horizon": 5}, {"Q": [1, 2]}, {"Q": np.eye(2)}, {"name": 'a,"b\n'}, {"scaling": float("nan")}]
    for _ in range(2):
        found = mpct.campaign(academic_problem(), runs, processes=1, results=tmp_path / f"r.{suffix}")
        assert [row["error"] for row in found.rows] == ["argument", None, None, None, None, "out_of_range"]


def test_files_are_written_where_links_and_devices_point(tmp_path):
    path, link = tmp_path / "r.csv", tmp_path / "link.csv"
    link.symlink_to(path)
    mpct.campaign(academic_problem(), {"scaling": [0.5]}, processes=1, results=link)
    assert link.is_symlink() and path.is_file()
    mpct.ProblemFile(academic_problem()).write(os.devnull)
    assert not Path(os.devnull).is_file()
    with pytest.raises(IsADirectoryError):
        mpct.ProblemFile(academic_problem()).write(tmp_path)


def test_no_runs():
    assert len(mpct.campaign(academic_problem(), [])) == 0


def test_killed_process(tmp_path):
    runs = [{"x0": [0.01 * i, 0], "steps": 2000} for i in range(24)]
    killed = []

    def kill_once(done, total, failed):
        if not killed and done >= 2:
            killed.append(int(worker_of_a_child()))
            os.kill(killed[0], signal.SIGKILL)

    found = mpct.campaign(academic_problem(), runs, simulation=SETTING, processes=2, progress=kill_once)
    assert killed and not found.failed
    assert same(found) == same(mpct.campaign(academic_problem(), runs, simulation=SETTING, processes=1))


def worker_of_a_child():
    import multiprocessing

    return next(p.pid for p in multiprocessing.active_children())


class EndsItsProcess:
    """Takes down the process that receives it."""

    def __reduce__(self):
        return os._exit, (1,)


@pytest.mark.parametrize("method", ["spawn", "forkserver"])
def test_run_that_kills_its_worker(method):
    runs = [{"scaling": 0.5 + 0.01 * i} for i in range(20)]
    runs[7] = {"name": EndsItsProcess()}
    found = mpct.campaign(academic_problem(), runs, processes=2, start_method=method)
    assert [row["run"] for row in found.failed] == [7] and found.rows[7]["error"] == "worker_lost"


def test_interrupt_keeps_what_was_done(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        f"""
import signal
import sys
sys.path.insert(0, {str(Path(__file__).parent)!r})
from conftest import academic_problem
import mpct
if __name__ == "__main__":
    # As in a terminal: tests that a shell runs in the background inherit an interrupt that is ignored.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    runs = [{{"x0": [0.001 * i, 0]}} for i in range(1000)]
    setting = mpct.Simulation([0, 0], [2, 0.5], 3000)
    try:
        mpct.campaign(academic_problem(), runs, simulation=setting, processes=2, results={str(tmp_path / "r.csv")!r},
                      progress=lambda *p: print(*p, flush=True))
    except KeyboardInterrupt:
        print("interrupted", flush=True)
"""
    )
    process = subprocess.Popen(
        [sys.executable, script], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    try:
        assert process.stdout.readline().startswith("1 ")
        os.killpg(process.pid, signal.SIGINT)
        out, err = process.communicate(timeout=30)
    finally:
        process.kill()
    assert out.endswith("interrupted\n") and err == ""
    assert 1 <= len((tmp_path / "r.csv").read_text().splitlines()) - 1 < 1000


def test_script_without_guard_is_told(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        f"""
import sys
sys.path.insert(0, {str(Path(__file__).parent)!r})
from conftest import academic_problem
import mpct
mpct.campaign(academic_problem(), {{"scaling": [0.5, 0.9]}}, processes=2)
"""
    )
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=60)
    assert done.returncode != 0 and "__name__ == '__main__'" in done.stderr


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_on_a_dask_cluster_of_which_a_worker_is_killed(tmp_path, suffix):
    distributed = pytest.importorskip("distributed")
    runs = [{"x0": [0.01 * i, 0], "disturbance": [0.01, 0.01], "steps": 1500} for i in range(40)]
    runs.append({"scaling": 1.5})
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None, processes=True) as cluster,
        distributed.Client(cluster) as client,
    ):
        pids = client.run(os.getpid)
        assert len(pids) == 2
        killed = []

        def kill_once(done, total, failed):
            if not killed:
                killed.append(next(iter(pids.values())))
                os.kill(killed[0], signal.SIGKILL)

        path = tmp_path / f"r.{suffix}"
        options = {"simulation": SETTING, "client": client, "results": path}
        found = mpct.campaign(academic_problem(), runs, progress=kill_once, **options)
        assert killed
        # The first half of the file is kept; a second campaign does the rest.
        from mpct import _campaign_file

        _campaign_file.write(path, found.rows[:20], found.parameters)
        seen = []
        resumed = mpct.campaign(academic_problem(), runs, progress=lambda *p: seen.append(p), **options)
    assert seen[0][0] == 21 and seen[-1] == (41, 41, 1) and same(resumed) == same(found)
    assert [row["error"] for row in found.rows] == [None] * 40 + ["out_of_range"]
    workers = {row["worker"].split(":")[1] for row in found.rows}
    assert str(list(pids.values())[1]) in workers
    assert same(found) == same(mpct.campaign(academic_problem(), runs, simulation=SETTING, processes=1))


def test_outcomes_name_every_column():
    row = mpct.campaign(academic_problem(), {"scaling": [0.5]}, processes=1).rows[0]
    assert set(OUTCOME) <= set(row)


def test_other_threads_run_meanwhile():
    ticks, stop = [], threading.Event()

    def tick():
        while not stop.is_set():
            ticks.append(time.monotonic())
            time.sleep(0.005)

    thread = threading.Thread(target=tick)
    thread.start()
    mpct.simulate(academic_problem().design().controller(), [0, 0], [2, 0.5], 20000)
    stop.set()
    thread.join()
    assert max(np.diff(ticks)) < 0.5
