"""Reports and pictures are those of the command."""

import json
import pickle
import re
import xml.dom.minidom

import numpy as np
import pytest

import mpct
from test_command import COMMAND, EXAMPLES, command


def without_times(page):
    """A page without measured times, which differ from run to run: numbers with a unit of time, and what is drawn of them."""
    page = re.sub(r"[0-9.e+-]+ (?:ns|[uµ]s|ms|s|%)", "TIME", page)
    return re.sub(r"<svg.*?</svg>", "", page, flags=re.DOTALL)


def test_report(design, tmp_path):
    run = mpct.simulate(design.controller(), [0, 0], [(0, [2, 0.5]), (50, [5, 1])], 100)
    page = run.report(tmp_path / "report.html")
    assert page.startswith("<!DOCTYPE html>") and (tmp_path / "report.html").read_text(encoding="utf-8") == page
    assert "http://" not in page.replace("http://www.w3.org", "") and "https://" not in page
    picture = run.picture(tmp_path / "picture.svg", ["x2", "u1"])
    xml.dom.minidom.parseString(picture)
    assert picture.count("<g transform") == 2 and (tmp_path / "picture.svg").read_text(encoding="utf-8") == picture
    assert run.picture().count("<g transform") == 4
    # A run out of a pickle has no controller of its own.
    again = pickle.loads(pickle.dumps(run))
    assert again.controller is None and run.controller is not None
    assert again.picture(controller=design.controller()) == run.picture()
    assert again.report(controller=design.controller()) == page


def test_picture_in_pixels(design, tmp_path):
    run = mpct.simulate(design.controller(), [0, 0], [2, 0.5], 30)
    svg = run.picture(tmp_path / "picture.PNG", ["x1", "x2"])
    width, height = (float(v) for v in re.search(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', svg).groups())
    from matplotlib import image

    pixels = image.imread(tmp_path / "picture.PNG", format="png")
    assert pixels.shape[:2] == (2 * height, 2 * width)
    # Something is drawn on the white ground, in more than one colour.
    shades = np.unique(pixels.reshape(-1, pixels.shape[2]), axis=0)
    assert (pixels[0, 0] == 1).all() and len(shades) > 10
    assert run.picture(tmp_path / "without").startswith("<svg") and (tmp_path / "without").read_text(encoding="utf-8")[:4] == "<svg"


def test_report_has_the_margins_of_the_proofs(design):
    run = mpct.simulate(design.controller(), [0, 0], [2, 0.5], 30)
    verified = mpct.verify(design.certificate())
    page = run.report()
    said = re.search(r"(\d+) rows implied by the steps before.*?smallest margin ([0-9.e\u2212]+)", page, re.DOTALL)
    rows, margin = said.group(1), said.group(2).replace("\u2212", "-")
    assert int(rows) == verified.rows_rigorous + verified.rows_to_tolerance
    assert float(margin) == pytest.approx(verified.smallest_margin, rel=1e-2)
    problem = design.problem.replace(formulation="no_terminal_constraint", horizon_extension=2, gamma=20, horizon=3, alpha=1)
    run = mpct.simulate(problem.design().controller(), [0, 0], [0.3, 0.1], 10)
    region = mpct.StabilityRegion(run.controller, [0.3, 0.1], "throughout_region")
    assert region.contains([0, 0]).inside
    assert "the state is in \u03a5" in run.report()


def test_a_disturbance_is_seen(design):
    calm = mpct.simulate(design.controller(), [0, 0], [2, 0.5], 30)
    windy = mpct.simulate(design.controller(), [0, 0], [2, 0.5], 30, disturbance=[1e-6, 0])
    plant = design.problem.plant
    assert not calm._disturbed(plant) and windy._disturbed(plant)
    shifted = mpct.Plant(plant.A, plant.B, operating_point=([1, 0.25], [0.5, 0]))
    problem = mpct.Problem(shifted, state=(-3, 3), input=(-2, 2), Q=10, R=100, O=1e4)
    run = mpct.simulate(problem.design().controller(), [0, 0], [2, 0.5], 30)
    assert not run._disturbed(shifted)


@pytest.mark.skipif(COMMAND is None, reason="MPCT_COMMAND names no command")
def test_report_is_that_of_the_command(tmp_path):
    page, picture = tmp_path / "page.html", tmp_path / "picture.svg"
    command("simulate", EXAMPLES / "academic.toml", "--report", page, "--csv", tmp_path / "a.csv", "--picture", picture)
    file = mpct.ProblemFile.read(EXAMPLES / "academic.toml")
    design = file.problem.design()
    run = file.simulation.run(design.controller())
    assert run.picture() == picture.read_text(encoding="utf-8")
    # The number of linear programs depends on threads.
    plain = [re.sub(r"\d+ linear programs", "", without_times(p)) for p in (run.report(), page.read_text(encoding="utf-8"))]
    assert plain[0] == plain[1]


def test_files_of_a_reproduction(tmp_path):
    found = mpct.reproduce("short", tmp_path / "new" / "folder", png=True)
    names = {p.name for p in (tmp_path / "new" / "folder").iterdir()}
    pictures = {n for n in names if n.endswith(".png")}
    assert names - pictures == {"section-4.html", "section-4.json", "table-1.csv", "table-2.csv"} and len(pictures) >= 3
    for name in pictures:
        assert (tmp_path / "new" / "folder" / name).read_bytes().startswith(b"\x89PNG")
    assert found["table_1"] and all(line["terminal_horizon"] == line["printed_horizon"] for line in found["table_1"])
    assert json.loads((tmp_path / "new" / "folder" / "section-4.json").read_text(encoding="utf-8")) == found


def test_rows_and_sets(problem, design):
    rows = problem.constraint_rows()
    assert len(rows) == problem.rows == len(rows.source) and "state_upper[1]" in rows.source
    i = rows.source.index("state_upper[1]")
    np.testing.assert_allclose(rows.C[i] * rows.scale[i], [0, 1])
    assert rows.scale[i] == 3
    found = design.maximal_admissible_set()
    G, g = design.terminal_set()
    np.testing.assert_array_equal(found.G, G)
    assert len(found) == len(g) == len(found.origin) and found.states == 2
    assert {step for _, step in found.origin} <= {None, *range(design.terminal_horizon + 1)}
    assert found.contains([0, 0], [0, 0]) and not found.contains([3, 3], [0, 0])
    # A row of step k, evaluated along the terminal law, is the constraint it comes from.
    A, B, K = problem.plant.A, problem.plant.B, design.gain
    Mx, Mu = np.split(design.steady_state_basis, [2])
    law = np.block([[A + B @ K, B @ (Mu - K @ Mx)], [np.zeros((2, 2)), np.eye(2)]])
    signals = np.block([[np.eye(2), np.zeros((2, 2))], [K, Mu - K @ Mx]])
    for row, (name, step) in zip(found.G, found.origin):
        j = rows.source.index(name)
        if step is not None:
            constraint = np.concatenate([rows.C[j], rows.D[j]]) @ signals @ np.linalg.matrix_power(law, step)
            np.testing.assert_allclose(row, constraint, atol=1e-9)


def test_continuous_matrices():
    A, B = [[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]]
    known = mpct.Plant.continuous(A, B, 0.1).continuous_matrices
    np.testing.assert_array_equal(known[0], A)
    np.testing.assert_array_equal(known[1], B)
    assert mpct.Plant(A, B).continuous_matrices is None


def test_set_points_with_inputs():
    # x⁺ = x + u_1 + u_2: every equilibrium state is reached by many inputs, which the input of the set-point chooses.
    plant = mpct.Plant([[1.0]], [[1.0, 1.0]])
    problem = mpct.Problem(plant, state=(-1, 1), input=(-2, 2), Q=1, R=1, O=100, O_input=1.0)
    need = mpct.scaling_need(problem, [0.1], [1.9, -1.9])
    assert need.needed == pytest.approx(0.95) and mpct.scaling_need(problem, [0.1]).needed == pytest.approx(0.1)
    advice = mpct.scaling_advice(problem, [[0.1], [0.1]], [None, [1.9, -1.9]])
    assert [n.needed for n in advice.set_points] == pytest.approx([0.1, 0.95])


def test_a_run_put_together_by_hand(design):
    """That of another plant than the model: what is wrong with it is named."""
    controller, x, steps = design.controller(), np.zeros(2), []
    A, B = design.problem.plant.A, design.problem.plant.B
    for _ in range(20):
        step = controller.step(x, [2, 0.5])
        steps.append((x, step))
        x = A @ x + B @ step.u + 0.01 * np.sin(x)
    known = {
        "x": [x.tolist() for x, _ in steps],
        "setpoint": np.tile([2, 0.5], (20, 1)),
        "status": [s.status for _, s in steps],
        "admissible": [s.admissible for _, s in steps],
        "iterations": [s.iterations for _, s in steps],
        "solve_seconds": [s.seconds for _, s in steps],
        "final_state": x,
        "cumulative_cost": 0.0,
        "worst_violation": 0.0,
        **{n: [getattr(s, n) for _, s in steps] for n in ("u", "artificial_state", "artificial_input", "cost", "offset_cost")},
    }
    run = mpct.Run(**known)
    assert run._disturbed(design.problem.plant)
    assert "<svg" in run.report(controller=controller) and mpct.performance(run, design.problem).steps == 20
    assert run.to_dataframe().shape == (20, 16) and len(run.plot().axes) == 4
    for name, value, message in [
        ("admissible", np.ones(20), "admissible: expected an array of booleans"),
        ("iterations", -np.ones(20, int), "iterations: expected an array of whole numbers"),
        ("status", "optimal", "status: expected a list of texts"),
        ("status", ["fine"] * 20, "status: expected 'optimal' or 'candidate'"),
        ("reason", [None] * 19, "reason: expected 20 steps"),
        ("reason", "none", "reason: expected a list of texts and None"),
        ("u", np.zeros((19, 2)), "u: expected 20 steps, as in x, found 19"),
        ("x", np.zeros(20), "x: expected a matrix"),
        ("x", np.zeros((20, 3)), "run: expected one with 2 states"),
        ("artificial_state", np.zeros((20, 1)), "artificial_state"),
    ]:
        with pytest.raises(mpct.Error, match=message):
            mpct.Run(**{**known, name: value}).report(controller=controller)
