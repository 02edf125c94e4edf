//! Outlines of the things of a world, seen from above or from the side.

use alula_geometry::Timestamp;
use alula_sim::world::{PersonState, Shape, World};
use nalgebra::Vector3;

use crate::plot::{Fill, MapShape, Outline};

/// Endless things are drawn up to this height in side views, m.
const DRAWN_TOP_M: f64 = 4.0;

/// Two of the world's axes, for a view.
#[derive(Clone, Copy)]
pub enum View {
    /// From above: x east, y north.
    Top,
    /// From the south: x east, z up.
    Side,
}

impl View {
    /// The place of a point in the view.
    pub fn of(self, point: &Vector3<f64>) -> (f64, f64) {
        match self {
            Self::Top => (point.x, point.y),
            Self::Side => (point.x, point.z),
        }
    }
}

/// All things and people of a world at a time, as they are seen.
pub fn shapes(view: View, world: &World, time: Timestamp) -> Vec<MapShape> {
    let still = world.obstacles().iter().filter_map(|obstacle| {
        Some(
            MapShape::new(outline(view, &obstacle.shape)?, Fill::Obstacle).labelled(&obstacle.name),
        )
    });
    let people = world.people_at(time).map(|person| {
        MapShape::new(person_outline(view, &person), Fill::Person)
            .labelled(&format!("person {}", person.id + 1))
    });
    let ground = match view {
        View::Top => None,
        View::Side => {
            let z = world.ground_height_m();
            let line = Outline::Line {
                from: (-1e3, z),
                to: (1e3, z),
            };
            Some(MapShape::new(line, Fill::Ground))
        }
    };
    ground.into_iter().chain(still).chain(people).collect()
}

/// A person as seen.
pub fn person_outline(view: View, person: &PersonState) -> Outline {
    let axes = person.semi_axes_m;
    let centre = view.of(&person.centre_world.coords);
    match view {
        View::Top => Outline::Ellipse {
            centre,
            half_axes: (axes.x, axes.y),
            angle_rad: person.yaw_rad,
        },
        View::Side => {
            let (s, c) = person.yaw_rad.sin_cos();
            let across = ((axes.x * c).powi(2) + (axes.y * s).powi(2)).sqrt();
            Outline::Ellipse {
                centre,
                half_axes: (across, axes.z),
                angle_rad: 0.0,
            }
        }
    }
}

/// The shadow of a shape in a view.
fn outline(view: View, shape: &Shape) -> Option<Outline> {
    match shape {
        Shape::Box {
            world_from_box,
            half_size_m,
        } => {
            let corners = (0..8).map(|i| {
                let sign = |bit: usize| if i >> bit & 1 == 0 { -1.0 } else { 1.0 };
                let corner = half_size_m.component_mul(&Vector3::new(sign(0), sign(1), sign(2)));
                view.of(&(world_from_box * nalgebra::Point3::from(corner)).coords)
            });
            Some(Outline::Polygon(convex_hull(corners.collect())))
        }
        Shape::Cylinder {
            centre_m: [x, y],
            radius_m,
            bottom_m,
            top_m,
        } => Some(match view {
            View::Top => Outline::Circle {
                centre: (*x, *y),
                radius: *radius_m,
            },
            View::Side => {
                let bottom = bottom_m.max(0.0);
                let top = top_m.min(bottom.max(0.0) + DRAWN_TOP_M);
                Outline::Rect {
                    centre: (*x, 0.5 * (bottom + top)),
                    size: (2.0 * radius_m, top - bottom),
                    angle_rad: 0.0,
                }
            }
        }),
        Shape::Sphere {
            centre_world,
            radius_m,
        } => Some(Outline::Circle {
            centre: view.of(&centre_world.coords),
            radius: *radius_m,
        }),
        Shape::Mesh(mesh) => {
            let corners = mesh
                .triangles()
                .iter()
                .flatten()
                .map(|p| view.of(&p.coords));
            Some(Outline::Polygon(convex_hull(corners.collect())))
        }
    }
}

/// Corners of the smallest convex polygon around points, counter-clockwise (Andrew's chains).
fn convex_hull(mut points: Vec<(f64, f64)>) -> Vec<(f64, f64)> {
    points.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    points.dedup();
    let turns_left = |a: &(f64, f64), b: &(f64, f64), c: &(f64, f64)| {
        (b.0 - a.0) * (c.1 - a.1) - (b.1 - a.1) * (c.0 - a.0) > 0.0
    };
    let chain = |points: &mut dyn Iterator<Item = (f64, f64)>| {
        let mut chain: Vec<(f64, f64)> = Vec::new();
        for point in points {
            while let [.., a, b] = chain[..] {
                if turns_left(&a, &b, &point) {
                    break;
                }
                chain.pop();
            }
            chain.push(point);
        }
        chain.pop();
        chain
    };
    let mut hull = chain(&mut points.iter().copied());
    hull.extend(chain(&mut points.iter().rev().copied()));
    hull
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hull_of_a_square_with_inner_points_is_the_square() {
        let points = vec![
            (0.0, 0.0),
            (1.0, 0.0),
            (0.5, 0.5),
            (1.0, 1.0),
            (0.0, 1.0),
            (0.5, 0.0),
        ];
        let hull = convex_hull(points);
        assert_eq!(hull, vec![(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]);
    }
}
