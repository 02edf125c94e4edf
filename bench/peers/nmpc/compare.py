"""Solves one stream of optimal control problems with acados, CasADi + IPOPT and alula, and compares the answers.

1. IPOPT flies every seed in closed loop; what it was asked goes to problems.csv, the flights and the
   reference answers beside it.
2. Every solver solves that stream, warm started by its own answers. Solvers take turns seed by seed on one
   core, several rounds; the CPU time of a solve is the least of its rounds.
3. Reference of the answers: IPOPT to 1e-9 from its own answer of step 1, that is the same local minimum.
4. acados and alula fly the same seeds in closed loop themselves.

Called by ../nmpc.sh.
"""

import argparse
import csv
import json
import os
from pathlib import Path

import numpy as np

import problem as ocp
from flight import Flight
from problem import Problem
from report import Result, summary, write_report
from with_acados import Acados
from with_alula import Alula
from with_ipopt import Ipopt

REFERENCE_TOLERANCE = 1e-9


def pin_to_one_core():
    """Everything started from here on shares one core."""
    if hasattr(os, "sched_setaffinity"):
        core = max(os.sched_getaffinity(0))
        os.sched_setaffinity(0, {core})


def fly(solver, seed, arguments, evaluator, take=lambda problem, solution: None):
    flight = Flight(seed, arguments.detection, evaluator.step)
    for _ in range(arguments.steps):
        problem = flight.problem()
        solution = solver.solve(problem)
        take(problem, solution)
        flight.advance(solution.inputs[0])
    return {"seed": seed, "min_distance": float(flight.min_distance), "reached_s": flight.reached_s}


def record(ipopt, arguments, evaluator):
    """The flights of IPOPT, what they asked and the reference answers."""
    flights, problems, references = [], [], []
    polisher = Ipopt(REFERENCE_TOLERANCE, iterations=500)

    def take(problem, solution):
        states = evaluator.states(problem.state, solution.inputs)
        problems.append(problem)
        references.append(polisher.polish(problem, states, solution.inputs))

    for seed in range(arguments.seeds):
        flights.append(fly(ipopt, seed, arguments, evaluator, take))
    return flights, problems, references


def write_problems(path, problems):
    with open(path, "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(ocp.header())
        writer.writerows(problem.row() for problem in problems)


def read_problems(path):
    with open(path, newline="") as file:
        rows = csv.reader(file)
        next(rows)
        return [Problem.from_row(row) for row in rows]


def write_record(folder, flights, problems, references):
    write_problems(folder / "problems.csv", problems)
    (folder / "ipopt_flights.json").write_text(json.dumps(flights) + "\n")
    np.save(folder / "references.npy", np.array([r.inputs for r in references]))


def read_record(folder):
    flights = json.loads((folder / "ipopt_flights.json").read_text())
    inputs = np.load(folder / "references.npy")
    references = [ocp.Solution(u, np.nan, 0, 0, True, "read") for u in inputs]
    return flights, read_problems(folder / "problems.csv"), references


def by_seed(problems):
    groups = {}
    for index, problem in enumerate(problems):
        groups.setdefault(problem.seed, []).append(index)
    return groups


def solve_all(solvers, problems, rounds):
    """Name to solutions, solvers taking turns seed by seed."""
    solutions = {name: [None] * len(problems) for name in solvers}
    for turn in range(rounds):
        for indices in by_seed(problems).values():
            for name, solver in solvers.items():
                for index in indices:
                    solution = solver.solve(problems[index])
                    if turn > 0:
                        solution.cpu_s = min(solution.cpu_s, solutions[name][index].cpu_s)
                    solutions[name][index] = solution
        print(f"round {turn + 1} of {rounds} done", flush=True)
    return solutions


def check(alula, evaluator, problems):
    """Largest relative difference between the cost that alula reports and that of the common evaluator."""
    worst = 0.0
    for problem in problems:
        solution = alula.solve(problem)
        cost = evaluator.cost(problem, solution.inputs)
        worst = max(worst, abs(solution.own_cost - cost) / cost)
    return worst


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--alula", help="the program peer_problem; left out: peers alone")
    parser.add_argument("--work", type=Path, required=True, help="folder for generated code and results")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--steps", type=int, default=120)
    parser.add_argument("--detection", type=float, default=2.5, help="range at which obstacles are seen, m")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--again", action="store_true", help="solve what --work has recorded, without IPOPT")
    parser.add_argument("--compiled", action="store_true", help="compile IPOPT's functions")
    return parser.parse_args()


def main():
    given = arguments()
    given.work.mkdir(parents=True, exist_ok=True)
    folder = str(given.work.resolve())
    pin_to_one_core()
    evaluator = ocp.Evaluator()
    solvers = {
        "acados RTI": Acados(folder, real_time=True),
        "acados SQP": Acados(folder, real_time=False),
    }
    if given.alula:
        solvers["alula"] = Alula(given.alula)
    if not given.again:
        solvers["IPOPT"] = Ipopt(compiled=given.compiled)
        write_record(given.work, *record(solvers["IPOPT"], given, evaluator))
    # What the files hold is what is solved.
    ipopt_flights, problems, references = read_record(given.work)
    given.seeds = len(ipopt_flights)
    print(f"{len(problems)} problems of {given.seeds} flights", flush=True)
    if given.alula:
        worst = check(solvers["alula"], evaluator, problems[: given.steps])
        print(f"alula's cost differs from the common one by {worst:.1e} of it at most", flush=True)

    solutions = solve_all(solvers, problems, given.rounds)
    flights = {"IPOPT": ipopt_flights}
    for name, solver in solvers.items():
        if name not in flights:
            flights[name] = [fly(solver, seed, given, evaluator) for seed in range(given.seeds)]

    results = {}
    for name, answers in solutions.items():
        results[name] = Result(problems, references, answers, flights[name], evaluator)
    write_report(given.work, results, problems, references)
    print(json.dumps({"load": os.getloadavg()[0]}))
    print(summary(results))


if __name__ == "__main__":
    main()
