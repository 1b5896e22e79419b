//! The body of a simulated growth as a file, in the formats of `growbot export` and `growbot view`.

use std::path::Path;

use clap::ValueEnum;
use growbot_client::atomic_file::{format_from_extension, write_atomic};
use growbot_client::plan::Plan;
use growbot_client::run_log::BodyKind;
use growbot_core::robot::Robot;
use growbot_host::output::is_standard_output;
use growbot_pictures::drawing::pdf::svg_to_pdf;
use growbot_pictures::drawing::png::png;
use growbot_pictures::export::body::ExportedBody;
use growbot_pictures::export::mesh::MeshResolution;
use growbot_pictures::export::obstacles::scene_view;
use growbot_pictures::export::{centreline_csv, glb, stl};
use growbot_pictures::view::picture::{self, PictureOptions};
use growbot_pictures::view::{NamedScene, SimulatedBody, Subject, page};

use super::super::Failure;

/// File formats of a body.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum BodyFormat {
    Csv,
    Stl,
    Glb,
    Html,
    Svg,
    Png,
    Pdf,
}

/// All extensions of `-o`.
const ENDINGS: [&str; 8] = ["csv", "stl", "glb", "html", "svg", "png", "pdf", "json"];
/// Resolution of a mesh: number of chords around the wall, and number of layers for each ring of vertices.
const RESOLUTION: MeshResolution = MeshResolution { segments: 64, layers_per_ring: 1 };
/// Width of a PNG, pixels.
const WIDTH: u32 = 1600;

impl BodyFormat {
    /// Returns the format of a body's file by its extension. `None` for `.json`, which is for the result, and for
    /// standard output.
    pub fn of(file: &Path) -> Result<Option<Self>, Failure> {
        match format_from_extension(file, &ENDINGS)? {
            // All extensions but that of the result are formats of bodies.
            Some(ending) => Ok(Self::from_str(ending, true).ok()),
            None if is_standard_output(file) => Ok(None),
            None => Err(Failure::bad_input(format!(
                "unknown format of {}: end the name in .csv, .stl, .glb, .html, .svg, .png or .pdf, or in .json for \
                 the result",
                file.display()
            ))),
        }
    }
}

/// A grown body that is written to a file.
pub struct BodyToWrite<'a> {
    /// Name of the growth.
    pub name: &'a str,
    pub robot: &'a Robot,
    pub plan: &'a Plan,
    pub body: SimulatedBody<'a>,
    /// Scene in which the body was grown. `None` without a scene.
    pub scene: Option<NamedScene<'a>>,
}

/// Writes the body that was laid.
pub fn write(file: &Path, format: BodyFormat, grown: &BodyToWrite) -> Result<(), Failure> {
    let BodyToWrite { name, robot, plan, body: laid, scene } = *grown;
    let kind = BodyKind::Laid.name();
    let body = || ExportedBody::laid(robot, &plan.start, laid.layers);
    let subject = Subject { name, robot, plan, run: None, laid: Some(laid), scene };
    let picture = || picture::svg(&[&subject], &PictureOptions::default());
    let bytes = match format {
        BodyFormat::Csv => centreline_csv::write(&body(), None).into_bytes(),
        BodyFormat::Stl => stl::write(kind, &body(), RESOLUTION)?,
        BodyFormat::Glb => glb::write(&[(kind, &body())], scene_view(&subject)?.as_ref(), RESOLUTION)?,
        BodyFormat::Html => page::render(&subject)?.into_bytes(),
        BodyFormat::Svg => picture()?.into_bytes(),
        BodyFormat::Pdf => svg_to_pdf(&picture()?).map_err(Failure::bad_input)?,
        BodyFormat::Png => png(&picture()?, WIDTH)?,
    };
    write_atomic(file, &bytes)?;
    growbot_host::note!("body, {kind}, written to {}, {} bytes", file.display(), bytes.len());
    Ok(())
}
