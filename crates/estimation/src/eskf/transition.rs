//! The transition matrix as a truncated series of the powers of A (document S, section 2.5.2).

use nalgebra::{Matrix3, Matrix3x4, Matrix4, Matrix4x3, SMatrix};

use super::orientation::Motion;
use super::{Truncation, index};

/// The blocks of F - I that are not zero, `p`, `v`, `o`, `a`, `w` being position, velocity,
/// orientation, accelerometer and gyroscope bias.
///
/// With A = [v <- V o - R a, o <- W o + Q w, p <- v] the powers of A put, for example, V W dt^2/2
/// into `vo` and V Q dt^3/6 into `pw`.
#[derive(Clone, Copy, Debug)]
pub(super) struct TransitionMatrix {
    truncation: Truncation,
    dt_s: f64,
    po: Matrix3x4<f64>,
    pa: Matrix3<f64>,
    pw: Matrix3<f64>,
    vo: Matrix3x4<f64>,
    va: Matrix3<f64>,
    vw: Matrix3<f64>,
    oo: Matrix4<f64>,
    ow: Matrix4x3<f64>,
}

impl TransitionMatrix {
    /// The series of e^(A dt) up to the order of `truncation`.
    pub fn new(motion: &Motion, dt_s: f64, truncation: Truncation) -> Self {
        let v = &motion.velocity_from_orientation;
        let w = &motion.orientation_from_orientation;
        let q = &motion.orientation_from_bias;
        let mut f = Self {
            truncation,
            dt_s,
            po: Matrix3x4::zeros(),
            pa: Matrix3::zeros(),
            pw: Matrix3::zeros(),
            vo: v * dt_s,
            va: motion.velocity_from_bias * dt_s,
            vw: Matrix3::zeros(),
            oo: w * dt_s,
            ow: q * dt_s,
        };
        if truncation >= Truncation::F2 {
            let half = 0.5 * dt_s * dt_s;
            f.po += v * half;
            f.pa += motion.velocity_from_bias * half;
            f.vo += v * w * half;
            f.vw += v * q * half;
            f.oo += w * w * half;
            f.ow += w * q * half;
        }
        if truncation >= Truncation::F3 {
            let sixth = dt_s * dt_s * dt_s / 6.0;
            f.po += v * w * sixth;
            f.pw += v * q * sixth;
            f.vo += v * w * w * sixth;
            f.vw += v * w * q * sixth;
            f.oo += w * w * w * sixth;
            f.ow += w * w * q * sixth;
        }
        f
    }

    /// F times a matrix of any width, by block rows.
    pub fn times<const C: usize>(&self, m: &SMatrix<f64, 16, C>) -> SMatrix<f64, 16, C> {
        let v = m.fixed_rows::<3>(index::VELOCITY);
        let o = m.fixed_rows::<4>(index::ORIENTATION);
        let a = m.fixed_rows::<3>(index::ACCELEROMETER_BIAS);
        let w = m.fixed_rows::<3>(index::GYROSCOPE_BIAS);
        let mut product = *m;
        let mut p_new = product.fixed_rows_mut::<3>(index::POSITION);
        p_new += v * self.dt_s;
        if self.truncation > Truncation::F1 {
            p_new += self.po * o + self.pa * a + self.pw * w;
        }
        let mut v_new = product.fixed_rows_mut::<3>(index::VELOCITY);
        v_new += self.vo * o + self.va * a;
        if self.truncation > Truncation::F1 {
            v_new += self.vw * w;
        }
        let mut o_new = product.fixed_rows_mut::<4>(index::ORIENTATION);
        o_new += self.oo * o + self.ow * w;
        product
    }

    /// F P F^T of a symmetric P: F times the transpose of F P.
    pub fn around(&self, covariance: &SMatrix<f64, 16, 16>) -> SMatrix<f64, 16, 16> {
        self.times(&self.times(covariance).transpose())
    }
}
