//! Conversion of a drawing to a PDF of one page. Paths stay paths and letters become outlines, so no program needs a
//! font. Only the features of the drawings here are supported: paths of one colour or of a linear gradient.

use std::collections::BTreeMap;
use std::io::Write;

use flate2::Compression;
use flate2::write::ZlibEncoder;
use pdf_writer::types::{FunctionShadingType, LineCapStyle, LineJoinStyle};
use pdf_writer::{Content, Filter, Finish, Name, Pdf, Rect, Ref, TextStr};
use resvg::tiny_skia::PathSegment;
use resvg::usvg::{self, FillRule, Group, LineCap, LineJoin, LinearGradient, Node, Paint, Stroke, Transform};

use super::png::read;

/// PDF points per unit of the drawing: a point is 1/72 inch, and a unit 1/96 inch.
const POINTS: f32 = 0.75;
/// Number of colours with which a gradient is sampled.
const SAMPLES: u16 = 256;

/// Error of the conversion to PDF.
#[derive(Debug, thiserror::Error)]
pub enum PdfError {
    /// The drawing is not valid SVG.
    #[error("cannot draw the picture as PDF: {0}; write the picture as SVG")]
    Svg(#[from] usvg::Error),
    /// Compression of the page failed.
    #[error("cannot write the picture as PDF: {0}; write the picture as SVG")]
    Packing(#[from] std::io::Error),
}

/// Converts a drawing (SVG) to PDF.
///
/// # Errors
/// [`PdfError`].
pub fn svg_to_pdf(svg: &str) -> Result<Vec<u8>, PdfError> {
    let tree = read(svg)?;
    let (width, height) = (POINTS * tree.size().width(), POINTS * tree.size().height());
    let mut page = PdfPage { content: Content::new(), opacities: BTreeMap::new(), gradients: Vec::new() };
    // PDF coordinates start at the lower edge.
    let upright = Transform::from_row(POINTS, 0.0, 0.0, -POINTS, 0.0, height);
    page.content.transform(row(upright));
    page.group(tree.root(), 1.0);
    page.write(Rect::new(0.0, 0.0, width, height)).map_err(PdfError::from)
}

fn row(transform: Transform) -> [f32; 6] {
    let Transform { sx, kx, ky, sy, tx, ty } = transform;
    [sx, ky, kx, sy, tx, ty]
}

/// An unfinished PDF page.
struct PdfPage {
    content: Content,
    /// Pairs of opacities (fill, stroke), in thousandths, each with the number of its graphics state.
    opacities: BTreeMap<[u16; 2], usize>,
    /// Gradients: the coordinates of both ends (x1, y1, x2, y2), and the sampled colours.
    gradients: Vec<([f32; 4], Vec<u8>)>,
}

impl PdfPage {
    fn group(&mut self, group: &Group, opacity: f32) {
        let opacity = opacity * group.opacity().get();
        for node in group.children() {
            match node {
                Node::Group(group) => self.group(group, opacity),
                Node::Text(text) => self.group(text.flattened(), opacity),
                Node::Path(path) if path.is_visible() => self.path(path, opacity),
                Node::Path(_) | Node::Image(_) => {}
            }
        }
    }

    fn path(&mut self, path: &usvg::Path, opacity: f32) {
        self.content.save_state();
        self.content.transform(row(path.abs_transform()));
        let of = |part: Option<f32>| (1000.0 * opacity * part.unwrap_or(1.0)).round() as u16;
        let opacities =
            [of(path.fill().map(|fill| fill.opacity().get())), of(path.stroke().map(|it| it.opacity().get()))];
        if opacities != [1000, 1000] {
            let next = self.opacities.len();
            let number = *self.opacities.entry(opacities).or_insert(next);
            self.content.set_parameters(Name(format!("O{number}").as_bytes()));
        }
        let rule = path.fill().map_or(FillRule::NonZero, usvg::Fill::rule);
        let filled = match path.fill().map(usvg::Fill::paint) {
            Some(Paint::Color(color)) => {
                let [red, green, blue] = rgb(*color);
                self.content.set_fill_rgb(red, green, blue);
                true
            }
            Some(Paint::LinearGradient(gradient)) => {
                self.gradient(gradient, path, rule);
                false
            }
            _ => false,
        };
        let stroked = path.stroke().is_some_and(|stroke| self.stroke_style(stroke));
        if filled || stroked {
            self.outline(path);
        }
        match (filled, stroked, rule) {
            (true, true, FillRule::NonZero) => self.content.fill_nonzero_and_stroke(),
            (true, true, FillRule::EvenOdd) => self.content.fill_even_odd_and_stroke(),
            (true, false, FillRule::NonZero) => self.content.fill_nonzero(),
            (true, false, FillRule::EvenOdd) => self.content.fill_even_odd(),
            (false, true, _) => self.content.stroke(),
            (false, false, _) => &mut self.content,
        };
        self.content.restore_state();
    }

    /// Sets the style of a stroke. Returns false if its paint is not a colour.
    fn stroke_style(&mut self, stroke: &Stroke) -> bool {
        let Paint::Color(color) = stroke.paint() else { return false };
        let [red, green, blue] = rgb(*color);
        self.content.set_stroke_rgb(red, green, blue).set_line_width(stroke.width().get());
        self.content.set_line_cap(match stroke.linecap() {
            LineCap::Butt => LineCapStyle::ButtCap,
            LineCap::Round => LineCapStyle::RoundCap,
            LineCap::Square => LineCapStyle::ProjectingSquareCap,
        });
        self.content.set_line_join(match stroke.linejoin() {
            LineJoin::Miter | LineJoin::MiterClip => LineJoinStyle::MiterJoin,
            LineJoin::Round => LineJoinStyle::RoundJoin,
            LineJoin::Bevel => LineJoinStyle::BevelJoin,
        });
        if let Some(dashes) = stroke.dasharray() {
            self.content.set_dash_pattern(dashes.iter().copied(), stroke.dashoffset());
        }
        true
    }

    fn gradient(&mut self, gradient: &LinearGradient, path: &usvg::Path, rule: FillRule) {
        self.content.save_state();
        self.outline(path);
        match rule {
            FillRule::NonZero => self.content.clip_nonzero(),
            FillRule::EvenOdd => self.content.clip_even_odd(),
        };
        self.content.end_path();
        self.content.transform(row(gradient.transform()));
        self.content.shading(Name(format!("S{}", self.gradients.len()).as_bytes()));
        self.content.restore_state();
        let colours = (0..SAMPLES).flat_map(|sample| colour_at(gradient, f32::from(sample) / f32::from(SAMPLES - 1)));
        self.gradients.push(([gradient.x1(), gradient.y1(), gradient.x2(), gradient.y2()], colours.collect()));
    }

    fn outline(&mut self, path: &usvg::Path) {
        let mut last = (0.0, 0.0);
        for segment in path.data().segments() {
            match segment {
                PathSegment::MoveTo(to) => {
                    self.content.move_to(to.x, to.y);
                    last = (to.x, to.y);
                }
                PathSegment::LineTo(to) => {
                    self.content.line_to(to.x, to.y);
                    last = (to.x, to.y);
                }
                PathSegment::QuadTo(by, to) => {
                    // A cubic curve with the same points.
                    let near = |from: f32, by: f32| from + 2.0 / 3.0 * (by - from);
                    self.content.cubic_to(
                        near(last.0, by.x),
                        near(last.1, by.y),
                        near(to.x, by.x),
                        near(to.y, by.y),
                        to.x,
                        to.y,
                    );
                    last = (to.x, to.y);
                }
                PathSegment::CubicTo(one, other, to) => {
                    self.content.cubic_to(one.x, one.y, other.x, other.y, to.x, to.y);
                    last = (to.x, to.y);
                }
                PathSegment::Close => {
                    self.content.close_path();
                }
            }
        }
    }

    fn write(self, size: Rect) -> std::io::Result<Vec<u8>> {
        let Self { content, opacities, gradients } = self;
        let mut pdf = Pdf::new();
        let [catalog, pages, page, stream, info] = [1, 2, 3, 4, 5].map(Ref::new);
        let opacity = |number: usize| Ref::new(6 + number as i32);
        let shading = |number: usize| Ref::new(6 + (opacities.len() + 2 * number) as i32);
        let colours = |number: usize| Ref::new(7 + (opacities.len() + 2 * number) as i32);
        pdf.catalog(catalog).pages(pages);
        pdf.pages(pages).kids([page]).count(1);
        let mut written = pdf.page(page);
        written.parent(pages).media_box(size).contents(stream);
        let mut resources = written.resources();
        let mut states = resources.ext_g_states();
        for number in 0..opacities.len() {
            states.pair(Name(format!("O{number}").as_bytes()), opacity(number));
        }
        states.finish();
        let mut shadings = resources.shadings();
        for number in 0..gradients.len() {
            shadings.pair(Name(format!("S{number}").as_bytes()), shading(number));
        }
        shadings.finish();
        resources.finish();
        written.finish();
        pdf.document_info(info).producer(TextStr(concat!("growbot ", env!("CARGO_PKG_VERSION"))));
        for ([fill, stroke], number) in &opacities {
            let mut state = pdf.ext_graphics(opacity(*number));
            state.non_stroking_alpha(f32::from(*fill) / 1000.0).stroking_alpha(f32::from(*stroke) / 1000.0);
        }
        for (number, (ends, samples)) in gradients.iter().enumerate() {
            let mut written = pdf.function_shading(shading(number));
            written.shading_type(FunctionShadingType::Axial).coords(*ends).extend([true, true]);
            written.function(colours(number)).color_space().device_rgb();
            written.finish();
            let mut function = pdf.sampled_function(colours(number), samples);
            function.domain([0.0, 1.0]).range([0.0, 1.0, 0.0, 1.0, 0.0, 1.0]);
            function.size([i32::from(SAMPLES)]).bits_per_sample(8);
        }
        let mut packed = ZlibEncoder::new(Vec::new(), Compression::best());
        packed.write_all(content.finish().as_slice())?;
        pdf.stream(stream, &packed.finish()?).filter(Filter::FlateDecode);
        Ok(pdf.finish())
    }
}

fn rgb(color: usvg::Color) -> [f32; 3] {
    [color.red, color.green, color.blue].map(|part| f32::from(part) / 255.0)
}

/// Returns the colour at a position from 0 to 1 on a gradient.
fn colour_at(gradient: &LinearGradient, at: f32) -> [u8; 3] {
    let stops = gradient.stops();
    let after = stops.iter().position(|stop| stop.offset().get() >= at).unwrap_or(stops.len().saturating_sub(1));
    let Some((from, to)) = stops.get(after.saturating_sub(1)).zip(stops.get(after)) else { return [0; 3] };
    let (begin, end) = (from.offset().get(), to.offset().get());
    let share = if end > begin { ((at - begin) / (end - begin)).clamp(0.0, 1.0) } else { 1.0 };
    let mix = |from: u8, to: u8| (f32::from(from) + share * (f32::from(to) - f32::from(from))).round() as u8;
    let (from, to) = (from.color(), to.color());
    [mix(from.red, to.red), mix(from.green, to.green), mix(from.blue, to.blue)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pdf_page_has_the_drawing_size_and_outlined_letters() {
        let svg = "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 200 50\" width=\"200\" \
                   height=\"50\"><defs><linearGradient id=\"g\"><stop offset=\"0\" stop-color=\"#000\"/><stop \
                   offset=\"1\" stop-color=\"#fff\"/></linearGradient></defs><rect width=\"50\" height=\"10\" \
                   fill=\"url(#g)\"/><path d=\"M0 0L9 9\" stroke=\"#f00\" stroke-opacity=\".5\"/><text x=\"10\" \
                   y=\"30\">mm</text></svg>";
        let bytes = svg_to_pdf(svg).unwrap();
        assert!(bytes.starts_with(b"%PDF-1."));
        let text = String::from_utf8_lossy(&bytes);
        for part in ["/MediaBox [0 0 150 37.5]", "/ShadingType 2", "/CA 0.5", "/Producer (growbot", "%%EOF"] {
            assert!(text.contains(part), "{part}: {text}");
        }
        assert!(!text.contains("/Font"), "letters are outlines");
        let without = svg_to_pdf(&svg.replace(">mm<", "> <")).unwrap();
        assert!(bytes.len() > without.len() + 100, "letters are there");
        assert!(matches!(svg_to_pdf("<svg"), Err(PdfError::Svg(_))));
    }
}
