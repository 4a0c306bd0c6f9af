#!/usr/bin/env python3
"""Runs Ceres, GTSAM and evo over every problem that the tests know and writes one JSON file a run beside this file.

usage, from the project's root: python3 tests/golden/record.py [ceres|gtsam|graphs|landmarks|ranges|evo|sweeps|table …]     (default: all)
`graphs` is the part of `gtsam` that solves pose graphs, `landmarks` that of graphs with landmarks, `ranges` that of graphs with ranges, `sweeps` the part of `evo` that sweeps its options.
Needs: numpy, gtsam and evo (pip); the Ceres harness built into target/ceres, see ../shared/peers/README.md.
`table` only prints README.md's table from what is there. Costs are printed with 13 digits by the peers;
`evaluated_cost` is the independent evaluator's, with 17 digits, for the solution that the peer wrote, where it can write one.
"""
import importlib.metadata
import json
import os
import shlex
import subprocess
import sys

here = os.path.dirname(os.path.abspath(__file__))
root = os.getcwd()
PEERS, DATA, TWINS = "../shared/peers", "../shared/data", "tests/golden/twins"
OUT = "target/golden.g2o"

GRAPH = ("1/2 sum r' Omega r over all edges, r = Log(Z^-1 Xi^-1 Xj) in the full group logarithm, translation first, "
         "lowest vertex id fixed, no loss (DESIGN section 3).")
LANDMARKS = ("1/2 sum r' Omega r: edges as in GRAPH, Log(Z^-1 X S) of priors on poses with their sensor S, S^-1 X^-1 p - z of "
             "landmarks by position, the angle between of those by bearing, differences in the world of priors on positions, no loss.")
RANGES = ("1/2 sum r' S^-1 r with the covariances S of the file: edges as in GRAPH, Log(Z^-1 X) of priors on poses, X^-1 p - z of "
          "landmarks by position, p - z of priors on landmarks, |a - b| - z of ranges; without priors the first pose is fixed, no loss.")
BUNDLE = ("1/2 sum ||predicted - measured||^2 in px^2 over all observations, those behind a camera included, no loss; "
          "9 unknowns a camera (pose, f, k1, k2), free gauge (DESIGN section 3).")
FIXED = ("1/2 sum ||predicted - measured||^2 in px^2 over all observations, those behind a camera included, no loss; "
         "f, k1, k2 fixed at the file's values, free gauge (DESIGN section 3).")
BEHIND = (" GTSAM leaves an observation out while its point is behind the camera (zero residual): comparable only where none "
          "is behind, as `same_objective_at_start` says for the file's start.")
ROOM = ("1/2 sum ||predicted - measured||^2 in px^2 over all observations of a 3D point, no loss, intrinsics fixed, "
        "first image in natural order of names fixed (DESIGN section 3).")


def run(command):
    env = dict(os.environ, OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1")
    p = subprocess.run(shlex.split(command), cwd=root, env=env, capture_output=True, text=True)
    if p.returncode:
        sys.exit(f"{command}\n{p.stderr[-800:]}")
    return p.stdout.splitlines(), p.stderr


def evaluate(*files):
    sys.path.insert(0, os.path.join(root, PEERS))
    import evaluate as peer
    files = [os.path.join(root, f) for f in files]
    return peer.g2o(*files) if files[0].endswith(".g2o") else peer.bal(files[0])


def ceres_version():
    try:
        v = subprocess.run(["dpkg-query", "-W", "-f", "${Version}", "libceres-dev"], capture_output=True, text=True).stdout
    except OSError:
        v = ""
    return f"Ceres {v or '(version unknown)'}"


def write(folder, name, record):
    os.makedirs(os.path.join(here, folder), exist_ok=True)
    with open(os.path.join(here, folder, name + ".json"), "w") as f:
        json.dump(record, f, indent=2)
        f.write("\n")
    print(folder, name, record.get("final_cost", record.get("matched_pairs")), flush=True)


def solve(peer, file, variant, objective, command, out=False, **more):
    """One run: its trace's ends, and what the independent evaluator finds."""
    lines, errors = run(command)
    first = next(l for l in lines if l.startswith("0 ")).split()
    final = next(l for l in lines if l.startswith("FINAL")).split()
    stem = os.path.splitext(os.path.basename(file))[0]
    record = {"peer": peer, "problem": os.path.basename(file), "variant": variant, "objective": objective,
              "command": command, "initial_cost": float(first[1]), "final_cost": float(final[1]), "iterations": int(final[2])}
    if "tolerance" in errors:
        record["termination"] = errors.strip().rsplit("s: ", 1)[-1]
    if out:
        record["evaluated_cost"] = evaluate(file, OUT)
        gap = abs(record["evaluated_cost"] - record["final_cost"]) / record["final_cost"]
        if gap > 1e-9:
            sys.exit(f"{command}: says {record['final_cost']}, its file costs {record['evaluated_cost']}")
    # What is read from the peer's solution is read now.
    record.update({key: value() if callable(value) else value for key, value in more.items()})
    write(peer.split()[0].lower(), f"{stem}-{variant}", record)


BAL = [f"{DATA}/bal/{n}.txt" for n in ("ladybug-49-7776", "trafalgar-21-11315", "dubrovnik-3-7")] + [f"{TWINS}/window-6-80.txt"]
GRAPHS_3D = [f"{DATA}/pose_graph/{n}.g2o" for n in ("sphere2500", "parking-garage", "torus3D", "smallGrid3D", "tinyGrid3D")] + [f"{TWINS}/sphere-200.g2o"]
GRAPHS_2D = [f"{DATA}/pose_graph/{n}.g2o" for n in ("M3500", "city10000", "intel", "kitti_00", "CSAIL")] + [
    f"{TWINS}/grid-200.g2o", f"{TWINS}/grid-100-edges.g2o"]


def ceres():
    peer = ceres_version()
    for file in BAL:
        start = evaluate(file)
        solve(peer, file, "full", BUNDLE, f"target/ceres/bal {file} dense_schur 1 500 0", evaluated_initial_cost=start)
        solve(peer, file, "fixed-intrinsics", FIXED, f"target/ceres/bal {file} dense_schur 1 500 0 --fix-intrinsics",
              evaluated_initial_cost=start)
    for file in GRAPHS_3D:
        solve(peer, file, "file-start", GRAPH, f"target/ceres/pose_graph {file} 1 500 {OUT}", True)


def some_poses(path):
    """First vertex, quarters and last of a solution, by id: x y theta, or x y z qx qy qz qw."""
    vertices = [l.split() for l in open(os.path.join(root, path)) if l.startswith("VERTEX")]
    count = len(vertices)
    return {vertices[k][1]: [float(x) for x in vertices[k][2:]]
            for k in (0, count // 4, count // 2, 3 * count // 4, count - 1)}


def graphs():
    peer = "GTSAM " + importlib.metadata.version("gtsam")
    for file in GRAPHS_3D + GRAPHS_2D:
        edges_only = not any(l.startswith("VERTEX") for l in open(os.path.join(root, file)))
        start = "chordal" if "torus3D" in file else "odometry" if edges_only else "file"
        command = f"python3 {PEERS}/gtsam_pose_graph.py {file} 100 gn --start {start} --out {OUT}"
        solve(peer, file, f"{start}-start", GRAPH, command, True, poses=lambda: some_poses(OUT))


def landmarks():
    peer = "GTSAM " + importlib.metadata.version("gtsam")
    for file in (f"{TWINS}/park-80.g2o", f"{TWINS}/hall-60.g2o"):
        command = f"python3 tests/golden/gtsam_landmarks.py {file} 50 {OUT}"
        solve(peer, file, "file-start", LANDMARKS, command, poses=lambda: some_poses(OUT))


def ranges():
    """Of Plaza1 the tests of the solvers write the file."""
    peer = "GTSAM " + importlib.metadata.version("gtsam")
    for file in (f"{TWINS}/fleet-2d.pyfg", f"{TWINS}/fleet-3d.pyfg", "target/tmp/plaza1.pyfg"):
        command = f"python3 tests/golden/gtsam_pyfg.py {file} 200 {OUT}"
        solve(peer, file, "file-start", RANGES, command, poses=lambda: some_poses(OUT))


def gtsam():
    graphs()
    landmarks()
    ranges()
    peer = "GTSAM " + importlib.metadata.version("gtsam")
    for file in BAL:
        lines, _ = run(f"python3 {PEERS}/gtsam_bal.py {file} 1")
        start = evaluate(file)
        same = abs(float(lines[0].split()[1]) - start) <= 1e-9 * start
        solve(peer, file, "full", BUNDLE + BEHIND, f"python3 {PEERS}/gtsam_bal.py {file} 200",
              evaluated_initial_cost=start, same_objective_at_start=same)
    for folder in (f"{DATA}/colmap/room50", f"{TWINS}/colmap-room"):
        command = f"python3 tests/golden/gtsam_colmap.py {folder} 100"
        lines, _ = run(command)
        _, before, after, count = next(l for l in lines if l.startswith("EVALUATED")).split()
        rmse = lambda c: (2 * float(c) / int(count)) ** 0.5
        solve(peer, folder, "fixed-intrinsics", ROOM, command, evaluated_initial_cost=float(before), evaluated_cost=float(after),
              observations=int(count), rmse_px_before=rmse(before), rmse_px_after=rmse(after))


def evo():
    import evo_goldens
    for name, record in evo_goldens.records(root, DATA, TWINS):
        write("evo", name, record)
    sweeps()


def sweeps():
    """A case's statistics are on one line a relation: indented they would be a line a number."""
    import evo_goldens
    for name, record in evo_goldens.sweeps(root, DATA, TWINS):
        cases = record.pop("cases")
        text = json.dumps(record, indent=2)[:-2] + ',\n  "cases": ['
        for n, case in enumerate(cases):
            relations = case.pop("relations")
            lines = ",\n".join(f"      {json.dumps(k)}: {json.dumps(v)}" for k, v in relations.items())
            text += f"{',' if n else ''}\n    {json.dumps(case)[:-1]}, \"relations\": {{\n{lines}\n    }}}}"
        os.makedirs(os.path.join(here, "evo_sweeps"), exist_ok=True)
        with open(os.path.join(here, "evo_sweeps", name + ".json"), "w") as f:
            f.write(text + "\n  ]\n}\n")
        print("evo_sweeps", name, len(cases), flush=True)


def table():
    print("| golden | start | final cost | iterations | evaluated |\n|---|---|---|---|---|")
    for folder in ("ceres", "gtsam"):
        for n in sorted(os.listdir(os.path.join(here, folder))):
            r = json.load(open(os.path.join(here, folder, n)))
            print(f"| {folder}/{n} | {r['initial_cost']:.9g} | {r['final_cost']:.12e} | {r['iterations']} | "
                  f"{r['evaluated_cost']:.12e} |" if "evaluated_cost" in r else
                  f"| {folder}/{n} | {r['initial_cost']:.9g} | {r['final_cost']:.12e} | {r['iterations']} | |")
    print("\n| golden | pairs | rmse | max |\n|---|---|---|---|")
    for n in sorted(os.listdir(os.path.join(here, "evo"))):
        if n.endswith(".json"):
            r = json.load(open(os.path.join(here, "evo", n)))
            print(f"| evo/{n} | {r['matched_pairs']} | {r['statistics']['rmse']!r} | {r['statistics']['max']!r} |")


if __name__ == "__main__":
    sys.path.insert(0, here)
    for what in sys.argv[1:] or ["ceres", "gtsam", "evo", "table"]:
        {"ceres": ceres, "gtsam": gtsam, "graphs": graphs, "landmarks": landmarks, "ranges": ranges, "evo": evo, "sweeps": sweeps,
         "table": table}[what]()
