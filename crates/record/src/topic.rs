//! The topics of a recording and their schemas.

use foxglove::messages as fox;
use foxglove::{Encode, Schema};

use crate::schema;

macro_rules! topics {
    ($($(#[$meta:meta])* $variant:ident = $name:literal, $schema:expr;)*) => {
        /// A topic of a recording.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub(crate) enum Topic { $($(#[$meta])* $variant,)* }

        impl Topic {
            /// Number of topics.
            pub const COUNT: usize = [$($name),*].len();

            /// Its name in the file.
            pub fn name(self) -> &'static str {
                match self { $(Self::$variant => $name,)* }
            }

            /// The topic of that name, if it is one of ours.
            pub fn from_name(name: &str) -> Option<Self> {
                match name { $($name => Some(Self::$variant),)* _ => None }
            }

            /// Its schema; `None` only if a viewing message had no schema.
            pub fn schema(self) -> Option<Schema> {
                match self { $(Self::$variant => $schema,)* }
            }
        }
    };
}

topics! {
    Imu = "/sensors/imu", ours("ImuSample");
    Flow = "/sensors/flow", ours("FlowSample");
    Sonar = "/sensors/sonar", ours("RangeSample");
    Infrared = "/sensors/infrared", ours("RangeSample");
    MotionCapture = "/sensors/motion_capture", ours("PoseSample");
    Autopilot = "/sensors/autopilot", ours("AutopilotStatus");
    Depth = "/sensors/depth", fox::RawImage::get_schema();
    DepthCalibration = "/sensors/depth/calibration", fox::CameraCalibration::get_schema();
    Depth1 = "/sensors/depth_1", fox::RawImage::get_schema();
    Depth1Calibration = "/sensors/depth_1/calibration", fox::CameraCalibration::get_schema();
    Depth2 = "/sensors/depth_2", fox::RawImage::get_schema();
    Depth2Calibration = "/sensors/depth_2/calibration", fox::CameraCalibration::get_schema();
    Depth3 = "/sensors/depth_3", fox::RawImage::get_schema();
    Depth3Calibration = "/sensors/depth_3/calibration", fox::CameraCalibration::get_schema();
    Batch = "/batch", ours("Batch");
    State = "/estimate/state", ours("NavState");
    Sigma = "/estimate/sigma", ours("Sigma");
    Fusions = "/estimate/fusions", ours("Fusions");
    Mode = "/mode", ours("FlightMode");
    Requests = "/requests", ours("Requests");
    Reference = "/reference", ours("Reference");
    Detections = "/obstacles/detections", ours("Detections");
    Obstacles = "/obstacles/tracks", ours("Obstacles");
    Plan = "/plan", ours("Plan");
    Hindrance = "/hindrance", ours("Hindrance");
    Guard = "/guard", ours("GuardReport");
    Command = "/command", ours("StepCommand");
    Truth = "/truth", ours("Truth");
    Tf = "/tf", fox::FrameTransforms::get_schema();
    TfStatic = "/tf_static", fox::FrameTransforms::get_schema();
    Pose = "/pose", fox::PoseInFrame::get_schema();
    Path = "/path", fox::PosesInFrame::get_schema();
    PathTrue = "/path_true", fox::PosesInFrame::get_schema();
    Scene = "/scene", fox::SceneUpdate::get_schema();
    People = "/people", fox::SceneUpdate::get_schema();
    SceneObstacles = "/scene/obstacles", fox::SceneUpdate::get_schema();
    ScenePlan = "/scene/plan", fox::SceneUpdate::get_schema();
    Annotations = "/camera/annotations", fox::ImageAnnotations::get_schema();
    UDepth = "/u_depth", fox::RawImage::get_schema();
    Log = "/log", fox::Log::get_schema();
}

fn ours(message: &str) -> Option<Schema> {
    let name = format!("alula.{message}");
    Some(Schema::new(name, "protobuf", schema::DESCRIPTORS))
}
