"""Figures, table and files of the comparison."""

import csv
import json

import numpy as np

from problem import INPUT_MAX, INPUTS

# Solves after an obstacle comes into view that count as its appearance.
APPEARANCE_STEPS = 10
# First inputs closer than this fraction of their bound come from the same minimum for every purpose.
LARGE_ERROR = 0.05


def appearances(problems):
    """Marks the solves just after an obstacle came into view in flight."""
    marks, since = np.zeros(len(problems), bool), np.inf
    for index, problem in enumerate(problems):
        if problem.step == 0:
            since = np.inf
        elif any(now and not before for now, before in zip(problem.seen(), problems[index - 1].seen())):
            since = 0
        marks[index] = since < APPEARANCE_STEPS
        since += 1
    return marks


class Result:
    """One solver's answers to the stream and its own flights."""

    def __init__(self, problems, references, solutions, flights, evaluator):
        self.solutions, self.flights = solutions, flights
        self.appearance = appearances(problems)
        pairs = list(zip(problems, solutions, references, strict=True))
        self.error = np.array(
            [np.max(np.abs(s.inputs[0] - r.inputs[0]) / INPUT_MAX) for _, s, r in pairs]
        )
        self.cost = np.array(
            [evaluator.cost(p, np.clip(s.inputs, -INPUT_MAX, INPUT_MAX)) for p, s, _ in pairs]
        )
        self.reference_cost = np.array([evaluator.cost(p, r.inputs) for p, _, r in pairs])
        self.gap = self.cost / self.reference_cost - 1.0
        self.cpu_ms = np.array([1e3 * s.cpu_s for s in solutions])

    def figures(self):
        """Name to number, in the order of the table."""
        iterations = [s.iterations for s in self.solutions]
        inner = [s.qp_iterations for s in self.solutions]
        figures = {"solves": len(self.solutions), "cpu_ms_mean": np.mean(self.cpu_ms)}
        figures |= quantiles("cpu_ms", self.cpu_ms, (50, 75, 99, 100))
        figures |= {
            "iterations_mean": np.mean(iterations),
            "iterations_max": max(iterations),
            "qp_iterations_mean": np.mean(inner),
            "qp_iterations_max": max(inner),
            "failures": sum(not s.solved for s in self.solutions),
        }
        figures |= quantiles("u0_error", self.error, (50, 90, 99))
        figures |= quantiles("u0_error_appearance", self.error[self.appearance], (50, 90, 99))
        figures["appearance_solves"] = int(np.sum(self.appearance))
        figures |= quantiles("cost_gap", self.gap, (1, 50, 99))
        figures |= quantiles("cost_gap_appearance", self.gap[self.appearance], (1, 50, 99))
        figures["large_errors"] = int(np.sum(self.error > LARGE_ERROR))
        figures["large_errors_at_lower_cost"] = int(
            np.sum((self.error > LARGE_ERROR) & (self.gap < 0.0))
        )
        distances = [f["min_distance"] for f in self.flights]
        times = [f["reached_s"] for f in self.flights if f["reached_s"] is not None]
        figures |= {
            "flights": len(self.flights),
            "flight_min_distance": min(distances),
            "flight_mean_distance": np.mean(distances),
            "flight_collisions": sum(d < 1.0 for d in distances),
            "flight_reached": len(times),
            "flight_mean_s": np.mean(times) if times else np.nan,
        }
        return {name: round(float(value), 7) for name, value in figures.items()}


def quantiles(name, values, percents):
    if len(values) == 0:
        return {f"{name}_{label(p)}": np.nan for p in percents}
    return {f"{name}_{label(p)}": np.percentile(values, p) for p in percents}


def label(percent):
    return "max" if percent == 100 else f"p{percent:02d}"


def summary(results):
    """One table, a figure a row and a solver a column."""
    figures = {name: result.figures() for name, result in results.items()}
    quickest = figures["acados RTI"]["cpu_ms_mean"]
    for values in figures.values():
        values["cpu_ratio_to_acados_rti"] = values["cpu_ms_mean"] / quickest
    lines = ["| | " + " | ".join(figures) + " |", "|---" * (len(figures) + 1) + "|"]
    for row in next(iter(figures.values())):
        lines.append(f"| {row} | " + " | ".join(f"{v[row]:.4g}" for v in figures.values()) + " |")
    return "\n".join(lines)


def write_report(folder, results, problems, references):
    """summary.json, table.md and solves.csv."""
    figures = {name: result.figures() for name, result in results.items()}
    (folder / "summary.json").write_text(json.dumps(figures, indent=1) + "\n")
    (folder / "table.md").write_text(summary(results) + "\n")
    with open(folder / "solves.csv", "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(
            ["solver", "seed", "step", "appearance", "seen", "cpu_ms", "iterations", "qp_iterations"]
            + ["status", "u0_error", "cost", "reference_cost", "cost_gap"]
            + [f"u0_{i}" for i in range(INPUTS)]
            + [f"reference_u0_{i}" for i in range(INPUTS)]
        )
        for name, result in results.items():
            for i, (problem, solution) in enumerate(zip(problems, result.solutions)):
                writer.writerow(
                    [name, problem.seed, problem.step, int(result.appearance[i]), sum(problem.seen())]
                    + [result.cpu_ms[i], solution.iterations, solution.qp_iterations, solution.status]
                    + [result.error[i], result.cost[i], result.reference_cost[i], result.gap[i]]
                    + [*solution.inputs[0], *references[i].inputs[0]]
                )
