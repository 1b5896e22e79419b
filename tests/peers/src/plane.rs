//! Planners in the plane.

use std::ffi::{c_int, c_uint};
use std::hint::black_box;

use dubins_paths::PathType;
use dubins_paths::f64::{DubinsPath, PosRot};
use growbot_core::dubins2::{PathType as OurPathType, PlanarPath, PlanarPose, shortest};
use serde::Serialize;

/// Names of the planners.
pub const PLANNERS: [&str; 3] = ["growbot", "dubins_paths", "dubins"];

/// The path as the C library's header defines it.
#[repr(C)]
#[derive(Default)]
struct CPath {
    start: [f64; 3],
    lengths: [f64; 3],
    radius: f64,
    word: c_uint,
}

/// Path types in the order of the C library's enumeration.
const C_WORDS: [&str; 6] = ["LSL", "LSR", "RSL", "RSR", "RLR", "LRL"];

unsafe extern "C" {
    fn dubins_shortest_path(path: *mut CPath, start: *const f64, goal: *const f64, radius: f64) -> c_int;
}

/// A path: its path type, and the length of each segment, radii.
#[derive(Serialize)]
pub struct Path {
    word: &'static str,
    lengths: [f64; 3],
}

/// Starts and goals, in the form that each planner takes.
pub struct Plane {
    growbot: Vec<[PlanarPose; 2]>,
    dubins_paths: Vec<[PosRot; 2]>,
    dubins: Vec<[[f64; 3]; 2]>,
}

impl Plane {
    pub fn new(pairs: &[[[f64; 3]; 2]]) -> Self {
        let growbot = |[x, y, heading]: [f64; 3]| PlanarPose { x, y, heading };
        let dubins_paths = |[x, y, heading]: [f64; 3]| PosRot::from_floats(x, y, heading);
        Self {
            growbot: pairs.iter().map(|pair| pair.map(growbot)).collect(),
            dubins_paths: pairs.iter().map(|pair| pair.map(dubins_paths)).collect(),
            dubins: pairs.to_vec(),
        }
    }

    /// Returns the path of each pair.
    pub fn paths(&self, planner: &str) -> Result<Vec<Option<Path>>, String> {
        Ok(match planner {
            "growbot" => self.growbot.iter().map(|pair| Some(of_growbot(pair))).collect(),
            "dubins_paths" => self.dubins_paths.iter().map(of_dubins_paths).collect(),
            "dubins" => self.dubins.iter().map(of_dubins).collect(),
            _ => return Err(unknown(planner)),
        })
    }

    /// Finds all paths `passes` times, and returns the number of pairs.
    pub fn run(&self, planner: &str, passes: usize) -> Result<usize, String> {
        match planner {
            "growbot" => repeat(&self.growbot, passes, find_growbot),
            "dubins_paths" => repeat(&self.dubins_paths, passes, find_dubins_paths),
            "dubins" => repeat(&self.dubins, passes, find_dubins),
            _ => return Err(unknown(planner)),
        }
        Ok(self.growbot.len())
    }
}

fn unknown(planner: &str) -> String {
    format!("no planner in the plane is called {planner}")
}

/// Calls a planner for every pair, `passes` times.
fn repeat<T, P>(pairs: &[T], passes: usize, find: impl Fn(&T) -> P) {
    for _ in 0..passes {
        for pair in pairs {
            black_box(find(black_box(pair)));
        }
    }
}

/// Finds growbot's path. Its planner takes the goal relative to the start.
fn find_growbot([start, goal]: &[PlanarPose; 2]) -> PlanarPath {
    let (sine, cosine) = libm::sincos(start.heading);
    let (x, y) = (goal.x - start.x, goal.y - start.y);
    shortest(&PlanarPose { x: x * cosine + y * sine, y: y * cosine - x * sine, heading: goal.heading - start.heading })
}

fn of_growbot(pair: &[PlanarPose; 2]) -> Path {
    let path = find_growbot(pair);
    let word = match path.path_type {
        OurPathType::Lsl => "LSL",
        OurPathType::Rsr => "RSR",
        OurPathType::Lsr => "LSR",
        OurPathType::Rsl => "RSL",
        OurPathType::Lrl => "LRL",
        OurPathType::Rlr => "RLR",
    };
    Path { word, lengths: path.lengths }
}

fn find_dubins_paths(&[start, goal]: &[PosRot; 2]) -> Option<DubinsPath> {
    DubinsPath::shortest_from(start, goal, 1.0).ok()
}

fn of_dubins_paths(pair: &[PosRot; 2]) -> Option<Path> {
    find_dubins_paths(pair).map(|path| {
        let word = match path.path_type {
            PathType::LSL => "LSL",
            PathType::RSR => "RSR",
            PathType::LSR => "LSR",
            PathType::RSL => "RSL",
            PathType::LRL => "LRL",
            PathType::RLR => "RLR",
        };
        Path { word, lengths: path.param }
    })
}

fn find_dubins([start, goal]: &[[f64; 3]; 2]) -> Option<CPath> {
    let mut path = CPath::default();
    // SAFETY: the path has the layout of the header. Both poses are three numbers, which the function only reads.
    let error = unsafe { dubins_shortest_path(&raw mut path, start.as_ptr(), goal.as_ptr(), 1.0) };
    (error == 0).then_some(path)
}

fn of_dubins(pair: &[[f64; 3]; 2]) -> Option<Path> {
    let path = find_dubins(pair)?;
    Some(Path { word: C_WORDS.get(path.word as usize)?, lengths: path.lengths })
}
