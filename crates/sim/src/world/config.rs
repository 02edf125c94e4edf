//! The world as a scenario file describes it: the table `[world]`.

use alula_parameters::{ParameterError, Parameters, facts, parameters};
use serde::{Deserialize, Serialize};

use super::Material;

/// Greatest coordinate of anything in a world, m: beyond it f32 depth loses centimetres.
const FAR_M: f64 = 1e5;

parameters! {
    /// Everything in a world. Lengths in metres, world frame ENU.
    pub struct WorldConfig {
        /// The ground, a horizontal plane.
        pub ground: GroundConfig = GroundConfig::default(), nested();
        /// Things that stand still.
        pub obstacles: Vec<ObstacleConfig> = Vec::new(), nested();
        /// People who walk round their waypoints.
        pub people: Vec<PersonConfig> = Vec::new(), nested();
        /// People who follow recorded tracks.
        pub tracks: Vec<TrackConfig> = Vec::new(), nested();
        /// A random forest.
        pub forest: Option<ForestConfig> = None, nested();
        /// A corridor, with pillars if wanted.
        pub corridor: Option<CorridorConfig> = None, nested();
        /// Four walls, and a ceiling if wanted.
        pub room: Option<RoomConfig> = None, nested();
    }
}

parameters! {
    /// The ground, a horizontal plane.
    pub struct GroundConfig {
        /// Height of the plane, m.
        pub height_m: f64 = 0.0, within(-FAR_M, FAR_M);
        /// Its surface.
        pub material: Material = Material::Grass, any();
    }
}

/// One thing that stands still; `kind` in the file says which.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum ObstacleConfig {
    /// A box that stands upright.
    Box(BoxConfig),
    /// A straight wall on the ground.
    Wall(WallConfig),
    /// A vertical cylinder.
    Cylinder(CylinderConfig),
    /// A ball.
    Sphere(SphereConfig),
    /// A triangle mesh from a file.
    Mesh(MeshConfig),
}

impl Parameters for ObstacleConfig {
    fn validate(&self) -> Result<(), ParameterError> {
        match self {
            Self::Box(config) => config.validate(),
            Self::Wall(config) => config.validate(),
            Self::Cylinder(config) => config.validate(),
            Self::Sphere(config) => config.validate(),
            Self::Mesh(config) => config.validate(),
        }
    }
}

facts! {
    /// A box that stands upright.
    pub struct BoxConfig {
        /// Centre, m.
        pub centre_m: [f64; 3], within(-FAR_M, FAR_M);
        /// Full lengths of the edges, m.
        pub size_m: [f64; 3], above(0.0);
        /// Rotation about the vertical; none if absent.
        pub yaw_deg: Option<f64>, within(-360.0, 360.0);
        /// Surface; concrete if absent.
        pub material: Option<Material>, any();
    }
}

facts! {
    /// A straight wall that stands on the ground.
    pub struct WallConfig {
        /// One end of its middle line, m.
        pub from_m: [f64; 2], within(-FAR_M, FAR_M);
        /// The other end, m.
        pub to_m: [f64; 2], within(-FAR_M, FAR_M);
        /// Height above the ground, m.
        pub height_m: f64, above(0.0);
        /// Thickness, m.
        pub thickness_m: f64, above(0.0);
        /// Surface; plaster if absent.
        pub material: Option<Material>, any();
    }
}

facts! {
    /// A vertical cylinder.
    pub struct CylinderConfig {
        /// Place of the axis, m.
        pub centre_m: [f64; 2], within(-FAR_M, FAR_M);
        /// Radius, m.
        pub radius_m: f64, above(0.0);
        /// Height of the lower end, m. If absent: the ground when `height_m` is given, and no end
        /// at all when it is not.
        pub bottom_m: Option<f64>, within(-FAR_M, FAR_M);
        /// Length of the cylinder, m; endless upwards if absent.
        pub height_m: Option<f64>, above(0.0);
        /// Surface; concrete if absent.
        pub material: Option<Material>, any();
    }
}

facts! {
    /// A ball.
    pub struct SphereConfig {
        /// Centre, m.
        pub centre_m: [f64; 3], within(-FAR_M, FAR_M);
        /// Radius, m.
        pub radius_m: f64, above(0.0);
        /// Surface; metal if absent.
        pub material: Option<Material>, any();
    }
}

facts! {
    /// A triangle mesh from a file, its z axis up.
    pub struct MeshConfig {
        /// An STL or OBJ file.
        pub file: String, any();
        /// Place of the file's origin, m.
        pub position_m: [f64; 3], within(-FAR_M, FAR_M);
        /// Rotation about the vertical; none if absent.
        pub yaw_deg: Option<f64>, within(-360.0, 360.0);
        /// Metres per unit of the file; 1 if absent.
        pub scale: Option<f64>, above(0.0);
        /// Surface; concrete if absent.
        pub material: Option<Material>, any();
    }
}

/// Semi-axes of a person, m: a slim adult with room to swing the arms, 1.8 m tall (document L,
/// section 6).
const PERSON_SEMI_AXES_M: [f64; 3] = [0.4, 0.4, 0.9];

parameters! {
    /// A person who walks round a closed line of waypoints at constant speed.
    pub struct PersonConfig {
        /// Waypoints, m; the person walks from the last to the first again. One: stands there.
        pub waypoints_m: Vec<[f64; 2]> = Vec::new(), within(-FAR_M, FAR_M);
        /// Walking speed, m/s.
        pub speed_m_s: f64 = 1.2, within(0.0, 10.0);
        /// Radius of the arcs in which the person turns at waypoints, m. Nobody who walks turns on the
        /// spot: 0.4 m at 1.2 m/s takes 3.6 m/s^2.
        pub turn_radius_m: f64 = 0.0, within(0.0, 100.0);
        /// How long the person has been walking at the start of the simulation, s.
        pub start_s: f64 = 0.0, finite();
        /// Added to `start_s`: a time drawn from 0 to this for every seed and person.
        pub start_spread_s: f64 = 0.0, within(0.0, 1e6);
        /// Semi-axes of the ellipsoid: forward, sideways, up, m.
        pub semi_axes_m: [f64; 3] = PERSON_SEMI_AXES_M, within(0.05, 5.0);
    }
}

/// What becomes of recorded people when the recording ends.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AfterEnd {
    /// They are gone.
    #[default]
    Vanish,
    /// The recording starts again.
    Repeat,
}

parameters! {
    /// People who follow the tracks of a file with the columns `t_s,id,x_m,y_m`.
    pub struct TrackConfig {
        /// The file.
        pub file: String = String::new(), any();
        /// Which people of the file to take; all if absent.
        pub ids: Option<Vec<u64>> = None, any();
        /// Time of the recording at the start of the simulation, s.
        pub start_s: f64 = 0.0, finite();
        /// Added to `start_s`: a time drawn from 0 to this for every seed, the same for all people
        /// of the file.
        pub start_spread_s: f64 = 0.0, within(0.0, 1e6);
        /// Rotation of the recorded places about their origin, counter-clockwise.
        pub yaw_deg: f64 = 0.0, within(-360.0, 360.0);
        /// Added to the rotated places, m.
        pub offset_m: [f64; 2] = [0.0; 2], within(-FAR_M, FAR_M);
        /// What happens when the recording ends.
        pub after_end: AfterEnd = AfterEnd::Vanish, any();
        /// Semi-axes of the ellipsoids: forward, sideways, up, m.
        pub semi_axes_m: [f64; 3] = PERSON_SEMI_AXES_M, within(0.05, 5.0);
    }
}

parameters! {
    /// Vertical trunks at random places of a rectangle, uniform under the demands below.
    pub struct ForestConfig {
        /// One corner of the rectangle, m.
        pub min_m: [f64; 2] = [0.0, -15.0], within(-FAR_M, FAR_M);
        /// The opposite corner, m.
        pub max_m: [f64; 2] = [60.0, 15.0], within(-FAR_M, FAR_M);
        /// Trunks per square metre; give this or `count`.
        pub density_per_m2: Option<f64> = None, within(0.0, 10.0);
        /// Number of trunks; give this or `density_per_m2`.
        pub count: Option<usize> = None, within(0.0, 100_000.0);
        /// Least and greatest radius, m; uniform between.
        pub radius_m: [f64; 2] = [0.1, 0.3], within(0.01, 10.0);
        /// Least gap between the surfaces of two trunks, m.
        pub clear_gap_m: f64 = 1.0, within(0.0, 100.0);
        /// Height of the trunks, m; endless if absent.
        pub height_m: Option<f64> = None, above(0.0);
        /// Place kept clear for the start, m.
        pub start_m: Option<[f64; 2]> = None, within(-FAR_M, FAR_M);
        /// Place kept clear for the goal, m.
        pub goal_m: Option<[f64; 2]> = None, within(-FAR_M, FAR_M);
        /// Distance from start and goal to the nearest trunk's surface, m.
        pub clear_radius_m: f64 = 2.0, within(0.0, 1000.0);
        /// Trunks stand nowhere where anybody walks in this first time of the simulation, s, and a
        /// trunk that then finds no place is left out; people walk through trunks if absent.
        pub clear_of_people_s: Option<f64> = None, within(0.0, 7200.0);
        /// Surface.
        pub material: Material = Material::Bark, any();
    }
}

parameters! {
    /// Two parallel walls, open at both ends, with random pillars between them if wanted.
    pub struct CorridorConfig {
        /// Middle of the entrance, m.
        pub start_m: [f64; 2] = [0.0; 2], within(-FAR_M, FAR_M);
        /// Direction in which the corridor leads, counter-clockwise from east.
        pub yaw_deg: f64 = 0.0, within(-360.0, 360.0);
        /// Length, m.
        pub length_m: f64 = 30.0, within(0.1, FAR_M);
        /// Width between the walls, m.
        pub width_m: f64 = 3.0, within(0.1, FAR_M);
        /// Height of the walls, m.
        pub height_m: f64 = 3.0, within(0.1, 1000.0);
        /// Thickness of the walls, m.
        pub thickness_m: f64 = 0.2, within(0.01, 100.0);
        /// Number of pillars.
        pub pillars: usize = 0, within(0.0, 10_000.0);
        /// Least and greatest radius of pillars, m; uniform between.
        pub pillar_radius_m: [f64; 2] = [0.15, 0.3], within(0.01, 10.0);
        /// Least gap between two pillars, and beside each pillar on one side at least, m.
        pub clear_gap_m: f64 = 1.0, within(0.0, 100.0);
        /// Length at both ends without pillars, m.
        pub clear_ends_m: f64 = 2.0, within(0.0, FAR_M);
        /// Surface.
        pub material: Material = Material::Plaster, any();
    }
}

/// Whether a room is closed above.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Ceiling {
    /// The sky is seen.
    #[default]
    Open,
    /// A slab lies on the walls.
    Closed,
}

parameters! {
    /// Four walls round a rectangle of free floor.
    pub struct RoomConfig {
        /// Inner length, width and height, m.
        pub size_m: [f64; 3] = [10.0, 8.0, 3.0], within(0.5, 1e4);
        /// Middle of the floor, m.
        pub centre_m: [f64; 2] = [0.0; 2], within(-FAR_M, FAR_M);
        /// Thickness of walls and ceiling, m.
        pub thickness_m: f64 = 0.2, within(0.01, 100.0);
        /// Whether the room is closed above.
        pub ceiling: Ceiling = Ceiling::Open, any();
        /// Surface.
        pub material: Material = Material::Plaster, any();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alula_parameters::check::Tables;

    fn message(text: &str) -> String {
        match toml::from_str::<WorldConfig>(text) {
            Ok(config) => config.validate_under("world").unwrap_err().to_string(),
            Err(e) => e.to_string(),
        }
    }

    #[test]
    fn every_kind_is_read_by_its_name() {
        let config: WorldConfig = toml::from_str(
            "[[obstacles]]\nkind = \"box\"\ncentre_m = [1, 2.0, 3]\nsize_m = [1, 1, 1]\n\
             [[obstacles]]\nkind = \"wall\"\nfrom_m = [0, 0]\nto_m = [1, 0]\nheight_m = 2\nthickness_m = 0.1\n\
             [[obstacles]]\nkind = \"cylinder\"\ncentre_m = [0, 0]\nradius_m = 0.2\nmaterial = \"bark\"\n\
             [[obstacles]]\nkind = \"sphere\"\ncentre_m = [0, 0, 1]\nradius_m = 0.2\n\
             [[obstacles]]\nkind = \"mesh\"\nfile = \"a.stl\"\nposition_m = [0, 0, 0]\n\
             [forest]\ncount = 5\n[room]\nceiling = \"closed\"\n",
        )
        .unwrap();
        assert_eq!(config.obstacles.len(), 5);
        assert_eq!(config.validate_under("world"), Ok(()));
    }

    #[test]
    fn unknown_keys_are_refused_in_every_table() {
        let sphere = "[[obstacles]]\nkind = \"sphere\"\ncentre_m = [0, 0, 1]\nradius = 0.2\n";
        assert!(message(sphere).contains("radius"));
        assert!(message("[ground]\nheight = 1.0").contains("unknown field `height`"));
        assert!(message("[[obstacles]]\nkind = \"cone\"").contains("cone"));
    }

    #[test]
    fn values_out_of_range_are_named_with_their_path() {
        assert_eq!(
            message("[[obstacles]]\nkind = \"sphere\"\ncentre_m = [0, 0, 1]\nradius_m = -0.2\n"),
            "`world.obstacles[0].radius_m` is -0.2; allowed is above 0"
        );
        assert_eq!(
            message("[[people]]\nspeed_m_s = 20\nwaypoints_m = [[0, 0]]"),
            "`world.people[0].speed_m_s` is 20; allowed is 0 to 10"
        );
    }
}
