import threading

import matplotlib
import pytest

import mpct

matplotlib.use("Agg")


def academic_problem(**options):
    plant = mpct.Plant([[1.0, 1.0], [0.0, 1.0]], [[0.0, 0.5], [1.0, 0.5]])
    return mpct.Problem(plant, state=([-3, -3], [3, 3]), input=(-2, 2), **{"Q": 10, "R": 100, "O": 1e4, **options})


@pytest.fixture(scope="session")
def problem():
    return academic_problem()


@pytest.fixture(scope="session")
def design(problem):
    return problem.design()


@pytest.fixture
def controller(design):
    return design.controller()


def threads_agree(work):
    found = []
    threads = [threading.Thread(target=lambda: found.append(work())) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return len(found) == 4 and all(f == found[0] for f in found)
