//! The guard: independent limits, health rules and fallbacks
