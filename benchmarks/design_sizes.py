"""The whole offline design by `mpct design` alone: seconds, memory, growth with the number of carts.

Everything is measured as a process: from its start to its end, reading the problem file included. Peak memory is the
largest resident set, of one more run. Beside stand the times that the paper prints (Table 2 and
section 4.3), which are of another machine and of MATLAB. The problems are ours where the paper does not print a number
(springs, dampers, masses, horizon, offset weight of the carts); see the README of the repository.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import re
import shutil
import statistics
import subprocess
import tempfile
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from paper_search import RESULTS, ROOT, machine

# Table 2 of the paper, seconds.
PAPER_IMPLICIT = {
    3: 2.7063, 5: 3.7123, 10: 6.8664, 15: 21.5659, 25: 52.3099, 30: 73.6518, 50: 201.9882, 70: 390.5777, 100: 881.0654,
    200: 4610.1,
}  # fmt: skip
PAPER_EXPLICIT = {
    3: 7.6293, 5: 15.5986, 10: 54.4716, 15: 153.2055, 25: 541.9198, 30: 799.4687, 50: 3009.5, 70: 8739.9, 100: 69640.0,
}  # fmt: skip
# Section 4.3, seconds.
PAPER_DRONE = {"implicit": 16.9558, "explicit": 137.1241}
CARTS = (10, 25, 50, 100, 200, 500, 1000)
HUGE = 10_000
# States and inputs of plants without structure.
DENSE = ((20, 5), (40, 10), (60, 10), (100, 20))
EXPLICIT_UP_TO = 200


@dataclass
class Measured:
    """Medians over the repetitions of a process; `failed` is what it wrote when it did not end well."""

    wall: float
    cpu: float
    mebibytes: float
    text: str
    failed: str | None = None

    def number(self, label: str) -> int | None:
        found = re.search(rf"^\s*{label}\s+(\d+)", self.text, re.MULTILINE)
        return int(found[1]) if found else None


def once(command: list, limit: float) -> Measured:
    """One run of a process that has to end within `limit` seconds, without its memory."""
    with tempfile.TemporaryFile("w+") as out:
        started = time.perf_counter()
        process = subprocess.Popen([str(c) for c in command], stdout=out, stderr=subprocess.STDOUT)
        timer = threading.Timer(limit, process.kill)
        timer.start()
        _, status, usage = os.wait4(process.pid, 0)
        wall = time.perf_counter() - started
        timer.cancel()
        process.returncode = os.waitstatus_to_exitcode(status)
        out.seek(0)
        text = out.read()
    failed = None
    if wall >= limit:
        failed = f"over {limit:.0f} s"
    elif process.returncode != 0:
        failed = (text.strip().splitlines() or [f"exit code {process.returncode}"])[-1]
    return Measured(wall, usage.ru_utime + usage.ru_stime, math.nan, text, failed)


def peak_memory(command: list, limit: float) -> float:
    """Mebibytes, by a run of its own.

    What wait4 tells of a child begins with the resident set of the process that started it, which here is Python with its
    libraries. GNU time is small; without it the kernel's high-water mark is read while the process runs.
    """
    command = [str(c) for c in command]
    gnu_time = shutil.which("time")
    if gnu_time:
        with tempfile.NamedTemporaryFile("r") as told:
            run = [gnu_time, "--format=%M", f"--output={told.name}", *command]
            if subprocess.run(run, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, timeout=limit).returncode == 0:
                return int(told.read().split()[-1]) / 1024
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    most, status = math.nan, Path(f"/proc/{process.pid}/status")
    while process.poll() is None:
        try:
            found = re.search(r"VmHWM:\s+(\d+) kB", status.read_text())
        except OSError:
            break
        # Before it has become the command, the child is a copy of this program.
        if found and Path(f"/proc/{process.pid}/exe").resolve() == Path(command[0]).resolve():
            most = int(found[1]) / 1024
        time.sleep(5e-4)
    process.wait()
    return most


def measure(command: list, repeat: int, limit: float) -> Measured:
    """Medians; fewer repetitions when they take long."""
    runs: list[Measured] = []
    while len(runs) < repeat and sum(r.wall for r in runs) < 60.0:
        runs.append(once(command, limit))
        if runs[-1].failed:
            return runs[-1]
    wall, cpu = statistics.median(r.wall for r in runs), statistics.median(r.cpu for r in runs)
    return Measured(wall, cpu, peak_memory(command, limit), runs[-1].text)


def write_case(mpct: Path, folder: Path, case: str, count: int | None = None, scaling: float | None = None) -> Path:
    command = [mpct, "example", case] + (["--count", str(count)] if count else [])
    text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    if scaling is not None:
        text, changed = re.subn(r"^scaling = .*$", f"scaling = {scaling}", text, flags=re.MULTILINE)
        if changed != 1:
            raise SystemExit(f"{case}: no scaling to change")
    file = folder / f"{case}-{count or ''}-{scaling or ''}.toml"
    file.write_text(text)
    return file


def size(v: float) -> str:
    return "–" if math.isnan(v) else f"{v:.1f}" if v < 100 else f"{v:.0f}"


def seconds(v: float | None) -> str:
    return "–" if v is None or math.isnan(v) else f"{v:.2g}" if v < 0.01 else f"{v:.3g}" if v < 1000 else f"{v:,.0f}".replace(",", " ")


def ratio(paper: float | None, ours: float) -> str:
    return "–" if paper is None or math.isnan(ours) else f"{float(f'{paper / ours:.2g}'):,.0f}".replace(",", " ")


def exponent(pairs: list[tuple[float, float]]) -> float:
    """The slope of a straight line through the logarithms."""
    x, y = [math.log(p[0]) for p in pairs], [math.log(p[1]) for p in pairs]
    mx, my = statistics.fmean(x), statistics.fmean(y)
    return sum((a - mx) * (b - my) for a, b in zip(x, y, strict=True)) / sum((a - mx) ** 2 for a in x)


def designs(a: argparse.Namespace, folder: Path, carts: list[int]) -> tuple[list[str], dict[int, Measured]]:
    lines = [
        "## Design",
        "",
        "| problem | states, inputs | M̃ | linear programs | wall s | CPU s | peak MiB | growth of wall, of memory | paper's search, s | paper / wall |",
        "|" + "---|" * 10,
    ]
    cases = [("academic", None, None), ("drone", None, 0.9), ("drone", None, 0.99)] + [("carts", n, None) for n in carts]
    known: dict[int, Measured] = {}
    before: tuple[int, Measured] | None = None
    for case, count, scaling in cases:
        r = measure([a.mpct, "design", write_case(a.mpct, folder, case, count, scaling)], a.repeat, a.limit)
        name = f"{count} carts" if count else case + (f", λ = {scaling}" if scaling else "")
        paper = PAPER_IMPLICIT.get(count) if count else PAPER_DRONE["implicit"] if scaling == 0.9 else None
        if r.failed:
            lines.append(f"| {name} | – | – | – | {r.failed} | – | – | – | {seconds(paper)} | – |")
            print(lines[-1], flush=True)
            continue
        growth = "–"
        if count:
            known[count] = r
            if before:
                ends = [(before[0], before[1]), (count, r)]
                growth = f"{exponent([(n, m.wall) for n, m in ends]):.2f}, {exponent([(n, m.mebibytes) for n, m in ends]):.2f}"
            before = (count, r)
        found = re.search(r"(\d+) states, (\d+) inputs", r.text)
        lines.append(
            f"| {name} | {found[1]}, {found[2]} | {r.number('terminal horizon')} | {r.number('linear programs')} | {seconds(r.wall)} | "
            f"{seconds(r.cpu)} | {size(r.mebibytes)} | {growth} | {seconds(paper)} | {ratio(paper, r.wall)} |"
        )
        print(lines[-1], flush=True)
    if len(known) > 2:
        large = [(n, m) for n, m in known.items() if n >= 50] or list(known.items())
        if len(large) > 1:
            lines += [
                "",
                f"Straight line through the logarithms from {large[0][0]} to {large[-1][0]} carts: seconds grow like "
                f"n^{exponent([(n, m.wall) for n, m in large]):.2f}, memory like n^{exponent([(n, m.mebibytes) for n, m in large]):.2f}.",
            ]
    return lines, known


def dense_case(folder: Path, states: int, inputs: int) -> Path:
    """A random plant without any structure: spectral radius 0.98, every variable within 1."""
    rng = np.random.default_rng(1)
    A = rng.standard_normal((states, states))
    A *= 0.98 / np.abs(np.linalg.eigvals(A)).max()
    B = rng.standard_normal((states, inputs))
    ones = lambda count, sign: str([sign * 1.0] * count)
    file = folder / f"dense-{states}.toml"
    file.write_text(
        f'name = "dense {states} x {inputs}"\n[plant]\nA = {A.tolist()}\nB = {B.tolist()}\n'
        f"[constraints]\nstate_lower = {ones(states, -1)}\nstate_upper = {ones(states, 1)}\n"
        f"input_lower = {ones(inputs, -1)}\ninput_upper = {ones(inputs, 1)}\n"
        "[weights]\nQ = 1.0\nR = 1.0\nO = 1000.0\n[controller]\nprediction_horizon = 5\nscaling = 0.9\n"
    )
    return file


def phases(a: argparse.Namespace, folder: Path, carts: list[int]) -> list[str]:
    """Where the time goes, as `mpct design --json` tells it: medians."""
    lines = [
        "## Phases",
        "",
        "Milliseconds of `mpct design --json`, medians. Law: K and P. Steady states: M_θ and the rows of step 0. Rows: those of all "
        "steps. Programs: linear programs, on all cores. Rest: starting the process, reading the file, writing the answer.",
        "",
        "| problem | states, inputs | M̃ | linear programs | law | steady states | rows | programs | a program, µs of CPU | rest | wall ms | CPU ms |",
        "|" + "---|" * 12,
    ]
    cases = [("drone", write_case(a.mpct, folder, "drone"))]
    cases += [(f"{n} carts", write_case(a.mpct, folder, "carts", n)) for n in (100, 1000) if n <= max(carts, default=0)]
    cases += [(f"dense, {n} states", dense_case(folder, n, m)) for n, m in DENSE]
    for name, file in cases:
        runs = []
        for _ in range(a.repeat):
            r = once([a.mpct, "design", "--json", file], a.limit)
            if r.failed:
                raise SystemExit(f"{name}: {r.failed}")
            runs.append((r, json.loads(r.text)))
        middle = lambda f: statistics.median(f(r, d) for r, d in runs)
        law, steady, rows, programs = (1e3 * middle(lambda r, d: d["phases"][k]) for k in ("law", "steady_states", "rows", "programs"))
        wall, cpu = 1e3 * middle(lambda r, d: r.wall), 1e3 * middle(lambda r, d: r.cpu)
        d = runs[0][1]
        count = d["linear_programs"]
        each = 1e3 * programs * min(os.cpu_count() or 1, cpu / wall) / max(count, 1)
        parts = [law, steady, rows, programs]
        numbers = " | ".join(f"{v:.3g}" for v in parts)
        lines.append(
            f"| {name} | {d['n']}, {d['m']} | {d['terminal_horizon']} | {count} | {numbers} | {each:.3g} | {max(wall - sum(parts), 0.0):.3g} | "
            f"{wall:.4g} | {cpu:.4g} |"
        )
        print(lines[-1], flush=True)
    return lines


def explicit_sets(a: argparse.Namespace, folder: Path, carts: list[int]) -> tuple[list[str], dict[int, Measured]]:
    lines = [
        "## Explicit terminal set",
        "",
        "Design and explicit set without redundant rows in one process (`mpct design --explicit-set`), beside the paper's time for "
        "the explicit set. The paper's limit was 48 hours; for 200 carts it has no explicit set.",
        "",
        "| problem | rows of the set | constraint rows over steps 0 to M̃ | wall s | of these the set | peak MiB | paper, s | paper / wall |",
        "|" + "---|" * 8,
    ]
    known: dict[int, Measured] = {}
    cases = [("academic", None, None), ("drone", None, 0.9)] + [("carts", n, None) for n in carts if n <= EXPLICIT_UP_TO]
    for case, count, scaling in cases:
        file = write_case(a.mpct, folder, case, count, scaling)
        alone = measure([a.mpct, "design", file], a.repeat, a.limit)
        r = measure([a.mpct, "design", "--explicit-set", file], a.repeat, a.limit)
        name = f"{count} carts" if count else case
        paper = PAPER_EXPLICIT.get(count) if count else PAPER_DRONE["explicit"] if case == "drone" else None
        never = "none in 48 h" if count == 200 else seconds(paper)
        if r.failed:
            lines.append(f"| {name} | – | – | {r.failed} | – | – | {never} | – |")
        else:
            if count:
                known[count] = r
            rows, steps = r.number("rows of the explicit set"), r.number("terminal horizon")
            constraint_rows = int(re.search(r"(\d+) constraint rows", r.text)[1])
            lines.append(
                f"| {name} | {rows} | {constraint_rows * (steps + 1)} | {seconds(r.wall)} | "
                f"{seconds(max(r.wall - alone.wall, 0.0))} | {size(r.mebibytes)} | {never} | {ratio(paper, r.wall)} |"
            )
        print(lines[-1], flush=True)
    return lines, known


def certificates(a: argparse.Namespace, folder: Path, carts: list[int]) -> list[str]:
    lines = [
        "## Certificate",
        "",
        "`mpct design --certificate` writes a proof of K, P, M̃; `mpct verify` checks it with code that shares nothing with the "
        "search.",
        "",
        "| problem | bytes | design, wall s | design and certificate, wall s | verify, wall s | verify / design | peak MiB of verify |",
        "|" + "---|" * 7,
    ]
    cases = [("academic", None, None), ("drone", None, 0.9), ("drone", None, 0.99)] + [("carts", n, None) for n in carts if n in (50, 100, 200, 500)]
    for case, count, scaling in cases:
        file = write_case(a.mpct, folder, case, count, scaling)
        proof = folder / "certificate.json"
        proof.unlink(missing_ok=True)
        alone = measure([a.mpct, "design", file], a.repeat, a.limit)
        both = measure([a.mpct, "design", "--certificate", proof, file], a.repeat, a.limit)
        name = f"{count} carts" if count else case + (f", λ = {scaling}" if scaling else "")
        checked = measure([a.mpct, "verify", proof], a.repeat, a.limit) if not both.failed else both
        if checked.failed:
            lines.append(f"| {name} | – | {seconds(alone.wall)} | {checked.failed} | – | – | – |")
        else:
            lines.append(
                f"| {name} | {proof.stat().st_size} | {seconds(alone.wall)} | {seconds(both.wall)} | {seconds(checked.wall)} | "
                f"{checked.wall / alone.wall:.2f} | {size(checked.mebibytes)} |"
            )
        print(lines[-1], flush=True)
    return lines


def plot(implicit: dict[int, Measured], explicit: dict[int, Measured]) -> None:
    import matplotlib

    matplotlib.use("svg")
    matplotlib.rcParams["svg.hashsalt"] = "mpct"
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 4))
    left.loglog(list(PAPER_EXPLICIT), list(PAPER_EXPLICIT.values()), "^:", color="tab:red", label="paper, explicit set")
    left.loglog(list(PAPER_IMPLICIT), list(PAPER_IMPLICIT.values()), "o:", color="tab:orange", label="paper, its search")
    left.loglog(list(explicit), [r.wall for r in explicit.values()], "v-", color="tab:green", label="mpct, explicit set")
    left.loglog(list(implicit), [r.wall for r in implicit.values()], "s-", color="tab:blue", label="mpct design")
    left.set_ylabel("seconds")
    right.loglog(list(implicit), [r.mebibytes for r in implicit.values()], "s-", color="tab:blue", label="mpct design")
    right.loglog(list(explicit), [r.mebibytes for r in explicit.values()], "v-", color="tab:green", label="mpct, explicit set")
    right.set_ylabel("peak memory, MiB")
    for axes in (left, right):
        axes.set_xlabel("carts")
        axes.grid(True, which="both", linewidth=0.3)
        axes.legend()
    figure.tight_layout()
    figure.savefig(RESULTS / "design_sizes.svg", metadata={"Date": None})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mpct", type=Path, default=ROOT / "target/release/mpct")
    parser.add_argument("--carts", default=",".join(map(str, CARTS)), help="numbers of carts, comma separated")
    parser.add_argument("--huge", action="store_true", help=f"also {HUGE} carts")
    parser.add_argument("--repeat", type=int, default=5, help="runs of a process, of which the median counts; fewer when they take over a minute")
    parser.add_argument("--limit", type=float, default=3600.0, help="seconds a process may take")
    a = parser.parse_args()
    carts = sorted({int(v) for v in a.carts.split(",") if v} | ({HUGE} if a.huge else set()))
    RESULTS.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        design, implicit = designs(a, folder, carts)
        explicit, sets = explicit_sets(a, folder, carts)
        certificate = certificates(a, folder, carts)
        where = phases(a, folder, carts)
    lines = [
        "# Whole designs by size",
        "",
        f"Machine: {machine()}. Medians of up to {a.repeat} runs. Wall: from the start of the process to its end, with reading the "
        "file. Growth: exponent between this size and the one before. The times of the paper are of its own machine, in MATLAB; the "
        "problems are the same up to what the paper does not print.",
        "",
        *design,
        "",
        *explicit,
        "",
        *certificate,
        "",
        *where,
    ]
    (RESULTS / "design_sizes.md").write_text("\n".join(lines) + "\n")
    plot(implicit, sets)


if __name__ == "__main__":
    main()
