//! Studies: tables and figures of the source documents, measured anew and put beside theirs.
//!
//! A study is a function from a [`Request`] to [`Results`]: rows of figures, what is demanded of
//! them, and charts as plain data. It draws and prints nothing.

mod anees;
mod bias_observability;
mod chance_constraint;
mod chart;
mod delayed_poses;
mod depth_office;
mod euroc_variants;
mod long_loops;
mod obstacle_tracking;
mod odometry;
mod odometry_variants;
mod results;
mod velocity;

use std::env;
use std::num::NonZeroUsize;
use std::path::PathBuf;

pub use chart::{Chart, Curve, CurveBand, CurveStyle, Frame, Outline, StudyBar, Tone};
pub use results::{Bound, Column, Demand, Results, Row};

use crate::campaign::pool;
use crate::config::ConfigText;
use crate::flight::{self, Outcome, RecordTo};
use crate::{RunError, Scenario};

/// Name of the environment variable with the folder of recorded data.
const DATA_VARIABLE: &str = "ALULA_DATA";

/// All studies, in the order of the documents.
const STUDIES: &[Study] = &[
    delayed_poses::STUDY,
    velocity::STUDY,
    odometry_variants::STUDY,
    bias_observability::STUDY,
    anees::STUDY,
    euroc_variants::STUDY,
    long_loops::STUDY,
    depth_office::STUDY,
    obstacle_tracking::STUDY,
    chance_constraint::STUDY,
];

/// Something that a source document measured and that can be measured here.
#[derive(Debug)]
pub struct Study {
    /// Its name on the command line.
    pub name: &'static str,
    /// Document and section, table or figure.
    pub source: &'static str,
    /// What it shows, in one line.
    pub about: &'static str,
    /// What one run is, in the plural, for the progress: `flights`, `images`.
    pub runs_are: &'static str,
    /// Number of runs if none is asked for.
    pub default_runs: u64,
    /// Measures it.
    execute: fn(&Request, &Watch) -> Result<Results, RunError>,
}

/// What is asked of a study.
#[derive(Clone, Copy, Debug)]
pub struct Request {
    /// Seed of everything random; the runs count up from it.
    pub seed: u64,
    /// Number of runs.
    pub runs: u64,
    /// Runs at a time.
    pub jobs: NonZeroUsize,
}

/// How far a study is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// Tasks that are over.
    pub done: u64,
    /// All tasks.
    pub asked: u64,
}

/// Is told how far a study is, from any thread.
pub type Watch<'a> = dyn Fn(Progress) + Sync + 'a;

impl Study {
    /// All of them.
    pub fn all() -> &'static [Study] {
        STUDIES
    }

    /// The one with this name.
    ///
    /// # Errors
    /// When there is none; the message lists those that there are.
    pub fn find(name: &str) -> Result<&'static Study, RunError> {
        let found = STUDIES.iter().find(|study| study.name == name);
        found.ok_or_else(|| RunError::Input {
            what: name.to_owned(),
            finding: "there is no study of this name".into(),
            remedy: format!("There are: {}", names().join(", ")),
        })
    }

    /// Measures it; `runs` of the request replaces the usual number of runs.
    ///
    /// # Errors
    /// When its data are missing, or a run of it is not possible.
    pub fn execute(&self, request: &Request, watch: &Watch) -> Result<Results, RunError> {
        (self.execute)(request, watch)
    }
}

fn names() -> Vec<&'static str> {
    STUDIES.iter().map(|study| study.name).collect()
}

impl Request {
    /// The seeds of the runs.
    pub fn seeds(&self) -> Vec<u64> {
        (0..self.runs).map(|i| self.seed.wrapping_add(i)).collect()
    }

    /// Does `work` for each task on all the threads allowed, tells how far it is after each, and
    /// returns the results in the order of the tasks. The first error ends it all.
    ///
    /// # Errors
    /// The first one of `work`.
    pub fn do_all<T: Send>(
        &self,
        tasks: &[u64],
        watch: &Watch,
        work: &(dyn Fn(u64) -> Result<T, RunError> + Sync),
    ) -> Result<Vec<T>, RunError> {
        let asked = tasks.len() as u64;
        let places: Vec<u64> = (0..asked).collect();
        let mut results: Vec<Option<T>> = tasks.iter().map(|_| None).collect();
        let mut done = 0;
        watch(Progress { done, asked });
        pool::for_each(
            &places,
            self.jobs,
            &|place| (place, work(tasks[place as usize])),
            |(place, result)| {
                results[place as usize] = Some(result?);
                done += 1;
                watch(Progress { done, asked });
                Ok(())
            },
        )?;
        Ok(results.into_iter().flatten().collect())
    }
}

/// The scenario that comes with a study, with overrides.
fn built_in(text: &str, overrides: &[String]) -> Result<Scenario, RunError> {
    let text = ConfigText {
        file: "the scenario of the study".to_owned(),
        text: text.to_owned(),
    };
    Scenario::parse(text.with_overrides(overrides)?, PathBuf::new())
}

/// What was looked at in a flight, and how it ended.
struct Tape<T> {
    instants: Vec<T>,
    reached: bool,
    path_m: f64,
}

impl<T> Tape<T> {
    /// Flies, and keeps what `look` finds in each step.
    fn of(
        scenario: &Scenario,
        seed: u64,
        look: impl Fn(&flight::Progress) -> Option<T>,
    ) -> Result<Self, RunError> {
        let mut instants = Vec::new();
        let mut note = |progress: &flight::Progress| instants.extend(look(progress));
        let flight = flight::fly(scenario, seed, &RecordTo::Nothing, &mut note)?;
        Ok(Self {
            instants,
            reached: flight.summary.outcome == Outcome::Reached,
            path_m: flight.summary.path_length_m,
        })
    }
}

/// A folder of recorded data.
///
/// # Errors
/// When it is not there, with how to get it.
pub fn data_folder(name: &str, how_to_get_it: &str) -> Result<PathBuf, RunError> {
    let remedy = format!("{how_to_get_it}, and let {DATA_VARIABLE} name the folder that holds it");
    let input_error = |what: String, finding: &str| RunError::Input {
        what,
        finding: finding.into(),
        remedy: remedy.clone(),
    };
    let Some(root) = env::var_os(DATA_VARIABLE) else {
        return Err(input_error(
            name.to_owned(),
            &format!("the environment variable {DATA_VARIABLE} is not set"),
        ));
    };
    let folder = PathBuf::from(root).join(name);
    if folder.is_dir() {
        Ok(folder)
    } else {
        Err(input_error(
            folder.display().to_string(),
            "there is no such folder",
        ))
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU64, Ordering};

    use super::*;

    fn request(runs: u64, jobs: usize) -> Request {
        Request {
            seed: 5,
            runs,
            jobs: NonZeroUsize::new(jobs).unwrap(),
        }
    }

    #[test]
    fn results_come_in_the_order_of_the_tasks() {
        let request = request(50, 3);
        let told = AtomicU64::new(0);
        let watch = |progress: Progress| {
            told.fetch_max(progress.done, Ordering::Relaxed);
        };
        let squares = request.do_all(&request.seeds(), &watch, &|seed| Ok(seed * seed));
        let expected: Vec<u64> = (5..55).map(|seed| seed * seed).collect();
        assert_eq!(squares.unwrap(), expected);
        assert_eq!(told.into_inner(), 50);
    }

    #[test]
    fn an_error_of_a_run_is_that_of_the_study() {
        let request = request(9, 2);
        let result = request.do_all(&request.seeds(), &|_| {}, &|seed| match seed {
            7 => Err(Study::find("nothing of this name").unwrap_err()),
            seed => Ok(seed),
        });
        assert!(result.unwrap_err().to_string().contains("no study"));
    }

    #[test]
    fn names_are_different() {
        let mut names = names();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), STUDIES.len());
    }
}
