//! The world of the simulator in the words of a recording, for viewers.

use alula_geometry::{Pose, Timestamp};
use alula_record::{Person, SceneShape};
use alula_sim::world::{Shape, World};

/// Endless cylinders are drawn this far up and down, m.
const DRAWN_HEIGHT_M: f64 = 5.0;

/// Everything in the world that stands still.
pub fn static_shapes(world: &World) -> Vec<SceneShape> {
    world
        .obstacles()
        .iter()
        .map(|obstacle| scene_shape(&obstacle.shape))
        .collect()
}

/// The people in the world at a time.
pub fn people(world: &World, time: Timestamp) -> impl Iterator<Item = Person> + '_ {
    world.people_at(time).map(|person| Person {
        id: person.id,
        world_from_person: person.world_from_person(),
        semi_axes_m: person.semi_axes_m,
    })
}

fn scene_shape(shape: &Shape) -> SceneShape {
    match shape {
        Shape::Box {
            world_from_box,
            half_size_m,
        } => SceneShape::Box {
            world_from_box: *world_from_box,
            size_m: half_size_m * 2.0,
        },
        Shape::Cylinder {
            centre_m: [x, y],
            radius_m,
            bottom_m,
            top_m,
        } => {
            let bottom = bottom_m.max(-DRAWN_HEIGHT_M);
            let top = top_m.min(DRAWN_HEIGHT_M.max(bottom + DRAWN_HEIGHT_M));
            SceneShape::Cylinder {
                world_from_cylinder: Pose::translation(*x, *y, 0.5 * (bottom + top)),
                radius_m: *radius_m,
                height_m: top - bottom,
            }
        }
        Shape::Sphere {
            centre_world,
            radius_m,
        } => SceneShape::Sphere {
            centre_world: *centre_world,
            radius_m: *radius_m,
        },
        Shape::Mesh(mesh) => SceneShape::Triangles {
            corners_world: mesh.triangles().iter().flatten().copied().collect(),
        },
    }
}
