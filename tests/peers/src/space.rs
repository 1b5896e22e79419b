//! growbot's planners in space.

use std::hint::black_box;

use growbot_core::path::{Path, end, length};
use growbot_core::plan::{Planner, miss, plan};
use growbot_core::pose::Pose;
use growbot_core::robot::Robot;
use nalgebra::Vector3;
use serde::Serialize;

/// growbot's planners.
const PLANNERS: &[(&str, Planner)] = &[("two-plane", Planner::TwoPlane), ("shortest", Planner::Shortest)];

/// Finds a path with the planner that is timed.
fn find(robot: &Robot, start: &Pose, goal: &Pose, planner: Planner) -> Option<Path> {
    plan(robot, start, goal, RADIUS, planner).ok().map(|chosen| chosen.path)
}

/// Turning radius, mm.
const RADIUS: f64 = 100.0;

/// Returns the names of the planners.
pub fn planners() -> Vec<&'static str> {
    PLANNERS.iter().map(|(name, _)| *name).collect()
}

/// A path: its length, radii, and the distance of its end from the goal, radii or radians, whichever is larger.
#[derive(Serialize)]
pub struct Found {
    length: f64,
    miss: f64,
}

/// Starts and goals, and the robot for the planner.
pub struct Space {
    robot: Robot,
    pairs: Vec<(Pose, Pose)>,
}

impl Space {
    pub fn new(pairs: &[[[f64; 5]; 2]]) -> Result<Self, String> {
        let file = include_str!("../../../robots/growbot-a.toml");
        let robot = Robot::new(toml::from_str(file).map_err(|e| e.to_string())?).map_err(|e| e.to_string())?;
        let pose = |[x, y, z, heading, pitch]: [f64; 5]| {
            Pose::new(Vector3::new(x, y, z) * RADIUS, heading, pitch).map_err(|e| e.to_string())
        };
        let pairs =
            pairs.iter().map(|&[start, goal]| Ok((pose(start)?, pose(goal)?))).collect::<Result<_, String>>()?;
        Ok(Self { robot, pairs })
    }

    /// Returns the path of each pair.
    pub fn paths(&self, planner: &str) -> Result<Vec<Option<Found>>, String> {
        let planner = named(planner)?;
        let found = |(start, goal): &(Pose, Pose)| {
            find(&self.robot, start, goal, planner).map(|path| {
                let miss = miss(&end(&path, &start.frame()), goal);
                Found { length: length(&path) / RADIUS, miss: (miss.distance / RADIUS).max(miss.angle) }
            })
        };
        Ok(self.pairs.iter().map(found).collect())
    }

    /// Finds all paths `passes` times, and returns the number of pairs.
    pub fn run(&self, planner: &str, passes: usize) -> Result<usize, String> {
        let planner = named(planner)?;
        for _ in 0..passes {
            for (start, goal) in &self.pairs {
                black_box(find(&self.robot, black_box(start), black_box(goal), planner));
            }
        }
        Ok(self.pairs.len())
    }
}

fn named(name: &str) -> Result<Planner, String> {
    let known = PLANNERS.iter().find(|(known, _)| *known == name);
    known.map(|(_, planner)| *planner).ok_or_else(|| format!("no planner in space is called {name}"))
}
