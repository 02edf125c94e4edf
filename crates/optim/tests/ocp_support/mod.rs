//! Random stage programs, for the tests and benchmarks of optimal control.

// Not every test uses every helper.
#![allow(dead_code)]

pub mod mover;

use alula_optim::ocp::{SoftConstraint, StageCost, StageQp, Step};
use nalgebra::{SMatrix, SVector};

/// Numbers that look random, always the same (splitmix64).
pub struct Numbers(pub u64);

impl Numbers {
    /// Between -1 and 1.
    pub fn signed(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^= z >> 31;
        (z >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    /// Between 0 and 1.
    pub fn unit(&mut self) -> f64 {
        0.5 + 0.5 * self.signed()
    }

    /// Entries between -1 and 1.
    pub fn matrix<const R: usize, const C: usize>(&mut self) -> SMatrix<f64, R, C> {
        SMatrix::from_fn(|_, _| self.signed())
    }
}

/// A random program. `spread` scales what the states are drawn to and pushed by, and with it how
/// many bounds and constraints are active.
pub fn random_qp<const NX: usize, const NU: usize>(
    numbers: &mut Numbers,
    intervals: usize,
    constraints: usize,
    spread: f64,
) -> StageQp<NX, NU> {
    let mut qp = StageQp::new(intervals, constraints);
    qp.initial = numbers.matrix::<NX, 1>() * spread;
    let a = SMatrix::<f64, NX, NX>::identity() * (0.8 + 0.3 * numbers.unit())
        + numbers.matrix::<NX, NX>() * (0.5 / NX as f64);
    let b = numbers.matrix::<NX, NU>();
    for k in 0..intervals {
        qp.steps[k] = Step {
            next: numbers.matrix::<NX, 1>() * (0.1 * spread),
            a: a + numbers.matrix::<NX, NX>() * 0.02,
            b: b + numbers.matrix::<NX, NU>() * 0.1,
        };
        let bound = || SVector::<f64, NU>::repeat(1.0);
        let room = numbers.matrix::<NU, 1>() * 0.5;
        qp.bounds[k] = (room - bound(), room + bound());
    }
    for k in 0..=intervals {
        qp.costs[k] = random_cost(numbers, spread);
        for _ in 0..constraints {
            qp.constraints[k].push(random_constraint(numbers, spread));
        }
    }
    qp
}

fn random_cost<const NX: usize, const NU: usize>(
    numbers: &mut Numbers,
    spread: f64,
) -> StageCost<NX, NU> {
    // One square of a root over states and inputs keeps the whole curvature semi-definite.
    let (x, u) = (numbers.matrix::<NX, NX>(), numbers.matrix::<NX, NU>() * 0.3);
    StageCost {
        value: numbers.signed(),
        x: numbers.matrix::<NX, 1>() * spread,
        u: numbers.matrix::<NU, 1>(),
        xx: x.tr_mul(&x) * 0.2,
        ux: u.tr_mul(&x) * 0.2,
        uu: u.tr_mul(&u) * 0.2 + SMatrix::identity() * 0.1,
    }
}

fn random_constraint<const NX: usize>(numbers: &mut Numbers, spread: f64) -> SoftConstraint<NX> {
    SoftConstraint {
        value: numbers.signed() * spread,
        gradient: numbers.matrix::<NX, 1>(),
        linear: 20.0 * numbers.unit(),
        quadratic: 20.0 * numbers.unit(),
    }
}
