//! Recorded tracks of people: `t_s,id,x_m,y_m`, one place a line.

use std::collections::BTreeMap;

use nalgebra::{Rotation2, Vector2};

use super::WorldError;
use super::config::{AfterEnd, TrackConfig};
use super::people::Step;

/// The columns of a file of tracks.
const HEADER: [&str; 4] = ["t_s", "id", "x_m", "y_m"];

/// The track of one person: places at increasing times, straight lines between.
#[derive(Clone, Debug)]
pub(super) struct Track {
    samples: Vec<(f64, Vector2<f64>)>,
    /// Heading in each interval between samples, rad.
    headings: Vec<f64>,
    /// Time of the recording at the start of the simulation, s.
    start_s: f64,
    /// First and last time of the recording, if it repeats.
    span_s: Option<(f64, f64)>,
}

impl Track {
    fn new(samples: Vec<(f64, Vector2<f64>)>, start_s: f64, span_s: Option<(f64, f64)>) -> Self {
        let mut yaw = 0.0;
        let mut headings: Vec<f64> = samples
            .windows(2)
            .map(|pair| {
                let step = pair[1].1 - pair[0].1;
                // Who stands keeps looking the way they came.
                if step.norm() > 0.0 {
                    yaw = step.y.atan2(step.x);
                }
                yaw
            })
            .collect();
        headings.push(yaw);
        Self {
            samples,
            headings,
            start_s,
            span_s,
        }
    }

    /// First and last time of the simulation at which the person is there, s; outside of it never.
    pub fn presence_s(&self) -> (f64, f64) {
        match (self.span_s, self.samples.first(), self.samples.last()) {
            (None, Some((first, _)), Some((last, _))) => {
                (first - self.start_s, last - self.start_s)
            }
            _ => (f64::NEG_INFINITY, f64::INFINITY),
        }
    }

    /// Where the person is; `None` before the first sample and after the last.
    pub fn at(&self, time_s: f64) -> Option<Step> {
        let mut t = time_s + self.start_s;
        if let Some((first, last)) = self.span_s
            && t > last
        {
            t = first + (t - first).rem_euclid(last - first);
        }
        let next = self.samples.partition_point(|(sample, _)| *sample <= t);
        let (from_s, from) = *self.samples.get(next.checked_sub(1)?)?;
        let yaw_rad = self.headings[next - 1];
        let Some(&(to_s, to)) = self.samples.get(next) else {
            // At the very last sample the person is still there.
            return (t == from_s).then(|| Step {
                place: from,
                velocity: Vector2::zeros(),
                yaw_rad,
            });
        };
        let velocity = (to - from) / (to_s - from_s);
        Some(Step {
            place: from + velocity * (t - from_s),
            velocity,
            yaw_rad,
        })
    }
}

/// Reads the tracks that a config asks for, by increasing id.
pub(super) fn read(
    config: &TrackConfig,
    bytes: &[u8],
    key: &str,
) -> Result<Vec<(u64, Track)>, WorldError> {
    let mut by_id = parse(config, bytes, key)?;
    if let Some(ids) = &config.ids {
        if let Some(missing) = ids.iter().find(|id| !by_id.contains_key(id)) {
            let finding = format!(
                "`ids` names {missing}, which `{}` does not have",
                config.file
            );
            return Err(WorldError::degenerate(key, finding, "name ids of the file"));
        }
        by_id.retain(|id, _| ids.contains(id));
    }
    let times = || by_id.values().flatten().map(|(t, _)| *t);
    let first = times().fold(f64::INFINITY, f64::min);
    let last = times().fold(f64::NEG_INFINITY, f64::max);
    let span_s = match config.after_end {
        AfterEnd::Vanish => None,
        AfterEnd::Repeat if last > first => Some((first, last)),
        AfterEnd::Repeat => {
            let finding = format!("the tracks in `{}` last no time", config.file);
            return Err(WorldError::degenerate(key, finding, "do not repeat them"));
        }
    };
    let track = |(id, samples)| (id, Track::new(samples, config.start_s, span_s));
    Ok(by_id.into_iter().map(track).collect())
}

type Samples = BTreeMap<u64, Vec<(f64, Vector2<f64>)>>;

/// All samples of a file, by id.
fn parse(config: &TrackConfig, bytes: &[u8], key: &str) -> Result<Samples, WorldError> {
    let error = |line: u64, finding: String, remedy: &str| WorldError::Track {
        key: key.into(),
        file: config.file.clone(),
        line,
        finding,
        remedy: remedy.into(),
    };
    let turn = Rotation2::new(config.yaw_deg.to_radians());
    let mut lines = (1..).zip(bytes.split(|&byte| byte == b'\n'));
    let mut by_id = Samples::new();
    let header = lines.next().map_or(Ok(Vec::new()), |(_, line)| split(line));
    let header = header.map_err(|(f, r)| error(1, f, r))?;
    if header != HEADER {
        let finding = format!("found the header `{}`", header.join(","));
        return Err(error(1, finding, "expected `t_s,id,x_m,y_m`"));
    }
    for (number, line) in lines {
        if line.trim_ascii().is_empty() {
            continue;
        }
        let (t, id, place) = split(line)
            .and_then(|f| fields(&f))
            .map_err(|(f, r)| error(number, f, r))?;
        let samples = by_id.entry(id).or_default();
        if let Some((before, _)) = samples.last()
            && *before >= t
        {
            let finding = format!("time {t} s of id {id} does not come after {before} s");
            return Err(error(
                number,
                finding,
                "expected the times of an id to increase",
            ));
        }
        samples.push((t, turn * place + Vector2::from(config.offset_m)));
    }
    if by_id.is_empty() {
        let finding = "there is no line after the header".into();
        return Err(error(1, finding, "expected lines such as `0.4,1,2.5,-1.0`"));
    }
    Ok(by_id)
}

/// What is wrong with a line, and what is expected.
type Finding = (String, &'static str);

/// The fields of a line, without the spaces round them.
fn split(line: &[u8]) -> Result<Vec<&str>, Finding> {
    let text = std::str::from_utf8(line)
        .map_err(|e| (format!("found no text: {e}"), "expected text in UTF-8"))?;
    Ok(text.split(',').map(str::trim).collect())
}

/// Time, id and place of a line.
fn fields(record: &[&str]) -> Result<(f64, u64, Vector2<f64>), Finding> {
    if record.len() != HEADER.len() {
        let finding = format!("found {} fields", record.len());
        return Err((finding, "expected four: `t_s,id,x_m,y_m`"));
    }
    let number = |i: usize| {
        let value = record[i].parse::<f64>().ok().filter(|x| x.is_finite());
        let finding = || format!("found `{}` for {}", record[i], HEADER[i]);
        value.ok_or_else(|| (finding(), "expected a finite number"))
    };
    let id = record[1].parse::<u64>().map_err(|_| {
        let finding = format!("found `{}` for id", record[1]);
        (finding, "expected a whole number, 0 or greater")
    })?;
    Ok((number(0)?, id, Vector2::new(number(2)?, number(3)?)))
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "t_s,id,x_m,y_m\n0.0,7,0.0,0.0\n0.0,3,5.0,5.0\n2.0,7,2.0,0.0\n3.0,7,2.0,0.0\n5.0,7,2.0,4.0\n1.0,3,5.0,6.0\n";

    fn config() -> TrackConfig {
        TrackConfig {
            file: "walk.csv".into(),
            ..TrackConfig::default()
        }
    }

    fn track(config: &TrackConfig, id: u64) -> Track {
        let tracks = read(config, TEXT.as_bytes(), "world.tracks[0]").unwrap();
        tracks.into_iter().find(|(i, _)| *i == id).unwrap().1
    }

    fn refusal(text: &str) -> String {
        read(&config(), text.as_bytes(), "world.tracks[0]")
            .unwrap_err()
            .to_string()
    }

    #[test]
    fn places_between_samples_lie_on_the_line() {
        let step = track(&config(), 7).at(1.5).unwrap();
        assert_eq!(step.place, Vector2::new(1.5, 0.0));
        assert_eq!(step.velocity, Vector2::new(1.0, 0.0));
    }

    #[test]
    fn people_are_absent_before_the_first_and_after_the_last_sample() {
        let walker = track(&config(), 7);
        assert!(walker.at(-0.01).is_none() && walker.at(5.01).is_none());
        assert_eq!(walker.at(5.0).unwrap().place, Vector2::new(2.0, 4.0));
        assert_eq!(walker.at(0.0).unwrap().place, Vector2::zeros());
    }

    #[test]
    fn who_stands_keeps_the_heading() {
        assert_eq!(track(&config(), 7).at(2.5).unwrap().yaw_rad, 0.0);
    }

    #[test]
    fn start_offset_and_ids_apply() {
        let config = TrackConfig {
            start_s: 1.0,
            offset_m: [10.0, 0.0],
            ids: Some(vec![7]),
            ..config()
        };
        assert_eq!(read(&config, TEXT.as_bytes(), "").unwrap().len(), 1);
        assert_eq!(
            track(&config, 7).at(0.5).unwrap().place,
            Vector2::new(11.5, 0.0)
        );
        let unknown = TrackConfig {
            ids: Some(vec![4]),
            ..config
        };
        assert!(
            read(&unknown, TEXT.as_bytes(), "k")
                .unwrap_err()
                .to_string()
                .contains("names 4")
        );
    }

    #[test]
    fn places_are_turned_before_they_are_moved() {
        let config = TrackConfig {
            yaw_deg: 90.0,
            offset_m: [10.0, 0.0],
            ..config()
        };
        let step = track(&config, 7).at(1.0).unwrap();
        assert!((step.place - Vector2::new(10.0, 1.0)).norm() < 1e-12);
        assert!((step.velocity - Vector2::new(0.0, 1.0)).norm() < 1e-12);
        assert!((step.yaw_rad - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
    }

    #[test]
    fn places_are_continuous_across_the_samples() {
        let walker = track(&config(), 7);
        for sample_s in [2.0, 3.0] {
            let [before, after] = [-1e-9, 1e-9].map(|h| walker.at(sample_s + h).unwrap().place);
            // At no more than 2 m/s.
            assert!((after - before).norm() <= 4.1e-9);
        }
    }

    #[test]
    fn nobody_is_there_outside_of_their_presence() {
        let walker = track(
            &TrackConfig {
                start_s: 1.5,
                ..config()
            },
            3,
        );
        assert_eq!(walker.presence_s(), (-1.5, -0.5));
        assert!(walker.at(-0.5).is_some() && walker.at(-0.49).is_none());
    }

    #[test]
    fn a_repeated_recording_starts_again() {
        let config = TrackConfig {
            after_end: AfterEnd::Repeat,
            ..config()
        };
        assert_eq!(
            track(&config, 7).at(11.0).unwrap().place,
            Vector2::new(1.0, 0.0)
        );
        // Person 3 is there for the first second of each of the five.
        assert!(track(&config, 3).at(5.5).is_some() && track(&config, 3).at(7.0).is_none());
    }

    #[test]
    fn bad_lines_are_named_with_file_and_line() {
        assert_eq!(
            refusal("t_s,id,x_m,y_m\n0.0,1,2.0,3.0\n0.4,1,two,3.0\n"),
            "walk.csv:3: found `two` for x_m; expected a finite number (named by `world.tracks[0]`)"
        );
        assert!(refusal("t_s,id,x_m,y_m\n\n0.0,1,2.0\n").starts_with("walk.csv:3: found 3 fields"));
        assert!(refusal("t_s,id,x_m,y_m\n0.0,-1,2.0,1.0\n").contains("`-1` for id"));
        assert!(refusal("t_s,id,x_m,y_m\n0.0,1,nan,1.0\n").contains("`nan` for x_m"));
        assert!(
            refusal("t_s,id,x_m,y_m\n1.0,1,0,0\n0.5,1,0,0\n")
                .contains("walk.csv:3: time 0.5 s of id 1")
        );
        let bytes = b"t_s,id,x_m,y_m\r\n0,1,0,0\r\n1,1,\xff,0\r\n";
        let message = read(&config(), bytes, "").unwrap_err().to_string();
        assert!(message.starts_with("walk.csv:3: found no text"));
        assert!(refusal("").contains("found the header ``"));
        assert!(refusal("t,id,x,y\n0,1,0,0\n").contains("found the header `t,id,x,y`"));
        assert!(refusal("t_s,id,x_m,y_m\n").contains("no line after the header"));
    }
}
