//! Shapes on a map.

use std::f64::consts::TAU;

use super::Fill;
use super::scale::drawable;

/// Corners of the polygon that stands for an ellipse: at a radius of 300 pixels it is a tenth of a
/// pixel off.
const CORNERS: usize = 120;

/// Where a shape is, in the units of the map.
#[derive(Debug, Clone)]
pub enum Outline {
    /// A rectangle.
    Rect {
        /// Its centre.
        centre: (f64, f64),
        /// Its two sides.
        size: (f64, f64),
        /// Angle (rad) by which it is turned counter-clockwise.
        angle_rad: f64,
    },
    /// A circle.
    Circle {
        /// Its centre.
        centre: (f64, f64),
        /// Its radius.
        radius: f64,
    },
    /// An ellipse.
    Ellipse {
        /// Its centre.
        centre: (f64, f64),
        /// Its two half axes.
        half_axes: (f64, f64),
        /// Angle (rad) by which it is turned counter-clockwise.
        angle_rad: f64,
    },
    /// A polygon by its corners.
    Polygon(Vec<(f64, f64)>),
    /// A line between two points.
    Line {
        /// One end.
        from: (f64, f64),
        /// The other end.
        to: (f64, f64),
    },
}

/// A shape on a map.
#[derive(Debug, Clone)]
pub struct MapShape {
    /// Where it is.
    pub outline: Outline,
    /// What it stands for.
    pub fill: Fill,
    /// Its name; written where there is room, and shown under the pointer. May be empty.
    pub label: String,
}

impl MapShape {
    /// A shape without a name.
    pub fn new(outline: Outline, fill: Fill) -> Self {
        MapShape {
            outline,
            fill,
            label: String::new(),
        }
    }

    /// The same with a name.
    pub fn labelled(self, label: &str) -> Self {
        MapShape {
            label: label.to_string(),
            ..self
        }
    }
}

impl Outline {
    /// Corners of the outline; none if a value is not finite.
    pub(super) fn corners(&self) -> Vec<[f64; 2]> {
        let corners = match self {
            Outline::Rect {
                centre,
                size,
                angle_rad,
            } => {
                let (w, h) = (0.5 * size.0, 0.5 * size.1);
                let corners = [[-w, -h], [w, -h], [w, h], [-w, h]];
                corners
                    .map(|corner| turned(corner, *centre, *angle_rad))
                    .to_vec()
            }
            Outline::Circle { centre, radius } => ellipse(*centre, (*radius, *radius), 0.0),
            Outline::Ellipse {
                centre,
                half_axes,
                angle_rad,
            } => ellipse(*centre, *half_axes, *angle_rad),
            Outline::Polygon(corners) => corners.iter().map(|(x, y)| [*x, *y]).collect(),
            Outline::Line { from, to } => vec![[from.0, from.1], [to.0, to.1]],
        };
        if corners.iter().flatten().all(|value| drawable(*value)) {
            corners
        } else {
            Vec::new()
        }
    }
}

fn ellipse(centre: (f64, f64), half_axes: (f64, f64), angle_rad: f64) -> Vec<[f64; 2]> {
    let corner = |i: usize| {
        let (sin, cos) = (TAU * i as f64 / CORNERS as f64).sin_cos();
        turned([half_axes.0 * cos, half_axes.1 * sin], centre, angle_rad)
    };
    (0..CORNERS).map(corner).collect()
}

/// `corner` turned about the origin and moved to `centre`.
fn turned([x, y]: [f64; 2], centre: (f64, f64), angle_rad: f64) -> [f64; 2] {
    let (sin, cos) = angle_rad.sin_cos();
    [centre.0 + cos * x - sin * y, centre.1 + sin * x + cos * y]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check_extent(outline: Outline, expected: [f64; 4]) {
        let corners = outline.corners();
        let extreme = |axis: usize, sign: f64| {
            sign * corners
                .iter()
                .map(|c| sign * c[axis])
                .fold(f64::NEG_INFINITY, f64::max)
        };
        let extent = [
            extreme(0, -1.0),
            extreme(0, 1.0),
            extreme(1, -1.0),
            extreme(1, 1.0),
        ];
        for (found, wanted) in extent.iter().zip(expected) {
            assert!(
                (found - wanted).abs() < 1e-9,
                "{extent:?} instead of {expected:?}"
            );
        }
    }

    #[test]
    fn a_rectangle_turned_by_a_quarter_swaps_its_sides() {
        let quarter = 0.25 * TAU;
        let rect = Outline::Rect {
            centre: (1.0, 2.0),
            size: (4.0, 2.0),
            angle_rad: quarter,
        };
        check_extent(rect, [0.0, 2.0, 0.0, 4.0]);
    }

    #[test]
    fn a_circle_reaches_its_radius() {
        check_extent(
            Outline::Circle {
                centre: (1.0, 0.0),
                radius: 2.0,
            },
            [-1.0, 3.0, -2.0, 2.0],
        );
    }

    #[test]
    fn an_outline_with_a_missing_value_is_empty() {
        assert!(
            Outline::Circle {
                centre: (f64::NAN, 0.0),
                radius: 2.0
            }
            .corners()
            .is_empty()
        );
    }
}
