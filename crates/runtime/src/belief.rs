//! What the vehicle believed and what was true: distances, obstacles, plans, and the moments of the
//! closest approaches with their depth images. It is built step by step, from a flight under way
//! or from a recording of one, and stays small: images are kept for a few moments only.

use std::collections::BTreeSet;
use std::sync::Arc;

use alula_geometry::{Pose, Timestamp};
use alula_messages::{
    DepthImage, Detection, FlightMode, Hindrance, NavState, Obstacle, ObstacleMotion, Plan,
    PlanExit, SensorBatch, Sight, StackOutput,
};
use alula_record::TruthRecord;
use alula_sim::world::World;
use nalgebra::{Point3, Vector3};

/// Rate of the distances kept for plots, Hz.
const DISTANCES_HZ: f64 = 20.0;

/// Rate of the sightings kept for plots, Hz.
const SIGHTINGS_HZ: f64 = 5.0;

/// One moment is kept of each window of this length, s; chosen moments are as far apart.
const WINDOW_S: f64 = 2.0;

/// Most moments that are kept while the flight goes on.
const KEPT_MOMENTS: usize = 12;

/// A hindrance that is not told of for this long has ended, s.
const HINDRANCE_GAP_S: f64 = 0.5;

/// True distances from the vehicle's centre at one instant.
#[derive(Clone, Debug, PartialEq)]
pub struct Distances {
    /// Time since the start, s.
    pub t_s: f64,
    /// To the nearest thing that stands still, m.
    pub still_m: Option<f64>,
    /// To the ellipsoid of each person who is in the world, by number, m.
    pub people_m: Vec<(u32, f64)>,
}

impl Distances {
    /// To the nearest of all, m.
    pub fn least_m(&self) -> Option<f64> {
        let people = self.people_m.iter().map(|(_, distance)| *distance);
        people.chain(self.still_m).reduce(f64::min)
    }
}

/// Where an obstacle was believed to be at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sighting {
    /// Time since the start, s.
    pub t_s: f64,
    /// Number of the track.
    pub id: u32,
    /// Its centre, world, m.
    pub centre_world: Vector3<f64>,
    /// Whether it moves.
    pub motion: ObstacleMotion,
    /// Whether it is seen.
    pub sight: Sight,
}

/// The end of one run of the solver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solve {
    /// Time since the start, s.
    pub t_s: f64,
    /// How it ended.
    pub exit: PlanExit,
    /// Subproblems solved.
    pub iterations: u32,
    /// Greatest violation of a softened constraint, m.
    pub max_violation_m: f64,
    /// Number of obstacles that the plan keeps clear of.
    pub obstacles: usize,
}

/// A time in which something kept the vehicle from advancing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hindered {
    /// From, s since the start.
    pub from_s: f64,
    /// To, s since the start.
    pub to_s: f64,
    /// What kept it, as told last.
    pub by: Hindrance,
}

/// All that was believed at a close approach.
#[derive(Clone, Debug)]
pub struct Moment {
    /// Time since the start, s.
    pub t_s: f64,
    /// Time of the step.
    pub time: Timestamp,
    /// Least true distance from the vehicle's centre to anything, m.
    pub distance_m: f64,
    /// True pose of the body in the world.
    pub world_from_body: Pose,
    /// The estimate.
    pub state: NavState,
    /// The image that was looked at; `None` in a flight without images.
    pub image: Option<Arc<DepthImage>>,
    /// Boxes in it.
    pub detections: Vec<Detection>,
    /// Obstacles as known.
    pub obstacles: Vec<Obstacle>,
    /// The plan at that time.
    pub plan: Option<Plan>,
}

/// The story of what was believed in a flight.
#[derive(Clone, Debug, Default)]
pub struct BeliefLog {
    /// True distances while airborne, oldest first.
    pub distances: Vec<Distances>,
    /// Where obstacles were believed to be, oldest first.
    pub sightings: Vec<Sighting>,
    /// The plans that were made, oldest first.
    pub solves: Vec<Solve>,
    /// What kept the vehicle from advancing, oldest first.
    pub hindrances: Vec<Hindered>,
    /// Number of images that were looked at.
    pub images: u64,
    start: Option<Timestamp>,
    next_distances_s: f64,
    next_sightings_s: f64,
    tracked: BTreeSet<u32>,
    plan: Option<Plan>,
    image: Option<Arc<DepthImage>>,
    window: Option<(u64, Moment)>,
    moments: Vec<Moment>,
}

impl BeliefLog {
    /// Takes one step of a flight in. Steps come in order.
    pub fn push(
        &mut self,
        batch: &SensorBatch,
        output: &StackOutput,
        truth: &TruthRecord,
        world: &World,
    ) {
        let start = *self.start.get_or_insert(output.time);
        let t_s = output.time.seconds_since(start);
        self.note_plan(t_s, output);
        self.note_hindrance(t_s, output.hindrance);
        self.note_sightings(t_s, output);
        if let Some(image) = ahead(batch).next_back() {
            self.image = Some(Arc::clone(image));
        }
        if matches!(output.mode, FlightMode::Disarmed | FlightMode::Armed) {
            return;
        }
        let looks = output.seen_at.is_some() || (self.images == 0 && output.plan.is_some());
        let due = t_s >= self.next_distances_s;
        if !looks && !due {
            return;
        }
        let distances = distances(t_s, truth, world);
        // The way up and down leads past what stands at its foot.
        let on_the_way = !matches!(output.mode, FlightMode::TakingOff | FlightMode::Landing);
        if looks
            && on_the_way
            && let Some(distance_m) = distances.least_m()
        {
            self.note_moment(t_s, distance_m, batch, output, truth);
        }
        if due {
            self.next_distances_s = t_s + 1.0 / DISTANCES_HZ - 1e-6;
            self.distances.push(distances);
        }
    }

    /// Whether there is something to show: obstacles were looked for, or plans made.
    pub fn is_empty(&self) -> bool {
        self.images == 0 && self.solves.is_empty()
    }

    /// Time of the first step.
    pub fn start(&self) -> Timestamp {
        self.start.unwrap_or_default()
    }

    /// Number of different obstacles that were followed.
    pub fn tracked(&self) -> usize {
        self.tracked.len()
    }

    /// At most `count` moments of the closest approaches, in order of time, each at least two
    /// seconds from the others.
    pub fn moments(&self, count: usize) -> Vec<&Moment> {
        let last = self.window.iter().map(|(_, moment)| moment);
        let mut nearest_first: Vec<&Moment> = self.moments.iter().chain(last).collect();
        nearest_first.sort_by(|a, b| a.distance_m.total_cmp(&b.distance_m));
        let mut chosen: Vec<&Moment> = Vec::new();
        for moment in nearest_first {
            let apart = chosen
                .iter()
                .all(|c| (c.t_s - moment.t_s).abs() >= WINDOW_S);
            if apart && chosen.len() < count {
                chosen.push(moment);
            }
        }
        chosen.sort_by(|a, b| a.t_s.total_cmp(&b.t_s));
        chosen
    }

    fn note_plan(&mut self, t_s: f64, output: &StackOutput) {
        let Some(plan) = &output.plan else { return };
        self.solves.push(Solve {
            t_s,
            exit: plan.exit,
            iterations: plan.iterations,
            max_violation_m: plan.max_violation_m,
            obstacles: plan
                .obstacles
                .iter()
                .filter(|id| **id != alula_messages::NO_OBSTACLE)
                .count(),
        });
        self.plan = Some(*plan);
    }

    fn note_hindrance(&mut self, t_s: f64, hindrance: Option<Hindrance>) {
        let Some(by) = hindrance else { return };
        if let Some(last) = self.hindrances.last_mut()
            && last.by.name() == by.name()
            && t_s - last.to_s < HINDRANCE_GAP_S
        {
            last.to_s = t_s;
            last.by = by;
            return;
        }
        self.hindrances.push(Hindered {
            from_s: t_s,
            to_s: t_s,
            by,
        });
    }

    fn note_sightings(&mut self, t_s: f64, output: &StackOutput) {
        if output.seen_at.is_none() {
            return;
        }
        self.images += 1;
        self.tracked.extend(output.obstacles.iter().map(|o| o.id));
        if t_s < self.next_sightings_s {
            return;
        }
        self.next_sightings_s = t_s + 1.0 / SIGHTINGS_HZ - 1e-6;
        let sighting = |o: &Obstacle| Sighting {
            t_s,
            id: o.id,
            centre_world: o.centre_world,
            motion: o.motion,
            sight: o.sight,
        };
        self.sightings.extend(output.obstacles.iter().map(sighting));
    }

    /// Keeps the step if it is the nearest of its window so far.
    fn note_moment(
        &mut self,
        t_s: f64,
        distance_m: f64,
        batch: &SensorBatch,
        output: &StackOutput,
        truth: &TruthRecord,
    ) {
        let number = (t_s / WINDOW_S) as u64;
        let nearer = match &self.window {
            Some((window, moment)) if *window == number => distance_m < moment.distance_m,
            _ => true,
        };
        if !nearer {
            return;
        }
        let moment = Moment {
            t_s,
            time: output.time,
            distance_m,
            world_from_body: truth.world_from_body,
            state: output.state.clone(),
            image: self.seen_image(batch, output),
            detections: output.detections.clone(),
            obstacles: output.obstacles.clone(),
            plan: self.plan,
        };
        if let Some((window, last)) = self.window.replace((number, moment))
            && window != number
        {
            self.keep(last);
        }
    }

    fn seen_image(&self, batch: &SensorBatch, output: &StackOutput) -> Option<Arc<DepthImage>> {
        let seen_at = output.seen_at?;
        let mut images = ahead(batch).chain(&self.image);
        images.find(|image| image.time == seen_at).cloned()
    }

    /// Adds a moment, and drops the farthest when there are too many.
    fn keep(&mut self, moment: Moment) {
        self.moments.push(moment);
        if self.moments.len() > KEPT_MOMENTS {
            let distance = |i: &usize| self.moments[*i].distance_m;
            let farthest =
                (0..self.moments.len()).max_by(|a, b| distance(a).total_cmp(&distance(b)));
            farthest.map(|i| self.moments.remove(i));
        }
    }
}

/// Images of the camera that looks ahead.
fn ahead(batch: &SensorBatch) -> impl DoubleEndedIterator<Item = &Arc<DepthImage>> {
    batch.depth.iter().filter(|image| image.sensor == 0)
}

fn distances(t_s: f64, truth: &TruthRecord, world: &World) -> Distances {
    let centre = Point3::from(truth.world_from_body.translation.vector);
    let people = world.people_at(truth.time);
    Distances {
        t_s,
        still_m: world.clearance_of_obstacles(&centre).map(|c| c.distance_m),
        people_m: people.map(|p| (p.id, p.distance(&centre))).collect(),
    }
}

#[cfg(test)]
mod tests {
    use alula_sim::world::{Assets, WorldConfig};

    use super::*;

    /// A world with a pillar of radius 0.5 m at the origin.
    fn world() -> World {
        let text = "[[obstacles]]\nkind = \"cylinder\"\ncentre_m = [0.0, 0.0]\nradius_m = 0.5\n";
        let config: WorldConfig = toml::from_str(text).unwrap();
        let none: &Assets<'_> = &|file: &str| Err(format!("{file}: no files here"));
        World::new(&config, 1, none).unwrap()
    }

    /// A flight along x, 1 m north of the pillar's centre, at 100 Hz and 1 m/s from x = -10 m to
    /// 10 m; it looks at an image in every fifth step.
    fn flight(steps: i64) -> BeliefLog {
        let world = world();
        let mut log = BeliefLog::default();
        for step in 0..steps {
            let time = Timestamp::from_ns(step * 10_000_000);
            let x = -10.0 + time.as_s();
            let truth = TruthRecord {
                time,
                world_from_body: Pose::translation(x, 1.0, 1.0),
                velocity_world: Vector3::x(),
                clearance_m: None,
            };
            let looks = step % 5 == 0;
            let output = StackOutput {
                time,
                mode: FlightMode::Flying,
                seen_at: looks.then_some(time),
                plan: looks.then(Plan::default),
                ..StackOutput::default()
            };
            log.push(&SensorBatch::default(), &output, &truth, &world);
        }
        log
    }

    #[test]
    fn the_closest_approach_is_a_moment() {
        let log = flight(2000);
        let moments = log.moments(1);
        assert!((moments[0].t_s - 10.0).abs() < 1e-9, "{}", moments[0].t_s);
        assert!((moments[0].distance_m - 0.5).abs() < 1e-9);
    }

    #[test]
    fn moments_are_two_seconds_apart_and_in_order() {
        let log = flight(2000);
        let times: Vec<f64> = log.moments(6).iter().map(|m| m.t_s).collect();
        assert!(times.len() > 2);
        assert!(
            times.windows(2).all(|t| t[1] - t[0] >= WINDOW_S),
            "{times:?}"
        );
    }

    #[test]
    fn a_long_flight_keeps_few_images() {
        let log = flight(10_000);
        assert!(log.moments.len() <= KEPT_MOMENTS);
    }

    #[test]
    fn distances_are_kept_twenty_times_a_second() {
        assert_eq!(flight(1000).distances.len(), 200);
    }

    #[test]
    fn every_plan_is_a_solve() {
        assert_eq!(flight(1000).solves.len(), 200);
    }

    #[test]
    fn a_hindrance_told_of_step_by_step_is_one_time() {
        let mut log = BeliefLog::default();
        for (t_s, age_s) in [(1.0, 0.3), (1.1, 0.4), (1.2, 0.5)] {
            log.note_hindrance(t_s, Some(Hindrance::DepthStale { age_s }));
        }
        log.note_hindrance(3.0, Some(Hindrance::NoRoute));
        let times: Vec<_> = log.hindrances.iter().map(|h| (h.from_s, h.to_s)).collect();
        assert_eq!(times, [(1.0, 1.2), (3.0, 3.0)]);
    }

    #[test]
    fn a_flight_that_neither_looked_nor_planned_shows_nothing() {
        assert!(BeliefLog::default().is_empty());
        assert!(!flight(1).is_empty());
    }
}
