"""The optimal control problem that every solver of this comparison gets, stated once in CasADi.

A multirotor with first-order attitude and climb loops flies to a goal past two moving ellipsoids; the
model, the weights and the chance constraint are those of the authors' code for document L
(tud-amr/mrca-mav, `initialize.m`). `crates/planning/examples/peer_problem.rs` states the same in Rust;
`compare.py` compares the costs of the two.

State (world, z up): position 3, velocity 3, roll, pitch, yaw. Input: roll, pitch (rad), climb rate
(m/s), yaw rate (rad/s). Roll to the right accelerates to the right, pitch down forwards.
"""

from dataclasses import dataclass
from statistics import NormalDist

import casadi as ca
import numpy as np

INTERVALS, INTERVAL_S = 25, 0.06
STATES, INPUTS, OBSTACLES = 9, 4, 2
GRAVITY = 9.81

CLIMB_GAIN, CLIMB_TIME_S = 1.227, 0.3367
ROLL_GAIN, ROLL_TIME_S = 1.0181, 0.2386
PITCH_GAIN, PITCH_TIME_S = 1.0167, 0.2386
DRAG_FORWARD, DRAG_LEFT = 0.184, 0.2007

INPUT_MAX = np.array([np.radians(12.0), np.radians(12.0), 1.0, np.radians(90.0)])
VELOCITY_MAX = np.array([2.0, 2.0, 1.0])

# Semi-axes of vehicle and obstacle together.
SEMI_AXES_M = np.array([0.3, 0.3, 0.4]) + np.array([0.4, 0.4, 0.9])
COLLISION_PROBABILITY = 0.03
# The half-space bound keeps this many standard deviations along the normal: sqrt(2) erfinv(1 - 2 delta).
DEVIATIONS = NormalDist().inv_cdf(1.0 - COLLISION_PROBABILITY)
# Keeps the distance differentiable in an obstacle's centre.
DISTANCE_FLOOR_SQUARED = 1e-6

INPUT_WEIGHT = 0.1
NEARNESS_WEIGHT, FINAL_NEARNESS_WEIGHT = 1.0, 1.2
NEARNESS_STEEPNESS, NEARNESS_DISTANCE = 10.0, 1.4
GOAL_WEIGHT, FINAL_GOAL_WEIGHT = 0.01, 8.0
YAW_WEIGHT, FINAL_YAW_WEIGHT = 0.025, 0.5
VELOCITY_WEIGHT = 0.005
# Violations s cost LINEAR s + QUADRATIC s^2.
LINEAR, QUADRATIC = 50.0, 200.0

# Parameters of a point of the horizon: goal 3, yaw, 1 / length^2, then per obstacle centre 3 and
# the diagonal of the covariance 3.
PARAMETERS = 5 + 6 * OBSTACLES
# An obstacle that is not seen stands here.
UNSEEN_M = np.array([100.0, 100.0, 1.0])


@dataclass
class Problem:
    """One solve. `centres` and `variances` have shape (INTERVALS + 1, OBSTACLES, 3)."""

    seed: int
    step: int
    state: np.ndarray
    goal: np.ndarray
    yaw_goal: float
    centres: np.ndarray
    variances: np.ndarray

    def row(self):
        """The problem as numbers in the order of problems.csv."""
        obstacles = np.concatenate([self.centres, self.variances], axis=2)
        return [self.seed, self.step, *self.state, *self.goal, self.yaw_goal, *obstacles.ravel()]

    @classmethod
    def from_row(cls, row):
        values = np.array([float(x) for x in row])
        obstacles = values[15:].reshape(INTERVALS + 1, OBSTACLES, 6)
        return cls(
            int(values[0]), int(values[1]), values[2:11], values[11:14], values[14],
            obstacles[:, :, :3], obstacles[:, :, 3:],
        )  # fmt: skip

    def seen(self):
        """Which obstacles are seen."""
        return tuple(bool(c[0] != UNSEEN_M[0]) for c in self.centres[0])

    def parameters(self):
        """Shape (INTERVALS + 1, PARAMETERS)."""
        inverse_length2 = 1.0 / max(np.sum((self.state[:3] - self.goal) ** 2), 1.0)
        shared = np.tile([*self.goal, self.yaw_goal, inverse_length2], (INTERVALS + 1, 1))
        obstacles = np.concatenate([self.centres, self.variances], axis=2)
        return np.hstack([shared, obstacles.reshape(INTERVALS + 1, -1)])


def header():
    """Column names of problems.csv."""
    names = ["seed", "step"] + [f"x0_{i}" for i in range(STATES)]
    names += ["goal_x", "goal_y", "goal_z", "yaw_goal"]
    for k in range(INTERVALS + 1):
        for o in range(OBSTACLES):
            names += [f"k{k}_o{o}_{what}_{axis}" for what in ("centre", "var") for axis in "xyz"]
    return names


def derivative(x, u):
    """Time derivative of the state."""
    cos, sin = ca.cos(x[8]), ca.sin(x[8])
    forward = GRAVITY * ca.tan(x[7]) - DRAG_FORWARD * (cos * x[3] + sin * x[4])
    left = -GRAVITY * ca.tan(x[6]) - DRAG_LEFT * (cos * x[4] - sin * x[3])
    return ca.vertcat(
        x[3:6],
        cos * forward - sin * left,
        sin * forward + cos * left,
        (CLIMB_GAIN * u[2] - x[5]) / CLIMB_TIME_S,
        (ROLL_GAIN * u[0] - x[6]) / ROLL_TIME_S,
        (PITCH_GAIN * u[1] - x[7]) / PITCH_TIME_S,
        u[3],
    )


def step(x, u):
    """One interval by the classic Runge-Kutta method."""
    h = INTERVAL_S
    k1 = derivative(x, u)
    k2 = derivative(x + 0.5 * h * k1, u)
    k3 = derivative(x + 0.5 * h * k2, u)
    k4 = derivative(x + h * k3, u)
    return x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


def obstacles_of(p):
    """Centre and variances of every obstacle in the parameters of a point."""
    starts = [5 + 6 * o for o in range(OBSTACLES)]
    return [(p[s : s + 3], p[s + 3 : s + 6]) for s in starts]


def ellipsoid_distance(position, centre):
    """Offset from the centre in units of the semi-axes, and its length."""
    offset = (position - centre) / ca.DM(SEMI_AXES_M)
    return offset, ca.sqrt(ca.sumsqr(offset) + DISTANCE_FLOOR_SQUARED)


def nearness(position, centre):
    """Rises from 0 far away to 1 at the centre; the form with tanh cannot overflow."""
    _, distance = ellipsoid_distance(position, centre)
    return 0.5 - 0.5 * ca.tanh(0.5 * NEARNESS_STEEPNESS * (distance - NEARNESS_DISTANCE))


def chance_margin(position, centre, variances):
    """Not negative where the half-space bound of the collision probability holds."""
    offset, distance = ellipsoid_distance(position, centre)
    normal = offset / distance
    scaled = variances / ca.DM(SEMI_AXES_M**2)
    return distance - 1.0 - DEVIATIONS * ca.sqrt(ca.dot(normal**2, scaled))


def residuals(x, u, p):
    """The cost of a point before the last is the sum of their squares."""
    scale = ca.sqrt(p[4])
    return ca.vertcat(
        np.sqrt(INPUT_WEIGHT) * u / ca.DM(INPUT_MAX),
        np.sqrt(GOAL_WEIGHT) * scale * (x[:3] - p[:3]),
        np.sqrt(VELOCITY_WEIGHT) * x[3:6],
        np.sqrt(YAW_WEIGHT) * (x[8] - p[3]),
        *(np.sqrt(NEARNESS_WEIGHT) * nearness(x[:3], c) for c, _ in obstacles_of(p)),
    )


def final_residuals(x, p):
    """The cost of the last point is the sum of their squares."""
    scale = ca.sqrt(p[4])
    return ca.vertcat(
        np.sqrt(FINAL_GOAL_WEIGHT) * scale * (x[:3] - p[:3]),
        np.sqrt(VELOCITY_WEIGHT) * x[3:6],
        np.sqrt(FINAL_YAW_WEIGHT) * (x[8] - p[3]),
        *(np.sqrt(FINAL_NEARNESS_WEIGHT) * nearness(x[:3], c) for c, _ in obstacles_of(p)),
    )


def margins(x, p):
    """Chance constraints of a point; softly not negative at points 1 to INTERVALS."""
    return ca.vertcat(*(chance_margin(x[:3], c, v) for c, v in obstacles_of(p)))


def penalty(violation):
    """Cost of violations that are not negative."""
    return LINEAR * ca.sum1(violation) + QUADRATIC * ca.sumsqr(violation)


class Evaluator:
    """The exact-penalty cost of rolled-out inputs: one yardstick for every solver."""

    def __init__(self):
        x, u, p = ca.SX.sym("x", STATES), ca.SX.sym("u", INPUTS), ca.SX.sym("p", PARAMETERS)
        self.step = ca.Function("step", [x, u], [step(x, u)])
        inputs = ca.SX.sym("U", INPUTS, INTERVALS)
        points = ca.SX.sym("P", PARAMETERS, INTERVALS + 1)
        state, cost, states = x, 0, [x]
        for k in range(INTERVALS):
            cost += ca.sumsqr(residuals(state, inputs[:, k], points[:, k]))
            state = step(state, inputs[:, k])
            states.append(state)
            cost += penalty(ca.fmax(0.0, -margins(state, points[:, k + 1])))
            cost += penalty(ca.fmax(0.0, ca.fabs(state[3:6]) - ca.DM(VELOCITY_MAX)))
        cost += ca.sumsqr(final_residuals(state, points[:, INTERVALS]))
        arguments = [x, inputs, points]
        self._cost = ca.Function("cost", arguments, [cost])
        self._gradient = ca.Function("gradient", arguments, [ca.gradient(cost, inputs)])
        self._states = ca.Function("states", [x, inputs], [ca.horzcat(*states)])

    def cost(self, problem, inputs):
        """Cost of inputs of shape (INTERVALS, INPUTS)."""
        return float(self._cost(problem.state, inputs.T, problem.parameters().T))

    def gradient(self, problem, inputs):
        """Derivative of the cost by the inputs, same shape as they."""
        return np.array(self._gradient(problem.state, inputs.T, problem.parameters().T)).T

    def states(self, state, inputs):
        """Shape (INTERVALS + 1, STATES)."""
        return np.array(self._states(state, inputs.T)).T


@dataclass
class Solution:
    """What a solver answers. `inputs` has shape (INTERVALS, INPUTS)."""

    inputs: np.ndarray
    cpu_s: float
    iterations: int
    qp_iterations: int
    solved: bool
    status: str
    # The cost that the solver itself reports, if it does.
    own_cost: float = float("nan")


class WarmStart:
    """The previous states and inputs, moved one interval on; constant at a new flight."""

    def __init__(self):
        self.seed = None

    def begin(self, problem):
        """States and inputs to start from."""
        if problem.seed != self.seed:
            self.seed = problem.seed
            self.states = np.tile(problem.state, (INTERVALS + 1, 1))
            self.inputs = np.zeros((INTERVALS, INPUTS))
        else:
            self.states = np.vstack([self.states[1:], self.states[-1:]])
            self.inputs = np.vstack([self.inputs[1:], self.inputs[-1:]])
            self.states[0] = problem.state
        return self.states, self.inputs

    def forget(self):
        """The next solve starts a flight."""
        self.seed = None

    def keep(self, states, inputs):
        """Remembers the answer; a broken one is forgotten."""
        if np.all(np.isfinite(states)) and np.all(np.isfinite(inputs)):
            self.states, self.inputs = states.copy(), inputs.copy()
        else:
            self.forget()
