//! Shards: the tasks of a campaign dealt out to machines that do not know each other.

use std::str::FromStr;

/// Part `index` of `count`: the tasks whose number leaves the remainder `index` when divided by
/// `count`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    index: u64,
    count: u64,
}

impl Shard {
    /// The whole campaign.
    pub const WHOLE: Self = Self { index: 0, count: 1 };

    /// Whether a task belongs to it.
    pub fn holds(self, task: u64) -> bool {
        task % self.count == self.index
    }

    /// Name of its file of rows.
    pub(super) fn file_name(self) -> String {
        match self {
            Self::WHOLE => "rows.jsonl".to_owned(),
            Self { index, count } => format!("rows-{index}-of-{count}.jsonl"),
        }
    }
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts = text
            .split_once('/')
            .and_then(|(index, count)| Some((index.parse().ok()?, count.parse().ok()?)));
        match parts {
            Some((index, count)) if index < count => Ok(Self { index, count }),
            _ => Err("expected I/K with I from 0 to K - 1, for example 0/4".to_owned()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_task_belongs_to_one_shard() {
        let shards: Vec<Shard> = (0..3).map(|i| format!("{i}/3").parse().unwrap()).collect();
        for task in 0..10 {
            assert_eq!(shards.iter().filter(|s| s.holds(task)).count(), 1);
        }
    }

    #[test]
    fn shards_beyond_their_count_are_refused() {
        for text in ["3/3", "0/0", "1", "a/2", "-1/2", "1/2/3"] {
            assert!(text.parse::<Shard>().is_err(), "{text}");
        }
    }
}
