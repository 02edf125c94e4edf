//! Rules: how long a finding must last, what follows, and when it is over.

use alula_geometry::Timestamp;
use alula_messages::{Fallback, Finding};

/// What follows after a finding has lasted for a time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stage {
    pub(crate) after_s: f64,
    pub(crate) fallback: Fallback,
}

/// The stages of a rule; unused ones follow after an infinite time.
pub(crate) type Stages = [Stage; 3];

/// Builds [`Stages`] from pairs of time and fallback.
pub(crate) fn stages(pairs: &[(f64, Fallback)]) -> Stages {
    let unused = Stage {
        after_s: f64::INFINITY,
        fallback: Fallback::None,
    };
    std::array::from_fn(|i| {
        pairs
            .get(i)
            .map_or(unused, |&(after_s, fallback)| Stage { after_s, fallback })
    })
}

/// Watches one rule over time.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Watch {
    began: Option<Timestamp>,
    last: Timestamp,
    fallback: Fallback,
    finding: Option<Finding>,
}

impl Watch {
    /// Takes what one step has found. Before the first stage one good step resets the time; from
    /// then on only `release_s` of good steps do.
    pub(crate) fn update(
        &mut self,
        now: Timestamp,
        found: Option<Finding>,
        stages: &Stages,
        release_s: f64,
    ) {
        if found.is_some() {
            let began = *self.began.get_or_insert(now);
            self.last = now;
            self.finding = found;
            self.escalate(now.seconds_since(began), stages);
        } else if self.fallback == Fallback::None || now.seconds_since(self.last) >= release_s {
            *self = Self::default();
        }
    }

    fn escalate(&mut self, lasted_s: f64, stages: &Stages) {
        for stage in stages {
            if lasted_s >= stage.after_s {
                self.fallback = self.fallback.max(stage.fallback);
            }
        }
    }

    /// What the rule demands.
    pub(crate) fn fallback(&self) -> Fallback {
        self.fallback
    }

    /// The latest finding, once it has lasted long enough to have a consequence.
    pub(crate) fn finding(&self) -> Option<Finding> {
        self.finding.filter(|_| self.fallback != Fallback::None)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alula_messages::Violation;

    const BROKEN: Option<Finding> = Some(Finding {
        violation: Violation::Speed,
        found: 5.0,
        limit: 4.0,
    });

    fn run(watch: &mut Watch, from_s: f64, to_s: f64, found: Option<Finding>) -> Fallback {
        let rule = stages(&[(0.2, Fallback::Hold), (1.0, Fallback::Land)]);
        for k in (from_s * 100.0).round() as i64..=(to_s * 100.0).round() as i64 {
            watch.update(Timestamp::from_ns(k * 10_000_000), found, &rule, 0.5);
        }
        watch.fallback()
    }

    #[test]
    fn a_short_finding_has_no_consequence() {
        let mut watch = Watch::default();
        assert_eq!(run(&mut watch, 0.0, 0.19, BROKEN), Fallback::None);
        assert_eq!(run(&mut watch, 0.2, 0.2, None), Fallback::None);
        assert_eq!(run(&mut watch, 0.21, 0.4, BROKEN), Fallback::None);
    }

    #[test]
    fn a_lasting_finding_escalates() {
        let mut watch = Watch::default();
        assert_eq!(run(&mut watch, 0.0, 0.2, BROKEN), Fallback::Hold);
        assert_eq!(run(&mut watch, 0.21, 1.0, BROKEN), Fallback::Land);
    }

    #[test]
    fn release_needs_a_time_without_findings() {
        let mut watch = Watch::default();
        run(&mut watch, 0.0, 0.2, BROKEN);
        assert_eq!(run(&mut watch, 0.21, 0.69, None), Fallback::Hold);
        assert_eq!(run(&mut watch, 0.7, 0.7, None), Fallback::None);
    }
}
