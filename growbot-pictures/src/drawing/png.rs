//! Conversion of a drawing to pixels. The fonts (growbot-pictures/fonts/) are part of the program, so all machines draw
//! alike.

use std::sync::Arc;

use resvg::tiny_skia::{Pixmap, PremultipliedColorU8, Transform};
use resvg::usvg::{self, Options, Tree, fontdb};

const FONTS: [&[u8]; 2] =
    [include_bytes!("../../fonts/inter-regular.ttf"), include_bytes!("../../fonts/inter-semibold.ttf")];
const FAMILY: &str = "Inter";

/// Greatest number of pixels of a picture. It limits the memory, because each pixel takes four bytes.
const MAX_PIXELS: u64 = 200_000_000;

/// Error of the conversion to pixels.
#[derive(Debug, thiserror::Error)]
pub enum PngError {
    /// The drawing is not valid SVG.
    #[error("cannot draw the picture as pixels: {0}; write the picture as SVG")]
    Svg(#[from] usvg::Error),
    /// The picture would have too many pixels.
    #[error("a picture of {width} times {height} pixels is too large")]
    TooLarge {
        /// Width, pixels.
        width: u32,
        /// Height, pixels.
        height: u32,
    },
    /// Encoding of the pixels failed.
    #[error("cannot write the picture as PNG: {0}; write the picture as SVG")]
    Encoding(#[from] png::EncodingError),
}

/// Converts a drawing (SVG) to PNG. `width` is the width of the picture in pixels.
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
    Ok(packed(&pixels)?)
}

/// Parses a drawing (SVG) with the built-in fonts, and converts its letters to shapes.
pub(super) fn read(svg: &str) -> Result<Tree, usvg::Error> {
    let mut fonts = fontdb::Database::new();
    FONTS.iter().for_each(|font| fonts.load_font_data(font.to_vec()));
    for family in [fontdb::Database::set_serif_family, fontdb::Database::set_sans_serif_family] {
        family(&mut fonts, FAMILY);
    }
    let options = Options { font_family: FAMILY.to_owned(), fontdb: Arc::new(fonts), ..Options::default() };
    Tree::from_str(svg, &options)
}

/// Encodes the pixels on a white background as PNG, in as few bytes as possible.
fn packed(pixels: &Pixmap) -> Result<Vec<u8>, png::EncodingError> {
    // Colours are premultiplied with their opacity, and the rest is white.
    let on_white = |pixel: &PremultipliedColorU8| {
        let left = 255 - pixel.alpha();
        [pixel.red() + left, pixel.green() + left, pixel.blue() + left]
    };
    let colours: Vec<[u8; 3]> = pixels.pixels().iter().map(on_white).collect();
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, pixels.width(), pixels.height());
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_compression(png::Compression::High);
    // This filter needs the fewest bytes for faces of one colour.
    encoder.set_filter(png::Filter::NoFilter);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(colours.as_flattened())?;
    writer.finish()?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns width, height and bytes of the picture of a text at this width in pixels.
    fn of_text(text: &str, width: u32) -> (u32, u32, Vec<u8>) {
        let svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 200 50\" width=\"200\" height=\"50\">\
             <text x=\"10\" y=\"30\" font-family=\"Inter, Arial\">{text}</text></svg>"
        );
        let pixels = Pixmap::decode_png(&png(&svg, width).unwrap()).unwrap();
        (pixels.width(), pixels.height(), pixels.data().to_vec())
    }

    #[test]
    fn letters_are_drawn_without_installed_fonts() {
        let (width, height, empty) = of_text("", 400);
        assert_eq!((width, height), (400, 100));
        assert!(empty.iter().all(|byte| *byte == 255));
        let (.., written) = of_text("0.77 mm, 12 \u{b0}", 400);
        assert!(written.iter().filter(|byte| **byte < 255).count() > 1000);
        assert_ne!(written, of_text("0.78 mm, 12 \u{b0}", 400).2);
    }

    #[test]
    fn invalid_drawings_are_errors() {
        assert!(matches!(png("<svg", 100), Err(PngError::Svg(_))));
        let svg = "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"1\" height=\"1000000\"/>";
        assert!(matches!(png(svg, 1_000_000), Err(PngError::TooLarge { .. })));
    }
}
