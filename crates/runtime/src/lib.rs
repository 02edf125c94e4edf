//! The only place with clocks and files: it reads scenarios, flies them against a simulated
//! vehicle, replays recordings and runs estimators over real flights.
