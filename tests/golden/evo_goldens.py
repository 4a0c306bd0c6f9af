"""evo's APE and RPE of trajectory pairs at full double precision, through evo's own functions.

Called by record.py. Each record names the command that prints the same numbers (rounded).
Needs: numpy, evo
"""
import importlib.metadata
import os

from evo.core import metrics, sync
from evo.main_ape import ape
from evo.main_rpe import rpe
from evo.tools import file_interface

PAIRS = [  # name, folder (data or twins), truth, estimate
    ("fr2_desk_ORB", "data", "fr2_desk_groundtruth.txt", "fr2_desk_ORB.txt"),
    ("freiburg1_xyz-rgbdslam", "data", "freiburg1_xyz-groundtruth.txt", "freiburg1_xyz-rgbdslam.txt"),
    ("walk", "twins", "walk-truth.txt", "walk-estimate.txt"),
    ("walk-swapped", "twins", "walk-estimate.txt", "walk-truth.txt"),
]
RELATIONS = {
    "trans_part": (metrics.PoseRelation.translation_part, "m"),
    "angle_deg": (metrics.PoseRelation.rotation_angle_deg, "deg"),
    "rot_part": (metrics.PoseRelation.rotation_part, ""),
}


def matched(truth, estimate):
    a = file_interface.read_tum_trajectory_file(truth)
    b = file_interface.read_tum_trajectory_file(estimate)
    return (a.num_poses, b.num_poses), sync.associate_trajectories(a, b, max_diff=0.01)


def records(root, data, twins):
    version = "evo " + importlib.metadata.version("evo")
    for name, where, truth, estimate in PAIRS:
        folder = f"{data}/trajectories" if where == "data" else twins
        files = [os.path.join(root, folder, f) for f in (truth, estimate)]
        for metric in ("ape", "rpe"):
            for short, (relation, unit) in RELATIONS.items():
                poses, (a, b) = matched(*files)
                stamps = [float(a.timestamps[0]), float(a.timestamps[-1]), float(b.timestamps[0]), float(b.timestamps[-1])]
                pairs = a.num_poses
                record = {"peer": version, "truth": truth, "estimate": estimate, "metric": metric, "pose_relation": short,
                          "unit": unit}
                options = f"tum {folder}/{truth} {folder}/{estimate} -r {short} --t_max_diff 0.01"
                if metric == "ape":
                    record["command"] = f"evo_ape {options} -a"
                    result = ape(a, b, relation, align=True)
                else:
                    record["command"] = f"evo_rpe {options} -d 1 -u f"
                    result = rpe(a, b, relation, delta=1.0, delta_unit=metrics.Unit.frames)
                record["truth_poses"], record["estimate_poses"] = poses
                record["matched_pairs"] = pairs
                record["values"] = int(len(result.np_arrays["error_array"]))
                record["first_and_last_matched_stamps"] = {"truth": stamps[:2], "estimate": stamps[2:]}
                record["statistics"] = {k: float(v) for k, v in result.stats.items()}
                if metric == "ape":
                    m = result.np_arrays["alignment_transformation_sim3"]
                    record["alignment"] = {"rotation": m[:3, :3].tolist(), "translation": m[:3, 3].tolist()}
                yield f"{name}-{metric}-{short}", record
