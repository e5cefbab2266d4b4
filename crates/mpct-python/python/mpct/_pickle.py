"""How pickled objects are made again."""

from __future__ import annotations

from typing import Any

import numpy as np

from ._mpct import Controller, Design, Plant, Problem


def plant(continuous: bool, a: np.ndarray, b: np.ndarray, options: dict[str, Any]) -> Plant:
    return Plant.continuous(a, b, **options) if continuous else Plant(a, b, **options)


def problem(text: str) -> Problem:
    return Problem.from_toml(text)


def design(problem: Problem, options: dict[str, Any]) -> Design:
    return problem.design(**options, progress=False)


def controller(design: Design, formulation: Any) -> Controller:
    return design.controller(formulation)
