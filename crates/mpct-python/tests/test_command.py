"""Python answers what the command answers, to the last digit."""

import csv
import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

import mpct

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
COMMAND = os.environ.get("MPCT_COMMAND")
pytestmark = pytest.mark.skipif(COMMAND is None, reason="MPCT_COMMAND names no command; `cargo xtask test` sets it")


def command(*arguments):
    done = subprocess.run([COMMAND, *map(str, arguments)], capture_output=True, text=True, check=True)
    return done.stdout


@pytest.mark.parametrize(
    ("case", "formulation"), [("academic", None), ("academic", "explicit"), ("drone", None), ("carts-10", None)]
)
def test_simulate_json(case, formulation):
    options = [] if formulation is None else ["--formulation", formulation]
    told = json.loads(command("simulate", EXAMPLES / f"{case}.toml", "--json", *options))
    file = mpct.ProblemFile.read(EXAMPLES / f"{case}.toml")
    design = file.problem.design()
    run = file.simulation.run(design.controller(formulation))
    assert design.terminal_horizon == told["terminal_horizon"]
    assert len(run) == len(told["steps"])
    for name in ("x", "u", "artificial_state", "artificial_input", "setpoint", "cost", "offset_cost", "admissible", "status"):
        assert [step[name] for step in told["steps"]] == np.asarray(getattr(run, name)).tolist(), name
    assert told["summary"]["cumulative_cost"] == run.cumulative_cost
    assert told["summary"]["final_state"] == run.final_state.tolist()
    assert told["summary"]["worst_violation"] == run.worst_violation


def test_simulate_csv(tmp_path):
    path = tmp_path / "academic.csv"
    command("simulate", EXAMPLES / "academic.toml", "--csv", path, "--report", tmp_path / "report.html")
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    file = mpct.ProblemFile.read(EXAMPLES / "academic.toml")
    frame = file.simulation.run(file.problem.design().controller()).to_dataframe().reset_index()
    assert list(frame.columns) == list(rows[0])
    for name in frame.columns.drop(["solve_seconds", "admissible", "status"]):
        assert [float(row[name]) for row in rows] == frame[name].tolist(), name
    assert [row["status"] for row in rows] == frame["status"].tolist()
    assert [row["admissible"] == "true" for row in rows] == frame["admissible"].tolist()


def test_design_and_certificate(tmp_path):
    path = tmp_path / "certificate.json"
    told = json.loads(command("design", EXAMPLES / "academic.toml", "--json", "--explicit-set", "--certificate", path))
    design = mpct.Problem.read(EXAMPLES / "academic.toml").design()
    assert told["terminal_horizon"] == design.terminal_horizon
    assert told["spectral_radius"] == design.spectral_radius
    assert told["gain"] == design.gain.tolist()
    assert told["terminal_weight"] == design.terminal_weight.tolist()
    assert told["terminal_rows"] == len(design.terminal_set()[1])
    assert path.read_text(encoding="utf-8") == design.certificate()
    verified = json.loads(command("verify", path, "--json"))
    assert verified["smallest_margin"] == mpct.verify(path).smallest_margin


def test_sweep_and_scaling():
    told = json.loads(command("sweep", EXAMPLES / "academic.toml", "--scaling", "0.99,0.9,0.5", "--json"))
    file = mpct.ProblemFile.read(EXAMPLES / "academic.toml")
    points = mpct.sweep(file.problem, [0.99, 0.9, 0.5], simulation=file.simulation)
    assert [(t["scaling"], t["terminal_horizon"], t["cumulative_cost"]) for t in told] == [
        (p.scaling, p.terminal_horizon, p.cumulative_cost) for p in points
    ]
    told = json.loads(command("scaling", EXAMPLES / "academic.toml", "--json"))
    advice = mpct.scaling_advice(file.problem, [s[1] for s in file.simulation.set_points])
    assert told["advised_scaling"] == advice.advised_scaling
    assert told["advised_terminal_horizon"] == advice.advised_terminal_horizon


def test_simulate_without_terminal_constraint(tmp_path):
    path = tmp_path / "section-3-5.toml"
    file = mpct.ProblemFile.read(EXAMPLES / "academic.toml")
    problem = file.problem.replace(formulation="no_terminal_constraint", horizon_extension=2, gamma=20, horizon=3)
    simulation = mpct.Simulation([0, 0], [(0, [2, 0.5]), (30, [-2, -0.5])], 60, [0.01, 0.02], 7)
    mpct.ProblemFile(problem, simulation).write(path)
    told = json.loads(command("simulate", path, "--json"))
    run = simulation.run(problem.design().controller())
    assert [step["x"] for step in told["steps"]] == run.x.tolist()
    assert told["summary"]["cumulative_cost"] == run.cumulative_cost


def test_check():
    told = json.loads(command("check", EXAMPLES / "academic.toml", "--json"))
    file = mpct.ProblemFile.read(EXAMPLES / "academic.toml")
    assert told["spectral_radius"] == file.problem.check().spectral_radius and told["constraint_rows"] == file.problem.rows
    for setpoint, (from_step, state) in zip(told["setpoints"], file.simulation.set_points, strict=True):
        closest = file.problem.closest_admissible(state)
        assert (setpoint["from_step"], setpoint["admissible"]) == (from_step, closest.admissible)
        assert setpoint["closest_state"] == closest.state.tolist() and setpoint["limiting"] == closest.limiting


def test_domain(tmp_path):
    options = ["--state=-3,3", "--state=1,0.5", "--direction=1,0.5", "--outline=0,1", "--volume"]
    sets = ["--set=implicit", "--set=explicit", "--set=regulation"]
    told = json.loads(command("domain", EXAMPLES / "academic.toml", "--json", *options, *sets))["sets"]
    problem = mpct.Problem.read(EXAMPLES / "academic.toml")
    design = problem.design()
    controllers = [
        design.controller("implicit"), design.controller("explicit"), problem.replace(task="regulation").design().controller()
    ]  # fmt: skip
    for one, controller in zip(told, controllers, strict=True):
        domain = mpct.DomainOfAttraction(controller)
        assert [s["inside"] for s in one["states"]] == [domain.contains(s["state"]).inside for s in one["states"]]
        proof = one["states"][1]["proof"]["inside"]
        assert (proof["candidate"], proof["slack"]) == ((m := domain.contains([1, 0.5])).candidate.tolist(), m.slack)
        reach = domain.reach([1, 0.5])
        assert one["reach"][0]["distance"] == reach.distance and one["reach"][0]["at_most"] == reach.at_most
        outline = domain.projection((0, 1))
        assert one["outline"]["vertices"] == outline.vertices.tolist() and one["outline"]["area"] == outline.area
        volume = domain.volume()
        assert one["volume"] == {n: getattr(volume, n) for n in ("value", "dimension", "gap", "vertices", "queries")}


def test_domain_without_terminal_constraint(tmp_path):
    path = tmp_path / "section-3-5.toml"
    problem = mpct.Problem.read(EXAMPLES / "academic.toml").replace(
        formulation="no_terminal_constraint", horizon_extension=2, gamma=20, horizon=3, alpha=1
    )
    path.write_text(problem.to_toml(), encoding="utf-8")
    options = ["--state=0.4,0", "--direction=1,0", "--section=0,1", "--volume", "--set-point=0.5,0", "--scope=throughout_region"]
    told = json.loads(command("domain", path, "--json", *options))["sets"][0]
    region = mpct.StabilityRegion(mpct.Problem.read(path).design().controller(), [0.5, 0], "throughout_region")
    assert told["states"][0]["proof"]["cost"] == region.contains([0.4, 0]).cost
    assert told["reach"][0]["distance"] == region.reach([1, 0]).distance
    assert told["outline"]["vertices"] == region.section().vertices.tolist()
    assert told["volume"]["value"] == region.volume().value


def test_pictures_are_those_of_the_command(tmp_path):
    command("simulate", EXAMPLES / "academic.toml", "--no-files", "--picture", tmp_path / "a.png", "--signals", "x1,u2")
    file = mpct.ProblemFile.read(EXAMPLES / "academic.toml")
    file.simulation.run(file.problem.design().controller()).picture(tmp_path / "b.png", ["x1", "u2"])
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_compare(tmp_path):
    file = mpct.ProblemFile.read(EXAMPLES / "academic.toml")
    other = mpct.ProblemFile(file.problem.replace(R=10), file.simulation)
    other.write(tmp_path / "other.toml")
    told = json.loads(command("compare", EXAMPLES / "academic.toml", tmp_path / "other.toml", "--json"))
    runs = [f.simulation.run(f.problem.design().controller()) for f in (file, other)]
    found = {figure.what: (figure.first, figure.second) for figure in mpct.compare(*runs)}
    # The first figure of the command is M̃; measured times differ.
    expected = {f["what"]: (f["first"], f["second"]) for f in told["figures"][1:]}
    assert list(found) == list(expected)
    assert {k: v for k, v in found.items() if "time" not in k} == {k: v for k, v in expected.items() if "time" not in k}
    performance = mpct.performance(runs[1])
    assert told["second"]["input_movement"] == performance.input_movement.tolist()
    assert [m["margin"] for m in told["second"]["margins"]] == [m.margin for m in performance.margins]


def test_examples_are_those_of_the_command(tmp_path):
    for case in ("academic", "drone"):
        path = tmp_path / f"{case}.toml"
        path.write_text(command("example", case), encoding="utf-8")
        assert mpct.ProblemFile.read(path).problem == mpct.example(case).problem


def test_messages_are_those_of_the_command(tmp_path):
    path = tmp_path / "wrong.toml"
    text = (EXAMPLES / "academic.toml").read_text(encoding="utf-8")
    path.write_text(text.replace("state_upper", "state_uper"), encoding="utf-8")
    done = subprocess.run([COMMAND, "check", path], capture_output=True, text=True)
    with pytest.raises(mpct.FileError) as error:
        mpct.ProblemFile.read(path)
    assert error.value.line > 1 and error.value.suggestion.endswith("state_upper")
    assert str(error.value) in done.stderr.replace("\n", " ")
