"""Public quadratic programming solvers behind one door.

Each class takes the program of a case once and then one (f, b) after another. `solve` returns z, the multipliers of the rows (or
None), whether the solver says that it is done, the seconds that it reports for the work of this call, and its iterations. What lies
in the seconds is said in each class. `forget` makes the next solve a cold one; `always_cold` solvers have no memory.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp


@dataclass
class Condensed:
    """min 1/2 z'Hz + (Fx x + Fr r)'z over G z <= 1 - W x, z = (u_0, ..., u_(N-1), theta)."""

    H: np.ndarray
    Fx: np.ndarray
    Fr: np.ndarray
    G: np.ndarray
    W: np.ndarray


@dataclass
class Staged:
    """The same program with the states as variables, v = (u_0, x_1, u_1, ..., x_N, ..., x_last, theta)."""

    P: sp.csc_matrix
    Fr: np.ndarray  # linear term of v: Fr (r, x)
    A: sp.csc_matrix  # A v = Ax x
    Ax: np.ndarray
    G: sp.csc_matrix  # G v <= 1
    pick: np.ndarray  # where (u_0, ..., u_(N-1), theta) stand in v
    ocp: dict  # stage by stage, for HPIPM


class Daqp:
    """Seconds: the dual active-set iterations, without the update of the least-distance problem (n_z^2 + rows n_z) before them."""

    name = "DAQP"
    always_cold = False

    def __init__(self, c: Condensed, s: Staged, f, b):
        import daqp

        self.model = daqp.Model()
        self.lower = np.full(len(b), -1e30)
        self.sense = np.zeros(len(b), dtype=np.int32)
        self.model.setup(c.H, f, c.G, b, self.lower, self.sense)
        self.cold = False

    def forget(self):
        self.cold = True

    def solve(self, f, b, x, r):
        self.model.update(None, f, None, b, self.lower, self.sense if self.cold else None)
        self.cold = False
        z, _, flag, info = self.model.solve()
        return z, np.asarray(info["lam"])[-len(b) :], flag == 1, info["solve_time"], info["iterations"]


class Reference(Daqp):
    """Not a rival: DAQP with tolerances that the inputs are compared at. Its own primal tolerance is 1e-6, which moves inputs
    by up to 7e-3 where rows are nearly parallel (drone, scaling 0.99)."""

    name = "reference"

    def __init__(self, c, s, f, b):
        super().__init__(c, s, f, b)
        self.model.settings = {**self.model.settings, "primal_tol": 1e-11, "progress_tol": 1e-14}


class PiqpDense:
    """Seconds: update and solve."""

    name = "PIQP dense"
    always_cold = True

    def __init__(self, c, s, f, b):
        import piqp

        self.solver, self.solved = piqp.DenseSolver(), piqp.PIQP_SOLVED
        self.solver.settings.compute_timings = True
        self.solver.setup(c.H, f, None, None, c.G, np.full(len(b), -1e30), b)

    def solve(self, f, b, x, r):
        self.solver.update(c=f, h_u=b)
        status = self.solver.solve()
        result = self.solver.result
        info = result.info
        return np.array(result.x), np.array(result.z_u), status == self.solved, info.update_time + info.solve_time, info.iter


class PiqpSparse(PiqpDense):
    """The condensed program through the sparse back end. Seconds: update and solve."""

    name = "PIQP sparse"

    def __init__(self, c, s, f, b):
        import piqp

        self.solver, self.solved = piqp.SparseSolver(), piqp.PIQP_SOLVED
        self.solver.settings.compute_timings = True
        self.solver.setup(sp.csc_matrix(c.H), f, None, None, sp.csc_matrix(c.G), np.full(len(b), -1e30), b)


class PiqpMultistage:
    """The states as variables, stage by stage, theta as a global variable. Seconds: update and solve."""

    name = "PIQP multistage"
    always_cold = True

    def __init__(self, c, s, f, b):
        import piqp

        self.s, self.solved = s, piqp.PIQP_SOLVED
        self.solver = piqp.SparseSolver()
        self.solver.settings.compute_timings = True
        self.solver.settings.kkt_solver = piqp.KKTSolver.sparse_multistage
        rows = s.G.shape[0]
        self.solver.setup(s.P, np.zeros(s.P.shape[0]), s.A, np.zeros(s.A.shape[0]), s.G, np.full(rows, -1e30), np.ones(rows))

    def solve(self, f, b, x, r):
        self.solver.update(c=self.s.Fr @ np.concatenate([r, x]), b=self.s.Ax @ x)
        status = self.solver.solve()
        info = self.solver.result.info
        z = np.array(self.solver.result.x)[self.s.pick]
        return z, None, status == self.solved, info.update_time + info.solve_time, info.iter


class Osqp:
    """Tolerances 1e-7: with its own the inputs are useless here. Seconds: update and solve."""

    name = "OSQP"
    always_cold = False

    def __init__(self, c, s, f, b):
        import osqp

        self.solver = osqp.OSQP()
        self.solver.setup(
            sp.csc_matrix(np.triu(c.H)), f, sp.csc_matrix(c.G), np.full(len(b), -np.inf), b,
            verbose=False, eps_abs=1e-7, eps_rel=1e-7, max_iter=20000, polishing=False,
        )

    def forget(self):
        self.solver.warm_start(x=np.zeros(self.solver.n), y=np.zeros(self.solver.m))

    def solve(self, f, b, x, r):
        self.solver.update(q=f, u=b)
        result = self.solver.solve()
        info = result.info
        return result.x, result.y, info.status_val == 1, info.update_time + info.solve_time, info.iter


class Clarabel:
    """Seconds: solve."""

    name = "Clarabel"
    always_cold = True

    def __init__(self, c, s, f, b):
        import clarabel

        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.presolve_enable = False
        settings.max_threads = 1
        self.solver = clarabel.DefaultSolver(
            sp.csc_matrix(np.triu(c.H)), f, sp.csc_matrix(c.G), b, [clarabel.NonnegativeConeT(len(b))], settings
        )

    def solve(self, f, b, x, r):
        self.solver.update(q=f, b=b)
        result = self.solver.solve()
        return np.array(result.x), np.array(result.z), str(result.status) in ("Solved", "AlmostSolved"), result.solve_time, result.iterations


class Proxqp:
    """Seconds: as reported (in microseconds) for the solve."""

    name = "ProxQP"
    always_cold = False

    def __init__(self, c, s, f, b):
        from proxsuite import proxqp

        self.qp, self.guess = proxqp.dense.QP(len(f), 0, len(b)), proxqp.InitialGuess
        self.qp.settings.eps_abs = 1e-7
        self.qp.settings.compute_timings = True
        self.qp.settings.initial_guess = self.guess.WARM_START_WITH_PREVIOUS_RESULT
        self.qp.init(c.H, f, None, None, c.G, np.full(len(b), -1e20), b)
        self.qp.solve()
        self.lower = np.full(len(b), -1e20)
        self.solved = proxqp.QPSolverOutput.PROXQP_SOLVED

    def forget(self):
        self.qp.settings.initial_guess = self.guess.NO_INITIAL_GUESS

    def solve(self, f, b, x, r):
        self.qp.update(g=f, l=self.lower, u=b)
        self.qp.solve()
        self.qp.settings.initial_guess = self.guess.WARM_START_WITH_PREVIOUS_RESULT
        info = self.qp.results.info
        return np.array(self.qp.results.x), np.array(self.qp.results.z), info.status == self.solved, 1e-6 * info.run_time, info.iter


class Qpoases:
    """Version 3.2 as packaged with CasADi, hot-started by it. Seconds: CasADi's time of the call into the solver."""

    name = "qpOASES"
    always_cold = False

    def __init__(self, c, s, f, b):
        import casadi as ca

        self.H, self.G = ca.DM(c.H), ca.DM(c.G)
        self.lower = np.full(len(b), -1e20)
        self.make = lambda: ca.conic(
            "qp", "qpoases", {"h": self.H.sparsity(), "a": self.G.sparsity()},
            {"printLevel": "none", "record_time": True, "error_on_fail": False, "sparse": False, "nWSR": 100_000},
        )
        self.solver = self.make()

    def forget(self):
        self.solver = self.make()

    def solve(self, f, b, x, r):
        result = self.solver(h=self.H, a=self.G, g=f, lba=self.lower, uba=b)
        stats = self.solver.stats()
        z, y = np.array(result["x"]).ravel(), np.array(result["lam_a"]).ravel()
        return z, y, bool(stats["success"]), stats["t_wall_solver"], max(0, stats.get("iter_count", 0))


class Hpipm:
    """As packaged with CasADi; the states as variables, theta as part of each stage's state. Seconds: CasADi's time of the call."""

    name = "HPIPM"
    always_cold = True

    def __init__(self, c, s, f, b):
        import casadi as ca

        o = s.ocp
        self.o, self.H, self.A = o, ca.DM(o["H"]), ca.DM(o["A"])
        self.solver = ca.conic(
            "qp", "hpipm", {"h": self.H.sparsity(), "a": self.A.sparsity()},
            {"N": o["N"], "nx": o["nx"], "nu": o["nu"], "ng": o["ng"], "record_time": True, "error_on_fail": False,
             # Its residuals are absolute, and the gradient has the size of the offset weight.
             "inf": 1e8, "hpipm": {"iter_max": 100, "res_g_max": 1e-8 * np.abs(s.Fr).max(), "res_b_max": 1e-8, "res_d_max": 1e-8,
                                   "res_m_max": 1e-8 * np.abs(s.Fr).max()}},
        )

    def solve(self, f, b, x, r):
        o = self.o
        lower, upper = o["lbx"].copy(), o["ubx"].copy()
        lower[: len(x)] = upper[: len(x)] = x
        g = np.zeros(len(lower))
        g[o["theta"]] = o["Fr"] @ r
        result = self.solver(h=self.H, a=self.A, g=g, lbx=lower, ubx=upper, lba=o["lba"], uba=o["uba"])
        stats = self.solver.stats()
        return np.array(result["x"]).ravel()[o["pick"]], None, bool(stats["success"]), stats["t_wall_solver"], max(0, stats.get("iter_count", 0))


RIVALS = [Daqp, PiqpDense, PiqpSparse, PiqpMultistage, Osqp, Clarabel, Proxqp, Qpoases, Hpipm]
