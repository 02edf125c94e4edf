//! Which detection belongs to which track.

use alula_geometry::Timestamp;
use alula_messages::{Cut, Detection, Footprint};
use alula_optim::AssignmentSolver;
use nalgebra::{Cholesky, Matrix3, Vector3};

use super::config::TrackerConfig;
use super::faces::{FACES, Faces};
use super::followed::{Track, covers};
use super::{Gates, flat};

/// Greatest coordinate, length and standard deviation of a detection that is believed, m.
const MAX_COORDINATE_M: f64 = 1e6;
const MAX_LENGTH_M: f64 = 100.0;

/// A detection reaches so far over a track's box and is still a fragment of it, m.
const FRAGMENT_MARGIN_M: f64 = 0.15;

/// Centres that are further apart than this and the standard deviations allow are not compared.
const NEAR_M: f64 = 2.0;
const NEAR_SIGMA: f64 = 4.0;

/// Two boxes touch in the image if at most this many columns lie between them.
const TOUCHING_COLUMNS: u16 = 3;

/// What hides a box is nearer by this much, m.
const NEARER_M: f64 = 0.1;

/// A detection of this image.
#[derive(Clone, Debug)]
pub(super) struct Seen {
    pub detection: Detection,
    pub faces: Faces,
    /// Horizontal distance from the camera, m.
    pub distance_m: f64,
    /// The track that it corrects.
    pub track: Option<usize>,
    /// It is part of something that is followed already.
    absorbed: bool,
}

impl Seen {
    pub fn new(
        detection: &Detection,
        camera_world: &Vector3<f64>,
        hidden: Cut,
        shape_noise_m: f64,
        distance_m: f64,
    ) -> Self {
        Self {
            detection: *detection,
            faces: Faces::new(detection, camera_world, hidden, shape_noise_m),
            distance_m,
            track: None,
            absorbed: false,
        }
    }

    /// Whether it is of something that is not followed yet.
    pub fn is_new(&self) -> bool {
        self.track.is_none() && !self.absorbed
    }

    fn covers(&self, point: &Vector3<f64>) -> bool {
        let d = &self.detection;
        covers(&d.centre_world, d.yaw_rad, &d.size_m, point, 0.0)
    }
}

/// What became of a track in this image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Fate {
    #[default]
    Unmatched,
    Matched,
    /// One detection covers it and others.
    Merged,
    /// Newer pieces of the same wall cover it.
    Replaced,
}

/// Matches detections with tracks; keeps the workspace for it.
#[derive(Clone, Debug)]
pub(super) struct Associator {
    costs: Vec<f64>,
    rows: Vec<usize>,
    columns: Vec<usize>,
    solver: AssignmentSolver,
    fates: Vec<Fate>,
}

impl Associator {
    pub fn new(max_tracks: usize, max_detections: usize) -> Self {
        Self {
            costs: Vec::with_capacity(max_tracks * max_detections),
            rows: Vec::with_capacity(max_tracks),
            columns: Vec::with_capacity(max_detections),
            solver: AssignmentSolver::new(max_tracks, max_detections),
            fates: Vec::with_capacity(max_tracks),
        }
    }

    pub fn is_matched(&self, track: usize) -> bool {
        self.fates.get(track) == Some(&Fate::Matched)
    }

    pub fn is_merged(&self, track: usize) -> bool {
        self.fates.get(track) == Some(&Fate::Merged)
    }

    pub fn is_replaced(&self, track: usize) -> bool {
        self.fates.get(track) == Some(&Fate::Replaced)
    }

    /// Sets the track of every detection that belongs to one.
    pub fn run(
        &mut self,
        config: &TrackerConfig,
        gates: &Gates,
        time: Timestamp,
        tracks: &mut [Track],
        seen: &mut [Seen],
    ) {
        self.fates.clear();
        self.fates.resize(tracks.len(), Fate::Unmatched);
        // Who was lost for long could be anywhere, and takes only what is left: not a part of
        // somebody who was seen a moment ago.
        for longest_s in [config.life.merge_s, f64::INFINITY] {
            let is_due = |track: &Track| time.seconds_since(track.last_seen) <= longest_s;
            self.match_round(gates, tracks, seen, is_due);
            self.hold_merged(config, time, tracks, seen);
            self.rescue(tracks, seen, is_due);
            self.absorb_fragments(tracks, seen);
        }
        self.match_flat(config, gates, tracks, seen);
        self.replace_flat(config, gates, tracks, seen);
    }

    /// Round tracks and round detections, at the greatest likelihood within the gates.
    fn match_round(
        &mut self,
        gates: &Gates,
        tracks: &[Track],
        seen: &mut [Seen],
        of: impl Fn(&Track) -> bool,
    ) {
        // A pair at the gate is as good as none.
        let skip = gates.of_sides[FACES];
        let is_round = |track: &Track| track.footprint == Footprint::Round && of(track);
        self.assign(
            tracks,
            seen,
            Footprint::Round,
            is_round,
            skip,
            |track, seen| round_cost(track, seen, gates),
        );
    }

    /// Flat tracks and flat detections.
    fn match_flat(
        &mut self,
        config: &TrackerConfig,
        gates: &Gates,
        tracks: &[Track],
        seen: &mut [Seen],
    ) {
        let (flat, gate) = (&config.flat, gates.of_sides[1]);
        // Above any cost of a permitted pair.
        let skip = 100.0 + gate;
        let is_flat = |track: &Track| track.footprint == Footprint::Flat;
        self.assign(
            tracks,
            seen,
            Footprint::Flat,
            is_flat,
            skip,
            |track, seen| flat::cost(track, &seen.detection, flat, gate),
        );
    }

    fn assign(
        &mut self,
        tracks: &[Track],
        seen: &mut [Seen],
        footprint: Footprint,
        of: impl Fn(&Track) -> bool,
        skip_cost: f64,
        cost: impl Fn(&Track, &Seen) -> f64,
    ) {
        self.rows.clear();
        self.columns.clear();
        self.costs.clear();
        let is_open = |fate: &Fate| *fate == Fate::Unmatched;
        self.rows
            .extend((0..tracks.len()).filter(|&i| of(&tracks[i]) && is_open(&self.fates[i])));
        self.columns.extend(
            (0..seen.len())
                .filter(|&j| seen[j].detection.footprint == footprint && seen[j].is_new()),
        );
        for &row in &self.rows {
            let costs = self
                .columns
                .iter()
                .map(|&column| cost(&tracks[row], &seen[column]));
            self.costs.extend(costs);
        }
        let (rows, columns) = (self.rows.len(), self.columns.len());
        let pairs = self.solver.solve(&self.costs, rows, columns, skip_cost);
        for (&row, pair) in self.rows.iter().zip(pairs) {
            if let Some(column) = *pair {
                seen[self.columns[column]].track = Some(row);
                self.fates[row] = Fate::Matched;
            }
        }
    }

    /// A detection over several fresh tracks is of things that stand too close to be told apart:
    /// the tracks go on by themselves for a while.
    fn hold_merged(
        &mut self,
        config: &TrackerConfig,
        time: Timestamp,
        tracks: &[Track],
        seen: &mut [Seen],
    ) {
        for seen in seen.iter_mut().filter(|seen| seen.is_new()) {
            let is_fresh = |track: &Track| {
                track.images >= config.life.confirm_images
                    && time.seconds_since(track.last_seen) <= config.life.merge_s
            };
            let open = |fates: &[Fate], i: usize| {
                matches!(fates[i], Fate::Unmatched | Fate::Merged)
                    && tracks[i].footprint == Footprint::Round
                    && is_fresh(&tracks[i])
                    && seen.covers(&tracks[i].position())
            };
            if (0..tracks.len()).filter(|&i| open(&self.fates, i)).count() < 2 {
                continue;
            }
            for i in 0..tracks.len() {
                if open(&self.fates, i) {
                    self.fates[i] = Fate::Merged;
                }
            }
            seen.absorbed = true;
        }
    }

    /// A detection in the box of a track that matched nothing is the same thing in a strange
    /// shape: the nearest one corrects the track, at raised noise.
    fn rescue(&mut self, tracks: &[Track], seen: &mut [Seen], of: impl Fn(&Track) -> bool) {
        for i in 0..tracks.len() {
            let track = &tracks[i];
            let is_open = self.fates[i] == Fate::Unmatched && of(track);
            if !is_open || track.footprint != Footprint::Round {
                continue;
            }
            let distance = |seen: &Seen| (seen.detection.centre_world - track.position()).norm();
            let inside = |seen: &&mut Seen| {
                seen.is_new()
                    && is_compact(&seen.detection)
                    && track.covers(&seen.detection.centre_world, 0.0)
            };
            let nearest = seen
                .iter_mut()
                .filter(inside)
                .min_by(|a, b| distance(a).total_cmp(&distance(b)));
            if let Some(nearest) = nearest {
                if nearest.detection.footprint == Footprint::Flat {
                    nearest.faces.open_back();
                }
                nearest.track = Some(i);
                self.fates[i] = Fate::Matched;
            }
        }
    }

    /// Detections inside the box of a matched track are parts of the same thing, as legs and arms
    /// of a person: their boxes are united.
    fn absorb_fragments(&self, tracks: &[Track], seen: &mut [Seen]) {
        for part in 0..seen.len() {
            if !seen[part].is_new() {
                continue;
            }
            let detection = seen[part].detection;
            let whole = (0..seen.len()).find(|&whole| {
                seen[whole].track.is_some_and(|track| {
                    tracks[track].footprint == Footprint::Round
                        && is_fragment(&tracks[track], &detection)
                })
            });
            if let Some(whole) = whole {
                seen[whole].faces.unite(&detection);
                seen[part].absorbed = true;
            }
        }
    }

    /// Flat tracks that were not matched and that this image's pieces cover are replaced by them.
    fn replace_flat(
        &mut self,
        config: &TrackerConfig,
        gates: &Gates,
        tracks: &[Track],
        seen: &[Seen],
    ) {
        for (track, fate) in tracks.iter().zip(&mut self.fates) {
            if track.footprint != Footprint::Flat || *fate != Fate::Unmatched {
                continue;
            }
            let covered: f64 = seen
                .iter()
                .filter(|seen| seen.detection.footprint == Footprint::Flat)
                .map(|seen| {
                    flat::covered_m(track, &seen.detection, &config.flat, gates.of_sides[1])
                })
                .sum();
            if covered >= config.flat.replaced_overlap * track.size().x {
                *fate = Fate::Replaced;
            }
        }
    }
}

/// Negative logarithm of the likelihood of a pair, over that of a measurement without error;
/// infinite outside the gate.
fn round_cost(track: &Track, seen: &Seen, gates: &Gates) -> f64 {
    if is_far(track, seen, gates) {
        return f64::INFINITY;
    }
    match track.innovation(&seen.faces) {
        Some(innovation) if innovation.distance <= gates.of_sides[innovation.degrees] => {
            0.5 * (innovation.distance + innovation.log_vagueness)
        }
        _ => f64::INFINITY,
    }
}

/// Whether a pair cannot pass the gate, at little cost.
///
/// `(a . nu)^2 / (a^T S a)` never exceeds the squared Mahalanobis distance. With all upright sides
/// shown some `a` makes the distance of the centres of it, of a variance below the traces' sum.
fn is_far(track: &Track, seen: &Seen, gates: &Gates) -> bool {
    let detection = &seen.detection;
    let apart = (detection.centre_world - track.position()).xy().norm();
    if seen.faces.shown[..4].iter().all(|&shown| shown) {
        let variance = track.state.position_variance_m2() + seen.faces.centre_variance_m2();
        return apart * apart > gates.of_sides[FACES] * variance;
    }
    let reach = NEAR_M + 0.5 * detection.size_m.xy().norm();
    apart > reach + NEAR_SIGMA * track.state.position_sigma_m()
}

/// Whether a detection could be of one person or pillar.
fn is_compact(detection: &Detection) -> bool {
    const MAX_COMPACT_M: f64 = 1.2;
    detection.footprint == Footprint::Round || detection.size_m.x <= MAX_COMPACT_M
}

fn is_fragment(track: &Track, detection: &Detection) -> bool {
    let inside = match detection.footprint {
        Footprint::Round => track.covers(&detection.centre_world, FRAGMENT_MARGIN_M),
        Footprint::Flat => is_whole_surface_inside(track, detection),
    };
    let smaller = (0..2).all(|i| {
        detection.size_m[i] <= track.size()[0].max(track.size()[1]) + 2.0 * FRAGMENT_MARGIN_M
    });
    inside && smaller
}

/// Whether a flat piece ends on both sides inside the box of a track: a wall behind or beside it goes
/// on.
fn is_whole_surface_inside(track: &Track, detection: &Detection) -> bool {
    let (sin, cos) = detection.yaw_rad.sin_cos();
    let half = Vector3::new(cos, sin, 0.0) * (0.5 * detection.size_m.x);
    let ends = [detection.centre_world - half, detection.centre_world + half];
    let is_cut = detection.cut.left || detection.cut.right;
    !is_cut && ends.iter().all(|end| track.covers(end, 0.0))
}

/// Whether a detection is of finite numbers of believable size, with covariances.
pub(super) fn is_usable(detection: &Detection) -> bool {
    let bounded = |x: &f64| x.abs() <= MAX_COORDINATE_M;
    let length = |x: &f64| (0.0..=MAX_LENGTH_M).contains(x);
    let variance = |x: &f64| (0.0..=MAX_LENGTH_M * MAX_LENGTH_M).contains(x);
    let covariance = &detection.centre_covariance;
    detection.centre_world.iter().all(bounded)
        && bounded(&detection.yaw_rad)
        && detection.size_m.iter().all(length)
        && detection.size_variance_m2.iter().all(variance)
        && covariance.diagonal().iter().all(variance)
        && (covariance - covariance.transpose()).amax() <= 1e-9 * covariance.amax()
        && Cholesky::new(covariance + Matrix3::identity() * 1e-12).is_some()
}

/// Sides of a box that something nearer hides: its neighbour in the image ends where it begins.
pub(super) fn hidden_sides(detections: &[Detection], index: usize) -> Cut {
    let this = &detections[index];
    let mut hidden = Cut::default();
    for (i, other) in detections.iter().enumerate() {
        let (a, b) = (&this.window, &other.window);
        let nearer = other.depth_m[0] + NEARER_M < this.depth_m[0];
        if i == index || !nearer || b.bottom < a.top || b.top > a.bottom {
            continue;
        }
        hidden.left |= b.left < a.left && b.right.saturating_add(TOUCHING_COLUMNS) >= a.left;
        hidden.right |= b.right > a.right && b.left <= a.right.saturating_add(TOUCHING_COLUMNS);
    }
    hidden
}
