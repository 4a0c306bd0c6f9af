"""RPE per second of trajectory pairs, by the functions of TUM's own evaluate_rpe.py, at full precision.

usage: tum_goldens.py FOLDER [DATA]      (FOLDER holds evaluate_rpe.py of the TUM RGB-D benchmark's tools, for Python 3)
Writes tests/golden/tum/*.json; run it from the project's root. Each record names the command that prints the same, rounded.
Needs: numpy
"""
import json
import os
import sys

import numpy

sys.path.insert(0, sys.argv[1])
import evaluate_rpe  # noqa: E402

DATA = sys.argv[2] if len(sys.argv) > 2 else "../shared/data"
HERE = "tests/golden"
PAIRS = [  # name, folder, truth, estimate, deltas in seconds
    ("fr2_desk_ORB", "data", "fr2_desk_groundtruth.txt", "fr2_desk_ORB.txt", (1.0, 0.25)),
    ("freiburg1_xyz-rgbdslam", "data", "freiburg1_xyz-groundtruth.txt", "freiburg1_xyz-rgbdslam.txt", (1.0,)),
    ("walk", "twins", "walk-truth.txt", "walk-estimate.txt", (1.0, 0.5)),
    ("walk-swapped", "twins", "walk-estimate.txt", "walk-truth.txt", (1.0,)),
]


def statistics(errors):
    e = numpy.array(errors)
    return {"rmse": float(numpy.sqrt(numpy.dot(e, e) / len(e))), "mean": float(e.mean()), "median": float(numpy.median(e)),
            "std": float(e.std()), "min": float(e.min()), "max": float(e.max())}


for name, where, truth, estimate, deltas in PAIRS:
    folder = f"{DATA}/trajectories" if where == "data" else f"{HERE}/twins"
    a, b = (evaluate_rpe.read_trajectory(os.path.join(folder, f)) for f in (truth, estimate))
    for delta in deltas:
        rows = evaluate_rpe.evaluate_trajectory(a, b, 0, True, delta, "s")
        record = {
            "peer": "evaluate_rpe.py of the TUM RGB-D benchmark", "truth": truth, "estimate": estimate, "delta_s": delta,
            "command": f"evaluate_rpe.py {truth} {estimate} --fixed_delta --delta {delta} --delta_unit s --max_pairs 0 --verbose",
            "pairs": len(rows),
            "translation_m": statistics([r[4] for r in rows]), "angle_deg": statistics(numpy.degrees([r[5] for r in rows])),
        }
        path = f"{HERE}/tum/{name}-{delta:g}s.json"
        with open(path, "w") as out:
            out.write(json.dumps(record, indent=2) + "\n")
        print(path, len(rows), record["translation_m"]["rmse"], record["angle_deg"]["rmse"])
