//! Long series reduced to what a screen can show.

use super::scale::drawable;

/// Pixels further out than this are moved in: renderers lose precision far outside of the figure.
const FARTHEST_PX: f64 = 2e4;

/// Below this distance two points of a path fall together on the screen.
const MERGE_DISTANCE_PX: f64 = 0.4;

/// A path may be drawn this far beside where it is: less than can be seen at twice the size.
const SHAPE_TOLERANCE_PX: f64 = 0.15;

/// A point on the figure, in pixels.
pub(super) type Px = [f64; 2];

/// Runs of points without gaps, in pixels: a point that cannot be drawn ends a run.
pub(super) fn runs<const N: usize>(
    points: impl IntoIterator<Item = [f64; N]>,
    to_px: impl Fn([f64; N]) -> [f64; N],
) -> Vec<Vec<[f64; N]>> {
    let mut runs = vec![Vec::new()];
    for point in points {
        if !point.iter().all(|value| drawable(*value)) {
            runs.push(Vec::new());
        } else if let Some(run) = runs.last_mut() {
            run.push(to_px(point).map(|px| px.clamp(-FARTHEST_PX, FARTHEST_PX)));
        }
    }
    runs.retain(|run| !run.is_empty());
    runs
}

/// Keeps, of the neighbours that share a column of pixels, the lowest and the highest in their order.
pub(super) fn by_column(run: &[Px]) -> Vec<Px> {
    let mut kept = Vec::new();
    for column in run.chunk_by(|a, b| a[0].floor() == b[0].floor()) {
        let lowest = index_of(column, |a, b| a < b);
        let highest = index_of(column, |a, b| a > b);
        kept.push(column[lowest.min(highest)]);
        if lowest != highest {
            kept.push(column[lowest.max(highest)]);
        }
    }
    // The ends of the line are where the data ends.
    if let (Some(last), Some(end)) = (kept.last(), run.last())
        && last != end
    {
        kept.push(*end);
    }
    kept
}

/// Index of the first point whose height is before all others by `before`.
fn index_of(column: &[Px], before: impl Fn(f64, f64) -> bool) -> usize {
    (1..column.len()).fold(0, |best, i| {
        if before(column[i][1], column[best][1]) {
            i
        } else {
            best
        }
    })
}

/// The envelope of a band, `[x, low, high]` in pixels: one entry for each column of pixels.
pub(super) fn envelope(run: &[[f64; 3]]) -> Vec<[f64; 3]> {
    let columns = run.chunk_by(|a, b| a[0].floor() == b[0].floor());
    let widest = |column: &[[f64; 3]]| {
        column
            .iter()
            .skip(1)
            .fold(column[0], |[x, low, high], entry| {
                // Pixels count downwards: the low side is the larger number.
                [x, low.max(entry[1]), high.min(entry[2])]
            })
    };
    let mut kept: Vec<_> = columns.map(widest).collect();
    if let (Some(last), Some(end)) = (kept.last(), run.last())
        && last[0] != end[0]
    {
        kept.push(*end);
    }
    kept
}

/// Keeps the points of a path that shape it: no other is further from the line through those kept
/// than a fraction of a pixel. (The method of Douglas and Peucker.)
pub(super) fn by_shape(run: &[Px]) -> Vec<Px> {
    let run = by_distance(run);
    let mut shapes = vec![false; run.len()];
    let mut open = vec![(0, run.len().saturating_sub(1))];
    while let Some((first, last)) = open.pop() {
        shapes
            .iter_mut()
            .skip(first)
            .step_by((last - first).max(1))
            .take(2)
            .for_each(|s| *s = true);
        let (farthest, distance) = (first + 1..last)
            .map(|i| (i, distance_to_segment(run[i], run[first], run[last])))
            .fold(
                (first, 0.0),
                |best, next| if next.1 > best.1 { next } else { best },
            );
        if distance > SHAPE_TOLERANCE_PX {
            open.extend([(first, farthest), (farthest, last)]);
        }
    }
    run.iter()
        .zip(shapes)
        .filter(|(_, shapes)| *shapes)
        .map(|(point, _)| *point)
        .collect()
}

fn distance_to_segment(point: Px, from: Px, to: Px) -> f64 {
    let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
    let (px, py) = (point[0] - from[0], point[1] - from[1]);
    let length2 = dx * dx + dy * dy;
    let along = if length2 > 0.0 {
        ((px * dx + py * dy) / length2).clamp(0.0, 1.0)
    } else {
        0.0
    };
    (px - along * dx).hypot(py - along * dy)
}

/// Drops points of a path that lie on top of the point before.
fn by_distance(run: &[Px]) -> Vec<Px> {
    let mut kept: Vec<Px> = Vec::new();
    for (i, point) in run.iter().enumerate() {
        let far = kept
            .last()
            .is_none_or(|last| (point[0] - last[0]).hypot(point[1] - last[1]) >= MERGE_DISTANCE_PX);
        if far || i + 1 == run.len() {
            kept.push(*point);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wave of 100 000 points over 500 columns with one spike up and one down.
    fn long_run() -> Vec<Px> {
        let mut run: Vec<Px> = (0..100_000)
            .map(|i| {
                let x = f64::from(i) / 200.0;
                [x, 50.0 + 20.0 * (0.1 * x).sin()]
            })
            .collect();
        run[33_333][1] = -7.0;
        run[77_777][1] = 123.0;
        run
    }

    #[test]
    fn two_points_a_column_remain() {
        let kept = by_column(&long_run());
        assert!(kept.len() <= 2 * 500 + 1, "{}", kept.len());
    }

    #[test]
    fn extremes_and_ends_remain() {
        let run = long_run();
        let kept = by_column(&run);
        let heights = || kept.iter().map(|point| point[1]);
        assert_eq!(heights().fold(f64::INFINITY, f64::min), -7.0);
        assert_eq!(heights().fold(f64::NEG_INFINITY, f64::max), 123.0);
        assert_eq!(kept.last(), run.last());
        assert_eq!(kept.first(), run.first());
    }

    #[test]
    fn short_runs_are_kept_whole() {
        let run = [[0.0, 3.0], [5.5, 1.0], [9.0, 2.0]];
        assert_eq!(by_column(&run), run);
        assert_eq!(by_shape(&run), run);
    }

    #[test]
    fn a_missing_value_splits_the_line() {
        let points = [[0.0, 1.0], [1.0, f64::NAN], [2.0, 1.0], [3.0, 2.0]];
        let split = runs(points, |point| point);
        assert_eq!(split, vec![vec![[0.0, 1.0]], vec![[2.0, 1.0], [3.0, 2.0]]]);
        assert!(runs([[f64::NAN, 0.0]], |point| point).is_empty());
    }

    #[test]
    fn the_envelope_covers_every_entry_of_its_column() {
        let run = [
            [1.1, 5.0, 3.0],
            [1.4, 9.0, 4.0],
            [1.9, 6.0, 1.0],
            [2.0, 7.0, 2.0],
        ];
        assert_eq!(envelope(&run), [[1.1, 9.0, 1.0], [2.0, 7.0, 2.0]]);
    }

    #[test]
    fn a_straight_path_is_its_ends() {
        let run: Vec<Px> = (0..500)
            .map(|i| [f64::from(i), 2.0 * f64::from(i)])
            .collect();
        assert_eq!(by_shape(&run), [run[0], run[499]]);
        assert_eq!(by_shape(&run[..1]), run[..1]);
        assert!(by_shape(&[]).is_empty());
    }

    #[test]
    fn a_path_keeps_its_shape_with_few_points() {
        let loops = |i| {
            let angle = 0.001 * f64::from(i);
            [300.0 * angle.cos(), 200.0 * (2.0 * angle).sin()]
        };
        let run: Vec<Px> = (0..12_000).map(loops).collect();
        let kept = by_shape(&run);
        assert!(kept.len() < 400, "{}", kept.len());
        for point in &run {
            let distances = kept
                .windows(2)
                .map(|w| distance_to_segment(*point, w[0], w[1]));
            let distance = distances.fold(f64::INFINITY, f64::min);
            assert!(
                distance <= SHAPE_TOLERANCE_PX + MERGE_DISTANCE_PX,
                "{point:?}: {distance}"
            );
        }
    }

    #[test]
    fn a_hovering_path_becomes_short_and_keeps_its_end() {
        let run: Vec<Px> = (0..10_000).map(|i| [0.0001 * f64::from(i), 0.0]).collect();
        let kept = by_shape(&run);
        assert!(kept.len() <= 4, "{}", kept.len());
        assert_eq!(kept.last(), run.last());
    }
}
