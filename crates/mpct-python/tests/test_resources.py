"""What steps cost: time and memory."""

import os
import sys

import numpy as np
import pytest
from step_overhead import overhead

import mpct

LARGEST_OVERHEAD = 3.0
"""Microseconds that a step of the drone may take longer than in Rust."""


def test_step_overhead():
    # Other programs on the machine can spoil a measurement, and not make it better than it is.
    for _ in range(5):
        rust, python, _ = overhead()
        if python - rust <= LARGEST_OVERHEAD:
            return
    pytest.fail(f"a step takes {python:.2f} us in Python and {rust:.2f} us in Rust")


def resident():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGESIZE")


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_memory_does_not_grow(controller):
    x, set_point = np.zeros(2), np.array([2.0, 0.5])

    def steps(count):
        for k in range(count):
            step = controller.step(x, set_point)
            step.u, step.artificial_state, step.predicted_states
            if k % 10 == 0:
                controller.step([0.1, 0.2], [1, 0])
                controller.qp(x, set_point)
                try:
                    controller.step([100.0, 100.0], set_point)
                except mpct.StepError:
                    pass

    steps(5_000)
    before = resident()
    steps(100_000)
    assert resident() - before < 4 << 20


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_memory_of_designs_is_given_back(problem):
    def work(count):
        for _ in range(count):
            controller = problem.design(progress=False).controller()
            mpct.simulate(controller, [0, 0], [2, 0.5], 10)
            problem.replace(scaling=0.8).qp([0, 0], [1, 0])

    work(100)
    before = resident()
    work(500)
    assert resident() - before < 8 << 20
