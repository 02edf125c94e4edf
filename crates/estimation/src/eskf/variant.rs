//! The choices of document S, table 2.1.

use std::fmt;

use alula_parameters::parameters;
use serde::{Deserialize, Serialize};

/// What the filter estimates, and where its error of orientation lives.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FilterKind {
    /// Error-state filter whose orientation error is in the body: `true = q * exp(error)`
    /// (document S, equation 2.3b, "LE").
    #[default]
    ErrorStateLocal,
    /// Error-state filter whose orientation error is in the world: `true = exp(error) * q`
    /// (document S, equation 2.3a, "GE").
    ErrorStateGlobal,
    /// Extended filter of the state itself: the four numbers of the quaternion are corrected by
    /// addition and brought back to length 1 (document S, section 2.7).
    Extended,
}

/// Which angular rate turns the vehicle between two samples (document S, equation 2.33).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum QuaternionIntegration {
    /// Zeroth order forward: that of the sample before.
    Q0F,
    /// Zeroth order backward: that of the new sample; exact for samples that are means over the
    /// interval before them.
    #[default]
    Q0B,
    /// First order: the rate changes evenly from one sample to the next; exact to second order
    /// for samples that are true at their stamp.
    Q1,
}

/// Highest power of `A dt` in the transition matrix (document S, equation 2.32).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Truncation {
    /// `I + A dt`.
    #[default]
    F1,
    /// and `A^2 dt^2 / 2`.
    F2,
    /// and `A^3 dt^3 / 6`.
    F3,
}

parameters! {
    /// One of the filters of document S, table 2.1.
    #[derive(Copy, Eq)]
    pub struct Variant {
        /// Error-state with local or global orientation error, or extended.
        pub filter: FilterKind = FilterKind::default(), any();
        /// Integration of the quaternion.
        pub integration: QuaternionIntegration = QuaternionIntegration::default(), any();
        /// Truncation of the transition matrix.
        pub transition: Truncation = Truncation::default(), any();
    }
}

impl Variant {
    /// Every combination: 9 extended and 18 error-state filters.
    pub fn all() -> impl Iterator<Item = Self> {
        const KINDS: [FilterKind; 3] = [
            FilterKind::Extended,
            FilterKind::ErrorStateGlobal,
            FilterKind::ErrorStateLocal,
        ];
        const TRUNCATIONS: [Truncation; 3] = [Truncation::F1, Truncation::F2, Truncation::F3];
        const INTEGRATIONS: [QuaternionIntegration; 3] = [
            QuaternionIntegration::Q0F,
            QuaternionIntegration::Q0B,
            QuaternionIntegration::Q1,
        ];
        KINDS.into_iter().flat_map(|filter| {
            TRUNCATIONS.into_iter().flat_map(move |transition| {
                INTEGRATIONS.into_iter().map(move |integration| Self {
                    filter,
                    integration,
                    transition,
                })
            })
        })
    }
}

/// As in the head of document S, table 2.2: `ESKF F1 Q0F LE`.
impl fmt::Display for Variant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (kind, frame) = match self.filter {
            FilterKind::ErrorStateLocal => ("ESKF", " LE"),
            FilterKind::ErrorStateGlobal => ("ESKF", " GE"),
            FilterKind::Extended => ("EKF", ""),
        };
        write!(
            f,
            "{kind} {:?} {:?}{frame}",
            self.transition, self.integration
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn there_are_twenty_seven_and_each_has_its_name() {
        let names: BTreeSet<String> = Variant::all().map(|v| v.to_string()).collect();
        assert_eq!((Variant::all().count(), names.len()), (27, 27));
        assert!(names.contains("EKF F1 Q0B") && names.contains("ESKF F3 Q1 GE"));
    }
}
