//! A campaign: one scenario flown with many seeds.
//!
//! A flight is a pure function of the resolved scenario and a seed, so a campaign is a set of tasks
//! by number: task `i` is the flight with seed `first_seed + i`. Tasks may run anywhere and in any
//! order. Each leaves one line in a file of rows, written whole when the flight is over; what is
//! not in a file has not been flown. Resuming, sharding and merging follow from that alone.

mod folder;
mod frozen;
mod interval;
mod merge;
pub(crate) mod pool;
mod refly;
mod row;
mod rows_file;
mod shard;
mod summary;
mod table;

use std::collections::{BTreeMap, BTreeSet};
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

pub use folder::Facts;
pub use interval::clopper_pearson_95;
pub use merge::merge;
pub use refly::{Difference, Refly, flight_folder};
pub use row::Row;
pub use shard::Shard;
pub use summary::{CampaignSummary, ClearanceFigures, TimingFigures};

use crate::{RunError, Scenario, make_folder};
use frozen::FrozenScenario;

/// Worlds of this many seeds are tried before a scenario is refused for good.
const WORLDS_TRIED: u64 = 10;

/// A campaign and the folder that holds all of it.
#[derive(Clone, Debug)]
pub struct Campaign {
    folder: PathBuf,
    facts: Facts,
    scenario: Scenario,
}

/// What a campaign is asked to be.
#[derive(Clone, Copy, Debug)]
pub struct Request<'a> {
    /// Scenario file; the built-in one if absent, or the folder's own if there are no overrides
    /// either.
    pub scenario: Option<&'a Path>,
    /// Changes to its keys.
    pub overrides: &'a [String],
    /// Number of flights; the folder's own if absent.
    pub runs: Option<u64>,
    /// Seed of the first flight; the folder's own, or else 1, if absent.
    pub first_seed: Option<u64>,
    /// The folder; `out/NAME-campaign` if absent.
    pub folder: Option<&'a Path>,
}

/// How many of the flights that a command flies are over.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Flights asked for.
    pub asked: u64,
    /// Flights that are over, those of earlier commands included.
    pub flown: u64,
    /// Of these, how many reached their goal.
    pub reached: u64,
    /// Of these, how many collided.
    pub collided: u64,
}

impl Tally {
    fn add(&mut self, row: &Row) {
        self.flown += 1;
        self.reached += u64::from(row.reached());
        self.collided += u64::from(row.collisions() > 0);
    }

    /// Whether every flight was flown and reached its goal.
    pub fn all_reached(&self) -> bool {
        self.reached == self.asked
    }
}

impl Campaign {
    /// Begins a campaign, or takes up the one that the folder holds.
    ///
    /// # Errors
    /// When the scenario is not allowed, or the folder holds another campaign.
    pub fn begin(request: &Request) -> Result<Self, RunError> {
        let own = request
            .folder
            .filter(|folder| folder::is_campaign(folder) && request.overrides.is_empty())
            .map(|folder| folder.join(folder::SCENARIO));
        let scenario =
            FrozenScenario::load(request.scenario.or(own.as_deref()), request.overrides)?;
        let folder = match request.folder {
            Some(folder) => folder.to_path_buf(),
            None => Path::new("out").join(format!("{}-campaign", scenario.name)),
        };
        if folder::is_campaign(&folder) {
            Self::open(&folder)?.take_up(request, &scenario)
        } else {
            Self::start(request, &scenario, folder)
        }
    }

    /// The campaign that a folder holds.
    ///
    /// # Errors
    /// When it holds none, or one that was changed by hand.
    pub fn open(folder: &Path) -> Result<Self, RunError> {
        let (facts, scenario) = folder::read(folder)?;
        Ok(Self {
            folder: folder.to_path_buf(),
            facts,
            scenario,
        })
    }

    fn start(
        request: &Request,
        scenario: &FrozenScenario,
        folder: PathBuf,
    ) -> Result<Self, RunError> {
        let Some(runs) = request.runs else {
            return Err(RunError::Input {
                what: folder.display().to_string(),
                finding: "holds no campaign yet, and the number of flights is not given".into(),
                remedy: "Say how many: --runs N".into(),
            });
        };
        let facts = Facts {
            scenario: scenario.name.clone(),
            digest: scenario.digest.clone(),
            first_seed: request.first_seed.unwrap_or(1),
            runs,
            version: crate::VERSION.to_owned(),
        };
        facts.check_seeds()?;
        check_worlds(&scenario.scenario, facts.first_seed, runs)?;
        make_folder(&folder)?;
        folder::write(&folder, &facts, scenario)?;
        Self::open(&folder)
    }

    /// Goes on with this campaign if it is the one that was asked for, with more flights if so
    /// asked.
    fn take_up(mut self, request: &Request, wanted: &FrozenScenario) -> Result<Self, RunError> {
        folder::check_same_scenario(&self.folder, wanted)?;
        self.facts
            .check_request(&self.folder, request.runs, request.first_seed)?;
        if request.runs.is_some_and(|runs| runs > self.facts.runs) {
            self.facts.runs = request.runs.unwrap_or(self.facts.runs);
            self.facts.check_seeds()?;
            folder::write_facts(&self.folder, &self.facts)?;
        }
        Ok(self)
    }

    /// What identifies it.
    pub fn facts(&self) -> &Facts {
        &self.facts
    }

    /// Where it lives.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// What it flies.
    pub fn scenario(&self) -> &Scenario {
        &self.scenario
    }

    /// The rows of all flights so far, by seed.
    ///
    /// # Errors
    /// When a file of rows cannot be read, or two rows of one seed differ.
    pub fn rows(&self) -> Result<BTreeMap<u64, Row>, RunError> {
        rows_file::read_all(&self.folder)
    }

    /// Flies what is missing of a shard, `jobs` flights at a time, and appends a row for each as
    /// soon as it is over. `watch` is called before the first flight and after each.
    ///
    /// # Errors
    /// When rows cannot be read or written, or another process flies the same shard.
    pub fn fly_missing(
        &self,
        shard: Shard,
        jobs: NonZeroUsize,
        watch: &mut dyn FnMut(&Tally),
    ) -> Result<Tally, RunError> {
        let mut file = rows_file::RowsFile::open(&self.folder, shard)?;
        let rows = self.rows()?;
        let asked: BTreeSet<u64> = self.seeds(shard).collect();
        let mut tally = Tally {
            asked: asked.len() as u64,
            ..Tally::default()
        };
        for (_, row) in rows.iter().filter(|(seed, _)| asked.contains(seed)) {
            tally.add(row);
        }
        watch(&tally);
        let missing: Vec<u64> = asked
            .into_iter()
            .filter(|s| !rows.contains_key(s))
            .collect();
        drop(rows);
        pool::for_each(
            &missing,
            jobs,
            &|seed| row::fly(&self.scenario, seed),
            |row| {
                file.append(&row)?;
                tally.add(&row);
                watch(&tally);
                Ok(())
            },
        )?;
        Ok(tally)
    }

    fn seeds(&self, shard: Shard) -> impl Iterator<Item = u64> {
        let first_seed = self.facts.first_seed;
        (0..self.facts.runs)
            .filter(move |i| shard.holds(*i))
            .map(move |i| first_seed + i)
    }

    /// Writes the table of all flights so far and their summary, and returns the summary.
    ///
    /// # Errors
    /// When rows cannot be read or files not be written.
    pub fn conclude(&self) -> Result<CampaignSummary, RunError> {
        let rows = self.rows()?;
        let summary = CampaignSummary::of(&self.facts, rows.values());
        folder::write_whole(
            &self.folder.join(folder::TABLE),
            table::to_csv(rows.values()).as_bytes(),
        )?;
        let json = serde_json::to_vec_pretty(&summary).unwrap_or_default();
        folder::write_whole(&self.folder.join(folder::SUMMARY), &json)?;
        Ok(summary)
    }
}

/// Whether a folder holds a campaign.
pub fn is_campaign(folder: &Path) -> bool {
    folder::is_campaign(folder)
}

/// The rows of a campaign's folder, by seed.
///
/// # Errors
/// When the folder holds no campaign or its rows cannot be read.
pub fn read_rows(folder: &Path) -> Result<Vec<Row>, RunError> {
    let rows = Campaign::open(folder)?.rows()?;
    Ok(rows.into_values().collect())
}

/// Refuses a scenario in whose world no seed can fly. A world that is impossible for some seeds
/// only is a finding about these flights.
fn check_worlds(scenario: &Scenario, first_seed: u64, runs: u64) -> Result<(), RunError> {
    let mut last = Ok(());
    for seed in (first_seed..first_seed + runs.min(WORLDS_TRIED)).rev() {
        last = scenario.build_world(seed).map(|_| ());
        if last.is_ok() {
            break;
        }
    }
    last
}
