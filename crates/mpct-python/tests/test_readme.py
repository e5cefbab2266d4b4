"""What the READMEs show runs as it stands there."""

import re
from pathlib import Path

import pytest
from matplotlib import pyplot

ROOT = Path(__file__).resolve().parents[3]


def blocks(path):
    return re.findall(r"^```python\n(.*?)^```", path.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)


@pytest.mark.parametrize("path", ["README.md", "crates/mpct-python/README.md"])
def test_examples_of(path, tmp_path, monkeypatch, capsys):
    pytest.importorskip("pyarrow")
    found = blocks(ROOT / path)
    assert found
    # The first README reads a problem file of the repository; campaigns write where they run.
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    known = {"__name__": "__main__"}
    for block in found:
        exec(block, known)
    assert known["step"].admissible
    pyplot.close("all")
