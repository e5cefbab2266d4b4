"""Problem files of mpct, read independently of mpct."""

from __future__ import annotations

import csv
import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.linalg import expm, qr, solve_discrete_are, svd


@dataclass
class Problem:
    """A tracking problem in shifted coordinates, with rows C x + D u <= 1."""

    name: str
    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    row_names: list[str]
    Q: np.ndarray
    R: np.ndarray
    O: np.ndarray  # noqa: E741
    O_input: np.ndarray
    scaling: float
    horizon: int
    initial_state: np.ndarray
    steps: int
    set_points: list[tuple[int, np.ndarray]]

    @property
    def n(self) -> int:
        return self.A.shape[0]

    @property
    def m(self) -> int:
        return self.B.shape[1]


def _matrix(value, folder: Path) -> np.ndarray:
    if isinstance(value, dict) and "csv" in value:
        with open(folder / value["csv"], newline="") as file:
            return np.array([[float(v) for v in row] for row in csv.reader(file)])
    if isinstance(value, dict):
        m = np.zeros(value["shape"])
        for i, j, v in value["entries"]:
            m[int(i), int(j)] += v
        return m
    return np.array(value, dtype=float)


def _weight(value, size: int, folder: Path) -> np.ndarray:
    if isinstance(value, (int, float)):
        return float(value) * np.eye(size)
    if isinstance(value, list) and value and not isinstance(value[0], list):
        return np.diag(np.array(value, dtype=float))
    return _matrix(value, folder)


def zero_order_hold(A: np.ndarray, B: np.ndarray, time: float) -> tuple[np.ndarray, np.ndarray]:
    n, m = B.shape
    block = np.zeros((n + m, n + m))
    block[:n, :n], block[:n, n:] = A, B
    e = expm(block * time)
    return e[:n, :n], e[:n, n:]


def read(path: str | Path) -> Problem:
    path = Path(path)
    with open(path, "rb") as file:
        data = tomllib.load(file)
    folder, plant = path.parent, data["plant"]
    A, B = _matrix(plant["A"], folder), _matrix(plant["B"], folder)
    if plant.get("continuous", False):
        A, B = zero_order_hold(A, B, plant["sampling_time"])
    n, m = B.shape
    at = plant.get("operating_point", {})
    x_op = np.array(at.get("state", np.zeros(n)), dtype=float)
    u_op = np.array(at.get("input", np.zeros(m)), dtype=float)
    limits = data.get("constraints", {})
    c, d, bound, names = [], [], [], []

    def row(cx, du, b, name):
        room = b - cx @ x_op - du @ u_op
        if np.isfinite(b):
            if room <= 0:
                raise ValueError(f"{name}: the origin is not strictly inside")
            c.append(cx / room)
            d.append(du / room)
            names.append(name)

    for kind, size in (("state", n), ("input", m)):
        lower = limits.get(f"{kind}_lower", [-np.inf] * size)
        upper = limits.get(f"{kind}_upper", [np.inf] * size)
        for i in range(size):
            e = np.zeros(n + m)
            e[i if kind == "state" else n + i] = 1.0
            row(e[:n], e[n:], upper[i], f"{kind}_upper[{i}]")
            row(-e[:n], -e[n:], -lower[i], f"{kind}_lower[{i}]")
    for block, rows in enumerate(limits.get("mixed", [])):
        cm, dm = _matrix(rows["C"], folder), _matrix(rows["D"], folder)
        for i, b in enumerate(rows["d"]):
            row(cm[i], dm[i], b, f"mixed[{block}] row {i}")
    weights, controller = data["weights"], data.get("controller", {})
    simulation = data.get("simulation", {})
    return Problem(
        name=data.get("name", path.stem),
        A=A,
        B=B,
        C=np.array(c),
        D=np.array(d),
        row_names=names,
        Q=_weight(weights["Q"], n, folder),
        R=_weight(weights["R"], m, folder),
        O=_weight(weights["O"], n, folder),
        O_input=_weight(weights.get("O_input", 0.0), m, folder),
        scaling=controller.get("scaling", 0.9),
        horizon=controller.get("prediction_horizon", 10),
        initial_state=np.array(simulation.get("initial_state", np.zeros(n)), dtype=float) - x_op,
        steps=simulation.get("steps", 1),
        set_points=[
            (s["from_step"], np.array(s["state"], dtype=float) - x_op)
            for s in simulation.get("setpoint", [])
        ],
    )


def lqr(p: Problem) -> tuple[np.ndarray, np.ndarray]:
    """K and P of (3)."""
    P = solve_discrete_are(p.A, p.B, p.Q, p.R)
    K = -np.linalg.solve(p.R + p.B.T @ P @ p.B, p.B.T @ P @ p.A)
    return K, P


def steady_states(p: Problem) -> tuple[np.ndarray, np.ndarray]:
    """M_theta in a basis that is sparse where the plant allows it: theta is m of the equilibrium's coordinates.

    An orthonormal basis would be dense and would slow the linear programs of a large plant down.
    """
    _, s, vt = svd(np.hstack([p.A - np.eye(p.n), p.B]))
    if s[p.n - 1] <= 1e-11 * s[0]:
        raise ValueError("[A - I, B] lacks full row rank")
    basis = vt[p.n :].T
    _, _, order = qr(basis.T, pivoting=True)
    basis = basis @ np.linalg.inv(basis[np.sort(order[: p.m])])
    basis[np.abs(basis) < 1e-12] = 0.0
    return basis[: p.n], basis[p.n :]
