"""Every program runs, at toy size; every Python block of the README runs as it stands."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent


def run(arguments: list[str], folder: Path) -> str:
    # no display and no home directory
    environment = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "HOME")}
    environment |= {"PYTHONPATH": str(ROOT)}
    result = subprocess.run(
        [sys.executable, *arguments], cwd=folder, env=environment, capture_output=True, text=True
    )
    assert result.returncode == 0, result.stderr[-2000:]
    return result.stdout


def test_the_motor_study_runs_and_redrawing_changes_no_byte(tmp_path):
    arguments = ["-m", "experiments.linear_motor", "--toy", "--out", str(tmp_path)]
    printed = run(arguments, ROOT)
    assert "Table I" in printed
    assert "Table III" in printed
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    expected = {f"fig{k}.png" for k in range(1, 11)} | {"overview.png"}
    expected |= {"table1.csv", "table2.csv", "table3.csv", "trajectory_M.csv"}
    assert expected <= set(before)
    assert all(len(data) < 200_000 for data in before.values())
    run([*arguments, "--redraw"], ROOT)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.parametrize(
    "block", re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.S)
)
def test_the_readmes_python_runs(block, tmp_path):
    assert run(["-c", block], tmp_path)
