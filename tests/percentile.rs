//! Percentiles for tests and benchmarks of several crates.

/// The value below which this share of the values lies, which are sorted for it; the nearest one
/// that occurred.
pub fn percentile(values: &mut [f64], share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * share).round() as usize]
}
