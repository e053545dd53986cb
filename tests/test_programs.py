"""Every program runs at reduced size, and every Python block of the README runs unchanged."""

import os
import re
import subprocess
import sys
from pathlib import Path

import jax
import numpy as np
import pytest

from experiments._support.processes import make_room
from experiments.paper.tables import gains
from jaxid.io.files import read_table

ROOT = Path(__file__).parent.parent


def run(arguments: list[str], folder: Path) -> str:
    # no display and no home directory
    environment = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "HOME")}
    # code that runs once takes longer to compile than to run
    environment |= {"PYTHONPATH": str(ROOT), "JAX_DISABLE_MOST_OPTIMIZATIONS": "1"}
    result = subprocess.run(
        [sys.executable, *arguments], cwd=folder, env=environment, capture_output=True, text=True
    )
    assert result.returncode == 0, result.stderr[-2000:]
    return result.stdout


def test_the_motor_programs_run_and_redrawing_changes_no_byte(tmp_path):
    """All run in one process, so that only the first search is compiled."""
    program = f"""
from pathlib import Path
from experiments.beyond import crosscheck
from experiments.paper.__main__ import Study, configure, main
configure()
out = Path({str(tmp_path)!r})
main(Study(toy=True, processes=1, out=out))
crosscheck.main(crosscheck.Crosscheck(toy=True, processes=1, out=out))
searched = (out / "crosscheck.csv").read_bytes()
crosscheck.main(crosscheck.Crosscheck(toy=True, compare=True, out=out))
assert (out / "crosscheck.csv").read_bytes() == searched
before = {{path.name: path.read_bytes() for path in out.iterdir()}}
main(Study(toy=True, processes=1, out=out, redraw=True))
assert {{path.name: path.read_bytes() for path in out.iterdir()}} == before
"""
    script = tmp_path.with_suffix(".py")
    script.write_text(program)
    printed = run([str(script)], ROOT)
    assert printed.count("Table I:") == 2
    assert "Table III" in printed
    sizes = {path.name: path.stat().st_size for path in tmp_path.iterdir()}
    expected = {f"fig{k}.png" for k in range(1, 11)} | {"overview.png"}
    expected |= {"table1.csv", "table2.csv", "table3.csv", "trajectory_M.csv", "crosscheck.csv"}
    expected |= {
        "table4.csv",
        "floor.png",
        "proved.csv",
        "possible.png",
        "trajectory_minimax.csv",
    }
    assert expected <= set(sizes)
    assert all(size < 200_000 for size in sizes.values())


def test_the_benchmarks_run(tmp_path):
    assert "targets met" in run(["-m", "experiments.bench", "--toy", "--out", str(tmp_path)], ROOT)
    assert (tmp_path / "bench.csv").exists()


def test_the_comparison_with_ipopt_runs_and_leaves_its_table_alone(tmp_path):
    pytest.importorskip("casadi")
    program = ["-m", "experiments.bench.design_against_ipopt", "--toy", "--processes", "1"]
    assert "IPOPT's best reached" in run([*program, "--out", str(tmp_path)], ROOT)
    (row,) = read_table(tmp_path / "bench_design.csv")
    assert (row["parameter"], row["N"]) == ("M", "30")
    assert float(row["J_ours"]) > 0
    assert [path.name for path in tmp_path.iterdir()] == ["bench_design.csv"]


@pytest.mark.slow
def test_the_programs_that_keep_the_limits_of_the_axis(tmp_path):
    """Robust and end-to-end designs run in one process, because they share compilations.

    The motion with a proved tube keeps its limits even after a very short search. Later stages of a
    case are no worse than earlier ones, and rows removed from the archive are found again.
    """
    program = f"""
from pathlib import Path
from experiments.beyond import endtoend, robust
from jaxid.runtime import configure
configure()
out = Path({str(tmp_path)!r})
robust.main(robust.Robust(toy=True, out=out))
options = endtoend.EndToEnd(toy=True, processes=1, out=out)
endtoend.main(options)
archive = out / "toy_endtoend.csv"
before = {{path.name: path.read_bytes() for path in out.iterdir() if path != archive}}
lost = (",robust,", "study,M,30,100,two_stage")
kept = [line for line in archive.read_text().splitlines(True) if not any(x in line for x in lost)]
archive.write_text("".join(kept))
endtoend.main(options)
assert {{path.name: path.read_bytes() for path in out.iterdir() if path != archive}} == before
"""
    script = tmp_path.with_suffix(".py")
    script.write_text(program)
    printed = run([str(script)], ROOT)
    assert "by proof" in printed
    assert {"toy_tube.png", "toy_table6.png", "toy_table7.png"} <= {
        path.name for path in tmp_path.iterdir()
    }

    rows = {row["limits"]: row for row in read_table(tmp_path / "toy_robust.csv")}
    assert list(rows) == ["18", "proved", "sampled"]
    assert [row["proved"] for row in rows.values()] == ["false", "true", "true"]
    for side in ("position", "velocity", "input"):
        assert int(rows["proved"][f"searched_beyond_{side}"]) == 0
        assert int(rows["sampled"][f"random_beyond_{side}"]) == 0
    assert int(rows["18"]["searched_beyond_velocity"]) > 0

    designs = read_table(tmp_path / "toy_endtoend.csv")
    assert len(designs) == 15
    two = [row["jerk_m_s3"] for row in designs if row["design"] == "two_stage"]
    assert len(set(two)) == 2  # one motion for both filters, and one at 7 V
    assert all(float(row["beyond"]) <= 0 for row in designs if row["design"] != "by_18")
    for w, setting in (("50", "study"), ("100", "study"), ("1000", "7 V")):
        case = [row for row in designs if (row["w_rad_s"], row["setting"]) == (w, setting)]
        J_f, worst = (
            {row["design"]: float(row[column]) for row in case} for column in ("J_f", "J_f_worst")
        )
        assert J_f["end_to_end"] <= min(J_f["two_stage"], J_f["filter_aware"])
        assert worst["robust"] <= worst["two_stage"]


def test_a_stage_is_represented_by_the_best_motion_for_its_objective():
    """If the search for J_f finds a smaller J* than the search for J*, the filter gains nothing."""
    columns = ("J_star", "J_aware", "J_f", "J_f_worst", "beyond")
    values = {
        "by_18": (0.9, 0.9, 0.9, 0.9, 0.1),
        "two_stage": (1.2, 1.3, 1.5, 1.6, -0.1),
        "filter_aware": (1.1, 1.2, 1.4, 1.5, -0.1),
        "end_to_end": (1.3, 1.3, 1.2, 1.4, -0.1),
        "robust": (1.4, 1.4, 1.3, 1.3, -0.1),
    }
    row = gains({name: dict(zip(columns, row, strict=True)) for name, row in values.items()})
    assert row["J_f_two_stage"] == row["J_f_filter_aware"] == 1.4
    assert row["J_f_end_to_end"] == 1.2
    assert row["J_f_worst_two_stage"] == 1.5
    assert row["J_f_worst_robust"] == 1.3
    assert row["filter_percent"] == 0
    assert row["loop_percent"] == pytest.approx(-100 / 7)
    assert row["beyond_18"] == 0.1


@pytest.mark.parametrize(("column", "value"), [("J_f", None), ("J_star", np.nan), ("beyond", 1e-9)])
def test_a_design_without_a_number_or_beyond_its_limits_is_no_stage(column, value):
    columns = ("J_star", "J_aware", "J_f", "J_f_worst", "beyond")
    names = ("by_18", "two_stage", "filter_aware", "end_to_end", "robust")
    rows = {name: dict.fromkeys(columns[:4], 1.0) | {"beyond": -0.1} for name in names}
    rows["robust"] |= {column: value}
    with pytest.raises(ValueError, match=f"`designs`: .* robust .*{column}"):
        gains(rows)


def test_searches_do_not_depend_on_the_number_of_processes(tmp_path):
    """One and two processes return the same results for all cells. All cells are infeasible."""
    program = """
from experiments.paper.designs import TOY, Cell, search
from jaxid.runtime import configure
if __name__ == "__main__":
    configure()
    chains = [[Cell("M", 10), Cell("M", 20)], [Cell("B", 20)], [Cell("Fc", 15)]]
    one, two = (sorted(map(str, search(chains, TOY, 0, count))) for count in (1, 2))
    assert one == two
    assert len(one) == 4
    assert all("lasts 0.44 s (44 intervals)" in found for found in one)
"""
    script = tmp_path / "program.py"
    script.write_text(program)
    run([str(script)], ROOT)


@pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="only Linux counts mappings")
def test_room_for_compilations_is_made_when_it_runs_out_and_not_before():
    traced = []

    @jax.jit
    def double(x):
        traced.append(x)
        return 2 * x

    for most, expected in ((10**9, 1), (0, 2), (10**9, 2)):
        double(1.0)
        make_room(most)
        double(1.0)
        assert len(traced) == expected


OPTIONS = {
    "experiments.paper": "--redraw",
    "experiments.beyond.crosscheck": "--toy",
    "experiments.beyond.sweep": "--process-id",
    "experiments.bench": "--repetitions",
    "experiments.bench.design_against_ipopt": "--processes",
    "experiments.beyond.endtoend": "--motions",
    "experiments.beyond.robust": "--attacks",
}


def test_every_program_explains_its_options():
    """All run in one process, because imports take seconds."""
    program = """
import runpy, sys
for name in sys.argv[1:]:
    sys.argv = [name, "--help"]
    try:
        runpy.run_module(name, run_name="__main__")
    except SystemExit as end:
        assert end.code == 0
    print("the end of", name)
"""
    *printed, rest = run(["-c", program, *OPTIONS], ROOT).split("the end of ")
    assert rest.strip() == list(OPTIONS)[-1]
    for text, option in zip(printed, OPTIONS.values(), strict=True):
        assert option in text


@pytest.mark.parametrize(
    "block", re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.S)
)
def test_the_readmes_python_runs(block, tmp_path):
    assert run(["-c", block], tmp_path)
