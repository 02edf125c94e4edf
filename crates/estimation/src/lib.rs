//! Filters, odometry, consistency and trajectory metrics
