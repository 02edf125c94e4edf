//! The detector over real depth images of an office in which nothing moves: what stands still must
//! be found where it was.

use std::time::Instant;

use alula_messages::{DepthImage, Detection, Footprint};
use alula_perception::detect::reduce;
use alula_perception::{Detector, DetectorConfig, UDepth, View};
use alula_record::seven_scenes::{self, Frame as Recorded};
use nalgebra::{Matrix3, Vector3};

use super::{
    Chart, Column, Curve, CurveBand, Demand, Frame, Outline, Progress, Request, Results, Row,
    Study, Tone, Watch, data_folder,
};
use crate::RunError;
use crate::timing::Distribution;

/// Document L, sections 5-1-3 and 7-3.
pub const STUDY: Study = Study {
    name: "depth-office",
    source: "document L, sections 5-1-3 and 7-3, figure 5-3; images of 7-Scenes (Shotton et al. 2013)",
    about: "boxes in real depth images of an office: time, and whether they stay where they are",
    runs_are: "images",
    default_runs: 250,
    execute,
};

const FOLDER: &str = "kinect_office";
const HOW_TO_GET_IT: &str = "Download the scene `office` of 7-Scenes from Microsoft Research, unpack \
    its first sequence into a folder `kinect_office`";

/// Boxes of neighbouring images further apart than this are not the same thing, m.
const SAME_M: f64 = 0.3;

/// Standard deviation of the poses of the recording, rad.
const POSE_SIGMA_RAD: f64 = 0.005;

/// Growth of the noise of the structured light of the first Kinect, 1/m (Khoshelham and Elberink,
/// 2012: 1.4 mm at 1 m, growing with the square).
const NOISE_PER_M: f64 = 0.0015;

/// 75 % of the source's detections and trackings were quicker than this, ms (section 7-3).
const THEIRS_P75_MS: f64 = 8.0;

/// What is asked: the median time, ms; of the boxes that the image shows whole, the share that is
/// found again and how far half and nine tenths of these move, m.
const MEDIAN_MS: f64 = 1.0;
const FOUND_AGAIN: f64 = 0.85;
const MEDIAN_M: f64 = 0.02;
const P90_M: f64 = 0.15;

/// An image is looked at so many times; the least time is that of the detector alone, the first one
/// holds what else the machine does.
const REPEATS: usize = 3;

/// Images in a row of the table.
const PART: usize = 25;

/// Images that are drawn.
const DRAWN: usize = 3;

/// Each so many images, the boxes are drawn into the map.
const MAPPED: usize = 10;

/// The brightest and the darkest depth of the drawn images, m.
const FAR_M: f32 = 5.0;

/// What was found in one image.
struct Look {
    /// The first and the least time, ms.
    time_ms: f64,
    best_ms: f64,
    boxes: Vec<Detection>,
    /// Moves of the boxes that the image shows whole since the image before, m; without limit if
    /// there was nothing of its kind.
    moves_m: Vec<f64>,
    pictures: Option<[Chart; 2]>,
}

fn execute(request: &Request, watch: &Watch) -> Result<Results, RunError> {
    let folder = data_folder(FOLDER, HOW_TO_GET_IT)?;
    let count = request.runs as usize;
    let frames: Vec<Recorded> = seven_scenes::open(&folder)?
        .take(count)
        .collect::<Result<_, _>>()?;
    let upright =
        seven_scenes::upright(frames.iter().step_by(10)).ok_or_else(|| RunError::Input {
            what: folder.display().to_string(),
            finding: "its images show too little of a level floor to tell where up is".into(),
            remedy: "Give more images".into(),
        })?;
    let config = DetectorConfig {
        noise_per_m: NOISE_PER_M,
        ..DetectorConfig::default()
    };
    let mut detector = Detector::new(&config)?;
    let mut small = frames[0].image.clone();
    let mut looks: Vec<Look> = Vec::with_capacity(frames.len());
    let asked = frames.len() as u64;
    for (number, frame) in frames.iter().enumerate() {
        let view = View {
            world_from_body: upright.pose(&frame.world_from_camera),
            orientation_covariance: Matrix3::identity() * POSE_SIGMA_RAD.powi(2),
            floor_height_m: Some(upright.floor_height_m),
        };
        let times_ms: [f64; REPEATS] = std::array::from_fn(|_| {
            let start = Instant::now();
            reduce(&frame.image, &mut small);
            detector.detect(&small, &view);
            start.elapsed().as_secs_f64() * 1e3
        });
        let boxes = detector.detect(&small, &view).to_vec();
        let before = looks.last().map(|look| look.boxes.as_slice());
        let drawn = (1..=DRAWN).any(|i| number == i * (frames.len() - 1) / (DRAWN + 1));
        looks.push(Look {
            time_ms: times_ms[0],
            best_ms: times_ms.into_iter().fold(f64::INFINITY, f64::min),
            moves_m: before.map_or(Vec::new(), |before| moves(&boxes, before)),
            pictures: drawn.then(|| pictures(number, &small, &boxes, &detector.u_depth())),
            boxes,
        });
        watch(Progress {
            done: number as u64 + 1,
            asked,
        });
    }
    Ok(results(&looks))
}

/// Distances, m, seen from above, from each box that the image shows whole to the nearest one of
/// its kind in the image before.
fn moves(boxes: &[Detection], before: &[Detection]) -> Vec<f64> {
    let whole = boxes.iter().filter(|b| !(b.cut.left || b.cut.right));
    let nearest = |b: &Detection| {
        let same = before.iter().filter(|o| o.footprint == b.footprint);
        let apart = same.map(|o| (o.centre_world - b.centre_world).xy().norm());
        apart.fold(f64::INFINITY, f64::min)
    };
    whole.map(nearest).collect()
}

/// Figures over some images.
struct Figures {
    boxes: f64,
    round: f64,
    again: f64,
    moves: Distribution,
    p90_m: f64,
    time: Distribution,
    best: Distribution,
}

impl Figures {
    fn of(looks: &[Look]) -> Self {
        let count = looks.len() as f64;
        let boxes = || looks.iter().flat_map(|look| &look.boxes);
        let round = boxes().filter(|b| b.footprint == Footprint::Round).count();
        let whole: Vec<f64> = looks.iter().flat_map(|look| look.moves_m.clone()).collect();
        let mut again: Vec<f64> = whole.iter().copied().filter(|m| *m < SAME_M).collect();
        again.sort_by(f64::total_cmp);
        let times = |of: fn(&Look) -> f64| {
            let times: Vec<f64> = looks.iter().map(of).collect();
            Distribution::of(&times)
        };
        Self {
            boxes: boxes().count() as f64 / count,
            round: round as f64 / count,
            again: again.len() as f64 / whole.len() as f64,
            moves: Distribution::of(&again),
            p90_m: again
                .get((again.len() * 9).div_ceil(10).saturating_sub(1))
                .copied()
                .unwrap_or(f64::NAN),
            time: times(|look| look.time_ms),
            best: times(|look| look.best_ms),
        }
    }

    fn row(&self, images: &str) -> Row {
        Row::new()
            .with("images", images)
            .with("boxes", self.boxes)
            .with("round", self.round)
            .with("found_again", self.again)
            .with("move_p50_m", self.moves.p50)
            .with("move_p90_m", self.p90_m)
            .with("best_p50_ms", self.best.p50)
            .with("best_p99_ms", self.best.p99)
            .with("time_p50_ms", self.time.p50)
            .with("time_p75_ms", self.time.p75)
            .with("time_p99_ms", self.time.p99)
    }
}

fn results(looks: &[Look]) -> Results {
    let all = Figures::of(looks);
    let mut rows = vec![all.row("all").theirs("time_p75_ms", THEIRS_P75_MS)];
    for (i, part) in looks.chunks(PART).enumerate() {
        let (from, to) = (i * PART, i * PART + part.len() - 1);
        rows.push(Figures::of(part).row(&format!("{from} to {to}")));
    }
    Results {
        runs: looks.len() as u64,
        columns: columns(),
        rows,
        demands: vec![
            Demand::at_most("time of an image, median", "ms", MEDIAN_MS, all.time.p50),
            Demand::at_least(
                "share of whole boxes found again in the next image",
                "",
                FOUND_AGAIN,
                all.again,
            ),
            Demand::at_most("move of a box, median", "m", MEDIAN_M, all.moves.p50),
            Demand::at_most("move of a box, 90 %", "m", P90_M, all.p90_m),
        ],
        charts: charts(looks),
        notes: vec![
            "The time is that of halving an image of 640x480 and of finding the boxes in it, on one \
             core: the best of three looks at each image, which what else the machine does disturbs \
             least, and the first of them. The source's figure is that of detection and tracking on its vehicle, of images \
             that it does not state the size of."
                .to_owned(),
            format!(
                "Nothing moves but the camera. A box found again has one of its kind within \
                 {SAME_M} m in the image before, in the world of the recorded poses; boxes that the \
                 image cuts off at a side are left out."
            ),
        ],
    }
}

fn columns() -> Vec<Column> {
    vec![
        Column::new("images", "images", 0),
        Column::new("boxes", "boxes", 1),
        Column::new("round", "round", 1),
        Column::new("found_again", "found again", 3),
        Column::new("move_p50_m", "move (m)", 3),
        Column::new("move_p90_m", "90 % (m)", 3),
        Column::new("best_p50_ms", "best (ms)", 2),
        Column::new("best_p99_ms", "99 % (ms)", 2),
        Column::new("time_p50_ms", "first (ms)", 2),
        Column::new("time_p75_ms", "75 % (ms)", 2),
        Column::new("time_p99_ms", "99 % (ms)", 2),
    ]
}

fn charts(looks: &[Look]) -> Vec<Chart> {
    let pictures = looks.iter().filter_map(|look| look.pictures.clone());
    let mut charts: Vec<Chart> = pictures.flatten().collect();
    charts.push(map(looks));
    let curve = |of: &dyn Fn(&Look) -> f64| {
        let points = looks.iter().enumerate();
        points.map(|(i, look)| (i as f64, of(look))).collect()
    };
    let median = |look: &Look| match look.moves_m.len() {
        0 => f64::NAN,
        _ => Distribution::of(&look.moves_m).p50,
    };
    let p75 = |look: &Look| match look.moves_m.len() {
        0 => f64::NAN,
        _ => Distribution::of(&look.moves_m).p75,
    };
    let band = looks.iter().enumerate();
    charts.push(Chart::Curves {
        title: "moves of the boxes from image to image".to_owned(),
        x_label: "image".to_owned(),
        y_label: "move (m)".to_owned(),
        curves: vec![Curve::line("median", Tone::Measured, curve(&median))],
        bands: vec![CurveBand {
            name: "up to three quarters".to_owned(),
            points: band.map(|(i, look)| (i as f64, 0.0, p75(look))).collect(),
            tone: Tone::Measured,
        }],
    });
    charts.push(Chart::Curves {
        title: "time of an image, best of three".to_owned(),
        x_label: "image".to_owned(),
        y_label: "time (ms)".to_owned(),
        curves: vec![Curve::dots("", Tone::Measured, curve(&|look| look.best_ms))],
        bands: Vec::new(),
    });
    charts
}

/// All boxes from above, in the world of the recording.
fn map(looks: &[Look]) -> Chart {
    let boxes = looks.iter().step_by(MAPPED).flat_map(|look| &look.boxes);
    let outline = |b: &Detection| Outline {
        corners: corners(b),
        truth: false,
        label: String::new(),
    };
    let centres = looks.iter().flat_map(|look| &look.boxes);
    Chart::Map {
        title: format!(
            "boxes of each {MAPPED}th image, and the centres of all, from above in the world"
        ),
        x_label: "x (m)".to_owned(),
        y_label: "y (m)".to_owned(),
        curves: vec![Curve::dots(
            "centres",
            Tone::Measured,
            centres
                .map(|b| (b.centre_world.x, b.centre_world.y))
                .collect(),
        )],
        outlines: boxes.map(outline).collect(),
    }
}

/// Corners of a box seen from above, world, m.
fn corners(b: &Detection) -> Vec<(f64, f64)> {
    let (sin, cos) = b.yaw_rad.sin_cos();
    let along = Vector3::new(cos, sin, 0.0) * (0.5 * b.size_m.x);
    let across = Vector3::new(-sin, cos, 0.0) * (0.5 * b.size_m.y);
    [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
        .iter()
        .map(|(a, c)| {
            let corner = b.centre_world + along * *a + across * *c;
            (corner.x, corner.y)
        })
        .collect()
}

/// A depth image with its boxes, and its U-depth map.
fn pictures(number: usize, image: &DepthImage, boxes: &[Detection], map: &UDepth) -> [Chart; 2] {
    let share = |mm: &u16| match mm {
        0 | &u16::MAX => f32::NAN,
        // Near is bright.
        mm => 1.0 - f32::from(*mm) * 1e-3 / FAR_M,
    };
    let frame = |b: &Detection| Frame {
        edges: [
            f64::from(b.window.left),
            f64::from(b.window.top),
            // The last column and row belong to the window.
            f64::from(b.window.right) + 1.0,
            f64::from(b.window.bottom) + 1.0,
        ],
        label: format!("{:.1} m", b.depth_m[0]),
    };
    let camera = &image.camera;
    let aspect = f64::from(camera.height_px) / f64::from(camera.width_px.max(1));
    [
        Chart::Image {
            title: format!("image {number} with the boxes found in it"),
            columns: camera.width_px as usize,
            shares: image.depth_mm.iter().map(share).collect(),
            aspect: None,
            frames: boxes.iter().map(frame).collect(),
            scale: [format!("{FAR_M:.0} m and beyond"), "0 m".to_owned()],
        },
        u_depth(number, map, camera.height_px, aspect),
    ]
}

/// The U-depth map, the farthest bins on top.
fn u_depth(number: usize, map: &UDepth, height_px: u32, aspect: f64) -> Chart {
    // A surface that fills half of a column's height is bright.
    let full = 0.5 * height_px as f32;
    let share = |bin: usize, column: usize| match map.count(bin, column) {
        // The nearest bin holds the pixels without a return as well.
        _ if bin == 0 => f32::NAN,
        0 => f32::NAN,
        count => (1.0 + f32::from(count)).ln() / (1.0 + full).ln(),
    };
    let rows = (0..map.bins).rev();
    Chart::Image {
        title: format!("U-depth map of image {number}, far on top"),
        columns: map.columns,
        shares: rows
            .flat_map(|bin| (0..map.columns).map(move |column| (bin, column)))
            .map(|(bin, column)| share(bin, column))
            .collect(),
        aspect: Some(aspect),
        frames: Vec::new(),
        scale: [
            "1 pixel".to_owned(),
            format!("{full:.0}; {:.1} m high", map.bin_m * map.bins as f64),
        ],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(x_m: f64, footprint: Footprint) -> Detection {
        Detection {
            sensor: 0,
            centre_world: Vector3::new(x_m, 0.0, 0.0),
            yaw_rad: 0.0,
            size_m: Vector3::new(1.0, 1.0, 1.0),
            footprint,
            centre_covariance: Matrix3::zeros(),
            size_variance_m2: Vector3::zeros(),
            cut: Default::default(),
            window: Default::default(),
            depth_m: [1.0, 1.5],
            pixels: 100,
        }
    }

    #[test]
    fn a_move_is_to_the_nearest_of_its_kind() {
        let now = [found(1.0, Footprint::Round)];
        let before = [
            found(1.01, Footprint::Flat),
            found(1.25, Footprint::Round),
            found(0.5, Footprint::Round),
        ];
        assert_eq!(moves(&now, &before), [0.25]);
    }

    #[test]
    fn boxes_that_the_image_cuts_off_are_left_out() {
        let mut cut = found(1.0, Footprint::Round);
        cut.cut.left = true;
        assert!(moves(&[cut], &[found(1.0, Footprint::Round)]).is_empty());
    }

    #[test]
    fn corners_of_a_box_turn_with_it() {
        let turned = Detection {
            size_m: Vector3::new(2.0, 0.0, 1.0),
            yaw_rad: std::f64::consts::FRAC_PI_2,
            ..found(0.0, Footprint::Flat)
        };
        let (x, y) = corners(&turned)[1];
        assert!(x.abs() < 1e-12 && (y - 1.0).abs() < 1e-12, "{x} {y}");
    }
}
