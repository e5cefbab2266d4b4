"""What a step costs more in Python than in Rust, on the drone (12 states, 4 inputs): `python tests/step_overhead.py`.

Both loops run on the same controller, state and set-point. Each figure is the smallest of many repetitions that are
shorter than a time slice, so that other programs on the machine do not count.
"""

import time

import numpy as np

import mpct
from mpct import _mpct

STEPS = 50


def overhead(repetitions=400):
    """Microseconds of a step: in Rust, in Python, in Python with lists and the input read."""
    controller = mpct.example("drone").problem.design().controller()
    x, set_point = np.zeros(12), np.zeros(12)
    set_point[:3] = 0.5, 0.5, 0.5
    lists = x.tolist(), set_point.tolist()

    def in_rust():
        return _mpct._step_seconds(controller, x, set_point, STEPS)

    def in_python():
        start = time.perf_counter()
        for _ in range(STEPS):
            controller.step(x, set_point)
        return (time.perf_counter() - start) / STEPS

    def with_lists():
        start = time.perf_counter()
        for _ in range(STEPS):
            controller.step(*lists).u
        return (time.perf_counter() - start) / STEPS

    # Interleaved, so that a change of the clock rate meets all of them.
    rows = [[f() * 1e6 for f in (in_rust, in_python, with_lists)] for _ in range(repetitions)]
    return [min(column) for column in zip(*rows)]


if __name__ == "__main__":
    rust, python, lists = overhead(2000)
    print(f"in Rust {rust:.2f} us, in Python {python:.2f} us ({python - rust:+.2f}), lists and .u {lists:.2f} us ({lists - rust:+.2f})")
