//! Compiles the schemas of the recording, without a protobuf compiler to install.

use std::error::Error;
use std::path::PathBuf;

use prost_types::FileDescriptorSet;

fn main() -> Result<(), Box<dyn Error>> {
    let schemas: FileDescriptorSet = protox::compile(["proto/alula.proto"], ["proto"])?;
    let out = PathBuf::from(std::env::var("OUT_DIR")?);
    std::fs::write(out.join("alula.bin"), bare_descriptor(&schemas))?;
    prost_build::Config::new().compile_fds(schemas)?;
    println!("cargo::rerun-if-changed=proto/alula.proto");
    Ok(())
}

/// The descriptors without comments: they go into every recording, once for each schema.
fn bare_descriptor(schemas: &FileDescriptorSet) -> Vec<u8> {
    let mut bare = schemas.clone();
    for file in &mut bare.file {
        file.source_code_info = None;
    }
    prost::Message::encode_to_vec(&bare)
}
