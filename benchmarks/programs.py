"""The online program of a case, built from the problem file and from what `mpct design --json` exports (K, P, M_theta and the step at
which each row is spent), not by mpct's own code. Terminal rows stop where they are spent, for every solver alike.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

import problem_file
from rivals import Condensed, Staged


def matrix(value) -> np.ndarray:
    """A matrix of `mpct design --json`: a list of rows, or for large ones shape and entries."""
    if isinstance(value, list):
        return np.array(value)
    out = np.zeros(value["shape"])
    rows, columns, values = zip(*value["entries"])
    out[np.array(rows), np.array(columns)] = values
    return out


class Design:
    def __init__(self, p: problem_file.Problem, design: dict):
        self.K, self.P = matrix(design["gain"]), matrix(design["terminal_weight"])
        self.Mx = matrix(design["steady_state_basis"]["state"])
        self.Mu = matrix(design["steady_state_basis"]["input"])
        self.L = self.Mu - self.K @ self.Mx
        spent = {s["row"]: s["step"] for s in design["spent_steps"]}
        self.spent = np.array([spent[name] for name in p.row_names])
        W = (p.C @ self.Mx + p.D @ self.Mu) / p.scaling
        self.equilibrium_rows = W[np.abs(W).max(axis=1) > 1e-12]
        # Rows of the state alone are not asked of x_0.
        self.first = np.abs(p.D).max(axis=1) > 0


def condense(p: problem_file.Problem, d: Design) -> Condensed:
    n, m, N = p.n, p.m, p.horizon
    size = (N + 1) * m
    A, B, C, D, Q, R = (sp.csr_matrix(v) for v in (p.A, p.B, p.C, p.D, p.Q, p.R))
    # Predictions as (coefficients of x, coefficients of z).
    x = (np.eye(n), np.zeros((n, size)))
    theta = np.zeros((m, size))
    theta[:, N * m :] = np.eye(m)
    H, Fx = np.zeros((size, size)), np.zeros((size, n))
    rows, state_rows = [], []

    def add(weight, from_x, from_z):
        weighted = weight @ from_z
        H.__iadd__(2 * from_z.T @ weighted)
        Fx.__iadd__(2 * weighted.T @ from_x)

    for j in range(N):
        u = np.zeros((m, size))
        u[:, j * m : (j + 1) * m] = np.eye(m)
        add(Q, x[0], x[1] - d.Mx @ theta)
        add(R, np.zeros((m, n)), u - d.Mu @ theta)
        keep = d.first if j == 0 else np.ones(len(p.C), bool)
        rows.append((C @ x[1] + D @ u)[keep])
        state_rows.append((C @ x[0])[keep])
        x = (A @ x[0], A @ x[1] + B @ u)
    add(d.P, x[0], x[1] - d.Mx @ theta)
    add(sp.csr_matrix(p.O), np.zeros((n, n)), d.Mx @ theta)
    add(sp.csr_matrix(p.O_input), np.zeros((m, n)), d.Mu @ theta)
    Fr = -2 * (d.Mx @ theta).T @ p.O
    # Row i of the terminal law as long as it is not spent.
    Cx, Ct = p.C + p.D @ d.K, p.D @ d.L
    closed, feed = p.A + p.B @ d.K, p.B @ d.L
    for t in range(d.spent.max()):
        open_rows = d.spent > t
        rows.append(Cx[open_rows] @ x[1] + Ct[open_rows] @ theta)
        state_rows.append(Cx[open_rows] @ x[0])
        x = (closed @ x[0], closed @ x[1] + feed @ theta)
    rows.append(d.equilibrium_rows @ theta)
    state_rows.append(np.zeros((len(d.equilibrium_rows), n)))
    return Condensed((H + H.T) / 2, Fx, Fr, np.ascontiguousarray(np.vstack(rows)), np.vstack(state_rows))


def stage(p: problem_file.Problem, d: Design) -> Staged:
    n, m, N = p.n, p.m, p.horizon
    last = N + int(d.spent.max()) - 1  # the last step of which a row is asked
    closed, feed = p.A + p.B @ d.K, p.B @ d.L
    Cx, Ct = p.C + p.D @ d.K, p.D @ d.L
    # Places in v = (u_0, x_1, u_1, ..., x_(N-1), u_(N-1), x_N, ..., x_last, theta).
    u_at = [j * (n + m) for j in range(N)]
    x_at = [None] + [j * (n + m) + m for j in range(N)]
    x_at += [x_at[N] + (j - N) * n for j in range(N + 1, last + 1)]
    theta = x_at[last] + n
    size = theta + m
    P, A, G = sp.lil_matrix((size, size)), sp.lil_matrix((n * last, size)), []
    Ax = np.zeros((n * last, n))

    def cost(weight, at, basis):
        # (y - basis theta)' weight (y - basis theta) for y at `at`
        k = len(weight)
        P[at : at + k, at : at + k] += 2 * weight
        P[at : at + k, theta:] += -2 * weight @ basis
        P[theta:, at : at + k] += -2 * basis.T @ weight
        P[theta:, theta:] += 2 * basis.T @ weight @ basis

    for j in range(N):
        if j > 0:
            cost(p.Q, x_at[j], d.Mx)
        cost(p.R, u_at[j], d.Mu)
    # x_0 is no variable: its cost has a part quadratic in theta, and one linear in theta and x (in Fr).
    P[theta:, theta:] += 2 * d.Mx.T @ p.Q @ d.Mx
    cost(d.P, x_at[N], d.Mx)
    P[theta:, theta:] += 2 * (d.Mx.T @ p.O @ d.Mx + d.Mu.T @ p.O_input @ d.Mu)
    for j in range(last):
        row = slice(j * n, (j + 1) * n)
        A[row, x_at[j + 1] : x_at[j + 1] + n] = np.eye(n)
        if j < N:
            A[row, u_at[j] : u_at[j] + m] = -p.B
            if j == 0:
                Ax[row] = p.A
            else:
                A[row, x_at[j] : x_at[j] + n] = -p.A
        else:
            A[row, x_at[j] : x_at[j] + n] = -closed
            A[row, theta:] = -feed
    blocks, x0_rows = [], None
    for j in range(N):
        keep = d.first if j == 0 else np.ones(len(p.C), bool)
        block = sp.lil_matrix((int(keep.sum()), size))
        block[:, u_at[j] : u_at[j] + m] = p.D[keep]
        if j > 0:
            block[:, x_at[j] : x_at[j] + n] = p.C[keep]
        else:
            x0_rows = p.C[keep]
        blocks.append(block)
    for t in range(d.spent.max()):
        keep = d.spent > t
        block = sp.lil_matrix((int(keep.sum()), size))
        block[:, x_at[N + t] : x_at[N + t] + n] = Cx[keep]
        block[:, theta:] = Ct[keep]
        blocks.append(block)
    block = sp.lil_matrix((len(d.equilibrium_rows), size))
    block[:, theta:] = d.equilibrium_rows
    blocks.append(block)
    if np.abs(x0_rows).max(initial=0.0) > 0:
        raise ValueError("rows that mix the measured state and the first input are not built here")
    Fr = np.zeros((size, 2 * n))  # of (r, x)
    Fr[theta:, :n] = -2 * d.Mx.T @ p.O
    Fr[theta:, n:] = -2 * d.Mx.T @ p.Q
    pick = np.concatenate([np.arange(a, a + m) for a in u_at] + [np.arange(theta, size)])
    P, A, G = (sp.csc_matrix(v) for v in (P, A, sp.vstack(blocks)))
    return Staged(P, Fr, A, Ax, G, pick, ocp(p, d, last))


def ocp(p: problem_file.Problem, d: Design, last: int) -> dict:
    """Stage by stage with the state s = (x, theta): s_(k+1) = A_k s_k + B_k u_k, rows C_k s_k + D_k u_k <= 1; u_k for k < N."""
    n, m, N = p.n, p.m, p.horizon
    ns = n + m
    nu = [m] * N + [0] * (last + 1 - N)
    offset, at = [], 0
    for k in range(last + 1):
        offset.append(at)
        at += ns + nu[k]
    size = at
    H, rows, lower, upper, ng = sp.lil_matrix((size, size)), [], [], [], []
    e = np.hstack([np.eye(n), -d.Mx])
    for k in range(last + 1):
        s, u = offset[k], offset[k] + ns
        if k < N:
            H[s : s + ns, s : s + ns] += 2 * e.T @ p.Q @ e
            w = np.hstack([np.zeros((m, n)), -d.Mu, np.eye(m)])
            H[s : s + ns + m, s : s + ns + m] += 2 * w.T @ p.R @ w
        elif k == N:
            H[s : s + ns, s : s + ns] += 2 * e.T @ d.P @ e
        if k == last:
            H[s + n : s + ns, s + n : s + ns] += 2 * (d.Mx.T @ p.O @ d.Mx + d.Mu.T @ p.O_input @ d.Mu)
        if k < last:
            block = sp.lil_matrix((ns, size))
            step = np.zeros((ns, ns))
            step[n:, n:] = np.eye(m)
            if k < N:
                step[:n, :n] = p.A
                block[:n, u : u + m] = p.B
            else:
                step[:n, :n], step[:n, n:] = p.A + p.B @ d.K, p.B @ d.L
            block[:, s : s + ns] = step
            block[:, offset[k + 1] : offset[k + 1] + ns] = -np.eye(ns)
            rows.append(block)
            lower.append(np.zeros(ns))
            upper.append(np.zeros(ns))
        if k < N:
            keep = d.first if k == 0 else np.ones(len(p.C), bool)
            of_s, of_u = np.hstack([p.C[keep], np.zeros((keep.sum(), m))]), p.D[keep]
        else:
            keep = d.spent > k - N
            of_s, of_u = np.hstack([(p.C + p.D @ d.K)[keep], (p.D @ d.L)[keep]]), None
        if k == last:
            W = d.equilibrium_rows
            of_s = np.vstack([of_s, np.hstack([np.zeros((len(W), n)), W])])
        block = sp.lil_matrix((len(of_s), size))
        block[:, s : s + ns] = of_s
        if of_u is not None:
            block[:, u : u + m] = of_u
        rows.append(block)
        lower.append(np.full(len(of_s), -np.inf))
        upper.append(np.ones(len(of_s)))
        ng.append(len(of_s))
    theta = slice(offset[last] + n, offset[last] + ns)
    pick = np.concatenate([np.arange(offset[k] + ns, offset[k] + ns + m) for k in range(N)] + [np.arange(theta.start, theta.stop)])
    return {
        "N": last, "nx": [ns] * (last + 1), "nu": nu, "ng": ng,
        "H": sp.csc_matrix(H), "A": sp.csc_matrix(sp.vstack(rows)),
        "lba": np.concatenate(lower), "uba": np.concatenate(upper),
        "lbx": np.full(size, -np.inf), "ubx": np.full(size, np.inf),
        "theta": theta, "Fr": -2 * d.Mx.T @ p.O, "pick": pick,
    }
