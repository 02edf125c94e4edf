//! Messages for viewers: frames, paths, things and people, in the schemas of Foxglove.
//!
//! Nothing here is read back except depth pixels and the log.

use std::collections::BTreeMap;
use std::io::{Seek, Write};

use alula_geometry::{Pose, TimeDelta, Timestamp};
use alula_messages::{DepthImage, MAX_DEPTH_CAMERAS, StackOutput};
use foxglove::messages as fox;

use crate::RecordError;
use crate::convert_state::sigma;
use crate::draw::{
    Person, SceneShape, WORLD, calibration, depth_camera_frame, draw, entity, fox_pose, fox_vector,
    person, raw_image, stamp, transform,
};
use crate::draw_seen::{annotations, obstacle, plan, replace_all, u_depth_image};
use crate::recording::{LogLevel, TruthRecord};
use crate::sink::Sink;
use crate::topic::Topic;

/// Pixels and calibration of each depth camera.
const DEPTH_TOPICS: [[Topic; 2]; MAX_DEPTH_CAMERAS] = [
    [Topic::Depth, Topic::DepthCalibration],
    [Topic::Depth1, Topic::Depth1Calibration],
    [Topic::Depth2, Topic::Depth2Calibration],
    [Topic::Depth3, Topic::Depth3Calibration],
];

const BODY: &str = "body";
const BODY_TRUE: &str = "body_true";

/// Frames and poses: as often as a screen shows them.
const POSE_HZ: f64 = 50.0;
const SIGMA_HZ: f64 = 10.0;
const PEOPLE_HZ: f64 = 10.0;
const OBSTACLES_HZ: f64 = 10.0;
const PLAN_HZ: f64 = 10.0;
const U_DEPTH_HZ: f64 = 5.0;
/// How often a path is written, whole: a viewer that jumps in time draws the last one it finds.
const PATH_HZ: f64 = 1.0;
/// Most points of a path; a longer one keeps every second point.
const PATH_POINTS: usize = 400;
/// Time between the points of a path, until there are too many.
const PATH_STEP_S: f64 = 0.2;

/// What viewers were told so far.
pub(crate) struct View {
    pose: Throttle,
    pose_true: Throttle,
    sigma: Throttle,
    people: Throttle,
    path: Path,
    path_true: Path,
    mounts: BTreeMap<String, Pose>,
    mounts_chunk: Option<u64>,
    scene: Option<fox::SceneEntity>,
    calibration_chunks: [Option<u64>; MAX_DEPTH_CAMERAS],
    obstacles: Throttle,
    plan: Throttle,
    u_depth: Throttle,
    /// Exposure of the last image of the camera ahead that was written.
    image: Option<Timestamp>,
}

impl Default for View {
    fn default() -> Self {
        Self {
            pose: Throttle::from_hz(POSE_HZ),
            pose_true: Throttle::from_hz(POSE_HZ),
            sigma: Throttle::from_hz(SIGMA_HZ),
            people: Throttle::from_hz(PEOPLE_HZ),
            path: Path::new(),
            path_true: Path::new(),
            mounts: BTreeMap::new(),
            mounts_chunk: None,
            scene: None,
            calibration_chunks: [None; MAX_DEPTH_CAMERAS],
            obstacles: Throttle::from_hz(OBSTACLES_HZ),
            plan: Throttle::from_hz(PLAN_HZ),
            u_depth: Throttle::from_hz(U_DEPTH_HZ),
            image: None,
        }
    }
}

impl View {
    /// Frames, pose, path and standard deviations of the estimate.
    pub fn write_output<W: Write + Seek>(
        &mut self,
        sink: &mut Sink<W>,
        output: &StackOutput,
    ) -> Result<(), RecordError> {
        let now = output.time;
        if self.sigma.due(now) {
            let message = sigma(now.as_ns(), &output.state);
            sink.write(Topic::Sigma, now, now, &message)?;
        }
        self.repeat_mounts(sink, now)?;
        if !output.state.is_finite() {
            return Ok(());
        }
        let pose = &output.state.world_from_body;
        if self.pose.due(now) {
            write_frame(sink, now, BODY, pose)?;
            let message = fox::PoseInFrame {
                timestamp: stamp(now),
                frame_id: WORLD.to_owned(),
                pose: Some(fox_pose(pose)),
            };
            sink.write(Topic::Pose, now, now, &message)?;
        }
        self.write_sights(sink, output)?;
        self.path.extend(sink, Topic::Path, now, pose)
    }

    /// Obstacles, boxes in the image, and the plan.
    fn write_sights<W: Write + Seek>(
        &mut self,
        sink: &mut Sink<W>,
        output: &StackOutput,
    ) -> Result<(), RecordError> {
        let now = output.time;
        if let Some(seen_at) = output.seen_at {
            if self.obstacles.due(now) {
                let known = output.obstacles.iter();
                let finite = known.filter(|o| o.centre_world.iter().all(|x| x.is_finite()));
                let message = replace_all(now, finite.map(|o| obstacle(now, o)).collect());
                sink.write(Topic::SceneObstacles, now, now, &message)?;
            }
            // Boxes without their image help nobody.
            if self.image == Some(seen_at) {
                let message = annotations(seen_at, &output.detections);
                sink.write(Topic::Annotations, now, seen_at, &message)?;
            }
        }
        match &output.plan {
            Some(made) if self.plan.due(now) => {
                let message = replace_all(now, vec![plan(now, made)]);
                sink.write(Topic::ScenePlan, now, now, &message)
            }
            _ => Ok(()),
        }
    }

    /// A U-depth map.
    pub fn write_u_depth<W: Write + Seek>(
        &mut self,
        sink: &mut Sink<W>,
        time: Timestamp,
        [columns, bins]: [usize; 2],
        counts: &[u16],
    ) -> Result<(), RecordError> {
        if !self.u_depth.due(time) {
            return Ok(());
        }
        match u_depth_image(time, columns, bins, counts) {
            Some(message) => sink.write(Topic::UDepth, time, time, &message),
            None => Ok(()),
        }
    }

    /// Frame and path of the truth.
    pub fn write_truth<W: Write + Seek>(
        &mut self,
        sink: &mut Sink<W>,
        truth: &TruthRecord,
    ) -> Result<(), RecordError> {
        let pose = &truth.world_from_body;
        if self.pose_true.due(truth.time) {
            write_frame(sink, truth.time, BODY_TRUE, pose)?;
        }
        self.path_true
            .extend(sink, Topic::PathTrue, truth.time, pose)
    }

    /// Pixels of a depth image, and once in each chunk the camera.
    pub fn write_depth<W: Write + Seek>(
        &mut self,
        sink: &mut Sink<W>,
        now: Timestamp,
        image: &DepthImage,
    ) -> Result<(), RecordError> {
        self.mount(depth_camera_frame(image.sensor), &image.body_from_camera);
        self.repeat_mounts(sink, now)?;
        let camera = usize::from(image.sensor) % MAX_DEPTH_CAMERAS;
        let [topic, calibration_topic] = DEPTH_TOPICS[camera];
        let chunk = Some(sink.chunk_number());
        if self.calibration_chunks[camera] != chunk {
            self.calibration_chunks[camera] = chunk;
            sink.write(calibration_topic, now, image.time, &calibration(image))?;
        }
        if camera == 0 {
            self.image = Some(image.time);
        }
        sink.write(topic, now, image.time, &raw_image(image))
    }

    /// A frame that is fixed to the body.
    pub fn write_mount<W: Write + Seek>(
        &mut self,
        sink: &mut Sink<W>,
        now: Timestamp,
        name: &str,
        body_from_sensor: &Pose,
    ) -> Result<(), RecordError> {
        self.mount(name, body_from_sensor);
        self.repeat_mounts(sink, now)
    }

    fn mount(&mut self, name: &str, body_from_sensor: &Pose) {
        if self.mounts.get(name) != Some(body_from_sensor) {
            self.mounts.insert(name.to_owned(), *body_from_sensor);
            self.mounts_chunk = None;
        }
    }

    /// All frames that are fixed to the body, once in each chunk and when one is new.
    fn repeat_mounts<W: Write + Seek>(
        &mut self,
        sink: &mut Sink<W>,
        now: Timestamp,
    ) -> Result<(), RecordError> {
        let chunk = Some(sink.chunk_number());
        if self.mounts.is_empty() || self.mounts_chunk == chunk {
            return Ok(());
        }
        self.mounts_chunk = chunk;
        let mounts = self.mounts.iter();
        let message = fox::FrameTransforms {
            transforms: mounts
                .map(|(name, pose)| transform(now, BODY, name, pose))
                .collect(),
        };
        sink.write(Topic::TfStatic, now, now, &message)
    }

    /// Things that stand still, to be drawn as soon as the time is known.
    pub fn set_scene(&mut self, shapes: &[SceneShape]) {
        let mut entity = entity(Timestamp::ZERO, "scene".to_owned());
        for shape in shapes {
            draw(&mut entity, shape);
        }
        self.scene = Some(entity);
    }

    /// Draws the things that stand still, if that has not happened.
    pub fn write_scene<W: Write + Seek>(
        &mut self,
        sink: &mut Sink<W>,
        now: Timestamp,
    ) -> Result<(), RecordError> {
        let Some(mut entity) = self.scene.take() else {
            return Ok(());
        };
        entity.timestamp = stamp(now);
        let message = fox::SceneUpdate {
            deletions: Vec::new(),
            entities: vec![entity],
        };
        sink.write(Topic::Scene, now, now, &message)
    }

    /// People, on a topic of their own: a viewer that jumps in time sees the last message of each
    /// topic, and the scene is written once.
    pub fn write_people<W: Write + Seek>(
        &mut self,
        sink: &mut Sink<W>,
        time: Timestamp,
        people: impl IntoIterator<Item = Person>,
    ) -> Result<(), RecordError> {
        if !self.people.due(time) {
            return Ok(());
        }
        let message = fox::SceneUpdate {
            deletions: Vec::new(),
            entities: people.into_iter().map(|p| person(time, &p)).collect(),
        };
        sink.write(Topic::People, time, time, &message)
    }

    /// An event in words.
    pub fn write_log<W: Write + Seek>(
        &mut self,
        sink: &mut Sink<W>,
        time: Timestamp,
        level: LogLevel,
        text: &str,
    ) -> Result<(), RecordError> {
        let message = fox::Log {
            timestamp: stamp(time),
            level: level.to_foxglove() as i32,
            message: text.to_owned(),
            name: "alula".to_owned(),
            ..fox::Log::default()
        };
        sink.write(Topic::Log, time, time, &message)
    }
}

/// Lets a message through at most so often.
struct Throttle {
    period: TimeDelta,
    last: Option<Timestamp>,
}

impl Throttle {
    fn from_hz(rate_hz: f64) -> Self {
        Self {
            period: TimeDelta::from_hz(rate_hz),
            last: None,
        }
    }

    fn due(&mut self, now: Timestamp) -> bool {
        let due = self
            .last
            .is_none_or(|last| now < last || now - last >= self.period);
        if due {
            self.last = Some(now);
        }
        due
    }
}

/// Where the vehicle was, with points that grow further apart in time so that a long flight does
/// not fill the file.
struct Path {
    points: Vec<fox::Pose>,
    step: Throttle,
    write: Throttle,
}

impl Path {
    fn new() -> Self {
        Self {
            points: Vec::new(),
            step: Throttle::from_hz(1.0 / PATH_STEP_S),
            write: Throttle::from_hz(PATH_HZ),
        }
    }

    fn extend<W: Write + Seek>(
        &mut self,
        sink: &mut Sink<W>,
        topic: Topic,
        now: Timestamp,
        pose: &Pose,
    ) -> Result<(), RecordError> {
        if self.step.due(now) {
            self.push(pose);
        }
        if !self.write.due(now) {
            return Ok(());
        }
        let message = fox::PosesInFrame {
            timestamp: stamp(now),
            frame_id: WORLD.to_owned(),
            poses: self.points.clone(),
        };
        sink.write(topic, now, now, &message)
    }

    fn push(&mut self, pose: &Pose) {
        if self.points.len() == PATH_POINTS {
            let mut keep = false;
            self.points.retain(|_| {
                keep = !keep;
                keep
            });
            self.step.period = self.step.period + self.step.period;
        }
        // Viewers draw the line through the positions; orientations would double the size.
        self.points.push(fox::Pose {
            position: Some(fox_vector(&pose.translation.vector)),
            orientation: Some(fox::Quaternion {
                w: 1.0,
                ..fox::Quaternion::default()
            }),
        });
    }
}

fn write_frame<W: Write + Seek>(
    sink: &mut Sink<W>,
    now: Timestamp,
    child: &str,
    world_from_child: &Pose,
) -> Result<(), RecordError> {
    let message = fox::FrameTransforms {
        transforms: vec![transform(now, WORLD, child, world_from_child)],
    };
    sink.write(Topic::Tf, now, now, &message)
}
