"""The tutorial runs from top to bottom and shows what it says."""

from pathlib import Path

import pytest

nbformat = pytest.importorskip("nbformat")
nbclient = pytest.importorskip("nbclient")

PATH = Path(__file__).resolve().parents[3] / "examples" / "tutorial.ipynb"


def texts(cell):
    for output in cell.outputs:
        yield output.get("text", "")
        yield output.get("data", {}).get("text/plain", "")


def test_tutorial(monkeypatch):
    # The pictures are part of what is checked.
    monkeypatch.delenv("MPLBACKEND", raising=False)
    notebook = nbformat.read(PATH, as_version=4)
    assert all(not cell.get("outputs") for cell in notebook.cells), "the notebook is stored without outputs"
    nbclient.NotebookClient(notebook, timeout=120, kernel_name="python3").execute()
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    shown = {cell.source: "\n".join(texts(cell)) for cell in code}
    pictures = sum("image/png" in output.get("data", {}) for cell in code for output in cell.outputs)
    assert pictures == 3

    def output_of(part):
        return next(text for source, text in shown.items() if part in source)

    assert "Design(M̃=" in output_of("problem.design()\ndesign")
    outside = output_of("attracted.contains")
    assert "inside: True False" in outside and "at step" in outside
    # 0.97 m is beyond 90 % of the rail; the cart goes to 0.9 m.
    assert "False" in output_of("run.admissible.any()") and "0.9" in output_of("run.admissible.any()")
    assert "state_upper[0]" in output_of("closest = ")
    assert "equilibrium: False" in output_of("scaling_advice")
    assert "True" in output_of("reached.admissible.all()") and "0.97" in output_of("reached.admissible.all()")


def test_progress_in_a_notebook():
    notebook = nbformat.v4.new_notebook()
    work = """
import mpct
from mpct import _progress
_progress._DELAY = 0.0
problem = mpct.example("carts", 60).problem.replace(scaling=0.9999)
try:
    problem.design("sufficient", 10**6, time_limit=1.0)
except mpct.DesignError:
    pass
"""
    notebook.cells = [nbformat.v4.new_code_cell(work)]
    seen = []

    class Client(nbclient.NotebookClient):
        def process_message(self, message, cell, index):
            seen.append(message)
            return super().process_message(message, cell, index)

    Client(notebook, timeout=120, kernel_name="python3").execute()
    shown = [m["content"]["data"]["text/html"] for m in seen if m["msg_type"] in ("display_data", "update_display_data")]
    assert any("<progress" in html and "/180 rows, M̃ ≥" in html for html in shown)
    # One output, which is empty in the end.
    assert shown[-1] == "" and len(notebook.cells[0].outputs) == 1
