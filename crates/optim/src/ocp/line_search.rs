//! The exact minimum of a convex function along a line, from its slope.

/// Slope that counts as none, as a share of that at the start.
const SLOPE_SHARE: f64 = 1e-4;
/// Greatest number of slopes asked for.
const MAX_SLOPES: u32 = 60;

/// The step in (0, 1] at which a convex function is least, from its slopes at steps; 1 when it
/// falls all the way. By false position, and by halves when that moves the same end again and again.
pub(super) fn least(mut slope: impl FnMut(f64) -> f64) -> f64 {
    let (mut low, mut high) = ((0.0, slope(0.0)), (1.0, slope(1.0)));
    // A slope at the start that is not negative is rounding at the solution.
    if high.1 <= 0.0 || low.1 >= 0.0 {
        return 1.0;
    }
    let small = SLOPE_SHARE * -low.1;
    // How often in turn the same end was moved, and which.
    let (mut repeats, mut was_low) = (0, false);
    for _ in 0..MAX_SLOPES {
        let share = if repeats >= 2 {
            0.5
        } else {
            low.1 / (low.1 - high.1)
        };
        let step = low.0 + (high.0 - low.0) * share;
        let found = slope(step);
        if found.abs() <= small {
            return step;
        }
        let is_low = found < 0.0;
        repeats = if is_low == was_low { repeats + 1 } else { 0 };
        was_low = is_low;
        if is_low {
            low = (step, found);
        } else {
            high = (step, found);
        }
    }
    // The slope is not positive here: the function is no greater than at the start.
    if low.0 > 0.0 { low.0 } else { high.0 }
}

#[cfg(test)]
mod tests {
    use super::least;

    #[test]
    fn a_parabola_is_least_at_its_vertex() {
        assert!((least(|t| 2.0 * (t - 0.3)) - 0.3).abs() < 1e-12);
    }

    #[test]
    fn a_function_that_falls_takes_the_whole_step() {
        assert_eq!(least(|t| t - 2.0), 1.0);
    }

    #[test]
    fn a_sharp_bend_is_found() {
        // The slope jumps by a million per unit after 0.01.
        let slope = |t: f64| -1.0 + 1e6 * (t - 0.01).max(0.0);
        assert!(slope(least(slope)).abs() < 1e-3);
    }
}
