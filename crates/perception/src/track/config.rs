//! Parameters of the tracker.

use alula_parameters::parameters;

parameters! {
    /// Parameters of [`Tracker`](crate::Tracker), for people indoors and images at 15 to 60 Hz.
    pub struct TrackerConfig {
        /// Most tracks that are kept; the nearest ones stay.
        pub max_tracks: usize = 64, within(1.0, 1024.0);
        /// Most detections of an image that are used; the nearest ones are.
        pub max_detections: usize = 64, within(1.0, 1024.0);
        /// How tracks move and vary.
        pub model: TrackModelConfig = TrackModelConfig::default(), nested();
        /// Share of true pairs of track and detection that pass the gate.
        pub gate_probability: f64 = 0.999, within(0.5, 0.9999999);
        /// When an obstacle counts as moving.
        pub motion: MotionTestConfig = MotionTestConfig::default(), nested();
        /// How long tracks live.
        pub life: TrackLifeConfig = TrackLifeConfig::default(), nested();
        /// How pieces of walls are followed.
        pub flat: FlatConfig = FlatConfig::default(), nested();
    }
}

parameters! {
    /// How tracks move and vary.
    pub struct TrackModelConfig {
        /// Square root of the spectral density of a horizontal component of the acceleration,
        /// m/s^2 per sqrt Hz, of what may turn and stop unseen.
        pub acceleration_noise_m_s2_sqrt_hz: f64 = 1.2, within(0.01, 10.0);
        /// The same for what is seen and goes straight on.
        pub steady_acceleration_noise_m_s2_sqrt_hz: f64 = 0.15, within(0.01, 10.0);
        /// The same for what is seen and turns.
        pub turn_acceleration_noise_m_s2_sqrt_hz: f64 = 1.0, within(0.01, 10.0);
        /// Rate at which a walker's velocity turns, to either side, degrees per second.
        pub turn_rate_deg_s: f64 = 115.0, within(0.0, 720.0);
        /// Mean time for which a walker goes straight on, s.
        pub straight_s: f64 = 1.0, within(0.01, 1000.0);
        /// Mean time for which a walker turns, s.
        pub turn_s: f64 = 0.6, within(0.01, 1000.0);
        /// The same for obstacles that stand.
        pub static_acceleration_noise_m_s2_sqrt_hz: f64 = 0.1, within(0.0001, 10.0);
        /// The same for the vertical component.
        pub vertical_acceleration_noise_m_s2_sqrt_hz: f64 = 0.1, within(0.0001, 10.0);
        /// Random walk of an unseen standing obstacle, for the drift of odometry, m per sqrt s.
        pub static_drift_m_sqrt_s: f64 = 0.02, within(0.0, 1.0);
        /// Random walk of the lengths while seen, m per sqrt s.
        pub size_noise_m_sqrt_s: f64 = 0.1, within(0.0, 1.0);
        /// Motion of a side of the box that is not motion of the whole, as of limbs, m.
        pub shape_noise_m: f64 = 0.02, within(0.0, 0.5);
        /// Bound on the standard deviation of the velocity in every horizontal direction, m/s;
        /// a new track starts with it.
        pub max_velocity_sigma_m_s: f64 = 0.8, within(0.05, 5.0);
        /// Bound on the standard deviation of the vertical velocity, m/s.
        pub max_vertical_velocity_sigma_m_s: f64 = 0.1, within(0.001, 5.0);
        /// Width and depth that a round obstacle is taken to have at least while the image cuts
        /// it off, m.
        pub cut_width_m: f64 = 0.5, within(0.05, 5.0);
        /// Standard deviation of a length that was never seen whole, m.
        pub cut_sigma_m: f64 = 0.15, within(0.01, 5.0);
    }
}

parameters! {
    /// When an obstacle counts as moving.
    pub struct MotionTestConfig {
        /// Images before anything is decided.
        pub min_images: u32 = 8, within(1.0, 1000.0);
        /// Least speed of a moving obstacle, m/s.
        pub min_speed_m_s: f64 = 0.3, within(0.01, 5.0);
        /// Confidence in a velocity other than zero that makes an undecided obstacle moving.
        pub moving_probability: f64 = 0.999, within(0.5, 0.9999999);
        /// The same for an obstacle that stood until now.
        pub starting_probability: f64 = 0.9999, within(0.5, 0.9999999);
        /// Confidence below which a velocity counts as zero.
        pub standing_probability: f64 = 0.95, within(0.1, 0.9999);
        /// A velocity that counts as zero for this long makes an obstacle static, s.
        pub standing_s: f64 = 0.7, within(0.0, 10.0);
    }
}

parameters! {
    /// How long tracks live.
    pub struct TrackLifeConfig {
        /// Images after which a track is trusted.
        pub confirm_images: u32 = 3, within(1.0, 100.0);
        /// Images without detection, though the view is free beyond, that end a track before it
        /// is trusted.
        pub tentative_misses: u32 = 2, within(1.0, 100.0);
        /// A track before it is trusted ends after this time unseen, s.
        pub tentative_keep_s: f64 = 1.0, within(0.0, 60.0);
        /// Time without detection, though the view is free beyond, that ends a trusted track, s.
        pub ghost_s: f64 = 0.3, within(0.0, 10.0);
        /// Time without detection, though something ends the view where the track is, that ends
        /// it, s.
        pub doubtful_s: f64 = 1.0, within(0.0, 60.0);
        /// The view is free beyond a track if it reaches this far behind it, m.
        pub view_margin_m: f64 = 0.3, within(0.0, 5.0);
        /// Detections that cover several tracks start no new one for this long, s.
        pub merge_s: f64 = 0.5, within(0.0, 10.0);
        /// Somebody new is one who was lost only if he appears no further than this from where that
        /// one should be, m.
        pub recognise_m: f64 = 0.9, within(0.0, 100.0);
        /// An unseen track ends at this horizontal distance from the vehicle, m.
        pub keep_distance_m: f64 = 8.0, within(0.5, 1000.0);
        /// A track ends at this standard deviation of its horizontal position, m.
        pub keep_sigma_m: f64 = 1.5, within(0.05, 100.0);
        /// A track that does not stand ends after this time unseen, s.
        pub keep_s: f64 = 10.0, within(0.0, 1000.0);
    }
}

parameters! {
    /// How pieces of walls are followed.
    pub struct FlatConfig {
        /// Greatest angle between pieces of one surface, degrees.
        pub max_angle_deg: f64 = 25.0, within(1.0, 45.0);
        /// Greatest distance between pieces of one surface, across it, m.
        pub max_offset_m: f64 = 0.3, within(0.01, 2.0);
        /// Share of the shorter piece that must be covered by the other.
        pub min_overlap: f64 = 0.3, within(0.01, 1.0);
        /// Share of a piece that newer ones must cover to replace it.
        pub replaced_overlap: f64 = 0.6, within(0.1, 1.0);
        /// Greatest length to which a piece grows by what the image cuts off or hides, m.
        pub max_length_m: f64 = 2.5, within(0.1, 50.0);
        /// Images over which the heading of a piece is averaged.
        pub yaw_images: u32 = 5, within(1.0, 1000.0);
    }
}
