//! How well people are followed: a vehicle hovers in front of two of them, and its tracks are
//! compared with where they truly are.

use alula_geometry::{Pose, Timestamp};
use alula_messages::{Obstacle, StackOutput};
use alula_sim::world::{PersonState, World};

use super::{
    Chart, Column, Curve, CurveBand, Demand, Request, Results, Row, Study, Tone, Watch, built_in,
};
use crate::encounters::Eye;
use crate::flight::{self, Progress, RecordTo};
use crate::timing::Distribution;
use crate::{RunError, Scenario};

/// Document L, table 5-1.
pub const STUDY: Study = Study {
    name: "obstacle-tracking",
    source: "document L, section 5-2-3, table 5-1 and figure 5-9",
    about: "errors of the tracks of two walking people, seen by a hovering vehicle",
    runs_are: "flights",
    default_runs: 20,
    execute,
};

const SCENARIO: &str = include_str!("../../../../scenarios/watch-people.toml");

/// The source's average errors, m and m/s, and what is asked here: half of them.
const THEIRS: [f64; 2] = [0.26, 0.43];
const ASKED: [f64; 2] = [0.13, 0.22];

/// A person in view without a track nearer than this counts as not followed, m.
const SAME_M: f64 = 1.0;

/// A person whose velocity was another one this long ago turns, s and m/s.
const TURN_S: f64 = 0.3;
const TURN_M_S: f64 = 0.1;

/// A track is young for this long, s.
const YOUNG_S: f64 = 0.5;

/// True poses that are remembered until the image of their time has been looked at.
const POSES: usize = 100;

/// Width of the classes of distance and of age in the charts.
const CLASS_M: f64 = 0.5;
const CLASS_S: f64 = 0.25;
/// Ages from here on are no longer shown, s.
const OLD_S: f64 = 4.0;

/// One look at one person in view.
#[derive(Clone, Copy, Debug)]
struct Look {
    /// Distance of the person from the vehicle, m.
    distance_m: f64,
    /// What the track says, if there is one.
    track: Option<TrackErrors>,
    /// Where the person is, world, m.
    truth: (f64, f64),
    /// Whether the person turns.
    turns: bool,
}

impl Look {
    fn is_young(&self) -> bool {
        self.track.is_some_and(|track| track.age_s < YOUNG_S)
    }
}

#[derive(Clone, Copy, Debug)]
struct TrackErrors {
    place: (f64, f64),
    /// Errors in all three directions, m and m/s.
    position_m: f64,
    velocity_m_s: f64,
    /// How long the track has existed, s.
    age_s: f64,
}

fn execute(request: &Request, watch: &Watch) -> Result<Results, RunError> {
    let scenario = built_in(SCENARIO, &[])?;
    let seeds = request.seeds();
    let flights = request.do_all(&seeds, watch, &|seed| watch_people(&scenario, seed))?;
    Ok(results(&seeds, &flights))
}

/// Flies with one seed and looks at each person in view at the time of each image.
fn watch_people(scenario: &Scenario, seed: u64) -> Result<Vec<Look>, RunError> {
    let world = scenario.build_world(seed)?;
    let depth = scenario.config().simulation.sensors.depth.as_ref();
    let Some(eye) = depth.map(Eye::new) else {
        return Ok(Vec::new());
    };
    let mut observer = Observer {
        world: &world,
        eye,
        poses: Vec::new(),
        first_seen: Vec::new(),
        looks: Vec::new(),
    };
    let mut note = |progress: &Progress| observer.note(progress);
    flight::fly(scenario, seed, &RecordTo::Nothing, &mut note)?;
    Ok(observer.looks)
}

/// Sees what is true and what is believed.
struct Observer<'a> {
    world: &'a World,
    eye: Eye,
    poses: Vec<(Timestamp, Pose)>,
    /// Tracks with the time at which they began.
    first_seen: Vec<(u32, Timestamp)>,
    looks: Vec<Look>,
}

impl Observer<'_> {
    fn note(&mut self, progress: &Progress) {
        let output = progress.output;
        if self.poses.len() == POSES {
            self.poses.remove(0);
        }
        self.poses.push((output.time, progress.world_from_body));
        let hovers = output.mode == alula_messages::FlightMode::Hovering;
        if let Some(time) = output.seen_at.filter(|_| hovers) {
            self.compare(time, output);
        }
    }

    fn compare(&mut self, time: Timestamp, output: &StackOutput) {
        for obstacle in &output.obstacles {
            if !self.first_seen.iter().any(|(id, _)| *id == obstacle.id) {
                self.first_seen.push((obstacle.id, time));
            }
        }
        let Some(pose) = self.pose_at(time) else {
            return;
        };
        let people = self.world.people_at(time);
        let people: Vec<PersonState> = people
            .filter(|person| self.eye.sees(self.world, time, &pose, person))
            .collect();
        let tracks = assign(&people, &output.obstacles);
        for (person, track) in people.iter().zip(tracks) {
            let errors = track.map(|track| self.errors(person, track, time));
            let apart = person.centre_world.coords - pose.translation.vector;
            self.looks.push(Look {
                distance_m: apart.xy().norm(),
                track: errors,
                truth: (person.centre_world.x, person.centre_world.y),
                turns: self.turns(person, time),
            });
        }
    }

    /// The true pose at the time of an image.
    fn pose_at(&self, time: Timestamp) -> Option<Pose> {
        let apart_s = |at: &Timestamp| at.seconds_since(time).abs();
        let mut poses = self.poses.iter();
        let first = poses.next()?;
        let nearest = poses.fold(first, |best, pose| {
            if apart_s(&pose.0) < apart_s(&best.0) {
                pose
            } else {
                best
            }
        });
        Some(nearest.1)
    }

    /// Whether the velocity of a person changed a moment ago.
    fn turns(&self, person: &PersonState, time: Timestamp) -> bool {
        let before = Timestamp::from_s(time.as_s() - TURN_S);
        let mut people = self.world.people_at(before);
        people.any(|p| {
            p.id == person.id && (p.velocity_world - person.velocity_world).norm() > TURN_M_S
        })
    }

    fn errors(&self, person: &PersonState, track: &Obstacle, time: Timestamp) -> TrackErrors {
        let first = self.first_seen.iter().find(|(id, _)| *id == track.id);
        TrackErrors {
            place: (track.centre_world.x, track.centre_world.y),
            position_m: (track.centre_world - person.centre_world.coords).norm(),
            velocity_m_s: (track.velocity_world - person.velocity_world).norm(),
            age_s: first.map_or(0.0, |(_, since)| time.seconds_since(*since)),
        }
    }
}

/// The track of each person: the nearest pair first, each track once, none further away than
/// [`SAME_M`].
fn assign<'a>(people: &[PersonState], tracks: &'a [Obstacle]) -> Vec<Option<&'a Obstacle>> {
    let apart_m = |person: &PersonState, track: &Obstacle| {
        (track.centre_world - person.centre_world.coords)
            .xy()
            .norm()
    };
    let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
    for (i, person) in people.iter().enumerate() {
        for (k, track) in tracks.iter().enumerate() {
            pairs.push((apart_m(person, track), i, k));
        }
    }
    pairs.retain(|(apart_m, _, _)| *apart_m < SAME_M);
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut assigned: Vec<Option<usize>> = vec![None; people.len()];
    for (_, i, k) in pairs {
        if assigned[i].is_none() && !assigned.contains(&Some(k)) {
            assigned[i] = Some(k);
        }
    }
    assigned
        .into_iter()
        .map(|track| track.and_then(|k| tracks.get(k)))
        .collect()
}

/// Errors over some looks.
struct Errors {
    looks: usize,
    followed: f64,
    position: [f64; 2],
    velocity: [f64; 2],
}

impl Errors {
    fn of<'a>(looks: impl Iterator<Item = &'a Look>) -> Self {
        let looks: Vec<&Look> = looks.collect();
        let tracks: Vec<TrackErrors> = looks.iter().filter_map(|look| look.track).collect();
        let mean_and_rms = |error: fn(&TrackErrors) -> f64| {
            let count = tracks.len() as f64;
            let mean = tracks.iter().map(error).sum::<f64>() / count;
            let square = tracks.iter().map(|track| error(track).powi(2)).sum::<f64>() / count;
            [mean, square.sqrt()]
        };
        Self {
            looks: looks.len(),
            followed: tracks.len() as f64 / looks.len() as f64,
            position: mean_and_rms(|track| track.position_m),
            velocity: mean_and_rms(|track| track.velocity_m_s),
        }
    }

    fn row(&self, what: &str, seed: Option<u64>) -> Row {
        Row::new()
            .with("flight", what)
            .with("seed", seed)
            .with("looks", self.looks)
            .with("followed", self.followed)
            .with("position_error_m", self.position[0])
            .with("velocity_error_m_s", self.velocity[0])
            .with("position_rmse_m", self.position[1])
            .with("velocity_rmse_m_s", self.velocity[1])
    }
}

fn results(seeds: &[u64], flights: &[Vec<Look>]) -> Results {
    let each: Vec<Errors> = flights
        .iter()
        .map(|looks| Errors::of(looks.iter()))
        .collect();
    let all = Errors::of(flights.iter().flatten());
    let mut rows = vec![
        all.row("all", None)
            .theirs("position_error_m", THEIRS[0])
            .theirs("velocity_error_m_s", THEIRS[1]),
    ];
    let looks = || flights.iter().flatten();
    let young = looks().filter(|look| look.is_young());
    let turning = looks().filter(|look| look.turns && !look.is_young());
    let straight = looks().filter(|look| !look.turns && !look.is_young());
    rows.extend([
        Errors::of(young).row("young tracks", None),
        Errors::of(turning).row("people who turn", None),
        Errors::of(straight).row("straight on", None),
    ]);
    let spread = |name: &str, pick: fn(&Distribution) -> f64| {
        let of = |error: fn(&Errors) -> f64| {
            let values: Vec<f64> = each.iter().map(error).collect();
            pick(&Distribution::of(&values))
        };
        Row::new()
            .with("flight", name)
            .with("position_error_m", of(|e| e.position[0]))
            .with("velocity_error_m_s", of(|e| e.velocity[0]))
            .with("position_rmse_m", of(|e| e.position[1]))
            .with("velocity_rmse_m_s", of(|e| e.velocity[1]))
    };
    rows.push(spread("median flight", |d| d.p50));
    rows.push(spread("worst flight", |d| d.max));
    let of_seed =
        |(seed, errors): (&u64, &Errors)| errors.row(&format!("seed {seed}"), Some(*seed));
    rows.extend(seeds.iter().zip(&each).map(of_seed));
    Results {
        runs: flights.len() as u64,
        columns: columns(),
        rows,
        demands: vec![
            Demand::at_most("average position error", "m", ASKED[0], all.position[0]),
            Demand::at_most("average velocity error", "m/s", ASKED[1], all.velocity[0]),
        ],
        charts: charts(flights),
        notes: vec![
            "A look is a person in view, up to 5 m away, at the time of a depth image. Errors are \
             distances in all three directions between a track and the truth, averaged over all \
             looks from the first at a track on; they contain the error of the vehicle's own \
             odometry."
                .to_owned(),
            format!(
                "Young tracks are those of the first {YOUNG_S} s; people turn if their velocity was \
                 another one {TURN_S} s ago. The other rows of this kind are of tracks that are older."
            ),
            format!(
                "Followed is the share of looks at which there is a track within {SAME_M} m of the \
                 person."
            ),
        ],
    }
}

fn columns() -> Vec<Column> {
    vec![
        Column::new("flight", "flight", 0),
        Column::new("looks", "looks", 0),
        Column::new("followed", "followed", 3),
        Column::new("position_error_m", "position (m)", 3),
        Column::new("velocity_error_m_s", "velocity (m/s)", 3),
        Column::new("position_rmse_m", "RMSE (m)", 3),
        Column::new("velocity_rmse_m_s", "RMSE (m/s)", 3),
    ]
}

fn charts(flights: &[Vec<Look>]) -> Vec<Chart> {
    let known = || {
        let looks = flights.iter().flatten();
        looks.filter_map(|look| Some((look.distance_m, look.track?)))
    };
    let young = || known().filter(|(_, track)| track.age_s < OLD_S);
    vec![
        first_flight(flights),
        by_class(
            "position error by distance",
            ["distance of the person (m)", "error (m)"],
            CLASS_M,
            known().map(|(distance_m, track)| (distance_m, track.position_m)),
        ),
        by_class(
            "velocity error by distance",
            ["distance of the person (m)", "error (m/s)"],
            CLASS_M,
            known().map(|(distance_m, track)| (distance_m, track.velocity_m_s)),
        ),
        by_class(
            "position error by age of the track",
            ["time since the first look (s)", "error (m)"],
            CLASS_S,
            young().map(|(_, track)| (track.age_s, track.position_m)),
        ),
        by_class(
            "velocity error by age of the track",
            ["time since the first look (s)", "error (m/s)"],
            CLASS_S,
            young().map(|(_, track)| (track.age_s, track.velocity_m_s)),
        ),
    ]
}

/// Where the people were and where they were believed to be in the first flight.
fn first_flight(flights: &[Vec<Look>]) -> Chart {
    let looks = || flights.first().into_iter().flatten();
    let believed = looks().filter_map(|look| Some(look.track?.place));
    Chart::Map {
        title: "where people in view were, and where they were believed to be, in the first flight"
            .to_owned(),
        x_label: "x (m)".to_owned(),
        y_label: "y (m)".to_owned(),
        curves: vec![
            Curve::dots("tracks", Tone::Measured, believed.collect()),
            Curve::dots(
                "truth",
                Tone::Truth,
                looks().map(|look| look.truth).collect(),
            ),
        ],
        outlines: Vec::new(),
    }
}

/// Median and 75 % of errors in classes of something.
fn by_class(
    title: &str,
    labels: [&str; 2],
    width: f64,
    errors: impl Iterator<Item = (f64, f64)>,
) -> Chart {
    let mut classes = std::collections::BTreeMap::<u64, Vec<f64>>::new();
    for (place, error) in errors {
        let class = (place / width).max(0.0) as u64;
        classes.entry(class).or_default().push(error);
    }
    let spread: Vec<(f64, Distribution)> = classes
        .iter()
        .map(|(class, errors)| ((*class as f64 + 0.5) * width, Distribution::of(errors)))
        .collect();
    Chart::Curves {
        title: title.to_owned(),
        x_label: labels[0].to_owned(),
        y_label: labels[1].to_owned(),
        curves: vec![Curve::line(
            "median",
            Tone::Measured,
            spread.iter().map(|(x, d)| (*x, d.p50)).collect(),
        )],
        bands: vec![CurveBand {
            name: "up to three quarters".to_owned(),
            points: spread.iter().map(|(x, d)| (*x, 0.0, d.p75)).collect(),
            tone: Tone::Measured,
        }],
    }
}
