"""The paper's own search for the terminal horizon, as written in section 3.2, timed beside `mpct design`.

For M = 1, 2, ... the linear programs of (29), first form, are solved for all rows of X_aug,t:

    max  X_i' Aaug^(M+1) (x, theta)   over   (x_j, theta) in X_aug,t,  x_(j+1) = (A + B K) x_j + B L theta,  j = 0..M

with every x_j as a variable (sparse), HiGHS, one model a horizon; only the objective changes from row to row and the
solver starts from its last basis. The search ends at the first M for which every support is at most 1.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import highspy
import numpy as np
import scipy.sparse as sp

import problem_file

SPENT = 1.0 + 1e-7
RESULTS = Path(__file__).parent / "results"
ROOT = Path(__file__).parent.parent


@dataclass
class Terminal:
    """X_aug,t and the terminal dynamics."""

    AK: np.ndarray
    BL: np.ndarray
    Gx: np.ndarray
    Gt: np.ndarray


def terminal(p: problem_file.Problem) -> Terminal:
    K, _ = problem_file.lqr(p)
    Mx, Mu = problem_file.steady_states(p)
    L = Mu - K @ Mx
    W = (p.C @ Mx + p.D @ Mu) / p.scaling
    W = W[np.abs(W).max(axis=1) > 1e-12]
    Gx = np.vstack([p.C + p.D @ K, np.zeros((len(W), p.n))])
    Gt = np.vstack([p.D @ L, W])
    return Terminal(p.A + p.B @ K, p.B @ L, Gx, Gt)


def _sparse(m: np.ndarray) -> sp.csr_matrix:
    m = m.copy()
    m[np.abs(m) < 1e-12 * np.abs(m).max()] = 0.0
    return sp.csr_matrix(m)


def _model(t: Terminal, horizon: int) -> highspy.Highs:
    n, m = t.BL.shape
    stages = horizon + 1
    AK, BL, Gx, Gt = map(_sparse, (t.AK, t.BL, t.Gx, t.Gt))
    eye = sp.identity(n)
    rows = [[None] * (stages + 1) for _ in range(2 * stages - 1)]
    for j in range(stages):
        rows[j][j], rows[j][stages] = Gx, Gt
    for j in range(horizon):
        rows[stages + j][j], rows[stages + j][j + 1], rows[stages + j][stages] = AK, -eye, BL
    matrix = sp.csc_matrix(sp.bmat(rows))
    inequalities = stages * Gx.shape[0]
    lp = highspy.HighsLp()
    lp.num_col_, lp.num_row_ = matrix.shape[1], matrix.shape[0]
    lp.sense_ = highspy.ObjSense.kMaximize
    lp.col_cost_ = np.zeros(matrix.shape[1])
    lp.col_lower_ = np.full(matrix.shape[1], -highspy.kHighsInf)
    lp.col_upper_ = np.full(matrix.shape[1], highspy.kHighsInf)
    lp.row_lower_ = np.r_[np.full(inequalities, -highspy.kHighsInf), np.zeros(horizon * n)]
    lp.row_upper_ = np.r_[np.ones(inequalities), np.zeros(horizon * n)]
    lp.a_matrix_.format_ = highspy.MatrixFormat.kColwise
    lp.a_matrix_.start_ = matrix.indptr
    lp.a_matrix_.index_ = matrix.indices
    lp.a_matrix_.value_ = matrix.data
    solver = highspy.Highs()
    solver.setOptionValue("output_flag", False)
    solver.setOptionValue("threads", 1)
    # Only objectives change, so the last basis stays primal feasible: the primal simplex method is 2 to 3 times faster
    # here than the default one.
    solver.setOptionValue("simplex_strategy", 4)
    solver.passModel(lp)
    return solver


def search(p: problem_file.Problem, cap: float, all_rows: bool = True) -> tuple[int | None, float, int]:
    """The horizon (None when `cap` seconds are over), seconds, linear programs."""
    started = time.perf_counter()
    t = terminal(p)
    n, m = t.BL.shape
    # Rows of (x, theta) after M + 1 steps: Gx AK^(M+1) x + (Gt + Gx (sum AK^j) BL) theta.
    objective_x, objective_t = t.Gx.copy(), t.Gt.copy()
    objective_x, objective_t = objective_x @ t.AK, objective_t + objective_x @ t.BL
    programs, horizon = 0, 0
    while True:
        horizon += 1
        objective_x, objective_t = objective_x @ t.AK, objective_t + objective_x @ t.BL
        solver = _model(t, horizon)
        columns = np.r_[np.arange(n), np.arange((horizon + 1) * n, (horizon + 1) * n + m)].astype(np.int32)
        satisfied = True
        for i in range(len(t.Gx)):
            solver.changeColsCost(len(columns), columns, np.r_[objective_x[i], objective_t[i]])
            solver.run()
            programs += 1
            status = solver.getModelStatus()
            if status != highspy.HighsModelStatus.kOptimal:
                # Now and then a warm start ends in an error; once more from nothing.
                solver.clearSolver()
                solver.run()
                programs += 1
                status = solver.getModelStatus()
            if status == highspy.HighsModelStatus.kOptimal:
                satisfied &= solver.getInfo().objective_function_value <= SPENT
            elif status in (
                highspy.HighsModelStatus.kUnbounded,
                highspy.HighsModelStatus.kUnboundedOrInfeasible,
            ):
                satisfied = False
            else:
                raise RuntimeError(f"HiGHS: {status} at horizon {horizon}, row {i}")
            if not satisfied and not all_rows:
                break
            if time.perf_counter() - started > cap:
                return None, time.perf_counter() - started, programs
        if satisfied:
            return horizon, time.perf_counter() - started, programs


def design(mpct: Path, file: Path) -> tuple[int, float, float]:
    """Horizon, wall seconds and self-reported seconds of `mpct design`."""
    started = time.perf_counter()
    out = subprocess.run([mpct, "design", "--json", file], check=True, capture_output=True, text=True)
    wall = time.perf_counter() - started
    data = json.loads(out.stdout)
    return data["terminal_horizon"], wall, data["seconds"]


def machine() -> str:
    name = platform.processor() or platform.machine()
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                name = line.split(":", 1)[1].strip()
                break
    except OSError:
        pass
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    return (
        f"{name}, {os.cpu_count()} logical CPUs, {platform.system()} {platform.machine()}; "
        f"load average {load:.1f} at the end of the run (about 1 is the run itself, more means that others ran too)"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mpct", type=Path, default=ROOT / "target/release/mpct")
    parser.add_argument("--carts", default="3,5,10,15,25,30,50", help="numbers of carts, comma separated")
    parser.add_argument("--cap", type=float, default=600.0, help="seconds a size may take the paper's search")
    parser.add_argument("--repeat", type=int, default=3, help="runs a size, of which the median counts")
    parser.add_argument("--stop-early", action="store_true", help="leave a horizon at its first row that refuses it")
    parser.add_argument("--cases", default="academic,drone", help="other case studies, comma separated; may be empty")
    arguments = parser.parse_args()
    sizes = [int(v) for v in arguments.carts.split(",") if v]
    cases = [(c, None) for c in arguments.cases.split(",") if c] + [("carts", s) for s in sizes]
    rows, given_up = [], False
    with tempfile.TemporaryDirectory() as folder:
        for case, count in cases:
            command = [arguments.mpct, "example", case] + (["--count", str(count)] if count else [])
            file = Path(folder) / "problem.toml"
            file.write_text(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
            problem = problem_file.read(file)
            paper: list[float] = []
            horizon, programs = None, 0
            ours = [design(arguments.mpct, file) for _ in range(arguments.repeat)]
            while not (given_up and count) and len(paper) < arguments.repeat:
                horizon, seconds, programs = search(problem, arguments.cap, not arguments.stop_early)
                if horizon is None:
                    given_up = bool(count)
                    paper = []
                    break
                paper.append(seconds)
                if sum(paper) > arguments.cap / 2:
                    break
            wall = statistics.median(o[1] for o in ours)
            own = statistics.median(o[2] for o in ours)
            if horizon is not None and horizon != ours[0][0]:
                raise SystemExit(f"{case} {count}: horizons {horizon} and {ours[0][0]}")
            row = {
                "case": case if count is None else f"{count} carts",
                "count": count,
                "horizon": ours[0][0],
                "programs": programs if paper else None,
                "paper": statistics.median(paper) if paper else None,
                "wall": wall,
                "own": own,
            }
            rows.append(row)
            print(row, flush=True)
    RESULTS.mkdir(exist_ok=True)
    write_table(rows, arguments)
    plot([r for r in rows if r["count"]])


def write_table(rows: list[dict], arguments: argparse.Namespace) -> None:
    def seconds(v: float | None) -> str:
        return f"over {arguments.cap:.0f}" if v is None else f"{v:.3g}"

    early = "left at the first row that refuses" if arguments.stop_early else "all rows"
    lines = [
        "# Terminal horizon: the paper's search and `mpct design`",
        "",
        f"Machine: {machine()}. Medians of up to {arguments.repeat} runs, both sides in the same run, in seconds.",
        "",
        f"The paper's search: M = 1, 2, …, {early}, first form, sparse lifted programs, HiGHS "
        f"{highspy.Highs().version()} on one thread, started from the basis of the row before. Its seconds are those of "
        "the search inside Python with the Riccati equation (SciPy), without reading the file. `mpct design`: wall time "
        "of the process with reading, and the time it reports itself; it uses all cores.",
        "",
        "| problem | M̃ | programs of the search | search | `mpct design`, wall | reported | ratio (search / wall) |",
        "|---|---|---|---|---|---|---|",
    ]
    for r in rows:
        ratio = "–" if r["paper"] is None else f"{r['paper'] / r['wall']:.0f}"
        programs = "–" if r["programs"] is None else r["programs"]
        lines.append(
            f"| {r['case']} | {r['horizon']} | {programs} | {seconds(r['paper'])} | {r['wall']:.3g} | {r['own']:.3g} | {ratio} |"
        )
    (RESULTS / "paper_search.md").write_text("\n".join(lines) + "\n")


def plot(rows: list[dict]) -> None:
    import matplotlib

    matplotlib.use("svg")
    matplotlib.rcParams["svg.hashsalt"] = "mpct"
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(6, 4))
    done = [r for r in rows if r["paper"] is not None]
    axes.loglog([r["count"] for r in done], [r["paper"] for r in done], "o-", label="the paper's search, HiGHS")
    axes.loglog([r["count"] for r in rows], [r["wall"] for r in rows], "s-", label="mpct design, wall time")
    axes.loglog([r["count"] for r in rows], [r["own"] for r in rows], "s--", label="mpct design, reported")
    axes.set_xlabel("carts")
    axes.set_ylabel("seconds")
    axes.grid(True, which="both", linewidth=0.3)
    axes.legend()
    figure.tight_layout()
    figure.savefig(RESULTS / "paper_search.svg", metadata={"Date": None})


if __name__ == "__main__":
    main()
