//! Worlds for tests and benchmarks: scenario text drawn from a seed.

use std::fmt::Write;

use rand::RngExt;
use rand_pcg::Pcg64;

/// `count` obstacles of all kinds about the origin, at most 25 m away and none within 1.5 m of it
/// below a height of 3 m, and three people who walk round it.
pub fn mixed_world(seed: u64, count: usize) -> String {
    let mut generator = Pcg64::new(u128::from(seed), 0x5a);
    let mut uniform = |low: f64, high: f64| low + (high - low) * generator.random::<f64>();
    let mut text = String::new();
    for i in 0..count {
        let (distance, bearing) = (uniform(4.0, 25.0), uniform(0.0, std::f64::consts::TAU));
        let (x, y) = (distance * bearing.cos(), distance * bearing.sin());
        let (size, height) = (uniform(0.3, 1.5), uniform(0.5, 5.0));
        let yaw = uniform(-180.0, 180.0);
        text += "[[obstacles]]\n";
        let fields = match i % 10 {
            0..3 => format!(
                "kind = \"box\"\ncentre_m = [{x}, {y}, {}]\nsize_m = [{size}, 0.8, {height}]\nyaw_deg = {yaw}",
                0.5 * height
            ),
            3..5 => format!(
                "kind = \"cylinder\"\ncentre_m = [{x}, {y}]\nradius_m = {}",
                0.3 * size
            ),
            5 => format!(
                "kind = \"cylinder\"\ncentre_m = [{x}, {y}]\nradius_m = {size}\nheight_m = {}",
                0.5 * height
            ),
            6 => format!(
                "kind = \"cylinder\"\ncentre_m = [{x}, {y}]\nradius_m = {}\nbottom_m = 2.0",
                0.3 * size
            ),
            7 => format!("kind = \"sphere\"\ncentre_m = [{x}, {y}, {height}]\nradius_m = {size}"),
            8 => format!(
                "kind = \"wall\"\nfrom_m = [{x}, {y}]\nto_m = [{}, {}]\nheight_m = {height}\nthickness_m = 0.2",
                x - y * 0.15,
                y + x * 0.15
            ),
            _ => format!(
                "kind = \"mesh\"\nfile = \"pyramid.obj\"\nposition_m = [{x}, {y}, 0.0]\nscale = {size}\nyaw_deg = {yaw}"
            ),
        };
        let _ = writeln!(text, "{fields}");
    }
    for i in 0..3 {
        let r = 3.0 + f64::from(i);
        let _ = writeln!(
            text,
            "[[people]]\nwaypoints_m = [[{r}, {r}], [-{r}, {r}], [-{r}, -{r}], [{r}, -{r}]]\nstart_s = {}",
            7.0 * f64::from(i)
        );
    }
    text
}

/// The files that [`mixed_world`] names: a pyramid on a square.
///
/// # Errors
/// For any other name.
pub fn assets(file: &str) -> Result<Vec<u8>, String> {
    if file != "pyramid.obj" {
        return Err(format!("there is no `{file}`"));
    }
    let text = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nv 0 0 2\n\
                f 1 2 5\nf 2 3 5\nf 3 4 5\nf 4 1 5\nf 4 3 2 1\n";
    Ok(text.as_bytes().to_vec())
}
