"""evo's APE and RPE of trajectory pairs at full double precision, through evo's own functions.

Called by record.py. Each record names the command that prints the same numbers (rounded): `records` of evo's defaults,
`sweeps` of alignments, deltas and all pose relations.
Needs: numpy, evo
"""
import importlib.metadata
import os

import numpy as np
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


SWEPT = [  # name, folder, truth, estimate
    PAIRS[0],
    PAIRS[1],
    PAIRS[2],
    ("mono", "twins", "mono-truth.txt", "mono-estimate.txt"),
]
ALL_RELATIONS = {
    "trans_part": metrics.PoseRelation.translation_part,
    "rot_part": metrics.PoseRelation.rotation_part,
    "full": metrics.PoseRelation.full_transformation,
    "angle_deg": metrics.PoseRelation.rotation_angle_deg,
    "angle_rad": metrics.PoseRelation.rotation_angle_rad,
    "point_distance": metrics.PoseRelation.point_distance,
    "point_distance_error_ratio": metrics.PoseRelation.point_distance_error_ratio,
}
UNITS = {"f": metrics.Unit.frames, "m": metrics.Unit.meters, "d": metrics.Unit.degrees, "r": metrics.Unit.radians}
ALIGNMENTS = {  # covis' name: evo's arguments, evo's flags
    "se3": ({"align": True}, "-a"),
    "sim3": ({"align": True, "correct_scale": True}, "-as"),
    "scale": ({"correct_scale": True}, "-s"),
    "none": ({}, ""),
    "origin": ({"align_origin": True}, "--align_origin"),
}
FIGURES = ["rmse", "mean", "median", "std", "min", "max", "sse"]
DELTAS = [(1, "f"), (5, "f"), (0.5, "m"), (15, "d"), (0.3, "r")]


def cases(is_small):
    """Metric, alignment, poses to align, and for RPE: delta, unit, all pairs, tolerance, pairs from the reference."""
    for align in ALIGNMENTS:
        yield "ape", align, None, None
    if not is_small:
        for delta, unit in DELTAS:
            yield "rpe", "none", None, (delta, unit, False, None, False)
            yield "rpe", "sim3", None, (delta, unit, False, None, False)
            # All pairs by angle take the square of the poses.
            yield "rpe", "none" if unit == "d" else "sim3", None, (delta, unit, unit != "r", None, False)
        yield "rpe", "sim3", 100, (0.5, "m", True, 0.02, True)
        return
    for align in ("se3", "sim3", "scale"):
        yield "ape", align, 12, None
    for all_pairs in (False, True):
        for align in ("none", "sim3", "scale"):
            for delta, unit in DELTAS:
                yield "rpe", align, None, (delta, unit, all_pairs, None, False)
        for align in ("se3", "origin"):
            yield "rpe", align, None, (0.5, "m", all_pairs, None, False)
        yield "rpe", "sim3", 12, (0.5, "m", all_pairs, None, False)
        yield "rpe", "none", None, (0.5, "m", all_pairs, None, True)
        yield "rpe", "none", None, (15, "d", all_pairs, None, True)
    yield "rpe", "sim3", None, (0.5, "m", True, 0.02, False)
    yield "rpe", "none", None, (15, "d", True, 0.3, False)


def sweeps(root, data, twins):
    """One record a pair of trajectories; `arguments` of a case are covis', `command` is evo's."""
    version = "evo " + importlib.metadata.version("evo")
    for name, where, truth, estimate in SWEPT:
        folder = f"{data}/trajectories" if where == "data" else twins
        files = [os.path.join(root, folder, f) for f in (truth, estimate)]
        read = [file_interface.read_tum_trajectory_file(f) for f in files]
        record = {"peer": version, "truth": truth, "estimate": estimate, "figures": ["values", *FIGURES], "cases": []}
        for metric, align, first, motion in cases(where == "twins"):
            options, flags = ALIGNMENTS[align]
            options, arguments = dict(options), f"eval {metric} --align {align}"
            command = f"evo_{metric} tum {folder}/{truth} {folder}/{estimate} --t_max_diff 0.01 {flags}"
            if first is not None:
                options["n_to_align"] = first
                arguments += f" --n-to-align {first}"
                command += f" --n_to_align {first}"
            if motion is not None:
                delta, unit, all_pairs, tolerance, from_reference = motion
                options.update(delta=float(delta), delta_unit=UNITS[unit], all_pairs=all_pairs,
                               pairs_from_reference=from_reference)
                both = " --all{}pairs" if all_pairs else ""
                if tolerance is not None:
                    options["rel_delta_tol"] = tolerance
                    both += " --delta{}tol " + str(tolerance)
                if from_reference:
                    both += " --pairs{}from{}reference"
                arguments += f" --delta {delta} --delta-unit {unit}" + both.replace("{}", "-")
                command += f" --delta {delta} --delta_unit {unit}" + both.replace("{}", "_")
            relations = {}
            for short, relation in ALL_RELATIONS.items():
                if metric == "ape" and short == "point_distance_error_ratio":
                    continue
                a, b = sync.associate_trajectories(*read, max_diff=0.01)
                result = (ape if metric == "ape" else rpe)(a, b, relation, **options)
                values = int(len(result.np_arrays["error_array"]))
                relations[short] = [values, *(float(result.stats[figure]) for figure in FIGURES)]
            case = {"arguments": arguments, "command": command.replace("  ", " ").strip(), "relations": relations}
            if "correct_scale" in options:
                m = result.np_arrays["alignment_transformation_sim3"]
                case["scale"] = float(np.cbrt(np.linalg.det(m[:3, :3])))
            record["cases"].append(case)
        yield name, record
