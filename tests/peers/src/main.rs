//! Finds and times paths on request: growbot's own, those of the crate `dubins_paths`, and those of the C library
//! behind the Python package `dubins`.
//!
//! Requests are lines of JSON on standard input, and responses are lines of JSON on standard output. So a caller can
//! alternate between these planners and others, batch by batch. A slow moment of the machine then affects all of them
//! alike.
//!
//! Lengths are in turning radii, angles in radians.

mod plane;
mod space;

use std::io::{BufRead, Write, stdin, stdout};
use std::time::Instant;

use serde::Deserialize;
use serde_json::{Value, json};

use plane::Plane;
use space::Space;

/// A request.
#[derive(Deserialize)]
#[serde(tag = "do", rename_all = "snake_case", deny_unknown_fields)]
enum Request {
    /// Returns the names of the planners.
    Planners,
    /// Loads pairs of poses in the plane (x, y, heading), in place of the previous ones.
    LoadPlane { pairs: Vec<[[f64; 3]; 2]> },
    /// Loads pairs of poses in space (x, y, z, heading, pitch), in place of the previous ones.
    LoadSpace { pairs: Vec<[[f64; 5]; 2]> },
    /// Returns the path of each pair, or null if the planner finds none.
    Paths { planner: String },
    /// Returns nanoseconds for a path: the mean of `passes` passes over all pairs.
    Time { planner: String, passes: usize },
}

/// Loaded pairs of start and goal.
enum Loaded {
    Nothing,
    Plane(Plane),
    Space(Box<Space>),
}

impl Loaded {
    fn reply(&mut self, request: Request) -> Result<Value, String> {
        match request {
            Request::Planners => return Ok(json!({ "plane": plane::PLANNERS, "space": space::planners() })),
            Request::LoadPlane { pairs } => *self = Self::Plane(Plane::new(&pairs)),
            Request::LoadSpace { pairs } => *self = Self::Space(Box::new(Space::new(&pairs)?)),
            Request::Paths { planner } => {
                return match self {
                    Self::Nothing => Err("nothing is loaded".into()),
                    Self::Plane(plane) => plane.paths(&planner).map(|paths| json!(paths)),
                    Self::Space(space) => space.paths(&planner).map(|paths| json!(paths)),
                };
            }
            Request::Time { planner, passes } => {
                let began = Instant::now();
                let pairs = match self {
                    Self::Nothing => return Err("nothing is loaded".into()),
                    Self::Plane(plane) => plane.run(&planner, passes)?,
                    Self::Space(space) => space.run(&planner, passes)?,
                };
                let nanoseconds = began.elapsed().as_secs_f64() * 1e9;
                return Ok(json!(nanoseconds / (pairs * passes) as f64));
            }
        }
        Ok(Value::Null)
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut loaded = Loaded::Nothing;
    let mut replies = stdout().lock();
    for line in stdin().lock().lines() {
        let reply = loaded.reply(serde_json::from_str(&line?)?)?;
        writeln!(replies, "{reply}")?;
        replies.flush()?;
    }
    Ok(())
}
