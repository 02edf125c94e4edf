//! The only place with clocks and files: drives a stack, simulated or replayed
