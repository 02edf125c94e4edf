//! Assignment of rows to columns at the least total cost.

/// No row holds this column; and the column from which a search starts.
const NONE: usize = usize::MAX;

/// Solver of rectangular assignment problems with forbidden pairs, by shortest augmenting paths.
///
/// Chooses pairs (row, column), each row and each column at most once, that minimise
///
/// `sum of the costs of the chosen pairs + skip_cost * (rows without a column)`.
///
/// Each row owns a private column that means "no column" and costs `skip_cost`, so that a solution
/// always exists. Rows are added one by one, each along the path that is shortest in reduced
/// costs `c_ij - u_i - v_j >= 0` (Kuhn 1955, Munkres 1957 with the potentials of Jonker and
/// Volgenant, Computing 38, 1987): O(rows^2 (rows + columns)). Ties go to the lower column. The
/// workspace is allocated at construction.
#[derive(Clone, Debug)]
pub struct AssignmentSolver {
    max_rows: usize,
    max_columns: usize,
    row_potential: Vec<f64>,
    column_potential: Vec<f64>,
    row_of_column: Vec<usize>,
    reached_from: Vec<usize>,
    distance: Vec<f64>,
    settled: Vec<bool>,
    column_of_row: Vec<Option<usize>>,
}

impl AssignmentSolver {
    /// A solver for problems of at most these dimensions.
    pub fn new(max_rows: usize, max_columns: usize) -> Self {
        let all_columns = max_columns + max_rows;
        Self {
            max_rows,
            max_columns,
            row_potential: vec![0.0; max_rows],
            column_potential: vec![0.0; all_columns],
            row_of_column: vec![NONE; all_columns],
            reached_from: vec![NONE; all_columns],
            distance: vec![0.0; all_columns],
            settled: vec![false; all_columns],
            column_of_row: Vec::with_capacity(max_rows),
        }
    }

    /// The column of each row, or `None` for a row that is better left without.
    ///
    /// `costs` is row by row, `rows * columns` long. A cost that is not finite forbids its pair;
    /// costs may be negative. `skip_cost` must be finite. A problem that is larger than the
    /// workspace, or whose lengths do not fit, has no pairs.
    pub fn solve(
        &mut self,
        costs: &[f64],
        rows: usize,
        columns: usize,
        skip_cost: f64,
    ) -> &[Option<usize>] {
        self.column_of_row.clear();
        let fits = rows <= self.max_rows && columns <= self.max_columns;
        if !fits || costs.len() != rows * columns || !skip_cost.is_finite() {
            let rows = rows.min(self.max_rows);
            self.column_of_row.resize(rows, None);
            return &self.column_of_row;
        }
        self.row_potential[..rows].fill(0.0);
        self.column_potential[..rows + columns].fill(0.0);
        self.row_of_column[..rows + columns].fill(NONE);
        let cost = |row: usize, column: usize| {
            if column < columns {
                let cost = costs[row * columns + column];
                return if cost.is_finite() {
                    cost
                } else {
                    f64::INFINITY
                };
            }
            if column == columns + row {
                skip_cost
            } else {
                f64::INFINITY
            }
        };
        for row in 0..rows {
            let end = self.shortest_path(row, rows + columns, cost);
            self.augment(row, end);
        }
        self.read_off(rows, columns)
    }

    /// Dijkstra's search in reduced costs from `start` to the nearest column without a row; moves
    /// the potentials so that the reduced costs stay non-negative and vanish along the path.
    fn shortest_path(
        &mut self,
        start: usize,
        columns: usize,
        cost: impl Fn(usize, usize) -> f64,
    ) -> usize {
        self.distance[..columns].fill(f64::INFINITY);
        self.settled[..columns].fill(false);
        let (mut row, mut from, mut so_far) = (start, NONE, 0.0);
        let end = loop {
            let mut nearest = NONE;
            let mut nearest_distance = f64::INFINITY;
            for column in 0..columns {
                if self.settled[column] {
                    continue;
                }
                let through = so_far + cost(row, column)
                    - self.row_potential[row]
                    - self.column_potential[column];
                if through < self.distance[column] {
                    self.distance[column] = through;
                    self.reached_from[column] = from;
                }
                if self.distance[column] < nearest_distance {
                    nearest_distance = self.distance[column];
                    nearest = column;
                }
            }
            // The private column of `row` is open or leads on, so there always is a nearest one.
            so_far = nearest_distance;
            if self.row_of_column[nearest] == NONE {
                break nearest;
            }
            self.settled[nearest] = true;
            from = nearest;
            row = self.row_of_column[nearest];
        };
        self.move_potentials(start, columns, so_far);
        end
    }

    fn move_potentials(&mut self, start: usize, columns: usize, length: f64) {
        self.row_potential[start] += length;
        for column in 0..columns {
            if self.settled[column] {
                let change = length - self.distance[column];
                self.row_potential[self.row_of_column[column]] += change;
                self.column_potential[column] -= change;
            }
        }
    }

    /// Hands each column on the path to the row before it.
    fn augment(&mut self, start: usize, end: usize) {
        let mut column = end;
        loop {
            let before = self.reached_from[column];
            if before == NONE {
                self.row_of_column[column] = start;
                return;
            }
            self.row_of_column[column] = self.row_of_column[before];
            column = before;
        }
    }

    fn read_off(&mut self, rows: usize, columns: usize) -> &[Option<usize>] {
        self.column_of_row.resize(rows, None);
        for column in 0..columns {
            if self.row_of_column[column] != NONE {
                self.column_of_row[self.row_of_column[column]] = Some(column);
            }
        }
        &self.column_of_row
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn total(costs: &[f64], columns: usize, skip: f64, pairs: &[Option<usize>]) -> f64 {
        let cost = |(row, pair): (usize, &Option<usize>)| {
            pair.map_or(skip, |column| costs[row * columns + column])
        };
        pairs.iter().enumerate().map(cost).sum()
    }

    /// Least total over all choices, row by row.
    fn brute_force(costs: &[f64], columns: usize, skip: f64, row: usize, used: u32) -> f64 {
        if (row + 1) * columns > costs.len() {
            return 0.0;
        }
        let mut best = skip + brute_force(costs, columns, skip, row + 1, used);
        for column in 0..columns {
            let cost = costs[row * columns + column];
            if used & (1 << column) == 0 && cost.is_finite() {
                let rest = brute_force(costs, columns, skip, row + 1, used | (1 << column));
                best = best.min(cost + rest);
            }
        }
        best
    }

    fn problems() -> impl Strategy<Value = (usize, usize, f64, Vec<f64>)> {
        (1usize..6, 1usize..7, -1.0..12.0).prop_flat_map(|(rows, columns, skip)| {
            let entry = prop_oneof![3 => -5.0..10.0, 1 => Just(f64::INFINITY), 1 => Just(2.0)];
            let costs = prop::collection::vec(entry, rows * columns);
            (Just(rows), Just(columns), Just(skip), costs)
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]

        #[test]
        fn totals_equal_those_of_trying_everything((rows, columns, skip, costs) in problems()) {
            let mut solver = AssignmentSolver::new(5, 6);
            let pairs = solver.solve(&costs, rows, columns, skip).to_vec();
            let expected = brute_force(&costs, columns, skip, 0, 0);
            // Sums of at most five numbers below ten, in another order.
            prop_assert!((total(&costs, columns, skip, &pairs) - expected).abs() < 1e-12);
            let mut taken: Vec<_> = pairs.iter().flatten().collect();
            taken.sort();
            taken.dedup();
            prop_assert_eq!(taken.len(), pairs.iter().flatten().count());
        }
    }

    /// With potentials `u`, `v` for which `c >= u + v`, no assignment costs less than
    /// `sum u + sum v`; a total that meets it is optimal at any size.
    #[test]
    fn large_totals_meet_the_bound_of_the_potentials() {
        let n = 64;
        let cost = |i: usize| ((i * 7919 + i * i * 31) % 1009) as f64 / 100.0;
        let costs: Vec<f64> = (0..n * n).map(cost).collect();
        let mut solver = AssignmentSolver::new(n, n);
        let pairs = solver.solve(&costs, n, n, 1e3).to_vec();
        for (row, column) in (0..n * n).map(|i| (i / n, i % n)) {
            let reduced = costs[row * n + column]
                - solver.row_potential[row]
                - solver.column_potential[column];
            assert!(reduced > -1e-9);
        }
        let bound: f64 =
            solver.row_potential.iter().sum::<f64>() + solver.column_potential.iter().sum::<f64>();
        assert!((total(&costs, n, 1e3, &pairs) - bound).abs() < 1e-9);
    }

    #[test]
    fn a_row_is_left_out_when_its_pair_costs_more_than_skipping() {
        let mut solver = AssignmentSolver::new(2, 2);
        let costs = [0.0, 10.0, 10.0, f64::NAN];
        assert_eq!(solver.solve(&costs, 2, 2, 5.0), [Some(0), None]);
        assert_eq!(solver.solve(&costs, 2, 2, 50.0), [Some(1), Some(0)]);
    }

    #[test]
    fn a_problem_beyond_the_workspace_has_no_pairs() {
        let mut solver = AssignmentSolver::new(1, 1);
        assert_eq!(solver.solve(&[1.0, 2.0], 1, 2, 5.0), [None]);
    }
}
