//! Random scenes for tests and measurements: pillars, walls with windows, pipes, rubble, and clouds of points.
//!
//! A scene may have a *planted* path, which is laid first and kept free, so that a path exists. It may be *sealed*, so
//! that a closed surface surrounds the goal and no path exists.

use std::f64::consts::{PI, TAU};

use growbot_core::random::Rng;
use growbot_core::trigonometry::sin_cos;
use nalgebra::{Rotation3, Vector3};

use crate::centreline::{ArcSegment, Curve, TipPose, any_perpendicular};
use crate::scene::{Cloud, Mesh, Scene};
use crate::shapes::{Shape, Triangle};

/// Kind of random scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SceneFamily {
    /// Upright round pillars and boxes.
    Pillars,
    /// Walls across the way from start to goal, each with a window.
    Walls,
    /// Pipes in all directions.
    Pipes,
    /// Stones, as one closed mesh.
    Rubble,
    /// Surfaces of boulders, as points.
    Points,
}

/// All families.
pub const FAMILIES: [SceneFamily; 5] =
    [SceneFamily::Pillars, SceneFamily::Walls, SceneFamily::Pipes, SceneFamily::Rubble, SceneFamily::Points];

/// Known facts about the paths of a scene.
#[derive(Debug, Clone, PartialEq)]
pub enum KnownPath {
    /// A path exists. The field is a path that is kept free of obstacles.
    Path(Vec<ArcSegment>),
    /// No path exists.
    NoPath,
    /// Neither a path nor its absence is known.
    Unknown,
}

/// Requirements of the body in these scenes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TubeLimits {
    /// Minimum radius of bends, mm.
    pub radius: f64,
    /// Minimum distance of the centreline from obstacles, mm.
    pub clearance: f64,
}

/// A scene with start and goal.
#[derive(Debug, Clone)]
pub struct RandomScene {
    /// Family of the scene.
    pub family: SceneFamily,
    /// Boxes, balls and capsules.
    pub shapes: Vec<Shape>,
    /// Triangles of the closed mesh of the scene. Empty without a mesh.
    pub triangles: Vec<Triangle>,
    /// Points of the cloud of the scene, mm. Empty without a cloud.
    pub points: Vec<Vector3<f64>>,
    /// Start of the body.
    pub start: TipPose,
    /// Goal of the body.
    pub goal: TipPose,
    /// Known facts about the paths from start to goal.
    pub known: KnownPath,
}

/// Radius of the ball around each point of a cloud, mm.
pub const POINT_RADIUS: f64 = 4.0;

impl RandomScene {
    /// Builds the scene with its obstacles.
    pub fn scene(&self) -> Scene {
        let clouds = if self.points.is_empty() { vec![] } else { vec![Cloud::new(self.points.clone(), POINT_RADIUS)] };
        let meshes = if self.triangles.is_empty() { vec![] } else { vec![Mesh::solid(self.triangles.clone())] };
        Scene::new(self.shapes.clone(), Vec::new(), clouds, meshes)
    }
}

/// Draws the scene of this number, which is the same on every machine. Of ten scenes, five have a known path, which is
/// kept free of obstacles, one provably has no path, and for the rest it is unknown whether a path exists.
pub fn random_scene(family: SceneFamily, number: u64, body: &TubeLimits) -> RandomScene {
    let mut random = Rng::new(&[family as u64, number, 17]);
    let start = TipPose { position: Vector3::zeros(), direction: Vector3::z() };
    let way = random_path(&mut random, start, body);
    let goal = way.last().map_or(start, ArcSegment::end);
    let mut drawn = RandomScene {
        family,
        shapes: Vec::new(),
        triangles: Vec::new(),
        points: Vec::new(),
        start,
        goal,
        known: match number % 10 {
            0..5 => KnownPath::Path(way.clone()),
            5 => KnownPath::NoPath,
            _ => KnownPath::Unknown,
        },
    };
    // A known path is kept free of obstacles, with some extra distance. Otherwise only the start and end of the body
    // are kept free.
    let room = body.clearance + random.uniform_between(3.0, 15.0);
    let ends = [ArcSegment::line(start, 2.0 * body.clearance), ArcSegment::line(goal, -body.clearance)];
    let kept: &[ArcSegment] = if matches!(drawn.known, KnownPath::Path(_)) { &way } else { &ends };
    let free: Vec<Vector3<f64>> = kept.iter().flat_map(|stretch| sampled(stretch, 4.0)).collect();
    match family {
        SceneFamily::Pillars => pillars(&mut random, &mut drawn, &free, room),
        SceneFamily::Walls => walls(&mut random, &mut drawn, &way, &free, room),
        SceneFamily::Pipes => pipes(&mut random, &mut drawn, &free, room),
        SceneFamily::Rubble => rubble(&mut random, &mut drawn, &free, room),
        SceneFamily::Points => boulders(&mut random, &mut drawn, &free, room),
    }
    if drawn.known == KnownPath::NoPath {
        seal(&mut drawn, body);
    }
    drawn
}

/// Draws a way of arcs and lines, some 0.5 to 1 m long, that does not come back.
fn random_path(random: &mut Rng, start: TipPose, body: &TubeLimits) -> Vec<ArcSegment> {
    let mut tip = start;
    let mut way = Vec::new();
    for _ in 0..2 + random.below(3) {
        let x = any_perpendicular(&tip.direction);
        let (sin, cos) = sin_cos(TAU * random.uniform());
        let towards = x * cos + tip.direction.cross(&x) * sin;
        let radius = body.radius * random.uniform_between(1.0, 2.0);
        let arc = ArcSegment {
            from: tip,
            towards,
            curvature: 1.0 / radius,
            length: radius * random.uniform_between(0.2, 1.1),
        };
        // An arc that turns back towards the floor or the start is replaced by a straight line.
        let arc = if arc.end().direction.z < -0.3 { ArcSegment::line(tip, 50.0) } else { arc };
        let line = ArcSegment::line(arc.end(), random.uniform_between(50.0, 250.0));
        tip = line.end();
        way.extend([arc, line]);
    }
    way
}

/// Returns points of a segment that are at most `apart` (mm) apart.
fn sampled(stretch: &ArcSegment, apart: f64) -> Vec<Vector3<f64>> {
    let count = (stretch.length.abs() / apart).ceil().max(1.0) as u32;
    (0..=count).map(|i| stretch.point(stretch.length * f64::from(i) / f64::from(count))).collect()
}

/// Returns the minimum value of `distance` at these points.
fn min_distance(points: &[Vector3<f64>], distance: impl Fn(&Vector3<f64>) -> f64) -> f64 {
    points.iter().map(distance).fold(f64::INFINITY, f64::min)
}

/// Draws a point in the bounding box of start and goal, enlarged by a margin.
fn anywhere(random: &mut Rng, drawn: &RandomScene, margin: f64) -> Vector3<f64> {
    let (a, b) = (drawn.start.position, drawn.goal.position);
    let (min, max) = (a.inf(&b), a.sup(&b));
    Vector3::from_fn(|i, _| random.uniform_between(min[i] - margin, max[i] + margin))
}

/// Adds a shape to the scene if all points of `free` are farther than `room` (mm) from the shape. The points are so
/// dense that they represent a curve.
fn add(drawn: &mut RandomScene, shape: Shape, free: &[Vector3<f64>], room: f64) {
    if min_distance(free, |point| shape.distance(point)) > room + 0.1 {
        drawn.shapes.push(shape);
    }
}

fn pillars(random: &mut Rng, drawn: &mut RandomScene, free: &[Vector3<f64>], room: f64) {
    for _ in 0..60 {
        let centre = anywhere(random, drawn, 200.0);
        let size = random.uniform_between(15.0, 50.0);
        let shape = if random.below(2) == 0 {
            let up = Vector3::z() * 1500.0;
            Shape::Capsule { from: centre - up, to: centre + up, radius: size }
        } else {
            let rotation = Rotation3::from_axis_angle(&Vector3::z_axis(), random.uniform_between(0.0, PI));
            Shape::Box {
                centre,
                half_extents: Vector3::new(size, random.uniform_between(15.0, 60.0), 1500.0),
                rotation,
            }
        };
        add(drawn, shape, free, room);
    }
}

fn walls(random: &mut Rng, drawn: &mut RandomScene, way: &[ArcSegment], free: &[Vector3<f64>], room: f64) {
    let count = 2 + random.below(2);
    for wall in 0..count {
        // Walls stand across the way, one in each part of it, with a window there.
        let index = (way.len() as u64 * (2 * wall + 1) / (2 * count)) as usize;
        let Some(stretch) = way.get(index) else { continue };
        let tip = stretch.tip(stretch.length * random.uniform());
        let x = any_perpendicular(&tip.direction);
        let y = tip.direction.cross(&x);
        let axes = nalgebra::Matrix3::from_columns(&[x, y, tip.direction]);
        let rotation = Rotation3::from_matrix_unchecked(axes);
        let (thick, wide) = (random.uniform_between(5.0, 20.0), 1500.0);
        let hole = room + random.uniform_between(3.0, 20.0);
        for (side, along) in [(x, 0), (-x, 0), (y, 1), (-y, 1)] {
            let half_depth = 0.5 * (wide - hole);
            let half = if along == 0 { [half_depth, wide] } else { [hole, half_depth] };
            let shape = Shape::Box {
                centre: tip.position + side * (hole + half_depth),
                half_extents: Vector3::new(half[0], half[1], thick),
                rotation,
            };
            add(drawn, shape, free, room);
        }
    }
}

fn pipes(random: &mut Rng, drawn: &mut RandomScene, free: &[Vector3<f64>], room: f64) {
    for _ in 0..90 {
        let centre = anywhere(random, drawn, 150.0);
        // Most of them are parallel to an axis, as in a rack.
        let axis = if random.below(3) == 0 {
            random.direction()
        } else {
            [Vector3::x(), Vector3::y(), Vector3::z()][random.below(3) as usize]
        };
        let half = axis * random.uniform_between(100.0, 600.0);
        let shape =
            Shape::Capsule { from: centre - half, to: centre + half, radius: random.uniform_between(8.0, 35.0) };
        add(drawn, shape, free, room);
    }
}

/// Returns the corners (unit vectors) and faces of an octahedron whose faces are each divided into four: 18 corners, 32
/// faces.
fn stone() -> (Vec<Vector3<f64>>, Vec<[usize; 3]>) {
    let mut corners: Vec<Vector3<f64>> = Vec::new();
    let mut index = |point: Vector3<f64>| {
        let point = point.normalize();
        corners.iter().position(|corner| (corner - point).norm() < 1e-9).unwrap_or_else(|| {
            corners.push(point);
            corners.len() - 1
        })
    };
    let mut faces = Vec::new();
    for octant in 0..8 {
        let sign = |bit: u32| if octant >> bit & 1 == 0 { 1.0 } else { -1.0 };
        let [a, mut b, mut c] = [Vector3::x() * sign(0), Vector3::y() * sign(1), Vector3::z() * sign(2)];
        if sign(0) * sign(1) * sign(2) < 0.0 {
            (b, c) = (c, b);
        }
        let [ab, bc, ca] = [(a + b) * 0.5, (b + c) * 0.5, (c + a) * 0.5];
        for face in [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]] {
            faces.push(face.map(&mut index));
        }
    }
    (corners, faces)
}

fn rubble(random: &mut Rng, drawn: &mut RandomScene, free: &[Vector3<f64>], room: f64) {
    let (corners, faces) = stone();
    for _ in 0..120 {
        let centre = anywhere(random, drawn, 150.0);
        let size = random.uniform_between(25.0, 90.0);
        if min_distance(free, |point| (point - centre).norm()) < room + size + 0.1 {
            continue;
        }
        let points: Vec<Vector3<f64>> =
            corners.iter().map(|corner| centre + corner * (size * random.uniform_between(0.6, 1.0))).collect();
        drawn.triangles.extend(faces.iter().map(|face| Triangle(face.map(|corner| points[corner]))));
    }
}

fn boulders(random: &mut Rng, drawn: &mut RandomScene, free: &[Vector3<f64>], room: f64) {
    for _ in 0..80 {
        let centre = anywhere(random, drawn, 150.0);
        let size = random.uniform_between(20.0, 90.0);
        if min_distance(free, |point| (point - centre).norm()) < room + size + POINT_RADIUS + 0.1 {
            continue;
        }
        shell(&mut drawn.points, &centre, size, 8.0);
    }
}

/// Adds points of a sphere, about this far apart, along a spiral.
fn shell(points: &mut Vec<Vector3<f64>>, centre: &Vector3<f64>, radius: f64, apart: f64) {
    let count = (4.0 * PI * radius * radius / (apart * apart)).ceil() as u32;
    for i in 0..count {
        let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(count);
        let (sin, cos) = sin_cos(2.399_963_229_728_653 * f64::from(i) % TAU);
        let across = (1.0 - z * z).sqrt();
        points.push(centre + Vector3::new(across * cos, across * sin, z) * radius);
    }
}

/// Encloses the goal with a closed surface, so that no path exists.
fn seal(drawn: &mut RandomScene, body: &TubeLimits) {
    let centre = drawn.goal.position;
    // The size is large enough for the body, and too small for the start to be inside.
    let size = (2.5 * body.clearance).min(0.4 * (centre - drawn.start.position).norm());
    match drawn.family {
        SceneFamily::Points => shell(&mut drawn.points, &centre, 1.5 * size, 8.0),
        SceneFamily::Rubble => {
            let (corners, faces) = stone();
            for (scale, inwards) in [(1.7, false), (1.5, true)] {
                let points: Vec<Vector3<f64>> = corners.iter().map(|corner| centre + corner * (size * scale)).collect();
                drawn.triangles.extend(faces.iter().map(|&[a, b, c]| {
                    let face = if inwards { [a, c, b] } else { [a, b, c] };
                    Triangle(face.map(|corner| points[corner]))
                }));
            }
        }
        _ => {
            for axis in [Vector3::x(), Vector3::y(), Vector3::z()] {
                for side in [-1.0, 1.0] {
                    let half = Vector3::repeat(size) - axis * (size - 5.0);
                    let centre = centre + axis * (side * size);
                    drawn.shapes.push(Shape::Box { centre, half_extents: half, rotation: Rotation3::identity() });
                }
            }
        }
    }
}

/// Returns the minimum distance of these segments from the obstacles, mm, at points that are at most `apart` (mm)
/// apart. The distance from every obstacle is computed separately with independent formulas, to check the results of
/// the search trees.
pub fn brute_force_clearance(drawn: &RandomScene, stretches: &[ArcSegment], apart: f64) -> f64 {
    let points: Vec<Vector3<f64>> = stretches.iter().flat_map(|stretch| sampled(stretch, apart)).collect();
    min_distance(&points, |point| {
        let shapes = drawn.shapes.iter().map(|shape| brute_force_shape(shape, point));
        let cloud = drawn.points.iter().map(|centre| (point - centre).norm() - POINT_RADIUS);
        let faces = drawn.triangles.iter().map(|triangle| brute_force_triangle(triangle, point));
        shapes.chain(cloud).chain(faces).fold(f64::INFINITY, f64::min)
    })
}

/// Returns the distance from a point to a shape, mm. 0 inside the shape.
fn brute_force_shape(shape: &Shape, point: &Vector3<f64>) -> f64 {
    match shape {
        Shape::Box { centre, half_extents: half, rotation } => {
            let inside = rotation.inverse() * (point - centre);
            let nearest = inside.zip_map(half, |at, half| at.clamp(-half, half));
            (inside - nearest).norm()
        }
        Shape::Ball { centre, radius } => ((point - centre).norm() - radius).max(0.0),
        Shape::Capsule { from, to, radius } => {
            // The line's parameter by Cramer's rule, limited to its ends.
            let along = to - from;
            let share = along.dot(&(point - from)) / along.dot(&along).max(f64::MIN_POSITIVE);
            let foot = from + along * share.clamp(0.0, 1.0);
            ((point - foot).norm() - radius).max(0.0)
        }
    }
}

/// Returns the distance from a point to a triangle, mm. Finds the closest point by regions (Ericson 2005, "Real-Time
/// Collision Detection", 5.1.5).
pub fn brute_force_triangle(Triangle([a, b, c]): &Triangle, point: &Vector3<f64>) -> f64 {
    let (ab, ac, ap) = (b - a, c - a, point - a);
    let (d1, d2) = (ab.dot(&ap), ac.dot(&ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return ap.norm();
    }
    let bp = point - b;
    let (d3, d4) = (ab.dot(&bp), ac.dot(&bp));
    if d3 >= 0.0 && d4 <= d3 {
        return bp.norm();
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return (ap - ab * (d1 / (d1 - d3))).norm();
    }
    let cp = point - c;
    let (d5, d6) = (ab.dot(&cp), ac.dot(&cp));
    if d6 >= 0.0 && d5 <= d6 {
        return cp.norm();
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return (ap - ac * (d2 / (d2 - d6))).norm();
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        return (bp - (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)))).norm();
    }
    let sum = va + vb + vc;
    (ap - ab * (vb / sum) - ac * (vc / sum)).norm()
}
