use super::*;
use alula_geometry::gaussian::chi_square_quantile;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

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
            noise_scale: 1.0,
        }
    }

    fn covariance(&mut self) -> ErrorCovariance {
        let root = ErrorCovariance::from_fn(|_, _| self.0.random_range(-0.1..0.1));
        root * root.transpose()
    }

    fn seen<const M: usize>(&mut self) -> Linearised<M> {
        Linearised {
            innovation: SVector::from_fn(|_, _| self.0.random_range(-0.1..0.1)),
            jacobian: SMatrix::from_fn(|_, _| self.0.random_range(-1.0..1.0)),
            variance: SVector::from_fn(|_, _| self.0.random_range(0.001..0.1)),
        }
    }
}

fn draws() -> Draw {
    Draw(Pcg64::seed_from_u64(3))
}

/// Column `k` of the transition matrix: with `M = e_k e_0^T` the filter's `F M F^T` is
/// `(F e_k) e_0^T`, because an error in position stays what it is.
fn analytic_column(nominal: &Nominal, input: &InertialInput, dt_s: f64, k: usize) -> ErrorVector {
    let mut covariance = ErrorCovariance::zeros();
    covariance[(k, 0)] = 1.0;
    let mut filter = Filter {
        nominal: *nominal,
        covariance,
    };
    let force = input.specific_force - nominal.accelerometer_bias;
    let rate = input.angular_rate - nominal.gyroscope_bias;
    let middle = nominal.world_from_body * so3::exp(&(rate * (0.5 * dt_s)));
    let rotation = middle.to_rotation_matrix().into_inner();
    filter.advance_covariance(&rotation, &force, &rate, dt_s);
    filter.covariance.column(0).into_owned()
}

fn numeric_column(nominal: &Nominal, input: &InertialInput, dt_s: f64, k: usize) -> ErrorVector {
    let h = 1e-5;
    let stepped = |sign: f64| {
        let mut error = ErrorVector::zeros();
        error[k] = sign * h;
        let mut filter = Filter::new(nominal.plus(&error), [Vector3::zeros(); 5]);
        filter.step(input, dt_s, &ImuNoise::default());
        filter.nominal
    };
    stepped(-1.0).error_to(&stepped(1.0)) / (2.0 * h)
}

fn truncation(dt_s: f64) -> f64 {
    let mut draw = draws();
    let mut worst: f64 = 0.0;
    for _ in 0..20 {
        let (nominal, input) = (draw.nominal(), draw.input());
        for k in 0..15 {
            let difference = analytic_column(&nominal, &input, dt_s, k)
                - numeric_column(&nominal, &input, dt_s, k);
            worst = worst.max(difference.amax());
        }
    }
    worst
}

/// F1 leaves out terms in dt^2, the greatest of which is force * rate / 2 with forces up to
/// 13.5 m/s^2 and rates up to 5.2 rad/s here: a tenth of the step, a hundredth of the error.
#[test]
fn the_transition_meets_differences_to_first_order() {
    let (coarse, fine) = (truncation(0.01), truncation(0.001));
    assert!(coarse < 0.01_f64.powi(2) * 0.5 * 13.5 * 5.2, "{coarse}");
    assert!((fine / coarse - 0.01).abs() < 0.002, "{coarse} {fine}");
}

#[test]
fn standing_still_stays() {
    let mut filter = Filter::new(Nominal::default(), [Vector3::zeros(); 5]);
    let input = InertialInput {
        specific_force: -gravity_world(),
        angular_rate: Vector3::zeros(),
        noise_scale: 1.0,
    };
    filter.propagate(&input, 1.0, &ImuNoise::default());
    assert!(Nominal::default().error_to(&filter.nominal).norm() < 1e-12);
}

/// 1 s of white noise of density s gives a velocity variance of s^2 whatever the step is.
#[test]
fn process_noise_grows_with_time_and_not_with_the_rate() {
    let noise = ImuNoise::default();
    for steps in [100, 500] {
        let mut filter = Filter::new(Nominal::default(), [Vector3::zeros(); 5]);
        let input = InertialInput {
            specific_force: -gravity_world(),
            angular_rate: Vector3::zeros(),
            noise_scale: 1.0,
        };
        for _ in 0..steps {
            filter.propagate(&input, 1.0 / f64::from(steps), &noise);
        }
        let sigma = filter.covariance[(VELOCITY + 2, VELOCITY + 2)].sqrt();
        // Vertical velocity: the bias walk adds its third of a second cubed, under one per mille.
        assert!(
            (sigma / noise.accelerometer_noise_m_s2_sqrt_hz - 1.0).abs() < 1e-3,
            "{sigma}"
        );
    }
}

fn check_joseph<const M: usize>(draw: &mut Draw) {
    let mut filter = Filter {
        nominal: draw.nominal(),
        covariance: draw.covariance(),
    };
    let seen = draw.seen::<M>();
    let (p, h) = (filter.covariance, seen.jacobian);
    let n = SMatrix::<f64, M, M>::from_diagonal(&seen.variance);
    let gain = p * h.transpose() * (h * p * h.transpose() + n).try_inverse().unwrap();
    let rest = ErrorCovariance::identity() - gain * h;
    let joseph = rest * p * rest.transpose() + gain * n * gain.transpose();
    let error = gain * seen.innovation;
    let mut reset = ErrorCovariance::identity();
    let turn = error.fixed_rows::<3>(ORIENTATION).into_owned();
    reset
        .fixed_view_mut::<3, 3>(ORIENTATION, ORIENTATION)
        .copy_from(&so3::right_jacobian(&turn));
    let expected = reset * joseph * reset.transpose();
    let before = filter.nominal;
    assert!(filter.fuse(&seen, f64::INFINITY).accepted);
    assert!((filter.covariance - expected).amax() < 1e-9);
    assert!((before.error_to(&filter.nominal) - error).amax() < 1e-9);
}

#[test]
fn fusion_is_the_joseph_form_followed_by_the_reset() {
    let mut draw = draws();
    for _ in 0..20 {
        check_joseph::<1>(&mut draw);
        check_joseph::<2>(&mut draw);
        check_joseph::<3>(&mut draw);
    }
}

/// The error after the injection of `injected`, as a function of the error before it.
#[test]
fn the_reset_meets_differences() {
    let injected = Vector3::new(0.1, -0.3, 0.2);
    let after = |error: Vector3<f64>| so3::log(&(so3::exp(&injected).inverse() * so3::exp(&error)));
    let reset = so3::right_jacobian(&injected);
    for k in 0..3 {
        let mut d = Vector3::zeros();
        d[k] = 1e-6;
        let column = (after(injected + d) - after(injected - d)) / 2e-6;
        assert!((column - reset.column(k)).norm() < 1e-9);
    }
}

#[test]
fn an_innovation_beyond_the_gate_changes_nothing() {
    let mut draw = draws();
    let mut filter = Filter {
        nominal: draw.nominal(),
        covariance: draw.covariance(),
    };
    let mut seen = draw.seen::<2>();
    seen.innovation *= 1000.0;
    let before = filter.clone();
    assert!(!filter.fuse(&seen, chi_square_quantile(0.999, 2)).accepted);
    assert_eq!(filter, before);
}

#[test]
fn the_covariance_stays_symmetric_and_positive() {
    let mut draw = draws();
    let mut filter = Filter {
        nominal: draw.nominal(),
        covariance: draw.covariance(),
    };
    for _ in 0..2000 {
        filter.propagate(&draw.input(), 0.02, &ImuNoise::default());
        filter.fuse(&draw.seen::<3>(), f64::INFINITY);
        filter.nominal = draw.nominal();
        assert_eq!(filter.covariance, filter.covariance.transpose());
        assert!(filter.covariance.symmetric_eigenvalues().min() > -1e-12);
    }
}

#[test]
fn the_covariance_stays_bounded_without_measurements() {
    let mut draw = draws();
    let mut filter = Filter {
        nominal: draw.nominal(),
        covariance: draw.covariance(),
    };
    let input = draw.input();
    for _ in 0..20_000 {
        filter.propagate(&input, 0.1, &ImuNoise::default());
    }
    assert!(filter.covariance.iter().all(|x| x.abs() < 1.1e8));
}
