"""The problem of problem.py by CasADi and IPOPT: multiple shooting, exact Hessian, warm started."""

import time

import casadi as ca
import numpy as np

import problem as ocp
from problem import INPUTS, INTERVALS, OBSTACLES, PARAMETERS, STATES

SLACKS = 3 + OBSTACLES


class Ipopt:
    """`compiled` has the functions of the problem compiled by the C compiler."""

    def __init__(self, tolerance=1e-3, compiled=False, iterations=200):
        X, U = ca.SX.sym("X", STATES, INTERVALS + 1), ca.SX.sym("U", INPUTS, INTERVALS)
        S, P = ca.SX.sym("S", SLACKS, INTERVALS), ca.SX.sym("P", PARAMETERS, INTERVALS + 1)
        x0 = ca.SX.sym("x0", STATES)
        velocity_max = ca.DM(ocp.VELOCITY_MAX)
        cost, rows, lower, upper = 0, [X[:, 0] - x0], [np.zeros(STATES)], [np.zeros(STATES)]
        for k in range(INTERVALS):
            after, slack = X[:, k + 1], S[:, k]
            cost += ca.sumsqr(ocp.residuals(X[:, k], U[:, k], P[:, k])) + ocp.penalty(slack)
            rows += [
                after - ocp.step(X[:, k], U[:, k]),
                ocp.margins(after, P[:, k + 1]) + slack[3:],
                velocity_max - after[3:6] + slack[:3],
                velocity_max + after[3:6] + slack[:3],
            ]
            lower.append(np.zeros(STATES + OBSTACLES + 6))
            upper += [np.zeros(STATES), np.full(OBSTACLES + 6, np.inf)]
        cost += ca.sumsqr(ocp.final_residuals(X[:, INTERVALS], P[:, INTERVALS]))

        variables = ca.vertcat(ca.vec(X), ca.vec(U), ca.vec(S))
        unbounded = np.full(X.numel(), np.inf)
        self.lower_variables = np.r_[-unbounded, np.tile(-ocp.INPUT_MAX, INTERVALS), np.zeros(S.numel())]
        self.upper_variables = np.r_[unbounded, np.tile(ocp.INPUT_MAX, INTERVALS), np.full(S.numel(), np.inf)]
        self.lower_rows, self.upper_rows = np.concatenate(lower), np.concatenate(upper)
        options = {
            "print_time": False,
            "ipopt.print_level": 0,
            "ipopt.sb": "yes",
            "ipopt.max_iter": iterations,
            "ipopt.tol": tolerance,
            "ipopt.acceptable_tol": 10.0 * tolerance,
            "ipopt.warm_start_init_point": "yes",
            "ipopt.warm_start_bound_push": 1e-4,
            "ipopt.warm_start_mult_bound_push": 1e-4,
            "ipopt.mu_init": 1e-2,
        }
        if compiled:
            options |= {"jit": True, "compiler": "shell", "jit_options": {"flags": ["-O2"]}}
        program = {
            "x": variables,
            "p": ca.vertcat(x0, ca.vec(P)),
            "f": cost,
            "g": ca.vertcat(*rows),
        }
        self.solver = ca.nlpsol("solver", "ipopt", program, options)
        self.warm = ocp.WarmStart()
        self.slacks = S.numel()

    def solve(self, problem):
        states, inputs = self.warm.begin(problem)
        if problem.step == 0:
            self.slack = np.zeros(self.slacks)
            self.bound_multipliers = np.zeros(len(self.lower_variables))
            self.row_multipliers = np.zeros(len(self.lower_rows))
        solution, states = self.solve_from(problem, states, inputs)
        self.warm.keep(states, solution.inputs)
        return solution

    def solve_from(self, problem, states, inputs):
        """Solves from the given states and inputs and the multipliers of the solve before."""
        guess = np.r_[states.ravel(), inputs.ravel(), self.slack]
        parameters = np.r_[problem.state, problem.parameters().ravel()]
        start = time.process_time()
        answer = self.solver(
            x0=guess,
            lam_x0=self.bound_multipliers,
            lam_g0=self.row_multipliers,
            p=parameters,
            lbx=self.lower_variables,
            ubx=self.upper_variables,
            lbg=self.lower_rows,
            ubg=self.upper_rows,
        )
        cpu_s = time.process_time() - start
        found = np.array(answer["x"]).ravel()
        self.bound_multipliers = np.array(answer["lam_x"]).ravel()
        self.row_multipliers = np.array(answer["lam_g"]).ravel()
        states, inputs, self.slack = np.split(found, [states.size, states.size + inputs.size])
        statistics = self.solver.stats()
        solution = ocp.Solution(
            inputs.reshape(INTERVALS, INPUTS).copy(),
            cpu_s,
            int(statistics["iter_count"]),
            0,
            bool(statistics["success"]),
            statistics["return_status"],
        )
        return solution, states.reshape(INTERVALS + 1, STATES).copy()

    def polish(self, problem, states, inputs):
        """The local minimum next to the given trajectory, from no multipliers."""
        self.slack = np.zeros(self.slacks)
        self.bound_multipliers = np.zeros(len(self.lower_variables))
        self.row_multipliers = np.zeros(len(self.lower_rows))
        return self.solve_from(problem, states, inputs)[0]
