"""Closed loops of the case studies with public quadratic programming solvers.

The condensed program is built here from the problem file and from what `mpct design --json` exports (K, P, M_theta and
the step at which each row is spent), not by mpct's own code:

    min 1/2 z' H z + (F_x x + F_r x_r)' z   over   G z <= 1 - W x,   z = (u_0, ..., u_(N-1), theta)

Terminal rows stop where they are spent, for every solver alike. Every solver sees the same sequence of programs: those of
the closed loop driven by the first solver in the list, so that rounding does not lead them apart.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.sparse as sp

import problem_file
from paper_search import RESULTS, ROOT, machine


@dataclass
class Condensed:
    H: np.ndarray
    Fx: np.ndarray
    Fr: np.ndarray
    G: np.ndarray
    W: np.ndarray


def condense(p: problem_file.Problem, design: dict) -> Condensed:
    n, m, N = p.n, p.m, p.horizon
    K, P = np.array(design["gain"]), np.array(design["terminal_weight"])
    Mx = np.array(design["steady_state_basis"]["state"])
    Mu = np.array(design["steady_state_basis"]["input"])
    L = Mu - K @ Mx
    size = N * m + m
    # Predictions as (coefficients of x, coefficients of z).
    X = [(np.eye(n), np.zeros((n, size)))]
    U = []
    theta = np.zeros((m, size))
    theta[:, N * m :] = np.eye(m)
    H, Fx = np.zeros((size, size)), np.zeros((size, n))

    def add(weight, from_x, from_z):
        nonlocal H, Fx
        H = H + 2 * from_z.T @ weight @ from_z
        Fx = Fx + 2 * from_z.T @ weight @ from_x

    rows, state_rows = [], []

    def constrain(C, from_x, from_z):
        rows.append(C @ from_z)
        state_rows.append(C @ from_x)

    for j in range(N):
        u = np.zeros((m, size))
        u[:, j * m : (j + 1) * m] = np.eye(m)
        U.append(u)
        x = X[j]
        add(p.Q, x[0], x[1] - Mx @ theta)
        add(p.R, np.zeros((m, n)), u - Mu @ theta)
        # Rows of the state alone are not asked of x_0.
        keep = np.abs(p.D).max(axis=1) > 0 if j == 0 else np.ones(len(p.C), bool)
        rows.append(p.C[keep] @ x[1] + p.D[keep] @ u)
        state_rows.append(p.C[keep] @ x[0])
        X.append((p.A @ x[0], p.A @ x[1] + p.B @ u))
    x = X[N]
    add(P, x[0], x[1] - Mx @ theta)
    add(p.O, np.zeros((n, n)), Mx @ theta)
    add(p.O_input, np.zeros((m, n)), Mu @ theta)
    Fr = -2 * (Mx @ theta).T @ p.O
    # Row i of the terminal law as long as it is not spent.
    spent = {s["row"]: s["step"] for s in design["spent_steps"]}
    steps = np.array([spent[name] for name in p.row_names])
    Cx, Ct = p.C + p.D @ K, p.D @ L
    for t in range(steps.max()):
        open_rows = steps > t
        constrain(Cx[open_rows], x[0], x[1])
        rows[-1] = rows[-1] + Ct[open_rows] @ theta
        x = ((p.A + p.B @ K) @ x[0], (p.A + p.B @ K) @ x[1] + p.B @ L @ theta)
    W = (p.C @ Mx + p.D @ Mu) / p.scaling
    W = W[np.abs(W).max(axis=1) > 1e-12]
    rows.append(W @ theta)
    state_rows.append(np.zeros((len(W), n)))
    return Condensed((H + H.T) / 2, Fx, Fr, np.vstack(rows), np.vstack(state_rows))


class Daqp:
    name = "DAQP"

    def __init__(self, H, f, G, b):
        import daqp

        self.model = daqp.Model()
        self.lower = np.full(len(b), -1e30)
        self.sense = np.zeros(len(b), dtype=np.int32)
        self.model.setup(H, f, G, b, self.lower, self.sense)

    def solve(self, f, b):
        self.model.update(None, f, None, b, self.lower, None)
        x, _, flag, info = self.model.solve()
        return x, flag == 1, info.get("solve_time"), info.get("iterations")


class Piqp:
    name = "PIQP"

    def __init__(self, H, f, G, b):
        import piqp

        self.solver, self.solved = piqp.DenseSolver(), piqp.PIQP_SOLVED
        self.solver.settings.compute_timings = True
        self.solver.setup(H, f, None, None, G, np.full(len(b), -1e30), b)

    def solve(self, f, b):
        self.solver.update(c=f, h_u=b)
        status = self.solver.solve()
        info = self.solver.result.info
        return np.array(self.solver.result.x), status == self.solved, info.update_time + info.solve_time, info.iter


class Osqp:
    name = "OSQP"

    def __init__(self, H, f, G, b):
        import osqp

        self.solver = osqp.OSQP()
        self.solver.setup(
            sp.csc_matrix(np.triu(H)), f, sp.csc_matrix(G), np.full(len(b), -np.inf), b,
            verbose=False, eps_abs=1e-7, eps_rel=1e-7, max_iter=20000, polishing=False,
        )

    def solve(self, f, b):
        self.solver.update(q=f, u=b)
        r = self.solver.solve()
        return r.x, r.info.status_val == 1, r.info.update_time + r.info.solve_time, r.info.iter


class Clarabel:
    name = "Clarabel"

    def __init__(self, H, f, G, b):
        import clarabel

        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.presolve_enable = False
        self.solver = clarabel.DefaultSolver(
            sp.csc_matrix(np.triu(H)), f, sp.csc_matrix(G), b, [clarabel.NonnegativeConeT(len(b))], settings
        )

    def solve(self, f, b):
        self.solver.update(q=f, b=b)
        r = self.solver.solve()
        return np.array(r.x), str(r.status) in ("Solved", "AlmostSolved"), r.solve_time, r.iterations


class Proxqp:
    name = "ProxQP"

    def __init__(self, H, f, G, b):
        from proxsuite import proxqp

        self.qp = proxqp.dense.QP(len(f), 0, len(b))
        self.qp.settings.eps_abs = 1e-7
        self.qp.settings.compute_timings = True
        self.qp.settings.initial_guess = proxqp.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT
        self.qp.init(H, f, None, None, G, np.full(len(b), -1e20), b)
        self.qp.solve()
        self.lower = np.full(len(b), -1e20)
        self.solved = proxqp.QPSolverOutput.PROXQP_SOLVED

    def solve(self, f, b):
        self.qp.update(g=f, l=self.lower, u=b)
        self.qp.solve()
        info = self.qp.results.info
        # Reported in microseconds.
        return np.array(self.qp.results.x), info.status == self.solved, 1e-6 * info.run_time, info.iter


SOLVERS = [Daqp, Piqp, Osqp, Clarabel, Proxqp]


def programs(p: problem_file.Problem, c: Condensed, steps: int):
    """(f, b, input) of every step of the closed loop, driven by the first solver."""
    x, driver, out = p.initial_state.copy(), None, []
    for k in range(steps):
        reference = next((r for start, r in reversed(p.set_points) if start <= k), np.zeros(p.n))
        f, b = c.Fx @ x + c.Fr @ reference, 1.0 - c.W @ x
        driver = driver or SOLVERS[0](c.H, f, c.G, b)
        z, solved, _, _ = driver.solve(f, b)
        if not solved:
            raise SystemExit(f"{p.name}: {driver.name} fails at step {k}")
        out.append((f, b, z[: p.m].copy()))
        x = p.A @ x + p.B @ z[: p.m]
    return out


def measure(solver_class, c: Condensed, sequence, cap: float) -> dict:
    f, b, u = sequence[0]
    solver = solver_class(c.H, f, c.G, b)
    inside, outside, iterations, failed, worst_rows, apart = [], [], [], 0, 0.0, 0.0
    started = time.perf_counter()
    for f, b, u in sequence:
        before = time.perf_counter()
        z, solved, seconds, count = solver.solve(f, b)
        outside.append(time.perf_counter() - before)
        inside.append(outside[-1] if seconds is None else seconds)
        iterations.append(count or 0)
        failed += not solved
        apart = max(apart, float(np.abs(z[: len(u)] - u).max()))
        worst_rows = max(worst_rows, float((c.G @ z - b).max()))
        if time.perf_counter() - started > cap:
            break
    return {
        "solver": solver_class.name,
        "steps": len(inside),
        "inside": np.array(inside),
        "outside": np.array(outside),
        "iterations": np.array(iterations),
        "failed": failed,
        "violation": worst_rows,
        "apart": apart,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mpct", type=Path, default=ROOT / "target/release/mpct")
    parser.add_argument("--cases", default="academic,drone,carts:10")
    parser.add_argument("--steps", type=int, default=None, help="at most this many steps")
    parser.add_argument("--cap", type=float, default=120.0, help="seconds a solver may take for a case")
    arguments = parser.parse_args()
    lines = [
        "# Closed loops with public solvers",
        "",
        f"Machine: {machine()}. Microseconds a step. Inside: as the solver reports it; seen: from Python. The same condensed "
        "program with pruned terminal rows, the same states and set-points for every solver, each started from its last "
        "answer where it can. Violation: largest G z - b (right-hand sides are about 1). Input apart: largest difference from the "
        "input of the first solver.",
        "",
        "| problem | variables × rows | solver | mean | median | p99 | worst | seen, mean | iterations, mean / most | steps | not solved | violation | input apart |",
        "|" + "---|" * 13,
    ]
    for case in arguments.cases.split(","):
        name, _, count = case.partition(":")
        with tempfile.TemporaryDirectory() as folder:
            command = [arguments.mpct, "example", name] + (["--count", count] if count else [])
            file = Path(folder) / "problem.toml"
            file.write_text(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
            p = problem_file.read(file)
            out = subprocess.run([arguments.mpct, "design", "--json", file], check=True, capture_output=True, text=True)
        c = condense(p, json.loads(out.stdout))
        sequence = programs(p, c, min(p.steps, arguments.steps or p.steps))
        for solver_class in SOLVERS:
            try:
                r = measure(solver_class, c, sequence, arguments.cap)
            except Exception as error:  # a solver that cannot be run is reported, not hidden
                print(f"{p.name}: {solver_class.name}: {error!r}", flush=True)
                lines.append(f"| {p.name} | {c.G.shape[1]} × {c.G.shape[0]} | {solver_class.name} | failed: {type(error).__name__} |" + " |" * 9)
                continue
            t = 1e6 * r["inside"]
            line = (
                f"| {p.name} | {c.G.shape[1]} × {c.G.shape[0]} | {r['solver']} | {t.mean():.3g} | {np.median(t):.3g} | "
                f"{np.percentile(t, 99):.3g} | {t.max():.3g} | {1e6 * r['outside'].mean():.3g} | "
                f"{r['iterations'].mean():.1f} / {r['iterations'].max()} | {r['steps']} | {r['failed']} | {r['violation']:.1e} | {r['apart']:.1e} |"
            )
            lines.append(line)
            print(line, flush=True)
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / "closed_loop.md").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
