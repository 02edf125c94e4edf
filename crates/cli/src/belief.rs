//! What the vehicle believed in a flight, beside what was true, as figures.

use alula_geometry::{TimeDelta, Timestamp, so3};
use alula_messages::{Obstacle, ObstacleMotion, PlanExit, Sight};
use alula_runtime::Scenario;
use alula_runtime::belief::{BeliefLog, Moment};
use alula_runtime::flight_log::{FlightLog, Sample};
use alula_sim::world::World;
use nalgebra::{Matrix3, Vector3};

use crate::depth_pictures::{Eye, depth_picture, u_depth_picture};
use crate::outlines::{View, shapes};
use crate::page::{PageFigure, Row, Span, Status, Table};
use crate::plot::{
    Cell, Colour, Figure, Fill, Glyph, LineChart, MapPoint, MapShape, MapView, Marker, Outline,
    Panel, Series, Style,
};

/// Most moments that are drawn.
const MOMENTS: usize = 6;

/// Half the side of the map of a moment, m.
const MOMENT_REACH_M: f64 = 3.5;

/// True paths around a moment are drawn this long before and after it, s.
const AROUND_S: f64 = 2.0;

/// How far ahead obstacles are drawn where no plan says it, s.
const AHEAD_S: f64 = 1.5;

/// Paths are drawn with so many points a second.
const PATH_HZ: f64 = 10.0;

/// Distances beyond are of no interest, m.
const FAR_M: f64 = 4.0;

/// Classes of speed with their colours, slow to fast.
const SPEEDS: [Colour; 5] = [
    Colour::Grey,
    Colour::Sky,
    Colour::Blue,
    Colour::Green,
    Colour::Vermillion,
];

/// What is drawn of what was believed.
pub struct BeliefFigures {
    /// The whole flight from above.
    pub overview: MapView,
    charts: Vec<LineChart>,
    moments: Vec<MomentFigure>,
    hindrances: Table,
}

/// One close approach.
struct MomentFigure {
    title: String,
    map: MapView,
    pictures: Vec<crate::plot::Picture>,
}

/// A flight with what is needed to draw it.
#[derive(Clone, Copy)]
struct Story<'a> {
    belief: &'a BeliefLog,
    log: &'a FlightLog,
    world: &'a World,
    /// People nearer than this to the vehicle's centre are in contact, m.
    contact_distance_m: f64,
    eye: &'a Eye,
}

impl BeliefFigures {
    /// Figures of a flight of a scenario; `None` if it neither looked for obstacles nor planned.
    pub fn of_flight(
        scenario: &Scenario,
        belief: &BeliefLog,
        log: &FlightLog,
        world: &World,
    ) -> Option<Self> {
        let config = scenario.config();
        let avoidance = config.stack.avoidance.as_ref();
        let eye = avoidance.map(|a| Eye {
            detector: a.detector.clone(),
            floor_height_m: Some(a.conduct.floor_height_m),
        });
        let eye = eye.unwrap_or_default();
        let contact_distance_m = config.simulation.contact_distance_m;
        Self::new(belief, log, world, contact_distance_m, &eye)
    }

    /// Figures of a flight in a world; `None` if it neither looked for obstacles nor planned.
    /// People nearer than `contact_distance_m` to the vehicle's centre are in contact; `eye` is
    /// how the images were looked at.
    fn new(
        belief: &BeliefLog,
        log: &FlightLog,
        world: &World,
        contact_distance_m: f64,
        eye: &Eye,
    ) -> Option<Self> {
        if belief.is_empty() {
            return None;
        }
        let story = Story {
            belief,
            log,
            world,
            contact_distance_m,
            eye,
        };
        let moments = belief.moments(MOMENTS);
        let markers: Vec<Marker> = moments
            .iter()
            .enumerate()
            .map(|(i, moment)| Marker {
                x: moment.t_s,
                label: (i + 1).to_string(),
                colour: Colour::Grey,
            })
            .collect();
        let numbered = moments.iter().enumerate();
        Some(Self {
            overview: story.overview(&moments),
            charts: vec![
                story.distance_chart(&markers),
                story.iterations_chart(&markers),
                story.violation_chart(&markers),
            ],
            moments: numbered.map(|(i, m)| story.moment(i + 1, m)).collect(),
            hindrances: story.hindrance_table(),
        })
    }

    /// All figures, in reading order.
    pub fn figures(&self) -> Vec<PageFigure> {
        let overview = PageFigure {
            svg: self.overview.to_svg(1000.0),
            caption: "True paths from above with marks of time in seconds; numbers in circles are the closest \
                      approaches, drawn below."
                .to_owned(),
            span: Span::Full,
        };
        let chart = |(i, chart): (usize, &LineChart)| PageFigure {
            svg: chart.to_svg(if i == 0 { 1000.0 } else { 560.0 }),
            caption: String::new(),
            span: if i == 0 { Span::Full } else { Span::Half },
        };
        let charts = self.charts.iter().enumerate().map(chart);
        let moments = self.moments.iter().map(MomentFigure::figure);
        [overview]
            .into_iter()
            .chain(charts)
            .chain(moments)
            .collect()
    }

    /// Tables that belong to the figures.
    pub fn tables(&self) -> Vec<Table> {
        let some = !self.hindrances.rows.is_empty();
        some.then(|| self.hindrances.clone()).into_iter().collect()
    }
}

impl MomentFigure {
    fn figure(&self) -> PageFigure {
        let cell = |column, row, rows| Cell {
            column,
            row,
            columns: 1,
            rows,
        };
        let beside = self.pictures.len().max(1);
        let mut panels: Vec<(Cell, &dyn Panel)> = vec![(cell(0, 0, beside), &self.map)];
        for (row, picture) in self.pictures.iter().enumerate() {
            panels.push((cell(1, row, 1), picture));
        }
        let alone = self.pictures.is_empty();
        let figure = Figure {
            title: self.title.clone(),
            subtitle: String::new(),
            aspect: if alone { 1.0 } else { 0.6 },
            columns: if alone { vec![1.0] } else { vec![1.1, 1.0] },
            rows: vec![1.0; beside],
            panels,
        };
        PageFigure {
            svg: figure.to_svg(if alone { 560.0 } else { 1100.0 }),
            caption: "Grey and purple: what was there. Coloured outlines: what the vehicle believed, with its \
                      velocity and its place at the end of the plan; they lie where the vehicle believes to be \
                      itself."
                .to_owned(),
            span: if alone { Span::Half } else { Span::Full },
        }
    }
}

impl Story<'_> {
    fn time(&self, t_s: f64) -> Timestamp {
        self.belief.start() + TimeDelta::from_s(t_s)
    }

    fn samples(&self, from_s: f64, to_s: f64) -> impl Iterator<Item = &Sample> {
        let within = move |s: &&Sample| from_s <= s.t_s && s.t_s <= to_s;
        self.log.samples.iter().filter(within)
    }

    fn overview(&self, moments: &[&Moment]) -> MapView {
        let end_s = self.log.duration_s();
        let people = self.people_paths(0.0, end_s);
        let numbers = moments.iter().enumerate().map(|(i, moment)| MapPoint {
            at: View::Top.of(&moment.world_from_body.translation.vector),
            label: (i + 1).to_string(),
            glyph: Glyph::Waypoint,
        });
        MapView {
            title: "true paths, speed and time".to_owned(),
            x_label: "x east (m)".to_owned(),
            y_label: "y north (m)".to_owned(),
            shapes: shapes(View::Top, self.world, self.time(end_s)),
            paths: people
                .into_iter()
                .chain(self.speed_path(0.0, end_s))
                .collect(),
            points: self
                .time_marks(0.0, end_s, mark_step_s(end_s))
                .into_iter()
                .chain(numbers)
                .collect(),
            ..MapView::default()
        }
    }

    /// The true path in the colours of its speed.
    fn speed_path(&self, from_s: f64, to_s: f64) -> Vec<Series> {
        let step = speed_step(self.log.max_speed_m_s);
        let samples: Vec<&Sample> = self.samples(from_s, to_s).collect();
        let class = |s: &Sample| ((s.true_velocity.norm() / step) as usize).min(SPEEDS.len() - 1);
        let path = |(i, colour): (usize, &Colour)| {
            let points = samples.windows(2).flat_map(|pair| {
                let place = |s: &Sample| View::Top.of(&s.true_position);
                match [class(pair[0]), class(pair[1])] {
                    [first, _] if first == i => vec![place(pair[0]), place(pair[1])],
                    _ => vec![(f64::NAN, f64::NAN)],
                }
            });
            let (low, high) = (step * i as f64, step * (i + 1) as f64);
            Series::new(
                &format!("{low:.1}-{high:.1} m/s"),
                *colour,
                points.collect(),
            )
        };
        let used = |series: &Series| series.points.iter().any(|p| p.0.is_finite());
        SPEEDS.iter().enumerate().map(path).filter(used).collect()
    }

    /// True paths of people; a person who leaves the world leaves a gap.
    fn people_paths(&self, from_s: f64, to_s: f64) -> Vec<Series> {
        let steps = ((to_s - from_s) * PATH_HZ).max(0.0) as u64;
        let times = (0..=steps).map(|i| self.time(from_s + i as f64 / PATH_HZ));
        let mut paths: std::collections::BTreeMap<u32, Vec<(f64, f64)>> = Default::default();
        for (step, time) in times.enumerate() {
            for person in self.world.people_at(time) {
                let path = paths.entry(person.id).or_default();
                path.resize(step, (f64::NAN, f64::NAN));
                path.push(View::Top.of(&person.centre_world.coords));
            }
        }
        let series = |path| Series::new("people", Colour::Purple, path).styled(Style::Dashed);
        paths.into_values().map(series).collect()
    }

    /// Where vehicle and people were, every `step_s`.
    fn time_marks(&self, from_s: f64, to_s: f64, step_s: f64) -> Vec<MapPoint> {
        let first = (from_s / step_s).ceil().max(0.0) as u64;
        let last = (to_s / step_s).floor().max(0.0) as u64;
        let mark = |at, label: &str| MapPoint {
            at,
            label: label.to_owned(),
            glyph: Glyph::Dot,
        };
        let mut marks = Vec::new();
        for t_s in (first..=last).map(|i| i as f64 * step_s) {
            let label = format!("{t_s:.0}");
            let sample = self.log.samples.iter().find(|s| s.t_s >= t_s);
            marks.extend(sample.map(|s| mark(View::Top.of(&s.true_position), &label)));
            let people = self.world.people_at(self.time(t_s));
            marks.extend(people.map(|p| mark(View::Top.of(&p.centre_world.coords), &label)));
        }
        marks
    }

    fn distance_chart(&self, markers: &[Marker]) -> LineChart {
        let rows = &self.belief.distances;
        let still = rows.iter().map(|d| (d.t_s, d.still_m.unwrap_or(f64::NAN)));
        let ids: std::collections::BTreeSet<u32> = rows
            .iter()
            .flat_map(|d| d.people_m.iter().map(|(id, _)| *id))
            .collect();
        let person = |id: u32| {
            let distance = move |people: &[(u32, f64)]| {
                let found = people.iter().find(|(other, _)| *other == id);
                found.map_or(f64::NAN, |(_, distance)| *distance)
            };
            let points = rows.iter().map(|d| (d.t_s, distance(&d.people_m)));
            let colour = [Colour::Purple, Colour::Orange, Colour::Blue][id as usize % 3];
            // Beyond a few people, names would fill the figure.
            let name = if ids.len() <= 3 {
                format!("to person {}", id + 1)
            } else {
                "to people".to_owned()
            };
            Series::new(&name, colour, points.collect())
        };
        let ends = [rows.first(), rows.last()].into_iter().flatten();
        let limit = ends.map(|d| (d.t_s, self.contact_distance_m)).collect();
        let mut series = vec![Series::new(
            "to things that stand",
            Colour::Ink,
            still.collect(),
        )];
        series.extend(ids.iter().map(|id| person(*id)));
        let limit_name = format!("{:.2} m", self.contact_distance_m);
        series.push(Series::new(&limit_name, Colour::Vermillion, limit).styled(Style::Dashed));
        LineChart {
            title: "true distance from the vehicle's centre".to_owned(),
            x_label: "time (s)".to_owned(),
            y_label: "distance (m)".to_owned(),
            series,
            markers: markers.to_vec(),
            y_range: Some((0.0, FAR_M)),
            ..LineChart::default()
        }
    }

    fn iterations_chart(&self, markers: &[Marker]) -> LineChart {
        let solves = &self.belief.solves;
        let of = |exits: &[PlanExit]| {
            let of_kind = solves.iter().filter(|s| exits.contains(&s.exit));
            let points = of_kind.map(|s| (s.t_s, f64::from(s.iterations)));
            points.collect::<Vec<_>>()
        };
        let kinds: [(&str, Colour, &[PlanExit]); 3] = [
            ("converged", Colour::Blue, &[PlanExit::Converged]),
            (
                "iteration limit",
                Colour::Orange,
                &[PlanExit::IterationLimit],
            ),
            (
                "no progress or failed",
                Colour::Vermillion,
                &[PlanExit::NoProgress, PlanExit::Failed],
            ),
        ];
        let series = kinds.map(|(name, colour, exits)| {
            Series::new(name, colour, of(exits)).styled(Style::Points)
        });
        LineChart {
            title: "solver".to_owned(),
            x_label: "time (s)".to_owned(),
            y_label: "subproblems".to_owned(),
            series: series
                .into_iter()
                .filter(|s| !s.points.is_empty())
                .collect(),
            markers: markers.to_vec(),
            ..LineChart::default()
        }
    }

    fn violation_chart(&self, markers: &[Marker]) -> LineChart {
        let solves = self.belief.solves.iter();
        let points = solves.map(|s| (s.t_s, s.max_violation_m)).collect();
        LineChart {
            title: "greatest violation of a softened constraint".to_owned(),
            x_label: "time (s)".to_owned(),
            y_label: "slack (m)".to_owned(),
            series: vec![Series::new("", Colour::Vermillion, points)],
            markers: markers.to_vec(),
            ..LineChart::default()
        }
    }

    fn moment(&self, number: usize, moment: &Moment) -> MomentFigure {
        let title = format!(
            "{number}: at {:.1} s, {:.2} m from {}",
            moment.t_s,
            moment.distance_m,
            self.nearest(moment)
        );
        let pictures = moment.image.as_ref().map(|image| {
            [
                depth_picture(image, &moment.detections),
                u_depth_picture(image, moment, self.eye),
            ]
        });
        MomentFigure {
            title,
            map: self.moment_map(moment),
            pictures: pictures.into_iter().flatten().collect(),
        }
    }

    /// Name of what was nearest.
    fn nearest(&self, moment: &Moment) -> String {
        let centre = moment.world_from_body.translation.vector.into();
        let nearest = self.world.clearance(&centre, moment.time);
        nearest.map_or("nothing".to_owned(), |c| {
            self.world.describe(c.what).to_owned()
        })
    }

    fn moment_map(&self, moment: &Moment) -> MapView {
        let centre = moment.world_from_body.translation.vector;
        let (from_s, to_s) = (moment.t_s - AROUND_S, moment.t_s + AROUND_S);
        let ahead_s = moment.plan.map_or(AHEAD_S, |plan| {
            plan.interval_s * (plan.points.len() - 1) as f64
        });
        let mut shapes = shapes(View::Top, self.world, moment.time);
        shapes.push(MapShape::new(
            Outline::Circle {
                centre: (centre.x, centre.y),
                radius: self.contact_distance_m,
            },
            Fill::Margin,
        ));
        for obstacle in &moment.obstacles {
            shapes.extend(believed(obstacle, ahead_s));
        }
        let mut paths = self.people_paths(from_s.max(0.0), to_s);
        paths.extend(self.speed_path(from_s, to_s));
        paths.extend(field_of_view(moment));
        paths.extend(moment.obstacles.iter().filter_map(|o| velocity(o, ahead_s)));
        let (plan, target) = plan(moment);
        paths.extend(plan);
        let around = |x: f64| Some((x - MOMENT_REACH_M, x + MOMENT_REACH_M));
        MapView {
            title: String::new(),
            x_label: "x east (m)".to_owned(),
            y_label: "y north (m)".to_owned(),
            shapes,
            paths,
            points: target.into_iter().collect(),
            x_range: around(centre.x),
            y_range: around(centre.y),
        }
    }

    fn hindrance_table(&self) -> Table {
        let row = |h: &alula_runtime::belief::Hindered| Row {
            cells: vec![
                format!("{:.1}", h.from_s),
                format!("{:.1}", h.to_s - h.from_s),
                h.by.describe().to_owned(),
            ],
            status: Status::Neutral,
        };
        Table {
            title: "What kept it from advancing".to_owned(),
            header: ["from (s)", "for (s)", "reason"]
                .map(str::to_owned)
                .to_vec(),
            rows: self.belief.hindrances.iter().map(row).collect(),
            caption: String::new(),
        }
    }
}

/// Time between marks on paths: a dozen marks or fewer, on round times.
fn mark_step_s(duration_s: f64) -> f64 {
    let steps = [1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0];
    let few = steps.into_iter().find(|step| duration_s / step <= 12.0);
    few.unwrap_or(1000.0)
}

/// Width of a class of speed, m/s: the classes reach up to the greatest speed.
fn speed_step(max_m_s: f64) -> f64 {
    ((max_m_s / SPEEDS.len() as f64) * 10.0).ceil().max(1.0) / 10.0
}

/// An obstacle as it is believed to be, where its centre may be, and where that is some time on.
fn believed(obstacle: &Obstacle, ahead_s: f64) -> Vec<MapShape> {
    let centre = View::Top.of(&obstacle.centre_world);
    let size = (obstacle.size_m.x, obstacle.size_m.y);
    let outline = match obstacle.footprint {
        alula_messages::Footprint::Round => Outline::Ellipse {
            centre,
            half_axes: (0.5 * size.0, 0.5 * size.1),
            angle_rad: obstacle.yaw_rad,
        },
        alula_messages::Footprint::Flat => Outline::Rect {
            centre,
            size,
            angle_rad: obstacle.yaw_rad,
        },
    };
    let fill = match (obstacle.sight, obstacle.motion) {
        (Sight::Seen, ObstacleMotion::Static) => Fill::BelievedStill,
        (Sight::Seen | Sight::Missed, ObstacleMotion::Moving) => Fill::BelievedMoving,
        _ => Fill::BelievedUnseen,
    };
    let mut shapes = vec![MapShape::new(outline, fill).labelled(&obstacle.id.to_string())];
    if obstacle.motion == ObstacleMotion::Moving {
        for dt_s in [0.0, ahead_s] {
            let place = obstacle.centre_after(dt_s);
            let covariance = obstacle.centre_covariance_after(dt_s);
            shapes.push(MapShape::new(
                sigma_ellipse(&place, &covariance, 2.0),
                Fill::Uncertainty,
            ));
        }
    }
    shapes
}

/// The ellipse of `sigmas` standard deviations, from above.
fn sigma_ellipse(centre: &Vector3<f64>, covariance: &Matrix3<f64>, sigmas: f64) -> Outline {
    let (a, b, c) = (covariance[(0, 0)], covariance[(0, 1)], covariance[(1, 1)]);
    let middle = 0.5 * (a + c);
    let spread = (0.25 * (a - c) * (a - c) + b * b).sqrt();
    Outline::Ellipse {
        centre: View::Top.of(centre),
        half_axes: (
            sigmas * (middle + spread).max(0.0).sqrt(),
            sigmas * (middle - spread).max(0.0).sqrt(),
        ),
        angle_rad: 0.5 * (2.0 * b).atan2(a - c),
    }
}

/// An arrow to where a moving obstacle is believed to be some time on.
fn velocity(obstacle: &Obstacle, ahead_s: f64) -> Option<Series> {
    if obstacle.motion != ObstacleMotion::Moving {
        return None;
    }
    let (tail, tip) = (
        obstacle.centre_world.xy(),
        obstacle.centre_after(ahead_s).xy(),
    );
    let along = (tip - tail).try_normalize(1e-3)?;
    let across = nalgebra::Vector2::new(-along.y, along.x);
    let barb = |side: f64| tip - 0.15 * along + 0.08 * side * across;
    let points = [tail, tip, barb(1.0), tip, barb(-1.0)];
    let points = points.map(|p| (p.x, p.y)).to_vec();
    Some(Series::new("velocity", Colour::Orange, points))
}

/// The edges of what the camera sees, from the true pose.
fn field_of_view(moment: &Moment) -> Option<Series> {
    let image = moment.image.as_ref()?;
    let camera = &image.camera;
    let place = moment.world_from_body.translation.vector;
    let forward = image.body_from_camera.rotation * Vector3::z();
    let yaw = so3::yaw_rad(&moment.world_from_body.rotation) + forward.y.atan2(forward.x);
    let left = (camera.cx_px / camera.fx_px).atan();
    let right = ((f64::from(camera.width_px) - camera.cx_px) / camera.fx_px).atan();
    let edge = |angle: f64| {
        let (s, c) = angle.sin_cos();
        // Beyond the map on all sides.
        (
            place.x + 3.0 * MOMENT_REACH_M * c,
            place.y + 3.0 * MOMENT_REACH_M * s,
        )
    };
    let points = vec![edge(yaw + left), (place.x, place.y), edge(yaw - right)];
    Some(Series::new("field of view", Colour::Grey, points).styled(Style::Dashed))
}

/// The plan and where it leads.
fn plan(moment: &Moment) -> (Option<Series>, Option<MapPoint>) {
    let Some(plan) = &moment.plan else {
        return (None, None);
    };
    let points = plan.points.iter().map(|p| View::Top.of(&p.position_world));
    let target = MapPoint {
        at: View::Top.of(&plan.target_world),
        label: "target".to_owned(),
        glyph: Glyph::End,
    };
    let line = Series::new("plan", Colour::Ink, points.collect());
    (Some(line), Some(target))
}

#[cfg(test)]
#[path = "belief_tests.rs"]
mod tests;
