//! What the chance constraint promises and what it keeps: encounters in which it is just met, and
//! how often the vehicle then touches the obstacle.

use alula_geometry::gaussian::normal_quantile;
use alula_planning::mpc::{Keepout, Volume, sum_with_sphere};
use alula_sim::world::PersonState;
use nalgebra::{Matrix3, Point3, Vector3};
use rand::RngExt;
use rand_distr::{Distribution as _, StandardNormal};
use rand_pcg::Pcg64;

use super::{Chart, Column, Curve, CurveBand, Demand, Request, Results, Row, Study, Tone, Watch};
use crate::RunError;
use crate::campaign::clopper_pearson_95;

/// Document L, section 6.
pub const STUDY: Study = Study {
    name: "chance-constraint",
    source: "document L, section 6-1-2, equation 6-15, after Zhu and Alonso-Mora (RA-L 2019)",
    about: "chance of touching an obstacle where the chance constraint is just met",
    runs_are: "encounters for each delta",
    default_runs: 10_000,
    execute,
};

/// Chances that the constraint allows; the source flies with the third.
const DELTAS: [f64; 6] = [0.003, 0.01, 0.03, 0.05, 0.1, 0.2];

/// Encounters that are drawn at a time.
const BLOCK: u64 = 500;

/// Halvings of the distance at which the constraint is just met.
const HALVINGS: usize = 60;

/// Greatest distance at which it is looked for, m.
const FAR_M: f64 = 40.0;

/// How encounters end.
#[derive(Clone, Copy, Debug, Default)]
struct Tally {
    encounters: u64,
    /// The vehicle's sphere touches the obstacle.
    touched: u64,
    /// The vehicle's centre is in the volume that the constraint keeps it out of.
    inside: u64,
}

fn execute(request: &Request, watch: &Watch) -> Result<Results, RunError> {
    let blocks = request.runs.div_ceil(BLOCK);
    let tasks: Vec<u64> = (0..blocks * DELTAS.len() as u64).collect();
    let tallies = request.do_all(&tasks, watch, &|task| {
        let (delta, block) = (DELTAS[(task / blocks) as usize], task % blocks);
        let encounters = BLOCK.min(request.runs - block * BLOCK);
        // Each block has its own stream, so that no number of jobs changes a figure.
        let mut generator = Pcg64::new(u128::from(request.seed), u128::from(task));
        Ok(meet(&mut generator, delta, encounters))
    })?;
    let of_delta = |i: usize| {
        let from = i * blocks as usize;
        tallies[from..from + blocks as usize]
            .iter()
            .fold(Tally::default(), |sum, block| Tally {
                encounters: sum.encounters + block.encounters,
                touched: sum.touched + block.touched,
                inside: sum.inside + block.inside,
            })
    };
    let sums: Vec<Tally> = (0..DELTAS.len()).map(of_delta).collect();
    Ok(results(request.runs, &sums))
}

fn meet(generator: &mut Pcg64, delta: f64, encounters: u64) -> Tally {
    let quantile = normal_quantile(1.0 - delta);
    let mut tally = Tally {
        encounters,
        ..Tally::default()
    };
    for _ in 0..encounters {
        let encounter = Encounter::draw(generator, quantile);
        let position = encounter.true_position(generator);
        tally.touched += u64::from(encounter.touches(&position));
        tally.inside += u64::from(encounter.keepout.distance(&position).value < 0.0);
    }
    tally
}

/// An obstacle that is believed to be at the origin, and a vehicle where the constraint is just met.
struct Encounter {
    axes_m: Vector3<f64>,
    yaw_rad: f64,
    radius_m: f64,
    keepout: Keepout,
    position: Vector3<f64>,
}

impl Encounter {
    /// Obstacles from the size of a post to that of a car, seen more or less well, from all sides.
    fn draw(generator: &mut Pcg64, quantile: f64) -> Self {
        let axes_m = Vector3::from_fn(|_, _| generator.random_range(0.1..2.0));
        let yaw_rad = generator.random_range(-3.0..3.0);
        let radius_m = generator.random_range(0.2..0.6);
        let root = Matrix3::from_fn(|_, _| generator.random_range(-0.2..0.2));
        let keepout = Keepout {
            centre: Vector3::zeros(),
            covariance: root * root.transpose() + Matrix3::identity() * 1e-4,
            volume: Volume::ellipsoid(&sum_with_sphere(&axes_m, radius_m), yaw_rad),
        };
        let way = normal_vector(generator).normalize();
        let (mut low, mut high) = (0.0, FAR_M);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if keepout.chance_value(&(way * middle), quantile) < 0.0 {
                low = middle;
            } else {
                high = middle;
            }
        }
        Self {
            axes_m,
            yaw_rad,
            radius_m,
            keepout,
            position: way * high,
        }
    }

    /// Where the vehicle truly is, seen from the true centre of the obstacle.
    fn true_position(&self, generator: &mut Pcg64) -> Vector3<f64> {
        let normal = normal_vector(generator);
        let root = self.keepout.covariance.cholesky();
        self.position + root.map_or(normal, |root| root.l() * normal)
    }

    fn touches(&self, position: &Vector3<f64>) -> bool {
        let obstacle = PersonState {
            id: 0,
            centre_world: Point3::origin(),
            velocity_world: Vector3::zeros(),
            semi_axes_m: self.axes_m,
            yaw_rad: self.yaw_rad,
        };
        obstacle.distance(&Point3::from(*position)) < self.radius_m
    }
}

fn normal_vector(generator: &mut Pcg64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| StandardNormal.sample(generator))
}

fn results(runs: u64, sums: &[Tally]) -> Results {
    let row = |(delta, tally): (&f64, &Tally)| {
        let [low, high] = clopper_pearson_95(tally.touched, tally.encounters);
        Row::new()
            .with("delta", *delta)
            .with("encounters", tally.encounters)
            .with("touched", tally.touched)
            .with("touch_probability", share(tally.touched, tally))
            .with("touch_probability_ci95_low", low)
            .with("touch_probability_ci95_high", high)
            .with("inside_probability", share(tally.inside, tally))
            .theirs("touch_probability", *delta)
    };
    let demand = |(delta, tally): (&f64, &Tally)| {
        let what = format!("chance of touching for delta {delta}");
        Demand::at_most(&what, "", *delta, share(tally.touched, tally))
    };
    Results {
        runs,
        columns: vec![
            Column::new("delta", "delta", 3),
            Column::new("encounters", "encounters", 0),
            Column::new("touched", "touched", 0),
            Column::new("touch_probability", "chance", 4),
            Column::new("touch_probability_ci95_low", "95 % from", 4),
            Column::new("touch_probability_ci95_high", "to", 4),
            Column::new("inside_probability", "in the volume", 4),
        ],
        rows: DELTAS.iter().zip(sums).map(row).collect(),
        demands: DELTAS.iter().zip(sums).map(demand).collect(),
        charts: vec![chart(sums)],
        notes: vec![
            "The obstacle is an ellipsoid and the vehicle a sphere; where they are to each other is \
             normally distributed. The vehicle is put where the constraint is exactly met, from \
             where no other place along its way is more dangerous and allowed. Theirs is what the \
             constraint promises."
                .to_owned(),
            "In the volume is the share in which the centre lies in the ellipsoid that stands for \
             the sum of obstacle and vehicle, which is somewhat larger than the sum."
                .to_owned(),
        ],
    }
}

fn share(count: u64, tally: &Tally) -> f64 {
    count as f64 / tally.encounters as f64
}

fn chart(sums: &[Tally]) -> Chart {
    let points = |of: fn(&Tally) -> u64| {
        let pairs = DELTAS.iter().zip(sums);
        pairs.map(|(d, t)| (*d, share(of(t), t))).collect()
    };
    let bounds = DELTAS.iter().zip(sums).map(|(delta, tally)| {
        let [low, high] = clopper_pearson_95(tally.touched, tally.encounters);
        (*delta, low, high)
    });
    let promised = DELTAS.iter().map(|delta| (*delta, *delta)).collect();
    Chart::Curves {
        title: "what is promised and what is kept".to_owned(),
        x_label: "delta".to_owned(),
        y_label: "chance".to_owned(),
        curves: vec![
            Curve::dashed("promised", Tone::Theirs, promised),
            Curve::line("in the volume", Tone::Second, points(|t| t.inside)),
            Curve::line("touched", Tone::Measured, points(|t| t.touched)),
        ],
        bands: vec![CurveBand {
            name: "95 % confidence".to_owned(),
            points: bounds.collect(),
            tone: Tone::Measured,
        }],
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;

    #[test]
    fn an_encounter_is_where_the_constraint_is_just_met() {
        let mut generator = Pcg64::seed_from_u64(1);
        let quantile = normal_quantile(0.97);
        for _ in 0..50 {
            let encounter = Encounter::draw(&mut generator, quantile);
            let value = encounter
                .keepout
                .chance_value(&encounter.position, quantile);
            // The distance is halved to the last digits of an f64.
            assert!((0.0..1e-9).contains(&value), "{value}");
        }
    }

    #[test]
    fn who_touches_is_in_the_volume() {
        let mut generator = Pcg64::seed_from_u64(2);
        let tally = meet(&mut generator, 0.2, 2000);
        assert!(tally.touched > 0 && tally.touched <= tally.inside);
    }
}
