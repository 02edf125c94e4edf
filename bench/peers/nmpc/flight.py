"""The closed loop that the problems come from: 8 m past two people who cross the line."""

import numpy as np

from problem import (
    INPUT_MAX, INTERVAL_S, INTERVALS, OBSTACLES, SEMI_AXES_M, UNSEEN_M, Problem,
)  # fmt: skip

START_X_M, GOAL_M, CRUISE_M_S = -4.0, np.array([4.0, 0.0, 1.2]), 1.6
REACHED_M = 0.4
ACCELERATION_NOISE_M_S2 = 0.1
AXIS_SHARE = np.array([1.0, 1.0, 0.5])
HORIZONTAL = np.array([1.0, 1.0, 0.0])
# Standard deviations: measured position and velocity of the obstacles, own position and velocity.
OBSTACLE_M, OBSTACLE_M_S, OWN_M, OWN_M_S = 0.05, 0.1, 0.04, 0.02


class Flight:
    """One seed. Every solver meets the same obstacles and the same noise."""

    def __init__(self, seed, detection_m, model):
        self.seed, self.step, self.detection_m, self.model = seed, 0, detection_m, model
        layout, self.sensing, self.gusts = np.random.default_rng([seed, 20]).spawn(3)
        self.state = np.zeros(9)
        self.state[:3] = START_X_M, layout.uniform(-0.3, 0.3), GOAL_M[2]
        self.positions, self.velocities = np.zeros((2, OBSTACLES, 3))
        for o, side in enumerate((1.0, -1.0)):
            # The obstacle crosses the straight line when the vehicle gets there.
            meeting_s = layout.uniform(1.8, 3.6)
            heading = side * layout.uniform(0.35, 2.8)
            speed = layout.uniform(1.0, 2.0)
            self.velocities[o] = speed * np.cos(heading), speed * np.sin(heading), 0.0
            meeting = START_X_M + CRUISE_M_S * meeting_s, layout.uniform(-0.2, 0.2), 1.0
            self.positions[o] = meeting - self.velocities[o] * meeting_s
        self.min_distance, self.reached_s = np.inf, None

    def problem(self):
        """What the planner is asked now, from noisy measurements of the obstacles that are near."""
        shape = (OBSTACLES, 3)
        positions = self.positions + self.sensing.normal(0.0, OBSTACLE_M, shape) * AXIS_SHARE
        velocities = self.velocities + self.sensing.normal(0.0, OBSTACLE_M_S, shape) * HORIZONTAL
        seen = np.linalg.norm((self.positions - self.state[:3])[:, :2], axis=1) < self.detection_m
        positions[~seen], velocities[~seen] = UNSEEN_M, 0.0
        ahead_s = INTERVAL_S * np.arange(INTERVALS + 1)
        centres = positions + velocities * ahead_s[:, None, None]
        spread = OBSTACLE_M**2 + (OBSTACLE_M_S * ahead_s) ** 2 + OWN_M**2 + (OWN_M_S * ahead_s) ** 2
        variances = np.broadcast_to(spread[:, None, None] * AXIS_SHARE, centres.shape)
        return Problem(self.seed, self.step, self.state.copy(), GOAL_M, 0.0, centres, variances)

    def advance(self, command):
        """Flies one interval."""
        command = np.clip(np.nan_to_num(command), -INPUT_MAX, INPUT_MAX)
        self.state = np.array(self.model(self.state, command)).ravel()
        self.state[3:6] += self.gusts.normal(0.0, ACCELERATION_NOISE_M_S2, 3) * INTERVAL_S
        self.positions += self.velocities * INTERVAL_S
        offsets = (self.state[:3] - self.positions) / SEMI_AXES_M
        self.min_distance = min(self.min_distance, np.min(np.linalg.norm(offsets, axis=1)))
        self.step += 1
        if self.reached_s is None and np.linalg.norm(self.state[:3] - GOAL_M) < REACHED_M:
            self.reached_s = self.step * INTERVAL_S
