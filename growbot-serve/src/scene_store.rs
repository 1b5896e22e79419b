//! Scenes that clients have sent to the service, so that plans can avoid them.
//!
//! The service never deletes stored scenes, because jobs refer to them: a resumed growth must still avoid the scene of
//! its job.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use growbot_core::hash::Hasher;
use growbot_plan::atomic_file::write_atomic;
use growbot_plan::hexadecimal::format_hash;
use growbot_scene::read::is_geometry;
use growbot_scene::scene_file::{self, SceneBox};

use super::paths::ServicePaths;
use super::problem::Problem;

/// Maximum size of all stored scenes together, bytes.
const MAX_KEPT: u64 = 1 << 30;

/// Stores a scene file with this content. `name` is the client's name of the file. Returns the name under which
/// [`find`] finds the stored scene, and the bounding box of its obstacles.
pub fn store(places: &ServicePaths, name: &str, bytes: &[u8]) -> Result<(String, Option<SceneBox>), Problem> {
    let ending = Path::new(name).extension().and_then(|ending| ending.to_str()).unwrap_or_default();
    let ending = ending.to_ascii_lowercase();
    let is_scene_file = ending == "toml";
    if !is_scene_file && !is_geometry(Path::new(&format!("scene.{ending}"))) {
        return Err(Problem::bad(format!(
            "{name:?} does not have the extension of a scene file: send a .toml, .stl, .obj, .ply, .glb or .pcd file"
        )));
    }
    if is_scene_file {
        let written = scene_file::parse(&String::from_utf8_lossy(bytes), name).map_err(Problem::bad)?;
        let files =
            || written.meshes.iter().map(|mesh| &mesh.file).chain(written.clouds.iter().map(|cloud| &cloud.file));
        if let Some(other) = files().next() {
            return Err(Problem::bad(format!(
                "{name} refers to {other}, which was not sent: send a scene of a single file, or a plan through this \
                 scene"
            )));
        }
    }
    let directory = places.scenes();
    let kept: u64 = fs::read_dir(&directory)
        .map_err(Problem::internal)?
        .filter_map(|entry| entry.ok()?.metadata().ok())
        .map(|metadata| metadata.len())
        .sum();
    if kept + bytes.len() as u64 > MAX_KEPT {
        return Err(Problem::conflict(format!(
            "with this scene, the service would store more than {MAX_KEPT} bytes of scenes: remove scenes that no job \
             needs from {}",
            directory.display()
        )));
    }
    let kept = format!("{}.{ending}", format_hash(Hasher::hash(bytes)));
    let path = directory.join(&kept);
    write_atomic(&path, bytes).map_err(Problem::internal)?;
    match scene_file::load(&path) {
        Ok(loaded) => Ok((kept, loaded.bounding_box())),
        Err(error) => {
            // Another request with the same bytes may have removed it.
            fs::remove_file(&path).or_else(|error| match error.kind() {
                ErrorKind::NotFound => Ok(()),
                _ => Err(Problem::internal(error)),
            })?;
            Err(Problem::bad(error.to_string().replace(&path.display().to_string(), name)))
        }
    }
}

/// Returns the path of the stored scene with this name, or an error if no scene has this name.
pub fn find(places: &ServicePaths, name: &str) -> Result<PathBuf, Problem> {
    let is_name = name.chars().all(|letter| letter.is_ascii_alphanumeric() || letter == '.') && !name.starts_with('.');
    let path = places.scenes().join(name);
    if is_name && path.is_file() {
        return Ok(path);
    }
    Err(Problem::bad(format!(
        "the service stores no scene {name:?}: send the scene to /scenes first, and give the name in the \
         response as \"scene\" of this request"
    )))
}
