#!/usr/bin/env python3
"""covis beside its twins on pose graphs, in turn, in one run: tables, raw traces, pictures.

Every round runs each solver once, another one first each time. T is the median over the rounds of
the seconds until the cost is at most 1.001 times the best final cost of any solver on that file; the
time that a start takes is in it. Of a twin's starts the table shows the one with the least T (--all:
every one), of covis what it chooses. "ratio" is T over the best T of a twin with as many threads;
below 1 is faster than every twin.

With --incremental each file grows vertex by vertex, in id order: milliseconds of a step, beside
iSAM2. "above the best" is the largest excess over the lowest cost that any solver had at the same
number of vertices, looked at every 100, where that is more than a hundredth of the last. "ratio" is
the median and the 99th percentile over the least that a twin with as many threads has of each.

Nothing is taken on trust: the cost that a solver claims must be what g2o.py finds for the vertices
that it wrote with the edges of the file, to 1e-6, a start from the file's vertices must cost what
they cost, and a clock must lie within the wall's. A run that fails this has no row of numbers; for
covis the exit code is then 1.
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
import sys
from dataclasses import asdict
from pathlib import Path

import rounds
import runs
import solvers

DEFAULT_SOLVERS = ("covis,ceres:given,ceres:tree,gtsam:gn:given,gtsam:gn:tree,gtsam:gn:chordal,"
                   "gtsam:lm:given,gtsam:lm:tree,gtsam:lm:chordal")
DEFAULT_INCREMENTAL = "covis,isam2,isam2:0.01"
HEAD = ("| file | solver | from | threads | start cost | final cost | iterations | ms/iteration | T (s) | ratio "
        "| peak (MB) |")
INCREMENTAL_HEAD = ("| file | solver | threads | steps | median (ms) | p99 (ms) | longest (ms) | all (s) | final cost "
                    "| above the best | ratio median, p99 |")


def arguments() -> argparse.Namespace:
    text = f"{__doc__}\nsolvers:\n{solvers.POSE_GRAPH}\n\nsolvers with --incremental:\n{solvers.INCREMENTAL}"
    parser = argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="+", metavar="FILE", help="g2o files, SE2 or SE3")
    parser.add_argument("--incremental", action="store_true", help="vertex by vertex")
    parser.add_argument("--solvers", help=f"default: {DEFAULT_SOLVERS}; with --incremental {DEFAULT_INCREMENTAL}")
    parser.add_argument("--all", action="store_true", help="a row for every start of a twin")
    parser.add_argument("--threads", default="1,2", help="default: 1,2")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--max-iterations", type=int, default=100)
    parser.add_argument("--within", type=float, default=1e-3, help="how close to the best cost T asks for (1e-3)")
    parser.add_argument("--timeout", type=float, default=600.0, help="seconds a run may take")
    parser.add_argument("--covis", default=solvers.Programs.covis, metavar="BINARY")
    parser.add_argument("--ceres", default=solvers.Programs.ceres, metavar="FOLDER",
                        help=f"where its twins are (default: {solvers.Programs.ceres})")
    parser.add_argument("--json", metavar="PATH", help="write every trace here")
    parser.add_argument("--plot", default="target/reference/plots", metavar="FOLDER",
                        help="where a picture a file goes (default: target/reference/plots)")
    parser.add_argument("--no-plot", dest="plot", action="store_const", const="")
    parser.add_argument("--format", choices=["png", "svg"], default="png", help="of the pictures")
    options = parser.parse_args()
    default = DEFAULT_INCREMENTAL if options.incremental else DEFAULT_SOLVERS
    options.solvers = (options.solvers or default).split(",")
    try:
        options.threads = [int(count) for count in options.threads.split(",")]
        for solver in options.solvers:
            (solvers.check_incremental if options.incremental else solvers.check_pose_graph)(solver)
    except ValueError as error:
        parser.error(str(error))
    return options


def measure(size: dict, options: argparse.Namespace, settings: solvers.Settings) -> list[list[runs.Run]]:
    """All runs on a file."""
    file = size["file"]

    def execute(solver: str, threads: int, out: str) -> runs.Run:
        make = solvers.incremental if options.incremental else solvers.pose_graph
        return runs.run(solver, threads, make(solver, file, threads, out, settings), out, settings.timeout_s)

    def verify(run: runs.Run, out: str) -> str:
        wrong = verify_steps(run, size) if options.incremental else verify_start(run, size)
        return wrong or rounds.verify_end(run, "g2o.py", file, "--poses", out)

    # A file of edges only gives nobody a start.
    names = [solver for solver in options.solvers
             if size["cost"] is not None or solvers.split_start(solver)[1] != "given"]
    cases = [(threads, solver) for threads in options.threads for solver in names]
    return rounds.measure(cases, options.rounds, execute, verify)


def verify_start(run: runs.Run, size: dict) -> str:
    """Whether a run from the file's vertices starts at their cost."""
    if run.document.get("init") == "given" and not rounds.is_close(run.start, size["cost"]):
        return f"another objective: starts at {run.start:.6e}, the file costs {size['cost']:.6e}"
    return ""


def verify_steps(run: runs.Run, size: dict) -> str:
    """Whether the facts about the steps are there and fit the trace."""
    steps = run.document.get("incremental", {})
    if any(key not in steps for key in ("steps", "median_ms", "p99_ms", "max_ms", "final_cost")):
        return "no times of steps"
    if steps["steps"] != size["vertices"] or run.rows[-1]["iteration"] != size["vertices"]:
        return f"{steps['steps']} steps for {size['vertices']} vertices"
    # At least half of the steps take the median or more.
    if 0.5e-3 * steps["steps"] * steps["median_ms"] > run.rows[-1]["seconds"] + 1e-3:
        return "steps that take longer than all of them"
    return ""


def start_of(summary: dict) -> str:
    return summary["init"] or solvers.split_start(summary["solver"])[1]


def best_starts(summaries: list[dict]) -> list[dict]:
    """Of each twin and thread count the start with the least T, or else the lowest cost; all of covis."""
    def rank(summary: dict) -> tuple:
        seconds = summary.get("T")
        return bool(summary["error"]), math.inf if seconds is None else seconds, summary.get("final", math.inf)

    best: dict[tuple, dict] = {}
    for summary in summaries:
        solver = summary["solver"]
        key = (solver if solvers.is_covis(solver) else solvers.split_start(solver)[0], summary["threads"])
        if key not in best or rank(summary) < rank(best[key]):
            best[key] = summary
    return list(best.values())


def solved(size: dict, measured: list[list[runs.Run]], options: argparse.Namespace) -> list[dict]:
    """Prints the rows of a file and returns all summaries."""
    summaries = rounds.summarize(size["file"], measured, options.within)
    for summary, case in zip(summaries, measured):
        summary["init"] = case[0].document.get("init", "")
    for summary in summaries if options.all else best_starts(summaries):
        method = solvers.split_start(summary["solver"])[0]
        row = [rounds.name(size["file"]), method, start_of(summary), str(summary["threads"])]
        row += rounds.cells(summary, runs.own_peak_memory_mb())
        print(f"| {' | '.join(row)} |", flush=True)
    return summaries


def excess(run: runs.Run, lowest: dict[int, float]) -> float:
    """The largest relative excess of a trace over the lowest cost at the same number of vertices."""
    floor = 1e-2 * lowest[max(lowest)]
    pairs = [(row["cost"], lowest[row["iteration"]]) for row in run.rows if lowest.get(row["iteration"], 0.0) > floor]
    return max((cost / best - 1.0 for cost, best in pairs), default=0.0)


def grown(size: dict, measured: list[list[runs.Run]]) -> list[dict]:
    """Prints the rows of a file that grew and returns all summaries."""
    lowest: dict[int, float] = {}
    for case in measured:
        for row in case[0].rows if not case[0].error else []:
            lowest[row["iteration"]] = min(row["cost"], lowest.get(row["iteration"], math.inf))
    summaries = []
    for case in measured:
        first = case[0]
        summary = {"file": size["file"], "solver": first.solver, "threads": first.threads, "error": first.error}
        if not first.error:
            summary |= {key: statistics.median(run.document["incremental"][key] for run in case)
                        for key in ("median_ms", "p99_ms", "max_ms")}
            summary |= {"steps": size["vertices"], "final": first.final, "excess": excess(first, lowest),
                        "seconds": statistics.median(run.rows[-1]["seconds"] for run in case)}
        summaries.append(summary)
    for summary in summaries:
        row = [rounds.name(size["file"]), summary["solver"], str(summary["threads"])]
        if summary["error"]:
            row += [""] * 7 + [summary["error"]]
        else:
            twins = [s for s in summaries if not s["error"] and s["threads"] == summary["threads"]
                     and not solvers.is_covis(s["solver"])]
            summary["ratio"] = [summary[key] / min(twin[key] for twin in twins) if twins else None
                                for key in ("median_ms", "p99_ms")]
            row += [str(summary["steps"]), *(f"{summary[key]:.3f}" for key in ("median_ms", "p99_ms", "max_ms")),
                    f"{summary['seconds']:.3f}", f"{summary['final']:.9e}", f"{100.0 * summary['excess']:.3f} %",
                    ", ".join(f"{ratio:.3f}" for ratio in summary["ratio"] if ratio is not None)]
        print(f"| {' | '.join(row)} |", flush=True)
    return summaries


def main() -> int:
    options = arguments()
    programs = solvers.Programs(options.covis, options.ceres)
    settings = solvers.Settings(programs, options.max_iterations, timeout_s=options.timeout)
    machine = runs.machine()
    what = "" if options.incremental else f", T to within {options.within:g} of the best cost"
    head = INCREMENTAL_HEAD if options.incremental else HEAD
    print(f"{runs.describe(machine)}.\n{options.rounds} rounds{what}.\n\n{head}\n{rounds.rule(head)}", flush=True)
    record = {"machine": machine, "options": vars(options), "files": []}
    failed = False
    for file in options.files:
        try:
            size = runs.facts("g2o.py", file)
        except ValueError as error:
            sys.exit(f"error: {error}")
        measured = measure(size, options, settings)
        summaries = grown(size, measured) if options.incremental else solved(size, measured, options)
        failed |= any(solvers.is_covis(summary["solver"]) and summary["error"] for summary in summaries)
        traces = [asdict(run) for case in measured for run in case]
        record["files"].append({**size, "summaries": summaries, "runs": traces})
    if options.json:
        Path(options.json).write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
    rounds.print_blas(record["files"])
    if options.plot:
        drawn = record["files"] if options.incremental else [shown(entry, options.all) for entry in record["files"]]
        rounds.draw(drawn, options.plot, options.format, options.incremental)
    return 1 if failed else 0


def shown(entry: dict, every: bool) -> dict:
    """An entry with the runs that its table shows."""
    summaries = entry["summaries"] if every else best_starts(entry["summaries"])
    names = {(summary["solver"], summary["threads"]) for summary in summaries}
    return entry | {"runs": [run for run in entry["runs"] if (run["solver"], run["threads"]) in names]}


if __name__ == "__main__":
    sys.exit(main())
