"""Generates three pairs of trajectories, runs `evo_ape`, `evo_rpe` and alula's `metrics` example on
each, and prints the differences. Ends 1 if one is above 1e-6. Called by evo.sh."""

import argparse
import csv
import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

LIMIT = 1e-6
STATISTICS = ("rmse", "mean", "median", "max", "min")
# Our figure, evo's program, its pose relation.
FIGURES = (
    ("ape_trans", "evo_ape", "trans_part"),
    ("ape_angle_rad", "evo_ape", "angle_rad"),
    ("rpe_trans", "evo_rpe", "trans_part"),
    ("rpe_angle_rad", "evo_rpe", "angle_rad"),
)
EVO_ALIGN = {"none": [], "origin": ["--align_origin"], "rigid": ["-a"], "similarity": ["-as"]}


def write(path, times, positions, rotations):
    """TUM format; rotations are scipy's (x, y, z, w last as TUM has it)."""
    with open(path, "w") as file:
        for t, p, q in zip(times, positions, rotations.as_quat()):
            numbers = " ".join(f"{x:.12f}" for x in (*p, *q))
            file.write(f"{t:.9f} {numbers}\n")


def disturbed(rng, positions, rotations, position_sigma, angle_sigma):
    steps = rng.normal(0.0, position_sigma, positions.shape)
    turns = Rotation.from_rotvec(rng.normal(0.0, angle_sigma, positions.shape))
    return positions + np.cumsum(steps, axis=0), rotations * turns


def flight(seconds, rate):
    """A made-up flight: a drifting knot with all angles moving."""
    t = np.arange(0.0, seconds, 1.0 / rate)
    positions = np.stack(
        [3 * np.sin(0.5 * t), 2 * np.sin(0.8 * t + 1), 1.5 + 0.5 * np.cos(0.3 * t)], axis=1
    )
    angles = np.stack([0.4 * t, 0.2 * np.sin(t), 0.3 * np.cos(0.7 * t)], axis=1)
    return t, positions, Rotation.from_euler("zyx", angles)


def euroc(folder):
    path = Path(folder) / "euroc_v1_01/mav0/state_groundtruth_estimate0/data.csv"
    with open(path) as file:
        rows = [row for row in csv.reader(file) if row and not row[0].startswith("#")]
    times = np.array([int(row[0]) for row in rows]) * 1e-9
    values = np.array([[float(x) for x in row[1:8]] for row in rows])
    return times, values[:, :3], Rotation.from_quat(values[:, [4, 5, 6, 3]])


def pairs(work):
    """Yields name, reference, estimate, alignment, frames between the ends of relative errors."""
    rng = np.random.default_rng(1)
    data = os.environ.get("ALULA_DATA")
    times, positions, rotations = euroc(data) if data else flight(140.0, 20.0)
    name = "euroc thinned and noisy" if data else "long flight thinned and noisy"
    reference, estimate = work / "a_ref.tum", work / "a_est.tum"
    write(reference, times, positions, rotations)
    keep = np.arange(3, len(times), 2)
    noisy = disturbed(rng, positions[keep], rotations[keep], 0.003, 0.01)
    write(estimate, times[keep] + rng.uniform(-0.004, 0.004, len(keep)), *noisy)
    yield name, reference, estimate, "none", 10

    times, positions, rotations = flight(60.0, 50.0)
    reference, estimate = work / "b_ref.tum", work / "b_est.tum"
    write(reference, times, positions, rotations)
    motion = Rotation.from_euler("zyx", [1.0, -0.3, 0.4])
    moved = motion.apply(positions) + [5.0, -2.0, 1.0], motion * rotations
    write(estimate, times, *disturbed(rng, *moved, 0.002, 0.02))
    yield "synthetic, rotated and shifted", reference, estimate, "rigid", 25

    reference, estimate = work / "c_ref.tum", work / "c_est.tum"
    write(reference, times, positions, rotations)
    scaled = 1.3 * (motion.apply(positions) + [5.0, -2.0, 1.0]), motion * rotations
    write(estimate, times, *disturbed(rng, *scaled, 0.001, 0.01))
    yield "synthetic with scale 1.3", reference, estimate, "similarity", 1
    yield "the same, first poses aligned", reference, estimate, "origin", 7


def evo(program, relation, reference, estimate, alignment, frames, work):
    result = work / "result.zip"
    result.unlink(missing_ok=True)
    command = [Path(sys.executable).parent / program, "tum", reference, estimate]
    command += ["-r", relation, "--save_results", result, "--no_warnings", *EVO_ALIGN[alignment]]
    if program == "evo_rpe":
        command += ["--delta", str(frames), "--delta_unit", "f"]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    with zipfile.ZipFile(result) as archive:
        return json.loads(archive.read("stats.json"))


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--metrics", type=Path, required=True)
    parser.add_argument("--work", type=Path, required=True)
    arguments = parser.parse_args()
    worst = 0.0
    for name, reference, estimate, alignment, frames in pairs(arguments.work):
        command = [arguments.metrics, reference, estimate, "--align", alignment]
        output = subprocess.run(
            [*command, "--delta", str(frames)], check=True, capture_output=True, text=True
        ).stdout
        ours = json.loads(output)
        print(f"{name}: {ours['poses']} poses, alignment {alignment}, {frames} frames")
        for figure, program, relation in FIGURES:
            theirs = evo(program, relation, reference, estimate, alignment, frames, arguments.work)
            difference = max(abs(ours[figure][s] - theirs[s]) for s in STATISTICS)
            worst = max(worst, difference)
            print(
                f"  {figure:14} rmse {ours[figure]['rmse']:.9f}, evo {theirs['rmse']:.9f};"
                f" greatest difference of {', '.join(STATISTICS)}: {difference:.1e}"
            )
    print(f"greatest difference {worst:.1e}, allowed {LIMIT:.0e}")
    return 0 if worst <= LIMIT else 1


if __name__ == "__main__":
    sys.exit(main())
