//! Measures the time until a mesh of a million triangles and a cloud of a million points are ready, and the memory
//! needed.
//!
//! ```sh
//! cargo run --release -p growbot-scene --example loading
//! ```

use std::error::Error;
use std::fs;
use std::path::Path;
use std::time::Instant;

use growbot_core::random::Rng;
use growbot_scene::scene_file::load;
use nalgebra::Vector3;

/// Numbers of corners of the ball's mesh around its axis and from pole to pole: 2 x 708 x 707 triangles.
const SIDES: [u32; 2] = [708, 707];
const POINTS: u32 = 1_000_000;

fn main() -> Result<(), Box<dyn Error>> {
    let directory = tempfile::tempdir()?;
    fs::write(directory.path().join("ball.stl"), ball())?;
    fs::write(directory.path().join("scan.ply"), cloud(false))?;
    fs::write(directory.path().join("text.ply"), cloud(true))?;
    for (entry, name) in [("mesh", "ball.stl"), ("points", "scan.ply"), ("points", "text.ply")] {
        let more = if entry == "mesh" { "" } else { "radius_mm = 1\n" };
        let scene = directory.path().join("scene.toml");
        fs::write(&scene, format!("format = \"growbot-scene/1\"\n[[{entry}]]\nfile = \"{name}\"\n{more}"))?;
        measure(&scene, name)?;
    }
    Ok(())
}

fn measure(scene: &Path, name: &str) -> Result<(), Box<dyn Error>> {
    let begin = Instant::now();
    let loaded = load(scene)?;
    let ready = begin.elapsed();
    let mut random = Rng::new(&[3]);
    let begin = Instant::now();
    let sum: f64 = (0..100_000).map(|_| loaded.scene.distance_within(&(random.direction() * 1100.0), 1e9)).sum();
    let each = begin.elapsed() / 100_000;
    let status = fs::read_to_string("/proc/self/status")?;
    let peak = status.lines().find(|line| line.starts_with("VmHWM")).unwrap_or_default();
    println!("{name}: {} ready after {ready:?}, {each:?} a distance (mean {:.3})", loaded.scene.len(), sum / 1e5);
    println!("  {peak} so far");
    Ok(())
}

/// Returns a closed mesh of a ball of 1 m, as binary STL.
fn ball() -> Vec<u8> {
    let [round, up] = SIDES;
    let corner = |i: u32, j: u32| {
        if j == 0 || j == up {
            return Vector3::z() * if j == 0 { -1000.0 } else { 1000.0 };
        }
        let (a, b) = (std::f64::consts::TAU * f64::from(i % round) / f64::from(round), f64::from(j) / f64::from(up));
        let b = std::f64::consts::PI * (b - 0.5);
        Vector3::new(libm::cos(a) * libm::cos(b), libm::sin(a) * libm::cos(b), libm::sin(b)) * 1000.0
    };
    let mut triangles = Vec::new();
    for i in 0..round {
        for j in 0..up {
            let [a, b, c, d] = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    let mut bytes = vec![0; 80];
    bytes.extend((triangles.len() as u32).to_le_bytes());
    for triangle in triangles {
        bytes.extend([0; 12]);
        bytes.extend(triangle.iter().flat_map(Vector3::iter).flat_map(|value| (*value as f32).to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

/// Returns a cloud of points on a ball of 1 m, as PLY.
fn cloud(as_text: bool) -> Vec<u8> {
    let format = if as_text { "ascii" } else { "binary_little_endian" };
    let mut bytes = format!(
        "ply\nformat {format} 1.0\nelement vertex {POINTS}\nproperty float x\nproperty float y\nproperty float z\n\
         end_header\n"
    )
    .into_bytes();
    let mut random = Rng::new(&[4]);
    for _ in 0..POINTS {
        let point = random.direction() * 1000.0;
        if as_text {
            bytes.extend(format!("{:.4} {:.4} {:.4}\n", point.x, point.y, point.z).bytes());
        } else {
            bytes.extend(point.iter().flat_map(|value| (*value as f32).to_le_bytes()));
        }
    }
    bytes
}
