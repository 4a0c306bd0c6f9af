"""What the documents tell a user to run, run."""

import re
import runpy
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples" / "python"


def test_the_shortest_frontend_finds_the_true_poses(capsys, monkeypatch, server):
    monkeypatch.setattr(sys, "argv", ["stream_keyframes.py", server.url])
    runpy.run_path(str(EXAMPLES / "stream_keyframes.py"), run_name="__main__")
    rows = [[float(word) for word in line.split()] for line in capsys.readouterr().out.splitlines()[1:]]
    assert len(rows) == 6
    assert all(abs(optimized - truth) < 1e-4 for _, _, optimized, truth in rows)


@pytest.mark.parametrize("path", ["README.md", "python/README.md"])
def test_the_code_in_a_readme_runs_as_it_stands(capsys, path):
    blocks = re.findall(r"^```python\n(.*?)^```", (ROOT / path).read_text(), re.M | re.S)
    assert blocks
    for block in blocks:
        exec(compile(block, path, "exec"), {})
    assert abs(float(capsys.readouterr().out.split()[0]) - 0.4) < 1e-6
