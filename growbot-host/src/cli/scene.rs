//! `growbot scene`: writes an example scene.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use growbot_client::atomic_file::format_from_extension;
use growbot_host::output::write_to;
use growbot_scene::demo_scenes::{DemoScene, to_toml};

use super::Failure;

/// Write an example scene: obstacles drawn from a seed
///
/// The scene is a file of `growbot-scene/1`, the same for one seed on every machine. It has a free way that a tube of
/// 44 mm can take. Its first lines contain the command that plans this way.
#[derive(Args)]
#[command(after_help = "Examples:\n  growbot scene pipe-rack -o rack.toml\n  growbot scene rubble-heap --seed 7 -o \
                        heap.toml\n  growbot plan --to 0,0,960 --scene rack.toml -o plan.json")]
pub struct DemoSceneArgs {
    /// Kind of scene
    #[arg(value_name = "KIND")]
    kind: SceneKind,
    /// Seed of the obstacles: each gives another scene of the kind
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Write to this file, which ends in .toml [default: standard output]
    #[arg(short, long, value_name = "FILE", default_value = "-", hide_default_value = true)]
    output: PathBuf,
}

/// A kind of scene.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum SceneKind {
    /// Levels of pipes between four posts, 0.9 m high
    PipeRack,
    /// Slabs and bricks on a floor, 0.7 m across
    RubbleHeap,
}

/// Runs the command.
pub fn run(args: &DemoSceneArgs) -> Result<(), Failure> {
    let (example, name) = match args.kind {
        SceneKind::PipeRack => (DemoScene::PipeRack, "pipe-rack"),
        SceneKind::RubbleHeap => (DemoScene::RubbleHeap, "rubble-heap"),
    };
    format_from_extension(&args.output, &["toml"])?;
    let (from, to) = example.endpoints();
    let comments = [
        format!("Written by `growbot scene {name} --seed {}`.", args.seed),
        format!("To plan through it: growbot plan --from {from} --to {to} --scene FILE"),
    ];
    let scene = to_toml(&example.scene(args.seed), &comments);
    if write_to(&args.output, scene.as_bytes())? {
        growbot_host::note!("scene written to {}", args.output.display());
    }
    Ok(())
}
