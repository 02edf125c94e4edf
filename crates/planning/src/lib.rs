//! Minimum-snap trajectories through waypoints
