//! Control: the attitude loop of an autopilot with its mixer, the geometric position controller,
//! and the flight modes.

pub mod autopilot;
pub mod geometric;
pub mod mixer;
pub mod modes;
pub mod pid;
