use super::*;
use alula_geometry::gaussian::chi_square_quantile;
use nalgebra::UnitQuaternion;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use error_index::{ORIENTATION, VELOCITY};

type Coordinates = SVector<f64, 16>;

struct Draw(Pcg64);

impl Draw {
    fn vector(&mut self, size: f64) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.0.random_range(-size..size))
    }

    fn nominal(&mut self) -> Nominal {
        Nominal {
            position_world: self.vector(5.0),
            velocity_world: self.vector(3.0),
            world_from_body: so3::exp(&self.vector(1.5)),
            accelerometer_bias: self.vector(0.2),
            gyroscope_bias: self.vector(0.05),
        }
    }

    fn input(&mut self) -> InertialInput {
        InertialInput {
            specific_force: self.vector(3.0) + Vector3::z() * 9.8,
            angular_rate: self.vector(3.0),
            previous_angular_rate: self.vector(3.0),
            interval_s: 0.01,
            noise_scale: 1.0,
        }
    }

    fn covariance(&mut self) -> ErrorCovariance {
        let root = ErrorCovariance::from_fn(|_, _| self.0.random_range(-0.1..0.1));
        root * root.transpose()
    }

    fn filter(&mut self, variant: Variant) -> Filter {
        Filter::with_covariance(self.nominal(), &self.covariance(), variant)
    }

    fn seen<const M: usize>(&mut self) -> Linearised<M> {
        Linearised {
            innovation: SVector::from_fn(|_, _| self.0.random_range(-0.1..0.1)),
            jacobian: SMatrix::from_fn(|_, _| self.0.random_range(-1.0..1.0)),
            variance: SVector::from_fn(|_, _| self.0.random_range(0.001..0.1)),
            from: Seen::InWorld,
        }
    }
}

fn draws() -> Draw {
    Draw(Pcg64::seed_from_u64(3))
}

fn each_kind() -> impl Iterator<Item = Variant> {
    Variant::all()
        .filter(|v| v.transition == Truncation::F1 && v.integration == QuaternionIntegration::Q0B)
}

fn without_uncertainty(nominal: Nominal, variant: Variant) -> Filter {
    Filter::with_covariance(nominal, &ErrorCovariance::zeros(), variant)
}

/// The state that a small error in the coordinates of a filter makes of `nominal`.
fn moved(nominal: &Nominal, filter: FilterKind, error: &Coordinates) -> Nominal {
    let mut moved = without_uncertainty(
        *nominal,
        Variant {
            filter,
            ..Variant::default()
        },
    );
    moved.inject(error, Seen::InWorld);
    moved.nominal
}

/// The error in the coordinates of a filter that makes `to` of `from`, to first order.
fn difference(from: &Nominal, to: &Nominal, filter: FilterKind) -> Coordinates {
    from_error(filter, from) * from.error_to(to)
}

/// Columns of F: the error after a step of `dt_s` for a unit error before.
fn analytic(nominal: &Nominal, input: &InertialInput, dt_s: f64, v: Variant) -> Covariance {
    let force = input.specific_force - nominal.accelerometer_bias;
    let rate = input.rate(v.integration, &nominal.gyroscope_bias);
    let middle = nominal.world_from_body * so3::exp(&(rate * (0.5 * dt_s)));
    let motion = v.filter.motion(&middle, &force, &rate);
    TransitionMatrix::new(&motion, dt_s, v.transition).times(&Covariance::identity())
}

/// The same by central differences of the step, for errors that are tangent to the states: a
/// quaternion has length 1, an error state no fourth coordinate.
fn numeric(
    nominal: &Nominal,
    input: &InertialInput,
    dt_s: f64,
    v: Variant,
) -> SMatrix<f64, 16, 15> {
    const H: f64 = 1e-5;
    let tangents = from_error(v.filter, nominal);
    let stepped = |error: Coordinates| {
        let mut filter = without_uncertainty(moved(nominal, v.filter, &error), v);
        filter.step(input, dt_s, &ImuNoise::default());
        filter.nominal
    };
    let middle = stepped(Coordinates::zeros());
    let mut columns = SMatrix::<f64, 16, 15>::zeros();
    for k in 0..15 {
        let error = tangents.column(k) * H;
        let (before, after) = (stepped(-error), stepped(error));
        let change = difference(&middle, &after, v.filter) - difference(&middle, &before, v.filter);
        columns.set_column(k, &(change / (2.0 * H)));
    }
    columns
}

fn truncation_error(variant: Variant, dt_s: f64) -> f64 {
    let mut draw = draws();
    let mut worst: f64 = 0.0;
    for _ in 0..20 {
        let (nominal, mut input) = (draw.nominal(), draw.input());
        // The rate of a real vehicle changes by an amount of the order of the step.
        input.previous_angular_rate = input.angular_rate + draw.vector(3.0) * dt_s;
        input.interval_s = dt_s;
        let tangents = from_error(variant.filter, &nominal);
        let difference = analytic(&nominal, &input, dt_s, variant) * tangents
            - numeric(&nominal, &input, dt_s, variant);
        worst = worst.max(difference.amax());
    }
    worst
}

/// F1 leaves out terms in dt^2, the greatest of which is force * rate / 2 with forces up to
/// 13.5 m/s^2 and rates up to 5.2 rad/s here: a tenth of the step, a hundredth of the error. The
/// step itself is exact to second order, and so are F2 and F3: a tenth of the step, a thousandth.
#[test]
fn the_transition_of_every_variant_meets_differences_to_its_order() {
    for variant in Variant::all() {
        let (coarse, fine) = (
            truncation_error(variant, 0.01),
            truncation_error(variant, 0.001),
        );
        let second_order = 0.01_f64.powi(2) * 0.5 * 13.5 * 5.2;
        let (bound, order) = match variant.transition {
            Truncation::F1 => (second_order, 0.01),
            Truncation::F2 | Truncation::F3 => (second_order * 0.01 * 5.2, 0.001),
        };
        assert!(coarse < bound, "{variant}: {coarse} over {bound}");
        assert!(
            (fine / coarse / order - 1.0).abs() < 0.3,
            "{variant}: {coarse} {fine}"
        );
    }
}

/// A itself, from the transition to first order.
fn continuous(nominal: &Nominal, input: &InertialInput, filter: FilterKind) -> Covariance {
    let force = input.specific_force - nominal.accelerometer_bias;
    let rate = input.rate(QuaternionIntegration::Q0B, &nominal.gyroscope_bias);
    let motion = filter.motion(&nominal.world_from_body, &force, &rate);
    TransitionMatrix::new(&motion, 1.0, Truncation::F1).times(&Covariance::identity())
        - Covariance::identity()
}

/// Document S, equation 2.32, with full matrices.
#[test]
fn the_blocks_are_those_of_the_powers_of_a() {
    let mut draw = draws();
    for variant in Variant::all() {
        let (nominal, input) = (draw.nominal(), draw.input());
        let dt_s = 0.1;
        let step = continuous(&nominal, &input, variant.filter) * dt_s;
        let order = match variant.transition {
            Truncation::F1 => 1,
            Truncation::F2 => 2,
            Truncation::F3 => 3,
        };
        let (mut power, mut series) = (Covariance::identity(), Covariance::identity());
        for n in 1..=order {
            power = power * step / f64::from(n);
            series += power;
        }
        let force = input.specific_force - nominal.accelerometer_bias;
        let rate = input.rate(QuaternionIntegration::Q0B, &nominal.gyroscope_bias);
        let motion = variant
            .filter
            .motion(&nominal.world_from_body, &force, &rate);
        let blocks = TransitionMatrix::new(&motion, dt_s, variant.transition);
        // Of sums of a few numbers below ten.
        let difference = blocks.times(&Covariance::identity()) - series;
        assert!(difference.amax() < 1e-14, "{variant}");
    }
}

#[test]
fn the_product_around_a_covariance_is_f_p_f_transposed() {
    let mut draw = draws();
    for variant in Variant::all() {
        let filter = draw.filter(variant);
        let input = draw.input();
        let motion = variant.filter.motion(
            &filter.nominal.world_from_body,
            &input.specific_force,
            &input.angular_rate,
        );
        let f = TransitionMatrix::new(&motion, 0.01, variant.transition);
        let full = f.times(&Covariance::identity());
        let expected = full * filter.covariance * full.transpose();
        assert!((f.around(&filter.covariance) - expected).amax() < 1e-13);
    }
}

/// Orientation after a second in which the rate at `t` is `rate(t)`, sampled at 100 Hz.
fn turned(
    integration: QuaternionIntegration,
    rate: impl Fn(f64) -> Vector3<f64>,
) -> UnitQuaternion<f64> {
    let variant = Variant {
        integration,
        ..Variant::default()
    };
    let mut filter = without_uncertainty(Nominal::default(), variant);
    for i in 0..100 {
        let (before, after) = (0.01 * f64::from(i), 0.01 * f64::from(i + 1));
        let input = InertialInput {
            previous_angular_rate: rate(before),
            interval_s: 0.01,
            ..InertialInput::steady(Vector3::zeros(), rate(after))
        };
        filter.propagate(&input, 0.01, &ImuNoise::default());
    }
    filter.nominal.world_from_body
}

/// A rate that swings about one axis while it turns about another. Zeroth order is wrong by half
/// the change of the rate times the step; first order by terms of its square.
#[test]
fn first_order_integration_is_far_closer_than_zeroth() {
    let rate = |t: f64| Vector3::new((3.0 * t).sin(), (2.0 * t).cos(), 0.5 + t);
    let mut fine = UnitQuaternion::identity();
    for i in 0..100_000 {
        fine *= so3::exp(&(rate(1e-5 * (f64::from(i) + 0.5)) * 1e-5));
    }
    let error = |integration| turned(integration, rate).angle_to(&fine);
    let change = (rate(1.0) - rate(0.0)).norm();
    let zeroth = 0.5 * 0.01 * change;
    for integration in [QuaternionIntegration::Q0F, QuaternionIntegration::Q0B] {
        let ratio = error(integration) / zeroth;
        assert!((0.5..1.5).contains(&ratio), "{integration:?} {ratio}");
    }
    let first = error(QuaternionIntegration::Q1);
    assert!(first < 0.01 * zeroth, "{first}");
}

/// Document S, equation 2.33c, with its sum brought back to length 1.
#[test]
fn first_order_integration_is_that_of_the_source() {
    let (w0, w1) = (Vector3::new(1.0, -2.0, 0.5), Vector3::new(1.5, 0.3, -0.4));
    let dt_s = 0.01;
    let input = InertialInput {
        previous_angular_rate: w0,
        interval_s: dt_s,
        ..InertialInput::steady(Vector3::zeros(), w1)
    };
    let ours = so3::exp(&(input.rate(QuaternionIntegration::Q1, &Vector3::zeros()) * dt_s));
    let mut theirs = so3::exp(&((w0 + w1) * (0.5 * dt_s))).into_inner();
    theirs += nalgebra::Quaternion::from_imag(w0.cross(&w1) * (dt_s * dt_s / 24.0));
    // Third order in an angle of 0.01 rad, times a term of second order.
    assert!(ours.angle_to(&UnitQuaternion::from_quaternion(theirs)) < 1e-8);
}

#[test]
fn standing_still_stays() {
    for variant in Variant::all() {
        let mut filter = without_uncertainty(Nominal::default(), variant);
        let input = InertialInput::steady(-gravity_world(), Vector3::zeros());
        filter.propagate(&input, 1.0, &ImuNoise::default());
        assert!(Nominal::default().error_to(&filter.nominal).norm() < 1e-12);
    }
}

/// 1 s of white noise of density s gives variances of s^2 in velocity and orientation whatever
/// the step and the coordinates are.
#[test]
fn process_noise_grows_with_time_and_not_with_the_rate() {
    let noise = ImuNoise::default();
    for variant in Variant::all() {
        for steps in [100, 500] {
            let orientation = so3::from_roll_pitch_yaw(0.0, 0.0, 0.7);
            let nominal = Nominal {
                world_from_body: orientation,
                ..Nominal::default()
            };
            let mut filter = without_uncertainty(nominal, variant);
            let input = InertialInput::steady(-gravity_world(), Vector3::zeros());
            for _ in 0..steps {
                filter.propagate(&input, 1.0 / f64::from(steps), &noise);
            }
            let covariance = filter.covariance();
            let sigma = |row: usize| covariance[(row, row)].sqrt();
            // The bias walks add their third of a second cubed, under one per mille.
            let velocity = sigma(VELOCITY + 2) / noise.accelerometer_noise_m_s2_sqrt_hz;
            let turn = sigma(ORIENTATION + 2) / noise.gyroscope_noise_rad_s_sqrt_hz;
            assert!((velocity - 1.0).abs() < 1e-3, "{variant} {velocity}");
            assert!((turn - 1.0).abs() < 1e-3, "{variant} {turn}");
        }
    }
}

fn check_joseph<const M: usize>(draw: &mut Draw, variant: Variant) {
    let mut filter = draw.filter(variant);
    let seen = draw.seen::<M>();
    let (p, h) = (filter.covariance, filter.in_own_coordinates(&seen.jacobian));
    let n = SMatrix::<f64, M, M>::from_diagonal(&seen.variance);
    let gain = p * h.transpose() * (h * p * h.transpose() + n).try_inverse().unwrap();
    let rest = Covariance::identity() - gain * h;
    let joseph = rest * p * rest.transpose() + gain * n * gain.transpose();
    let correction = gain * seen.innovation;
    let before = filter.nominal;
    let turn = correction.fixed_rows::<4>(index::ORIENTATION).into_owned();
    let (orientation, block) = variant.filter.correct(&before.world_from_body, &turn);
    let mut reset = Covariance::identity();
    reset
        .fixed_view_mut::<4, 4>(index::ORIENTATION, index::ORIENTATION)
        .copy_from(&block);
    let expected = reset * joseph * reset.transpose();
    assert!(filter.fuse(&seen, f64::INFINITY).accepted);
    assert!((filter.covariance - expected).amax() < 1e-9);
    assert!(filter.nominal.world_from_body.angle_to(&orientation) < 1e-9);
    let position = before.position_world + correction.fixed_rows::<3>(index::POSITION);
    assert!((filter.nominal.position_world - position).norm() < 1e-12);
}

#[test]
fn fusion_is_the_joseph_form_followed_by_the_reset() {
    let mut draw = draws();
    for variant in each_kind() {
        for _ in 0..20 {
            check_joseph::<1>(&mut draw, variant);
            check_joseph::<2>(&mut draw, variant);
            check_joseph::<3>(&mut draw, variant);
        }
    }
}

/// A small measurement says the same to all filters: they differ in the second order of the
/// correction, here 1e-4 squared.
#[test]
fn a_small_correction_is_the_same_in_all_coordinates() {
    let mut draw = draws();
    let (nominal, covariance) = (draw.nominal(), draw.covariance());
    let mut seen = draw.seen::<2>();
    seen.innovation *= 1e-3;
    let fused = each_kind().map(|variant| {
        let mut filter = Filter::with_covariance(nominal, &covariance, variant);
        filter.fuse(&seen, f64::INFINITY);
        filter
    });
    let fused: Vec<Filter> = fused.collect();
    for other in &fused[1..] {
        assert!(fused[0].nominal.error_to(&other.nominal).norm() < 1e-7);
        assert!((fused[0].covariance() - other.covariance()).amax() < 1e-5);
    }
}

/// The error that remains after a correction, in the coordinates there, against differences of the
/// error before it.
#[test]
fn the_reset_of_every_filter_meets_differences() {
    let mut draw = draws();
    for variant in each_kind() {
        let q = draw.nominal().world_from_body;
        let local = Vector3::new(0.1, -0.3, 0.2);
        let correction = variant.filter.coordinates_from_local(&q) * local;
        let (corrected, reset) = variant.filter.correct(&q, &correction);
        let remaining = |error: nalgebra::Vector4<f64>| {
            let (truth, _) = variant.filter.correct(&q, &error);
            let turn = so3::log(&(corrected.inverse() * truth));
            variant.filter.coordinates_from_local(&corrected) * turn
        };
        for tangent in variant.filter.coordinates_from_local(&q).column_iter() {
            let d = tangent * 1e-6;
            let column = (remaining(correction + d) - remaining(correction - d)) / 2e-6;
            assert!((column - reset * tangent).norm() < 1e-9, "{variant}");
        }
    }
}

#[test]
fn changing_the_variant_keeps_what_is_known() {
    let mut draw = draws();
    let filter = draw.filter(Variant::default());
    let mut same = filter.clone();
    for variant in Variant::all() {
        same = same.in_variant(variant);
        assert!((same.covariance() - filter.covariance()).amax() < 1e-12);
    }
}

/// An error drawn in the body, seen in the coordinates of the filter and back.
#[test]
fn local_and_own_coordinates_are_inverse() {
    let mut draw = draws();
    for variant in each_kind() {
        let q = draw.nominal().world_from_body;
        let there_and_back =
            variant.filter.local_from_coordinates(&q) * variant.filter.coordinates_from_local(&q);
        assert!((there_and_back - nalgebra::Matrix3::identity()).amax() < 1e-14);
    }
}

#[test]
fn an_inflation_is_one_of_the_error_state() {
    let mut draw = draws();
    for variant in each_kind() {
        let mut filter = draw.filter(variant);
        let before = filter.covariance();
        let sigma = ErrorVector::from_fn(|i, _| 0.01 * (i as f64 + 1.0));
        filter.inflate(&sigma);
        let added = ErrorCovariance::from_diagonal(&sigma.component_mul(&sigma));
        assert!((filter.covariance() - before - added).amax() < 1e-12);
    }
}

#[test]
fn an_innovation_beyond_the_gate_changes_nothing() {
    let mut draw = draws();
    for variant in each_kind() {
        let mut filter = draw.filter(variant);
        let mut seen = draw.seen::<2>();
        seen.innovation *= 1000.0;
        let before = filter.clone();
        assert!(!filter.fuse(&seen, chi_square_quantile(0.999, 2)).accepted);
        assert_eq!(filter, before);
    }
}

#[test]
fn the_covariance_of_every_variant_stays_symmetric_and_positive() {
    let mut draw = draws();
    for variant in Variant::all() {
        let mut filter = draw.filter(variant);
        for _ in 0..300 {
            filter.propagate(&draw.input(), 0.02, &ImuNoise::default());
            filter.fuse(&draw.seen::<3>(), f64::INFINITY);
            assert_eq!(filter.covariance, filter.covariance.transpose());
            assert!(filter.covariance.symmetric_eigenvalues().min() > -1e-12);
        }
        let length = filter.nominal.world_from_body.norm();
        assert!((length - 1.0).abs() < 1e-12, "{variant}: {length}");
    }
}

#[test]
fn the_covariance_stays_bounded_without_measurements() {
    let mut draw = draws();
    for variant in each_kind() {
        let mut filter = draw.filter(variant);
        let input = draw.input();
        for _ in 0..2000 {
            filter.propagate(&input, 1.0, &ImuNoise::default());
        }
        let covariance = filter.covariance();
        assert!(covariance.iter().all(|x| x.abs() < 1.1e8), "{variant}");
    }
}
