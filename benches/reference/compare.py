#!/usr/bin/env python3
"""covis beside its twins on the same files, in turn, in one run: a table, raw traces, plots.

Every round runs each solver once, another one first each time. T is the median over the rounds of
the seconds until the cost is at most 1.001 times the best final cost of any solver on that file.
"ratio" is T over the best T of a twin with as many threads; below 1 is faster than every twin.
"peak" is the largest resident memory of the process, reading the file included.

Nothing is taken on trust: a solver's start and final cost must be what bal.py finds in the file and
in the file that it wrote, to 1e-6, and its clock must lie within the wall's. A run that fails this
has no row of numbers; for covis the exit code is then 1.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path

import rounds
import runs
import solvers

DEFAULT_SOLVERS = "covis,ceres:dense-schur,ceres:sparse-schur,ceres:iterative-schur,gtsam"
HEAD = "| file | solver | threads | start cost | final cost | iterations | ms/iteration | T (s) | ratio | peak (MB) |"


def arguments() -> argparse.Namespace:
    text = f"{__doc__}\nsolvers:\n{solvers.BUNDLE}"
    parser = argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="+", metavar="FILE", help="BAL files")
    parser.add_argument("--solvers", default=DEFAULT_SOLVERS, help=f"default: {DEFAULT_SOLVERS}")
    parser.add_argument("--threads", default="1,2", help="default: 1,2")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--max-iterations", type=int, default=100)
    parser.add_argument("--fix-intrinsics", action="store_true", help="6 unknowns a camera instead of 9")
    parser.add_argument("--within", type=float, default=1e-3, help="how close to the best cost T asks for (1e-3)")
    parser.add_argument("--timeout", type=float, default=600.0, help="seconds a run may take")
    parser.add_argument("--covis", default=solvers.Programs.covis, metavar="BINARY")
    parser.add_argument("--ceres", default=solvers.Programs.ceres, metavar="FOLDER",
                        help=f"where its twins are (default: {solvers.Programs.ceres})")
    parser.add_argument("--json", metavar="PATH", help="write every trace here")
    parser.add_argument("--plot", default="target/reference/plots", metavar="FOLDER",
                        help="where a picture a file goes, of cost against seconds (default: target/reference/plots)")
    parser.add_argument("--no-plot", dest="plot", action="store_const", const="")
    parser.add_argument("--format", choices=["png", "svg"], default="png", help="of the pictures")
    options = parser.parse_args()
    options.solvers = options.solvers.split(",")
    try:
        options.threads = [int(count) for count in options.threads.split(",")]
        for solver in options.solvers:
            solvers.check_bundle(solver)
    except ValueError as error:
        parser.error(str(error))
    return options


def measure(file: str, start: float, options: argparse.Namespace, settings: solvers.Settings) -> list[list[runs.Run]]:
    """All runs on a file that costs `start`."""
    def execute(solver: str, threads: int, out: str) -> runs.Run:
        command = solvers.bundle(solver, file, threads, out, settings)
        return runs.run(solver, threads, command, out, settings.timeout_s)

    def verify(run: runs.Run, out: str) -> str:
        if not rounds.is_close(run.start, start):
            return f"another objective: starts at {run.start:.6e}, the file costs {start:.6e}"
        return rounds.verify_end(run, "bal.py", out)

    cases = [(threads, solver) for threads in options.threads for solver in options.solvers]
    return rounds.measure(cases, options.rounds, execute, verify)


def line(summary: dict, floor_mb: float) -> str:
    """A row of the table."""
    head = [rounds.name(summary["file"]), summary["solver"], str(summary["threads"])]
    return f"| {' | '.join(head + rounds.cells(summary, floor_mb))} |"


def main() -> int:
    options = arguments()
    programs = solvers.Programs(options.covis, options.ceres)
    settings = solvers.Settings(programs, options.max_iterations, options.fix_intrinsics, options.timeout)
    machine = runs.machine()
    unknowns = 6 if options.fix_intrinsics else 9
    print(f"{runs.describe(machine)}.\n{unknowns} unknowns a camera, {options.rounds} rounds, "
          f"T to within {options.within:g} of the best cost.\n")
    print(HEAD)
    print(rounds.rule(HEAD), flush=True)
    record = {"machine": machine, "options": vars(options), "files": []}
    failed = False
    for file in options.files:
        try:
            size = runs.facts("bal.py", file)
        except ValueError as error:
            sys.exit(f"error: {error}")
        measured = measure(file, size["cost"], options, settings)
        summaries = rounds.summarize(file, measured, options.within)
        for summary in summaries:
            print(line(summary, runs.own_peak_memory_mb()), flush=True)
        failed |= any(solvers.is_covis(summary["solver"]) and summary["error"] for summary in summaries)
        traces = [asdict(run) for case in measured for run in case]
        record["files"].append({**size, "summaries": summaries, "runs": traces})
    if options.json:
        Path(options.json).write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
    rounds.print_blas(record["files"])
    if options.plot:
        rounds.draw(record["files"], options.plot, options.format)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
