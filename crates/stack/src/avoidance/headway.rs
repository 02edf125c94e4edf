//! Whether the vehicle comes nearer to where it is going.

use alula_geometry::Timestamp;

/// Watches the length of the way that is left.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Headway {
    best_m: Option<f64>,
    since: Timestamp,
}

impl Headway {
    /// Notes what is left of the way, m, and says for how long, s, it has not become shorter by
    /// more than `step_m`.
    pub fn note(&mut self, now: Timestamp, left_m: f64, step_m: f64) -> f64 {
        if self.best_m.is_none_or(|best| left_m < best - step_m) {
            self.best_m = Some(left_m);
            self.since = now;
        }
        now.seconds_since(self.since)
    }

    /// Begins anew.
    pub fn reset(&mut self) {
        self.best_m = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_without_headway_counts_from_the_last_gain() {
        let mut headway = Headway::default();
        let mut at = |t_s, left_m| headway.note(Timestamp::from_s(t_s), left_m, 0.3);
        assert_eq!(at(1.0, 5.0), 0.0);
        assert_eq!(at(3.0, 4.8), 2.0);
        assert_eq!(at(4.0, 4.6), 0.0);
        assert_eq!(at(9.0, 6.0), 5.0);
    }
}
