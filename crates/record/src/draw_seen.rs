//! What the vehicle sees and intends in the schemas of Foxglove.

use alula_geometry::{Pose, Timestamp};
use alula_messages::{
    Detection, Footprint, Obstacle, ObstacleMotion, PixelBox, Plan, PlanExit, Sight,
};
use foxglove::messages as fox;
use foxglove::messages::line_primitive::Type as LineType;
use foxglove::messages::points_annotation::Type as PointsType;
use foxglove::messages::scene_entity_deletion::Type as DeletionType;
use nalgebra::{Matrix3, Point3, Translation3, UnitQuaternion, Vector3};

use crate::draw::{colour, entity, fox_point, fox_pose, fox_vector, stamp};

/// Colours of document L, figure 7-8: red stands, yellow moves.
const STATIC: fox::Color = colour(0.85, 0.20, 0.15, 0.75);
const MOVING: fox::Color = colour(0.95, 0.80, 0.10, 0.75);
const UNDECIDED: fox::Color = colour(0.60, 0.60, 0.60, 0.75);
const INK: fox::Color = colour(0.10, 0.10, 0.10, 1.0);
const PLAN: fox::Color = colour(0.00, 0.45, 0.90, 1.0);
const PLAN_OF_NEED: fox::Color = colour(0.95, 0.45, 0.00, 1.0);
const WINDOW: fox::Color = colour(0.10, 0.95, 0.55, 1.0);

/// Opacity of what is not seen at the moment, as a share.
const UNSEEN: f64 = 0.35;

/// Points of the line around a covariance.
const ELLIPSE_POINTS: usize = 24;

/// Every so many points of a plan, its uncertainty is drawn.
const SIGMA_STRIDE: usize = 5;

/// A scene of its own: whatever the topic showed before goes.
pub(crate) fn replace_all(now: Timestamp, entities: Vec<fox::SceneEntity>) -> fox::SceneUpdate {
    fox::SceneUpdate {
        deletions: vec![fox::SceneEntityDeletion {
            timestamp: stamp(now),
            r#type: DeletionType::All as i32,
            id: String::new(),
        }],
        entities,
    }
}

/// An obstacle: its shape, its number, and what is known of its motion.
pub(crate) fn obstacle(now: Timestamp, obstacle: &Obstacle) -> fox::SceneEntity {
    let mut entity = entity(now, format!("obstacle {}", obstacle.id));
    add_shape(&mut entity, obstacle);
    add_number(&mut entity, obstacle);
    if obstacle.motion == ObstacleMotion::Moving {
        add_velocity(&mut entity, obstacle);
        add_uncertainty(&mut entity, obstacle);
    }
    entity
}

fn shade(obstacle: &Obstacle) -> fox::Color {
    let shade = match obstacle.motion {
        ObstacleMotion::Static => STATIC,
        ObstacleMotion::Moving => MOVING,
        ObstacleMotion::Undecided => UNDECIDED,
    };
    let visible = obstacle.sight == Sight::Seen;
    fox::Color {
        a: shade.a * if visible { 1.0 } else { UNSEEN },
        ..shade
    }
}

fn add_shape(entity: &mut fox::SceneEntity, obstacle: &Obstacle) {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), obstacle.yaw_rad);
    let place = Pose::from_parts(Translation3::from(obstacle.centre_world), turn);
    let pose = Some(fox_pose(&place));
    let size = Some(fox_vector(&obstacle.size_m));
    let color = Some(shade(obstacle));
    match obstacle.footprint {
        Footprint::Round => entity.cylinders.push(fox::CylinderPrimitive {
            pose,
            size,
            bottom_scale: 1.0,
            top_scale: 1.0,
            color,
        }),
        Footprint::Flat => entity.cubes.push(fox::CubePrimitive { pose, size, color }),
    }
}

fn add_number(entity: &mut fox::SceneEntity, obstacle: &Obstacle) {
    let above = Vector3::new(0.0, 0.0, 0.5 * obstacle.size_m.z + 0.15);
    let speed = obstacle.velocity_world.norm();
    let text = match obstacle.motion {
        ObstacleMotion::Moving => format!("{}: {speed:.1} m/s", obstacle.id),
        _ => obstacle.id.to_string(),
    };
    entity.texts.push(fox::TextPrimitive {
        pose: Some(fox_pose(&Pose::from(obstacle.centre_world + above))),
        billboard: true,
        font_size: 0.18,
        scale_invariant: false,
        color: Some(INK),
        text,
    });
}

/// An arrow as long as the way of one second.
fn add_velocity(entity: &mut fox::SceneEntity, obstacle: &Obstacle) {
    let velocity = obstacle.velocity_world;
    // Straight backwards there is no shortest turn, and any will do.
    let turn = UnitQuaternion::rotation_between(&Vector3::x(), &velocity).unwrap_or_else(|| {
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI)
    });
    let place = Translation3::from(obstacle.centre_world);
    let head_m = 0.2;
    entity.arrows.push(fox::ArrowPrimitive {
        pose: Some(fox_pose(&Pose::from_parts(place, turn))),
        shaft_length: (velocity.norm() - head_m).max(0.0),
        shaft_diameter: 0.06,
        head_length: head_m,
        head_diameter: 0.14,
        color: Some(INK),
    });
}

/// Two standard deviations of the place, at the foot.
fn add_uncertainty(entity: &mut fox::SceneEntity, obstacle: &Obstacle) {
    let covariance = obstacle.covariance.fixed_view::<3, 3>(0, 0).into_owned();
    let foot = obstacle.centre_world - Vector3::new(0.0, 0.0, 0.5 * obstacle.size_m.z);
    entity.lines.push(fox::LinePrimitive {
        r#type: LineType::LineLoop as i32,
        pose: Some(fox_pose(&Pose::identity())),
        thickness: 2.0,
        scale_invariant: true,
        points: ellipse(&foot, &covariance, 2.0),
        color: Some(INK),
        ..fox::LinePrimitive::default()
    });
}

/// The level ellipse of `sigmas` standard deviations: a circle through the Cholesky factor of the
/// covariance.
fn ellipse(centre: &Vector3<f64>, covariance: &Matrix3<f64>, sigmas: f64) -> Vec<fox::Point3> {
    let east = covariance[(0, 0)].max(f64::MIN_POSITIVE).sqrt();
    let across = covariance[(1, 0)] / east;
    let north = (covariance[(1, 1)] - across * across).max(0.0).sqrt();
    let point = |i: usize| {
        let (s, c) = (std::f64::consts::TAU * i as f64 / ELLIPSE_POINTS as f64).sin_cos();
        let offset = Vector3::new(east * c, across * c + north * s, 0.0);
        fox_point(&Point3::from(centre + sigmas * offset))
    };
    (0..ELLIPSE_POINTS).map(point).collect()
}

/// A plan: its line, its uncertainty and where it leads.
pub(crate) fn plan(now: Timestamp, plan: &Plan) -> fox::SceneEntity {
    let mut entity = entity(now, "plan".to_owned());
    let color = match plan.exit {
        PlanExit::Converged | PlanExit::IterationLimit => PLAN,
        PlanExit::NoProgress | PlanExit::Failed => PLAN_OF_NEED,
    };
    let points = plan.points.iter();
    entity.lines.push(fox::LinePrimitive {
        r#type: LineType::LineStrip as i32,
        pose: Some(fox_pose(&Pose::identity())),
        thickness: 0.05,
        points: points
            .map(|p| fox_point(&Point3::from(p.position_world)))
            .collect(),
        color: Some(color),
        ..fox::LinePrimitive::default()
    });
    for point in plan.points.iter().skip(SIGMA_STRIDE).step_by(SIGMA_STRIDE) {
        let sigma = point
            .position_covariance
            .diagonal()
            .map(|v| v.max(0.0).sqrt());
        entity.spheres.push(fox::SpherePrimitive {
            pose: Some(fox_pose(&Pose::from(point.position_world))),
            size: Some(fox_vector(&(2.0 * sigma))),
            color: Some(fox::Color { a: 0.3, ..color }),
        });
    }
    entity.spheres.push(fox::SpherePrimitive {
        pose: Some(fox_pose(&Pose::from(plan.target_world))),
        size: Some(fox_vector(&Vector3::repeat(0.15))),
        color: Some(color),
    });
    entity
}

/// Windows of detections over the image ahead that was exposed at `seen_at`.
pub(crate) fn annotations(seen_at: Timestamp, detections: &[Detection]) -> fox::ImageAnnotations {
    let ahead = || detections.iter().filter(|d| d.sensor == 0);
    fox::ImageAnnotations {
        timestamp: stamp(seen_at),
        points: ahead().map(|d| window(&d.window)).collect(),
        texts: ahead().map(caption).collect(),
        ..fox::ImageAnnotations::default()
    }
}

fn window(window: &PixelBox) -> fox::PointsAnnotation {
    let (left, top) = (f64::from(window.left), f64::from(window.top));
    // The last column and row belong to the window.
    let (right, bottom) = (
        f64::from(window.right) + 1.0,
        f64::from(window.bottom) + 1.0,
    );
    let corners = [(left, top), (right, top), (right, bottom), (left, bottom)];
    fox::PointsAnnotation {
        r#type: PointsType::LineLoop as i32,
        points: corners.map(|(x, y)| fox::Point2 { x, y }).to_vec(),
        outline_color: Some(WINDOW),
        thickness: 1.5,
        ..fox::PointsAnnotation::default()
    }
}

fn caption(detection: &Detection) -> fox::TextAnnotation {
    fox::TextAnnotation {
        position: Some(fox::Point2 {
            x: f64::from(detection.window.left),
            y: f64::from(detection.window.top),
        }),
        text: format!("{:.1} m", detection.depth_m[0]),
        font_size: 10.0,
        text_color: Some(WINDOW),
        ..fox::TextAnnotation::default()
    }
}

/// A U-depth map as an image, the farthest bins on top: `counts` holds for each of `bins` distances,
/// the nearest first, the pixels of each of `columns` columns. Counts beyond 255 are white.
pub(crate) fn u_depth_image(
    time: Timestamp,
    columns: usize,
    bins: usize,
    counts: &[u16],
) -> Option<fox::RawImage> {
    if columns == 0 || counts.len() != columns * bins {
        return None;
    }
    let rows = counts.chunks_exact(columns).rev();
    let bytes: Vec<u8> = rows.flatten().map(|&n| n.min(255) as u8).collect();
    Some(fox::RawImage {
        timestamp: stamp(time),
        frame_id: crate::draw::depth_camera_frame(0).to_owned(),
        width: u32::try_from(columns).ok()?,
        height: u32::try_from(bins).ok()?,
        encoding: "mono8".to_owned(),
        step: u32::try_from(columns).ok()?,
        data: bytes.into(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_farthest_bin_of_a_u_depth_map_is_on_top() {
        let image = u_depth_image(Timestamp::ZERO, 3, 2, &[1, 2, 3, 4, 5, 300]).unwrap();
        assert_eq!((image.width, image.height), (3, 2));
        assert_eq!(image.data.as_ref(), [4, 5, 255, 1, 2, 3]);
    }

    #[test]
    fn a_u_depth_map_of_another_size_is_no_image() {
        assert_eq!(u_depth_image(Timestamp::ZERO, 3, 2, &[0; 5]), None);
    }

    #[test]
    fn the_ellipse_is_where_the_mahalanobis_distance_is_the_number_of_sigmas() {
        let covariance = Matrix3::new(0.09, 0.03, 0.0, 0.03, 0.04, 0.0, 0.0, 0.0, 1.0);
        let plane = covariance.fixed_view::<2, 2>(0, 0).into_owned();
        let inverse = plane.try_inverse().unwrap();
        for p in ellipse(&Vector3::new(1.0, 2.0, 3.0), &covariance, 2.0) {
            let offset = nalgebra::Vector2::new(p.x - 1.0, p.y - 2.0);
            let squared = (offset.transpose() * inverse * offset).x;
            assert!((squared - 4.0).abs() < 1e-9, "{squared}");
        }
    }

    #[test]
    fn what_is_out_of_view_is_drawn_fainter() {
        let seen = Obstacle {
            id: 1,
            time: Timestamp::ZERO,
            centre_world: Vector3::zeros(),
            velocity_world: Vector3::zeros(),
            covariance: alula_messages::ObstacleCovariance::identity(),
            yaw_rad: 0.0,
            size_m: Vector3::repeat(1.0),
            size_variance_m2: Vector3::zeros(),
            footprint: Footprint::Round,
            motion: ObstacleMotion::Static,
            sight: Sight::Seen,
            last_seen: Timestamp::ZERO,
            images: 3,
        };
        let gone = Obstacle {
            sight: Sight::OutOfView,
            ..seen
        };
        let opacity = |o: &Obstacle| obstacle(Timestamp::ZERO, o).cylinders[0].color.unwrap().a;
        assert!(opacity(&gone) < opacity(&seen));
    }
}
