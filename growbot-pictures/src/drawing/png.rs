//! A drawing as pixels. The fonts (growbot-pictures/fonts/) are part of the program, so every machine draws the same.

use std::sync::Arc;

use resvg::tiny_skia::{Pixmap, PremultipliedColorU8, Transform};
use resvg::usvg::{self, Options, Tree, fontdb};

const FONTS: [&[u8]; 2] =
    [include_bytes!("../../fonts/inter-regular.ttf"), include_bytes!("../../fonts/inter-semibold.ttf")];
const FAMILY: &str = "Inter";

/// A picture has no more pixels, for which there should be memory: four bytes each.
const MAX_PIXELS: u64 = 200_000_000;

/// Why there are no pixels.
#[derive(Debug, thiserror::Error)]
pub enum PngError {
    /// The drawing is none that can be read.
    #[error("the picture cannot be drawn as pixels: {0}; take it as SVG")]
    Svg(#[from] usvg::Error),
    /// More pixels than there should be memory for.
    #[error("a picture of {width} times {height} pixels is too large: ask for less with --width")]
    TooLarge {
        /// Pixels across.
        width: u32,
        /// Pixels up and down.
        height: u32,
    },
    /// The pixels could not be packed.
    #[error("the picture cannot be written as PNG: {0}; take it as SVG")]
    Encoding(String),
}

/// The picture of a drawing (SVG); `width` in pixels.
///
/// # Errors
/// [`PngError`].
pub fn png(svg: &str, width: u32) -> Result<Vec<u8>, PngError> {
    let tree = read(svg)?;
    let scale = width as f32 / tree.size().width();
    let height = (scale * tree.size().height()).round().max(1.0) as u32;
    let too_large = || PngError::TooLarge { width, height };
    if u64::from(width) * u64::from(height) > MAX_PIXELS {
        return Err(too_large());
    }
    let mut pixels = Pixmap::new(width, height).ok_or_else(too_large)?;
    resvg::render(&tree, Transform::from_scale(scale, scale), &mut pixels.as_mut());
    packed(&pixels).map_err(|error| PngError::Encoding(error.to_string()))
}

/// The shapes of a drawing, its letters too.
pub(super) fn read(svg: &str) -> Result<Tree, usvg::Error> {
    let mut fonts = fontdb::Database::new();
    FONTS.iter().for_each(|font| fonts.load_font_data(font.to_vec()));
    for family in [fontdb::Database::set_serif_family, fontdb::Database::set_sans_serif_family] {
        family(&mut fonts, FAMILY);
    }
    let options = Options { font_family: FAMILY.to_owned(), fontdb: Arc::new(fonts), ..Options::default() };
    Tree::from_str(svg, &options)
}

/// The pixels on white, in as few bytes as may be.
fn packed(pixels: &Pixmap) -> Result<Vec<u8>, png::EncodingError> {
    // Colours are multiplied with how opaque they are: what is left is white.
    let on_white = |pixel: &PremultipliedColorU8| {
        let left = 255 - pixel.alpha();
        [pixel.red() + left, pixel.green() + left, pixel.blue() + left]
    };
    let colours: Vec<[u8; 3]> = pixels.pixels().iter().map(on_white).collect();
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, pixels.width(), pixels.height());
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_compression(png::Compression::High);
    // Of faces of one colour this leaves the fewest bytes.
    encoder.set_filter(png::Filter::NoFilter);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(colours.as_flattened())?;
    writer.finish()?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Width, height and bytes of the picture of a text at this width in pixels.
    fn of_text(text: &str, width: u32) -> (u32, u32, Vec<u8>) {
        let svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 200 50\" width=\"200\" height=\"50\">\
             <text x=\"10\" y=\"30\" font-family=\"Inter, Arial\">{text}</text></svg>"
        );
        let pixels = Pixmap::decode_png(&png(&svg, width).unwrap()).unwrap();
        (pixels.width(), pixels.height(), pixels.data().to_vec())
    }

    #[test]
    fn letters_are_drawn_without_any_font_on_the_machine() {
        let (width, height, empty) = of_text("", 400);
        assert_eq!((width, height), (400, 100));
        assert!(empty.iter().all(|byte| *byte == 255));
        let (.., written) = of_text("0.77 mm, 12 \u{b0}", 400);
        assert!(written.iter().filter(|byte| **byte < 255).count() > 1000);
        assert_ne!(written, of_text("0.78 mm, 12 \u{b0}", 400).2);
    }

    #[test]
    fn what_is_no_drawing_is_an_error() {
        assert!(matches!(png("<svg", 100), Err(PngError::Svg(_))));
        let svg = "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"1\" height=\"1000000\"/>";
        assert!(matches!(png(svg, 1_000_000), Err(PngError::TooLarge { .. })));
    }
}
