//! The body of a simulated growth as a file, in the formats of `growbot export` and `growbot view`.

use std::path::Path;

use growbot_host::output::is_standard_output;
use growbot_pictures::export::body::ExportedBody;
use growbot_pictures::export::mesh::MeshResolution;
use growbot_pictures::export::obstacles::scene_view;
use growbot_pictures::export::{centreline_csv, glb, obj, stl, three_mf};
use growbot_pictures::view::picture::{self, PictureOptions};
use growbot_pictures::view::{Subject, page};
use growbot_plan::atomic_file::write_atomic;
use growbot_plan::run_log::BodyKind;

use super::super::failure::Failure;
use super::super::output_format::OutputFormat::{self, Csv, Glb, Html, Json, Obj, Pdf, Png, Stl, Svg, ThreeMf};

/// All formats of `-o`.
const FORMATS: [OutputFormat; 10] = [Csv, Stl, Obj, ThreeMf, Glb, Html, Svg, Png, Pdf, Json];
/// Resolution of a mesh: number of chords around the wall, and number of layers for each ring of vertices.
const RESOLUTION: MeshResolution = MeshResolution { segments: 64, layers_per_ring: 1 };
/// Returns the format of a body's file by its extension. `None` for `.json`, which is for the result, and for standard
/// output.
pub fn format_of(file: &Path) -> Result<Option<OutputFormat>, Failure> {
    match OutputFormat::of(file, &FORMATS)? {
        Some(format) => Ok(Some(format).filter(|format| *format != Json)),
        None if is_standard_output(file) => Ok(None),
        None => Err(Failure::bad_input(format!(
            "unknown format of {}: end the name in .csv, .stl, .obj, .3mf, .glb, .html, .svg, .png or .pdf, or in \
             .json for the result",
            file.display()
        ))),
    }
}

/// Writes the body that was laid.
pub fn write(file: &Path, format: OutputFormat, subject: &Subject) -> Result<(), Failure> {
    let kind = BodyKind::Laid.name();
    let laid = subject.laid.map_or(&[][..], |laid| laid.layers);
    let body = || ExportedBody::laid(subject.robot, &subject.plan.start, laid);
    let bytes = match format {
        Csv => centreline_csv::write(&body(), None).into_bytes(),
        Stl => stl::write(kind, &body(), RESOLUTION)?,
        Obj => obj::write(kind, &body(), RESOLUTION)?.into_bytes(),
        ThreeMf => three_mf::write(kind, &body(), RESOLUTION).map_err(Failure::bad_input)?,
        Glb => glb::write(&[(kind, &body())], scene_view(subject)?.as_ref(), RESOLUTION)?,
        Html => page::render(subject)?.into_bytes(),
        _ => {
            let picture = picture::svg(&[subject], &PictureOptions::default())?;
            format.drawn(picture, OutputFormat::PNG_WIDTH)?
        }
    };
    write_atomic(file, &bytes)?;
    growbot_host::note!("body, {kind}, written to {}, {} bytes", file.display(), bytes.len());
    Ok(())
}
