"""The problem of problem.py by alula: the example `peer_problem` reads problems and writes answers, line by line."""

import subprocess

import numpy as np

import problem as ocp
from problem import INPUTS, INTERVALS


class Alula:
    """Keeps the program running; it warm starts by itself and begins anew at another seed or at step 0."""

    def __init__(self, program):
        self.process = subprocess.Popen(
            [program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
        )
        self.columns = None

    def solve(self, problem):
        row = problem.row()
        if self.columns is None:
            self.process.stdin.write(",".join(ocp.header()) + "\n")
        self.process.stdin.write(f"{row[0]},{row[1]}," + ",".join(f"{x:.17g}" for x in row[2:]) + "\n")
        self.process.stdin.flush()
        if self.columns is None:
            self.columns = self.read()
        answer = dict(zip(self.columns, self.read(), strict=True))
        if (int(answer["seed"]), int(answer["step"])) != (problem.seed, problem.step):
            raise RuntimeError(f"the program answered another problem: {answer}")
        inputs = [[float(answer[f"u{k}_{i}"]) for i in range(INPUTS)] for k in range(INTERVALS)]
        return ocp.Solution(
            np.array(inputs),
            1e-6 * float(answer["cpu_us"]),
            int(answer["sqp_iterations"]),
            int(answer["qp_iterations"]),
            answer["exit"] == "converged",
            answer["exit"],
            float(answer["cost"]),
        )

    def read(self):
        line = self.process.stdout.readline()
        if not line:
            raise RuntimeError(f"the program ended with {self.process.wait()}")
        return line.strip().split(",")
