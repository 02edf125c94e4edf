//! alula
fn main() {}
