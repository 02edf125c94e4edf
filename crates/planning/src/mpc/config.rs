//! Settings of the predictive planner.

use alula_parameters::parameters;

use super::keepout::Hull;

parameters! {
    /// Settings of the predictive planner. Costs have no unit; `*_weight` multiplies a square.
    pub struct PredictiveConfig {
        /// Radius of the sphere around the vehicle, m.
        pub radius_m: f64 = 0.4, within(0.05, 2.0);
        /// Greatest chance of collision with one obstacle at one point of the plan.
        pub delta: f64 = 0.03, within(1e-6, 0.49);
        /// Length of an interval, s.
        pub interval_s: f64 = 0.06, within(0.02, 0.2);
        /// Greatest commanded roll and pitch, degrees.
        pub max_tilt_deg: f64 = 16.0, within(1.0, 35.0);
        /// Greatest commanded climb rate, up and down, m/s.
        pub max_climb_m_s: f64 = 1.0, within(0.1, 5.0);
        /// Greatest commanded yaw rate, degrees per second.
        pub max_yaw_rate_deg_s: f64 = 150.0, within(5.0, 360.0);
        /// Body that stands for compact obstacles.
        pub hull: Hull = Hull::Cylinder, any();
        /// Horizontal widening of an upright ellipsoid, so that it contains the cylinder.
        pub hull_widening: f64 = 1.05, within(1.005, 2.0);
        /// Greatest margin for uncertainty, m: what is uncertain further than that does not close
        /// all space. Beyond it the chance of collision may exceed `delta`.
        pub max_margin_m: f64 = 0.25, within(0.01, 10.0);
        /// Obstacles that stay further than this from the expected path are left out, m.
        pub heed_m: f64 = 2.5, within(0.2, 50.0);
        /// A target further away than this is replaced by a point this far on the way to it, m.
        pub lead_m: f64 = 6.0, within(1.0, 100.0);
        /// Distance of the last point from the target, as a share of the first one's.
        pub goal_weight: f64 = 8.0, within(0.0, 1e4);
        /// The same at every point before.
        pub stage_goal_weight: f64 = 0.01, within(0.0, 1e4);
        /// Height above or below the target's, at every point.
        pub height_weight: f64 = 0.1, within(0.0, 1e4);
        /// Velocity at the last point, where the vehicle is to stop, on the scale of
        /// `goal_weight`.
        pub stop_weight: f64 = 2.0, within(0.0, 1e4);
        /// Velocity at every point.
        pub velocity_weight: f64 = 0.005, within(0.0, 1e4);
        /// Inputs as shares of their limits.
        pub input_weight: f64 = 0.1, within(1e-4, 1e4);
        /// Yaw away from the wanted one at the last point.
        pub yaw_weight: f64 = 2.0, within(0.0, 1e4);
        /// The same at every point before.
        pub stage_yaw_weight: f64 = 0.4, within(0.0, 1e4);
        /// Horizontal speed above the limit.
        pub speed_weight: f64 = 2.0, within(0.0, 1e4);
        /// Width of the transition at the speed limit, m/s.
        pub speed_softness_m_s: f64 = 0.05, within(0.005, 1.0);
        /// Potential of an obstacle.
        pub potential_weight: f64 = 0.5, within(0.0, 1e4);
        /// Steepness of the potential, 1/m.
        pub potential_slope_1_m: f64 = 12.0, within(0.1, 100.0);
        /// Distance from an obstacle's volume at which its potential is a quarter, m.
        pub potential_buffer_m: f64 = 0.15, within(0.0, 10.0);
        /// Penalty of coming too near to an obstacle, 1/m.
        pub collision_linear: f64 = 50.0, within(0.0, 1e5);
        /// Penalty of the squared nearness, 1/m^2.
        pub collision_quadratic: f64 = 200.0, within(0.0, 1e6);
        /// Penalty of leaving the field of view, 1/m.
        pub view_linear: f64 = 0.5, within(0.0, 1e5);
        /// Penalty of the square of that, 1/m^2.
        pub view_quadratic: f64 = 1.0, within(0.0, 1e6);
        /// Below this horizontal speed the yaw is kept, m/s.
        pub yaw_hold_m_s: f64 = 0.15, within(0.01, 2.0);
        /// Weight of the direction to the target against that of the motion, m/s.
        pub yaw_lead_m_s: f64 = 0.3, within(0.0, 5.0);
        /// Standard deviation of the vehicle's position against what it sees, now, m.
        pub position_sigma_m: f64 = 0.02, within(0.0, 1.0);
        /// Greatest standard deviation of its velocity that is believed, m/s.
        pub max_velocity_sigma_m_s: f64 = 0.3, within(0.0, 10.0);
        /// Standard deviation of the acceleration by disturbances in an interval, m/s^2.
        pub acceleration_sigma_m_s2: f64 = 0.3, within(0.0, 10.0);
        /// A state this far from the last plan starts a new one, m.
        pub jump_m: f64 = 0.5, within(0.05, 10.0);
        /// Greatest number of subproblems in one solution.
        pub max_iterations: u32 = 12, within(1.0, 200.0);
        /// Further solutions from other first guesses in one call, when the first one is blocked.
        pub restarts: u32 = 1, within(0.0, 4.0);
    }
}
