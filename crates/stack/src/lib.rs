//! Wires estimation, planning, control and the guard in a fixed order
