//! Triangle meshes: reading, and a tree of bounding boxes for rays and distances.

use std::collections::BTreeMap;
use std::io::Cursor;

use alula_geometry::Pose;
use nalgebra::Point3;
#[cfg(test)]
use nalgebra::Vector3;

use super::distance;
use super::ray::{self, Crossing, Ray};

/// Triangles in the world frame.
#[derive(Clone, Debug)]
pub struct Mesh {
    triangles: Vec<[Point3<f64>; 3]>,
    nodes: Vec<Node>,
    closed: bool,
}

/// A node of the tree over `triangles`, which are sorted so that each node owns a range.
#[derive(Clone, Copy, Debug)]
struct Node {
    low: Point3<f64>,
    high: Point3<f64>,
    first: u32,
    count: u32,
    /// Index of the second child; the first child follows its parent. 0 marks a leaf.
    second: u32,
}

/// Triangles in a leaf at most: below it a test of the box costs as much as it saves.
const LEAF: usize = 4;

/// Depth of the tree at most: halving 2^32 triangles.
const STACK: usize = 40;

/// What is wrong with a mesh file, and what to do.
pub(super) type Finding = (String, &'static str);

impl Mesh {
    /// Reads an STL (text or binary) or OBJ file, told apart by `name`, and places it in the world.
    pub(super) fn read(
        name: &str,
        bytes: &[u8],
        world_from_file: &Pose,
        scale: f64,
    ) -> Result<Self, Finding> {
        let corners = match name
            .rsplit('.')
            .next()
            .map(str::to_ascii_lowercase)
            .as_deref()
        {
            Some("stl") => read_stl(bytes)?,
            Some("obj") => read_obj(bytes)?,
            _ => {
                return Err((
                    "unknown kind of mesh".into(),
                    "use a file that ends in .stl or .obj",
                ));
            }
        };
        let place = |p: Point3<f64>| world_from_file * Point3::from(p.coords * scale);
        let placed = corners.into_iter().map(|t| t.map(place)).collect();
        Self::from_triangles(placed)
    }

    /// A mesh from triangles in the world frame; those without area are left out.
    pub(super) fn from_triangles(mut triangles: Vec<[Point3<f64>; 3]>) -> Result<Self, Finding> {
        if let Some(i) = triangles.iter().position(|t| !is_finite(t)) {
            return Err((
                format!("triangle {} has a coordinate that is not finite", i + 1),
                "export the mesh again",
            ));
        }
        triangles.retain(|[a, b, c]| (b - a).cross(&(c - a)).norm_squared() > 0.0);
        if triangles.is_empty() {
            return Err((
                "there is no triangle with an area in it".into(),
                "export the mesh with triangular faces",
            ));
        }
        let closed = is_closed(&triangles);
        let mut nodes = Vec::with_capacity(2 * triangles.len().div_ceil(LEAF));
        let count = triangles.len();
        build(&mut triangles, 0, count, &mut nodes);
        Ok(Self {
            triangles,
            nodes,
            closed,
        })
    }

    /// The triangles, world frame.
    pub fn triangles(&self) -> &[[Point3<f64>; 3]] {
        &self.triangles
    }

    /// Whether the triangles enclose a body, so that there is an inside.
    pub fn is_closed(&self) -> bool {
        self.closed
    }

    /// Lowest and highest coordinates, world frame, m.
    pub fn bounds(&self) -> (Point3<f64>, Point3<f64>) {
        (self.nodes[0].low, self.nodes[0].high)
    }

    /// First crossing of a ray nearer than `max_m`.
    pub(super) fn cast(&self, ray: &Ray, max_m: f64) -> Option<Crossing> {
        let mut best: Option<Crossing> = None;
        self.visit(|node, triangles| {
            let limit = best.map_or(max_m, |b| b.distance_m);
            if !node.meets(ray, limit) {
                return false;
            }
            for triangle in triangles {
                if let Some(hit) = ray::triangle(ray, triangle)
                    && best.is_none_or(|b| hit.distance_m < b.distance_m)
                {
                    best = Some(hit);
                }
            }
            true
        });
        best
    }

    /// Distance from a point, negative inside a closed mesh. Only distances below `limit_m` are
    /// exact; a greater one may come out as any value not below it.
    pub(super) fn distance(&self, point: &Point3<f64>, limit_m: f64) -> f64 {
        let mut best = limit_m.max(0.0).powi(2);
        let inside = self.closed && self.nodes[0].contains(point) && self.winding(point) > 0.5;
        if inside {
            best = f64::INFINITY;
        }
        self.visit(|node, triangles| {
            if node.distance_squared(point) >= best {
                return false;
            }
            for triangle in triangles {
                let nearest = distance::nearest_on_triangle(point, triangle);
                best = best.min((nearest - point).norm_squared());
            }
            true
        });
        if inside { -best.sqrt() } else { best.sqrt() }
    }

    /// Walks the tree depth first; `f` sees a node with the triangles of a leaf (none for an inner
    /// node) and says whether to go on below it.
    fn visit(&self, mut f: impl FnMut(&Node, &[[Point3<f64>; 3]]) -> bool) {
        let mut stack = [0_u32; STACK];
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let index = stack[top];
            let node = &self.nodes[index as usize];
            let (first, count) = (node.first as usize, node.count as usize);
            let leaf = node.second == 0;
            let range = if leaf { first..first + count } else { 0..0 };
            if f(node, &self.triangles[range]) && !leaf && top + 2 <= STACK {
                stack[top] = node.second;
                stack[top + 1] = index + 1;
                top += 2;
            }
        }
    }

    /// How often the mesh winds round a point: 1 (or -1) inside, 0 outside.
    ///
    /// The sum of the triangles' solid angles over 4 pi (van Oosterom and Strackee).
    fn winding(&self, point: &Point3<f64>) -> f64 {
        let mut sum = 0.0;
        for corners in &self.triangles {
            let [a, b, c] = corners.map(|corner| corner - point);
            let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
            let numerator = a.dot(&b.cross(&c));
            let denominator = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
            sum += 2.0 * numerator.atan2(denominator);
        }
        (sum / (4.0 * std::f64::consts::PI)).abs()
    }
}

impl Node {
    fn around(triangles: &[[Point3<f64>; 3]], first: usize) -> Self {
        let (mut low, mut high) = (triangles[0][0], triangles[0][0]);
        for corner in triangles.iter().flatten() {
            low = low.inf(corner);
            high = high.sup(corner);
        }
        Self {
            low,
            high,
            first: first as u32,
            count: triangles.len() as u32,
            second: 0,
        }
    }

    fn contains(&self, point: &Point3<f64>) -> bool {
        self.distance_squared(point) == 0.0
    }

    fn distance_squared(&self, point: &Point3<f64>) -> f64 {
        let excess = (self.low - point).sup(&(point - self.high));
        excess.map(|e| e.max(0.0)).norm_squared()
    }

    /// Whether a ray meets the box before `max_m`. The box is widened by rounding, since triangles
    /// may lie in its faces.
    fn meets(&self, ray: &Ray, max_m: f64) -> bool {
        let margin = 1e-9 * (1.0 + self.low.coords.amax().max(self.high.coords.amax()));
        let (mut enter, mut leave) = (0.0_f64, max_m);
        for axis in 0..3 {
            let inverse = 1.0 / ray.direction[axis];
            let one = (self.low[axis] - margin - ray.origin[axis]) * inverse;
            let other = (self.high[axis] + margin - ray.origin[axis]) * inverse;
            // `f64::max` passes over the NaN of 0 * inf: the ray then runs within the slab's face.
            enter = enter.max(one.min(other));
            leave = leave.min(one.max(other));
        }
        enter <= leave
    }
}

/// Builds the tree over `triangles[first..last]`, halving at the median of the longest side.
fn build(triangles: &mut [[Point3<f64>; 3]], first: usize, last: usize, nodes: &mut Vec<Node>) {
    let part = &mut triangles[first..last];
    let node = Node::around(part, first);
    let index = nodes.len();
    nodes.push(node);
    if part.len() <= LEAF {
        return;
    }
    let axis = (node.high - node.low).imax();
    let middle = part.len() / 2;
    let key = |t: &[Point3<f64>; 3]| t[0][axis] + t[1][axis] + t[2][axis];
    part.select_nth_unstable_by(middle, |a, b| key(a).total_cmp(&key(b)));
    build(triangles, first, first + middle, nodes);
    nodes[index].second = nodes.len() as u32;
    build(triangles, first + middle, last, nodes);
}

fn is_finite(triangle: &[Point3<f64>; 3]) -> bool {
    triangle.iter().all(|p| p.iter().all(|x| x.is_finite()))
}

/// Whether every edge is passed once in each direction, as on the surface of a body.
fn is_closed(triangles: &[[Point3<f64>; 3]]) -> bool {
    let bits = |p: &Point3<f64>| [p.x, p.y, p.z].map(|x| (x + 0.0).to_bits());
    let mut passes: BTreeMap<[[u64; 3]; 2], i64> = BTreeMap::new();
    for triangle in triangles {
        for i in 0..3 {
            let (a, b) = (bits(&triangle[i]), bits(&triangle[(i + 1) % 3]));
            let (edge, way) = if a < b { ([a, b], 1) } else { ([b, a], -1) };
            *passes.entry(edge).or_default() += way;
        }
    }
    passes.values().all(|&balance| balance == 0)
}

fn read_stl(bytes: &[u8]) -> Result<Vec<[Point3<f64>; 3]>, Finding> {
    const REMEDY: &str = "export the mesh again as binary or text STL";
    let mesh = stl_io::read_stl(&mut Cursor::new(bytes))
        .map_err(|e| (format!("not a whole STL file: {e}"), REMEDY))?;
    let corner = |i: usize| {
        let v = mesh.vertices.get(i)?;
        Some(Point3::new(
            f64::from(v[0]),
            f64::from(v[1]),
            f64::from(v[2]),
        ))
    };
    mesh.faces
        .iter()
        .map(|face| {
            let [a, b, c] = face.vertices.map(corner);
            Some([a?, b?, c?])
        })
        .collect::<Option<_>>()
        .ok_or_else(|| ("a face has a vertex that does not exist".into(), REMEDY))
}

fn read_obj(bytes: &[u8]) -> Result<Vec<[Point3<f64>; 3]>, Finding> {
    const REMEDY: &str = "export the mesh again as OBJ with faces";
    let options = tobj::LoadOptions {
        triangulate: true,
        ..Default::default()
    };
    // Materials are given in the scenario; the file's own are not looked for.
    let (models, _) = tobj::load_obj_buf(&mut Cursor::new(bytes), &options, |_| {
        Err(tobj::LoadError::OpenFileFailed)
    })
    .map_err(|e| (format!("not an OBJ file: {e}"), REMEDY))?;
    let mut triangles = Vec::new();
    for model in &models {
        let corner = |i: u32| {
            let v = model.mesh.positions.get(3 * i as usize..)?.get(..3)?;
            Some(Point3::new(
                f64::from(v[0]),
                f64::from(v[1]),
                f64::from(v[2]),
            ))
        };
        for face in model.mesh.indices.chunks_exact(3) {
            let (Some(a), Some(b), Some(c)) = (corner(face[0]), corner(face[1]), corner(face[2]))
            else {
                return Err(("a face has a vertex that does not exist".into(), REMEDY));
            };
            triangles.push([a, b, c]);
        }
    }
    Ok(triangles)
}

/// The twelve triangles of a box, outward.
#[cfg(test)]
pub(super) fn box_triangles(half: &Vector3<f64>) -> Vec<[Point3<f64>; 3]> {
    let mut triangles = Vec::new();
    for axis in 0..3 {
        for side in [-1.0, 1.0] {
            let corner = |b: f64, c: f64| {
                let mut p = Vector3::zeros();
                p[axis] = side * half[axis];
                p[(axis + 1) % 3] = b * half[(axis + 1) % 3];
                p[(axis + 2) % 3] = c * side * half[(axis + 2) % 3];
                Point3::from(p)
            };
            let (p, q, r, s) = (
                corner(-1.0, -1.0),
                corner(1.0, -1.0),
                corner(1.0, 1.0),
                corner(-1.0, 1.0),
            );
            triangles.push([p, q, r]);
            triangles.push([p, r, s]);
        }
    }
    triangles
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const HALF: Vector3<f64> = Vector3::new(0.5, 1.0, 0.25);

    fn box_mesh() -> Mesh {
        Mesh::from_triangles(box_triangles(&HALF)).unwrap()
    }

    fn obj_cube() -> String {
        let mut text = String::new();
        for t in box_triangles(&HALF) {
            for p in t {
                text += &format!("v {} {} {}\n", p.x, p.y, p.z);
            }
            text += "f -3 -2 -1\n";
        }
        text
    }

    proptest! {
        #[test]
        fn a_box_of_triangles_has_the_distances_of_a_box(
            p in [-2.0..2.0_f64, -2.0..2.0_f64, -2.0..2.0_f64]
        ) {
            let p = Point3::from(p);
            let found = box_mesh().distance(&p, f64::INFINITY);
            prop_assert!((found - distance::cuboid(&p, &HALF)).abs() < 1e-12);
        }

        #[test]
        fn a_box_of_triangles_meets_the_rays_that_a_box_meets(
            o in [-2.0..2.0_f64, -2.0..2.0_f64, -2.0..2.0_f64],
            d in [-1.0..1.0_f64, -1.0..1.0_f64, -1.0..1.0_f64],
        ) {
            let ray = Ray { origin: Point3::from(o), direction: Vector3::from(d).normalize() };
            let expected = ray::cuboid(&ray, &Pose::identity(), &HALF).map(|c| c.distance_m);
            let found = box_mesh().cast(&ray, 1e9).map(|c| c.distance_m);
            prop_assert_eq!(found.is_some(), expected.is_some());
            if let (Some(found), Some(expected)) = (found, expected) {
                prop_assert!((found - expected).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn obj_and_stl_of_one_body_agree() {
        let pose = Pose::translation(1.0, 2.0, 3.0);
        let obj = Mesh::read("a.obj", obj_cube().as_bytes(), &pose, 2.0).unwrap();
        let mut stl = String::from("solid box\n");
        for t in box_triangles(&HALF) {
            stl += "facet normal 0 0 1\nouter loop\n";
            for p in t {
                stl += &format!("vertex {} {} {}\n", p.x, p.y, p.z);
            }
            stl += "endloop\nendfacet\n";
        }
        stl += "endsolid box\n";
        let stl = Mesh::read("a.STL", stl.as_bytes(), &pose, 2.0).unwrap();
        assert!(obj.is_closed() && stl.is_closed());
        assert_eq!(obj.bounds(), stl.bounds());
        assert_eq!(obj.bounds().1, Point3::new(2.0, 4.0, 3.5));
    }

    #[test]
    fn an_open_mesh_has_no_inside() {
        let mut triangles = box_triangles(&HALF);
        triangles.pop();
        let mesh = Mesh::from_triangles(triangles).unwrap();
        assert!(!mesh.is_closed());
        assert!(mesh.distance(&Point3::origin(), f64::INFINITY) > 0.0);
    }

    #[test]
    fn files_without_a_mesh_are_refused() {
        let read = |name: &str, text: &str| {
            Mesh::read(name, text.as_bytes(), &Pose::identity(), 1.0)
                .unwrap_err()
                .0
        };
        assert!(read("a.ply", "ply").contains("unknown kind"));
        assert!(read("a.obj", "v 0 0 0\n").contains("no triangle"));
        assert!(read("a.obj", "v 0 zero 0\nf 1 1 1\n").contains("OBJ"));
        assert!(read("a.stl", "nothing").contains("STL"));
        assert!(read("a.obj", "v 0 0 0\nv 1 0 0\nv nan 1 0\nf 1 2 3\n").contains("not finite"));
    }
}
