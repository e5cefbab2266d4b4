"""Long work: threads, Ctrl-C, progress, limits."""

import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from conftest import academic_problem, threads_agree

import mpct


def test_progress_bar(problem, capsys, monkeypatch):
    from mpct import _progress

    monkeypatch.setattr(_progress, "_DELAY", 0.0)
    bar = _progress.bar(True)
    for done in range(3):
        bar(done, 3, 7)
        time.sleep(0.11)
    bar.close()
    shown = capsys.readouterr().err
    assert "2/3 rows" in shown and "M̃ ≥ 7" in shown and shown.endswith("\r")
    assert problem.design(progress=True).terminal_horizon == 5
    # Nobody looks at a captured stream.
    problem.design()
    assert capsys.readouterr().err == ""


def test_time_limit():
    with pytest.raises(mpct.DesignError) as error:
        mpct.example("carts", 40).problem.design(time_limit=0.0)
    assert error.value.kind == "interrupted" and error.value.at_least >= 0


def test_threads_share_a_controller(controller):
    expected = controller.step([0, 0], [2, 0.5]).u
    wrong = []

    def work():
        for _ in range(50):
            if not np.allclose(controller.step([0, 0], [2, 0.5]).u, expected, atol=1e-6):
                wrong.append(1)

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


def test_threads_with_controllers_of_their_own(design):
    points = ([2, 0.5], [-2, -0.5], [1, 0.25], [5, 1])
    expected = [mpct.simulate(design.controller(), [0, 0], point, 2000).x for point in points]
    found = [None] * 4

    def work(i):
        controller, x = design.controller(), np.zeros(2)
        A, B = design.problem.plant.A, design.problem.plant.B
        found[i] = [x]
        for _ in range(1999):
            x = A @ x + B @ controller.step(x, points[i]).u
            found[i].append(x)

    threads = [threading.Thread(target=work, args=(i,)) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for mine, alone in zip(found, expected):
        np.testing.assert_allclose(mine, alone, atol=1e-9)


def test_closed_loops_of_one_controller_follow_one_another(controller):
    expected = mpct.simulate(controller, [0, 0], [2, 0.5], 3000).x.tobytes()
    told = []
    assert threads_agree(lambda: told.append(mpct.simulate(controller, [0, 0], [2, 0.5], 3000).x.tobytes()) or told[-1])
    assert told == [expected] * 4


def test_progress_of_a_long_design():
    seen = []
    try:
        academic_problem(scaling=0.999999).design(condition="sufficient", time_limit=1.0, progress=lambda *p: seen.append(p))
    except mpct.DesignError:
        pass
    assert all(len(p) == 3 for p in seen)


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
@pytest.mark.parametrize("work", ["simulate", "other thread"])
def test_interrupt(work):
    code = f"""
import sys, threading
sys.path.insert(0, {str(Path(__file__).parent)!r})
from conftest import academic_problem
import mpct
controller = academic_problem().design().controller()
ticks = []
if {work == "other thread"}:
    def tick():
        import time
        while True:
            time.sleep(0.01); ticks.append(1)
    threading.Thread(target=tick, daemon=True).start()
print("ready", flush=True)
try:
    mpct.simulate(controller, [0, 0], [2, 0.5], steps=100_000_000)
except KeyboardInterrupt:
    print("interrupted", len(ticks) > 10 or not {work == "other thread"}, flush=True)
"""
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout.readline() == "ready\n"
        time.sleep(1.0)
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=20)
    finally:
        process.kill()
    assert out == "interrupted True\n"


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_interrupt_of_a_design():
    code = """
import mpct
problem = mpct.example("carts", 60).problem.replace(scaling=0.999999)
print("ready", flush=True)
try:
    problem.design(condition="sufficient", max_horizon=10**7)
    print("done")
except KeyboardInterrupt:
    print("interrupted", flush=True)
except mpct.DesignError as error:
    print(error.kind)
"""
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout.readline() == "ready\n"
        time.sleep(0.5)
        started = time.monotonic()
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=60)
    finally:
        process.kill()
    assert out == "interrupted\n"
    assert time.monotonic() - started < 10


def test_a_failing_watcher_ends_the_design():
    def watch(done, total, at_least):
        raise RuntimeError("seen enough")

    with pytest.raises(RuntimeError, match="seen enough"):
        mpct.example("carts", 60).problem.replace(scaling=0.999999).design("sufficient", 10**7, progress=watch)


def test_designs_in_threads():
    assert threads_agree(lambda: [academic_problem(scaling=s).design().terminal_horizon for s in (0.5, 0.9, 0.99)])


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
@pytest.mark.parametrize(
    "work",
    [
        "mpct.reproduce('standard')",
        "mpct.DomainOfAttraction(problem.design().controller()).projection()",
        "mpct.campaign(problem, {'horizon': range(1, 5000)}, processes=1)",
    ],
)
def test_interrupt_of_other_long_work(work):
    code = f"""
import mpct
problem = mpct.example("carts", 40).problem
print("ready", flush=True)
try:
    {work}
    print("done")
except KeyboardInterrupt:
    print("interrupted", flush=True)
"""
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout.readline() == "ready\n"
        time.sleep(0.7)
        started = time.monotonic()
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=60)
    finally:
        process.kill()
    assert out == "interrupted\n"
    assert time.monotonic() - started < 10
    assert process.returncode == 0


@pytest.mark.skipif(not hasattr(__import__("os"), "fork"), reason="no fork")
def test_work_in_a_forked_process():
    code = """
import multiprocessing, sys, warnings
import mpct
warnings.simplefilter("ignore")

def work(count):
    # A process forked from the forked one works, too.
    if count > 4:
        with multiprocessing.get_context("fork").Pool(1) as pool:
            return pool.map(work, [count - 3])[0]
    file = mpct.example("carts", count)
    design = file.problem.design()
    run = file.simulation.run(design.controller())
    return design.terminal_horizon, len(design.terminal_set()[1]) > 0, mpct.verify(design.certificate()).terminal_horizon

class NotDaemons(multiprocessing.get_context("fork").Process):
    daemon = property(lambda self: False, lambda self, value: None)

if __name__ == "__main__":
    expected = [work(3), work(4)]
    context = multiprocessing.get_context("fork")
    context = type("Context", (type(context),), {"Process": NotDaemons})()
    with context.Pool(2) as pool:
        assert pool.map(work, [3, 4, 6, 7]) == expected * 2
    print("done")
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.stdout == "done\n", done.stderr
