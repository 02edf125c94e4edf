mod bench;
mod descent;
mod nominal;
mod properties;
mod violations;
