"""Fusion by covis beside fusion by Open3D's VoxelBlockGrid: the same frames, poses and voxels, in turns.

usage: dense.py SEQUENCE POSES.txt --peer open3d_fusion.py [--voxels 0.02,0.01,0.005] [--threads 2,1]
                [--rounds 3] [--covis target/release/covis] [--python python3] [--camera fx,fy,cx,cy]

Each round runs both programs; of the rounds the one with the least p50 counts. Milliseconds are of
block allocation and integration, images decoded; `mesh` is the extraction of the whole surface. Prints a row
for voxel size and threads, with covis over Open3D. Needs what the peer needs: pip install open3d scipy
"""
import argparse
import json
import os
import re
import subprocess
import tempfile


def covis(args, voxel, threads, out):
    command = [args.covis, "--log", "error", "fuse", f"tum:{args.sequence}", "--poses", args.poses, "--voxel", str(voxel),
               "--truncation-voxels", "8", "--max-depth", "4", "--threads", str(threads), "--out", out, "--json",
               "--camera", args.camera]
    document = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    integrate, extract = document["stages"]["integrate"], document["stages"]["extract"]
    return integrate["p50_ms"], integrate["p99_ms"], extract["p50_ms"] * 1e-3, document["mesh"]["triangles"]


def open3d(args, voxel, threads):
    command = [args.python, args.peer, args.sequence, args.poses, str(voxel), "--intrinsics", args.camera]
    environment = dict(os.environ, OMP_NUM_THREADS=str(threads), TBB_NUM_THREADS=str(threads))
    if threads == 1:
        command = ["taskset", "-c", "0"] + command
    text = subprocess.run(command, check=True, capture_output=True, text=True, env=environment).stdout
    found = re.search(r"p50_ms (\S+) p99_ms (\S+) .*triangles (\d+) extract_s (\S+)", text)
    p50, p99, triangles, extract = found.groups()
    return float(p50), float(p99), float(extract), int(triangles)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("sequence")
    parser.add_argument("poses")
    parser.add_argument("--peer", required=True)
    parser.add_argument("--voxels", default="0.02,0.01,0.005")
    parser.add_argument("--threads", default="2,1")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--covis", default="target/release/covis")
    parser.add_argument("--python", default="python3")
    parser.add_argument("--camera", default="517.3,516.5,318.6,255.3")
    args = parser.parse_args()
    print("| voxel | threads | covis p50 / p99 ms | Open3D p50 / p99 ms | ratio | covis mesh s | Open3D mesh s | ratio | triangles |")
    print("|---|---|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as out:
        for threads in map(int, args.threads.split(",")):
            for voxel in map(float, args.voxels.split(",")):
                ours, theirs = [], []
                for _ in range(args.rounds):
                    ours.append(covis(args, voxel, threads, out))
                    theirs.append(open3d(args, voxel, threads))
                (a50, a99, am, at), (b50, b99, bm, bt) = min(ours), min(theirs)
                am, bm = min(row[2] for row in ours), min(row[2] for row in theirs)
                print(f"| {voxel:g} m | {threads} | {a50:.2f} / {a99:.2f} | {b50:.2f} / {b99:.2f} | {a50 / b50:.2f} / {a99 / b99:.2f} "
                      f"| {am:.3f} | {bm:.3f} | {am / bm:.2f} | {at} / {bt} |", flush=True)


if __name__ == "__main__":
    main()
