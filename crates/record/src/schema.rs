//! The message types generated from `proto/alula.proto`, and their descriptors.

#![allow(missing_docs, clippy::all)]

include!(concat!(env!("OUT_DIR"), "/alula.rs"));

/// A `FileDescriptorSet` that holds every message of the package `alula`.
pub const DESCRIPTORS: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/alula.bin"));
