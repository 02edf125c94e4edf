//! Recordings and foreign logs: MCAP, EuRoC folders, TUM trajectories
