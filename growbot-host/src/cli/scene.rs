//! `growbot scene`: writes an example scene, or shows what was read from a file.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use growbot_host::output::{is_standard_output, print, write_to};
use growbot_plan::atomic_file::format_from_extension;
use growbot_plan::figures::fixed;
use growbot_plan::sanitize::json_line;
use growbot_scene::demo_scenes::{DemoScene, to_toml};
use growbot_scene::scene_file::{self, SceneBox};
use growbot_scene::scene_summary::SceneSummary;

use super::failure::Failure;

/// Show what a scene holds, or write an example scene
///
/// For a file (.toml, .stl, .obj, .ply, .glb, .pcd) the command prints the obstacles and the box that holds them, in mm
/// in the base's axes, z up. Look at the box before you plan: most formats state neither axes nor units.
///
/// For a kind, the command writes a file of `growbot-scene/1` with obstacles drawn from a seed, the same for one seed
/// on every machine. It has a free way that a tube of 44 mm can take. Its first lines contain the command that plans
/// this way.
#[derive(Args)]
#[command(after_help = "Examples:\n  growbot scene room.glb\n  growbot scene pipe-rack -o rack.toml\n  growbot scene \
                        rubble-heap --seed 7 -o heap.toml\n  growbot plan --to 0,0,960 --scene rack.toml -o plan.json")]
pub struct SceneInfoArgs {
    /// File to show, or kind of example: pipe-rack (levels of pipes between four posts, 0.9 m high) or rubble-heap
    /// (slabs and bricks on a floor, 0.7 m across)
    #[arg(value_name = "FILE|KIND")]
    source: PathBuf,
    /// Seed of an example's obstacles: each gives another scene of the kind [default: 1]
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Write an example to this file, which ends in .toml [default: standard output]
    #[arg(short, long, value_name = "FILE", default_value = "-", hide_default_value = true)]
    output: PathBuf,
    /// Print what a file holds as one line of JSON
    #[arg(long)]
    json: bool,
}

/// A kind of example scene.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum SceneKind {
    PipeRack,
    RubbleHeap,
}

/// Runs the command.
pub fn run(args: &SceneInfoArgs) -> Result<(), Failure> {
    let kind = args.source.to_str().and_then(|name| SceneKind::from_str(name, false).ok());
    let Some(kind) = kind else { return show(args) };
    if args.json {
        return Err(Failure::bad_input(
            "--json applies only to scene files, but an example scene is written as TOML: remove --json",
        ));
    }
    write_example(kind, args.seed.unwrap_or(1), &args.output)
}

fn show(args: &SceneInfoArgs) -> Result<(), Failure> {
    let file = args.source.display().to_string();
    if args.seed.is_some() || !is_standard_output(&args.output) {
        return Err(Failure::bad_input(format!(
            "--seed and -o apply only to the example scenes pipe-rack and rubble-heap, but {file} is not one of \
             them: remove these options"
        )));
    }
    let loaded = scene_file::load(&args.source)?;
    let info = SceneSummary::new(file, &loaded);
    Ok(print(&if args.json { json_line(&info) } else { text_of(&info) })?)
}

fn text_of(summary: &SceneSummary) -> String {
    let SceneSummary { file, hash, margin_mm, shapes, half_spaces, triangles, points, bounds } = summary;
    let sides = match bounds {
        Some(SceneBox { min_mm, max_mm }) => ["x", "y", "z"]
            .iter()
            .zip(min_mm.iter().zip(max_mm))
            .map(|(axis, (min, max))| format!("  {axis}       {:>10} to {:>10} mm\n", fixed(*min, 2), fixed(*max, 2)))
            .collect(),
        None => "  no box    half spaces have no bounds\n".to_owned(),
    };
    let margin =
        margin_mm.map_or_else(|| "not stated: plans take that of the robot".to_owned(), |mm| format!("{mm} mm"));
    format!(
        "{file}\n{sides}  holds     {shapes} boxes, balls and capsules, {half_spaces} half spaces, {triangles} \
         triangles, {points} points\n  margin    {margin}\n  hash      {hash}\n"
    )
}

fn write_example(kind: SceneKind, seed: u64, output: &Path) -> Result<(), Failure> {
    let (example, name) = match kind {
        SceneKind::PipeRack => (DemoScene::PipeRack, "pipe-rack"),
        SceneKind::RubbleHeap => (DemoScene::RubbleHeap, "rubble-heap"),
    };
    format_from_extension(output, &["toml"])?;
    let (from, to) = example.endpoints();
    let comments = [
        format!("Written by `growbot scene {name} --seed {seed}`."),
        format!("To plan through it: growbot plan --from {from} --to {to} --scene FILE"),
    ];
    let scene = to_toml(&example.scene(seed), &comments);
    if write_to(output, scene.as_bytes())? {
        growbot_host::note!("scene written to {}", output.display());
    }
    Ok(())
}
