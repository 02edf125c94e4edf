//! How a vehicle flies among obstacles, and what it must know of itself to do so.

use alula_parameters::{facts, parameters};
use alula_perception::{DetectorConfig, SeenSpaceConfig, TrackerConfig};
use alula_planning::mpc::{PredictiveConfig, TiltModel};
use alula_planning::route::RouteConfig;

facts! {
    /// Flight among obstacles: with this table the vehicle avoids what it sees.
    pub struct AvoidanceConfig {
        /// How the vehicle answers commands of tilt and climb.
        pub vehicle: TiltModel, nested();
        /// When to plan, to slow down, to stop and to give up.
        #[serde(default)]
        pub conduct: ConductConfig, nested();
        /// Depth image to boxes.
        #[serde(default)]
        pub detector: DetectorConfig, nested();
        /// Boxes to tracks.
        #[serde(default)]
        pub tracker: TrackerConfig, nested();
        /// What has been seen to be free.
        #[serde(default)]
        pub seen: SeenSpaceConfig, nested();
        /// Which way round.
        #[serde(default)]
        pub route: RouteConfig, nested();
        /// The predictive planner.
        #[serde(default)]
        pub planner: PredictiveConfig, nested();
    }
}

parameters! {
    /// Conduct among obstacles.
    pub struct ConductConfig {
        /// Greatest horizontal speed, m/s.
        pub max_speed_m_s: f64 = 2.0, within(0.1, 10.0);
        /// Greatest horizontal speed over the height above the floor, rad/s: nearer to the ground a
        /// flow camera loses it.
        pub max_flow_rad_s: f64 = 1.7, within(0.1, 1000.0);
        /// Speed at which space that was never seen may be entered, m/s.
        pub creep_speed_m_s: f64 = 0.35, within(0.0, 2.0);
        /// Deceleration with which the vehicle can stop before such space, m/s^2.
        pub braking_m_s2: f64 = 1.0, within(0.1, 10.0);
        /// Distance that it keeps from such space, m.
        pub unseen_margin_m: f64 = 0.4, within(0.0, 5.0);
        /// Least width of something that moves, m: of a person at the border of an image only an
        /// arm may be seen.
        pub least_width_m: f64 = 0.6, within(0.0, 5.0);
        /// Something counts as lower than the vehicle when its top is this much below the
        /// vehicle's sphere, m; tops at the border of an image are not known well.
        pub pass_over_m: f64 = 0.6, within(0.0, 10.0);
        /// How far the vehicle may rise above or sink below the heights of its way, m.
        pub height_band_m: f64 = 0.25, within(0.05, 10.0);
        /// World height of the floor, m.
        pub floor_height_m: f64 = 0.0, within(-1000.0, 1000.0);
        /// Time from one plan to the next, s.
        pub replan_s: f64 = 0.06, within(0.02, 1.0);
        /// Brake when the newest depth image is older than this, s.
        pub depth_stale_s: f64 = 0.3, within(0.05, 5.0);
        /// A step of the position estimate beyond its velocity that counts as a jump, m.
        pub jump_m: f64 = 0.2, within(0.02, 5.0);
        /// Distance at which a waypoint on the way counts as passed, m.
        pub pass_radius_m: f64 = 0.6, within(0.05, 5.0);
        /// Distance at which the last waypoint counts as reached, m.
        pub arrive_radius_m: f64 = 0.25, within(0.02, 5.0);
        /// Speed below which it does, m/s.
        pub arrive_speed_m_s: f64 = 0.3, within(0.02, 5.0);
        /// Clearance to be lost by something that comes near from which on a hovering vehicle
        /// gives way, m.
        pub give_way_m: f64 = 0.8, within(0.0, 5.0);
        /// For this long after somebody who moves was seen the vehicle looks round for others and
        /// for who left the view, s.
        pub wary_s: f64 = 10.0, within(0.0, 600.0);
        /// Speed of a fast walker, m/s: from the side can come who is no slower than the vehicle.
        pub walker_m_s: f64 = 1.3, within(0.1, 5.0);
        /// A direction from which somebody can come is looked at again after this time, s.
        pub glance_s: f64 = 1.0, within(0.1, 60.0);
        /// Greatest angle between the camera and the way while doing so in flight, degrees.
        pub glance_deg: f64 = 50.0, within(0.0, 180.0);
        /// A hovering vehicle returns after nothing has come near for this long, s.
        pub return_s: f64 = 1.5, within(0.0, 60.0);
        /// Coming nearer to the goal by less than `progress_m` in this time is a stall, s.
        pub stall_s: f64 = 6.0, within(1.0, 600.0);
        /// What counts as coming nearer, m.
        pub progress_m: f64 = 0.3, within(0.01, 10.0);
        /// A stalled flight is given up after this long, s.
        pub give_up_s: f64 = 25.0, within(2.0, 3600.0);
        /// Distance by which the cone of the present view is set back, so that the vehicle itself
        /// lies in it, m.
        pub view_setback_m: f64 = 1.0, within(0.0, 5.0);
    }
}
