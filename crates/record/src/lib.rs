//! Recordings and foreign logs: MCAP, EuRoC and 7-Scenes folders, TUM trajectories.
//!
//! A [`Recorder`] writes what a vehicle sensed, what the stack made of it and, where it is known,
//! the truth, into an MCAP file that Foxglove Studio, PlotJuggler and Python read. A
//! [`Recording`] reads it back bit by bit, as far as the file goes. `docs/recordings.md` lists
//! topics and schemas.
//!
//! ```
//! use alula_messages::SensorBatch;
//! use alula_record::{Event, Header, Recorder, Recording};
//! # fn main() -> Result<(), alula_record::RecordError> {
//! # let folder = tempfile::tempdir().unwrap();
//! # let path = folder.path().join("flight.mcap");
//! let header = Header { scenario_name: "hover".into(), ..Header::default() };
//! let mut recorder = Recorder::create(&path, &header)?;
//! recorder.write_batch(&SensorBatch::default())?;
//! recorder.finish()?;
//!
//! let recording = Recording::open(&path)?;
//! assert_eq!(recording.header(), &header);
//! for event in recording {
//!     assert_eq!(event?, Event::Batch(SensorBatch::default()));
//! }
//! # Ok(())
//! # }
//! ```

mod assemble;
mod container;
mod convert;
mod convert_output;
mod convert_seen;
mod convert_state;
mod covariance;
mod draw;
mod draw_seen;
mod error;
pub mod euroc;
mod header;
mod recorder;
mod recording;
mod schema;
pub mod seven_scenes;
mod sink;
mod text;
mod topic;
pub mod tum;
mod view;

pub use draw::{Person, SceneShape, depth_camera_frame};
pub use error::RecordError;
pub use header::Header;
pub use recorder::Recorder;
pub use recording::{
    Damage, DamageKind, Event, LogEntry, LogLevel, Recording, Summary, TopicSummary, TruthRecord,
};
