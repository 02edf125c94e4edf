//! Quadratic programs: no robot words
