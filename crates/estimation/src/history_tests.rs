use super::*;
use crate::eskf::Nominal;
use crate::measurement::PositionMeasurement;
use alula_geometry::TimeDelta;

fn ms(ms: i64) -> Timestamp {
    Timestamp::from_ns(ms * 1_000_000)
}

fn imu(time: Timestamp) -> ImuSample {
    let t = time.as_s();
    ImuSample {
        time,
        specific_force: Vector3::new(t.sin(), (2.0 * t).cos(), 9.8),
        angular_rate: Vector3::new(0.3 * t.cos(), 0.2, -0.1 * t),
    }
}

/// A history that starts at 0 ms and has a sample each 4 ms up to `last`.
fn history(capacity: usize, last: i64) -> History {
    let mut history = History::new(capacity, ImuNoise::default(), Gates::new(0.999));
    let first = imu(ms(0));
    let input = InertialInput::steady(first.specific_force, first.angular_rate);
    let sigma = [0.1, 0.1, 0.1, 0.02, 0.01].map(Vector3::repeat);
    history.start(ms(0), input, Filter::new(Nominal::default(), sigma));
    extend(&mut history, 0, last);
    history
}

fn extend(history: &mut History, from: i64, to: i64) {
    for i in from / 4 + 1..=to / 4 {
        history.push(&imu(ms(4 * i)), 1.0, &mut |_| {});
    }
}

fn position(x: f64) -> Measurement {
    Measurement::Position(PositionMeasurement {
        position_world: Vector3::new(x, 0.0, 0.0),
        sigma_m: 0.05,
    })
}

fn settled(mut history: History) -> Filter {
    history.settle(&mut |_| {});
    history.latest().unwrap().0.clone()
}

#[test]
fn a_late_measurement_does_what_it_would_have_done_in_time() {
    let mut in_time = history(100, 40);
    in_time.insert(ms(38), position(0.1)).unwrap();
    in_time.settle(&mut |_| {});
    extend(&mut in_time, 40, 200);

    let mut late = history(100, 200);
    late.settle(&mut |_| {});
    late.insert(ms(38), position(0.1)).unwrap();
    assert_eq!(settled(late), settled(in_time));
}

#[test]
fn the_order_of_arrival_does_not_matter() {
    let run = |order: [i64; 3]| {
        let mut history = history(100, 200);
        for time in order {
            history
                .insert(ms(time), position(0.001 * time as f64))
                .unwrap();
            history.settle(&mut |_| {});
        }
        settled(history)
    };
    let expected = run([20, 90, 150]);
    assert_eq!(run([150, 20, 90]), expected);
    assert_eq!(run([90, 150, 20]), expected);
}

#[test]
fn each_measurement_is_reported_once() {
    let mut history = history(100, 200);
    let mut reported = Vec::new();
    for time in [150, 20, 90] {
        history.insert(ms(time), position(0.0)).unwrap();
        history.settle(&mut |fusion| reported.push(fusion.time));
    }
    assert_eq!(reported, [ms(150), ms(20), ms(90)]);
}

#[test]
fn a_measurement_older_than_the_ring_is_refused() {
    let mut history = history(10, 200);
    assert_eq!(
        history.insert(ms(160), position(0.0)),
        Err(Rejection::TooOld)
    );
    assert_eq!(history.insert(ms(165), position(0.0)), Ok(()));
}

#[test]
fn the_same_measurement_twice_is_refused() {
    let mut history = history(100, 200);
    history.insert(ms(90), position(0.0)).unwrap();
    assert_eq!(
        history.insert(ms(90), position(0.0)),
        Err(Rejection::OutOfOrder)
    );
}

#[test]
fn a_ring_that_overflows_between_settlings_loses_nothing() {
    let mut small = history(10, 20);
    small.insert(ms(14), position(0.1)).unwrap();
    let mut fused = 0;
    for i in 6..100 {
        small.push(&imu(ms(4 * i)), 1.0, &mut |_| fused += 1);
    }
    assert_eq!(fused, 1);
    let mut large = history(200, 20);
    large.insert(ms(14), position(0.1)).unwrap();
    extend(&mut large, 20, 396);
    assert_eq!(settled(small), settled(large));
}

/// The mean of readings that hold since the sample before: 1 ms of the sample at 8 ms, 4 ms of
/// that at 12 ms, 2 ms of that at 16 ms.
#[test]
fn the_mean_angular_rate_weighs_by_overlap() {
    let history = history(100, 40);
    let found = history.mean_angular_rate(ms(7), ms(14)).unwrap();
    let rate = |t| imu(ms(t)).angular_rate;
    let expected = (rate(8) + rate(12) * 4.0 + rate(16) * 2.0) / 7.0;
    assert!((found - expected).norm() < 1e-15);
    assert!(history.mean_angular_rate(ms(50), ms(60)).is_none());
}

/// Cutting an interval leaves attitude as it is and velocity up to terms in dt^3: here
/// 10 m/s^2 * (0.4 rad/s)^2 * (4 ms)^3 = 1e-7 m/s.
#[test]
fn a_measurement_without_weight_changes_nothing() {
    let whole = settled(history(100, 200));
    let mut cut = history(100, 200);
    let weightless = Measurement::Position(PositionMeasurement {
        position_world: Vector3::zeros(),
        sigma_m: 1e6,
    });
    cut.insert(ms(101) + TimeDelta::from_ns(300_000), weightless)
        .unwrap();
    let difference = whole.nominal.error_to(&settled(cut).nominal);
    assert!(difference.norm() < 1e-7, "{difference}");
}
