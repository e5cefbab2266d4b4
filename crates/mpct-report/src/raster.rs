//! SVG pictures as PNG. Text is drawn with DejaVu Sans, which is part of the command: no font need be installed.

use resvg::tiny_skia::{Color, Pixmap, Transform};
use resvg::usvg::{Options, Tree};
use std::path::Path;

/// Pixels per unit of the picture: sharp on paper and on dense screens.
const SCALE: f32 = 2.0;
/// Pixels of the largest picture; four bytes each are held in memory.
const MAX_PIXELS: f32 = 6.4e7;
const FONT: &str = "DejaVu Sans";

/// How a picture is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Lines and text.
    Svg,
    /// Pixels.
    Png,
}

impl Format {
    /// By the end of the file's name; a name without one means SVG. The message names the ends that are known.
    pub fn of(path: &Path) -> Result<Self, String> {
        let end = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        match end.as_deref() {
            None | Some("svg") => Ok(Self::Svg),
            Some("png") => Ok(Self::Png),
            Some(other) => Err(format!(
                "cannot draw {}: pictures end in .svg or .png, not in .{other}",
                path.display()
            )),
        }
    }

    /// The bytes of an SVG picture in this format.
    pub fn encode(self, svg: &str) -> Result<Vec<u8>, String> {
        match self {
            Self::Svg => Ok(svg.as_bytes().to_vec()),
            Self::Png => png(svg),
        }
    }
}

/// The picture as PNG on a white ground.
pub fn png(svg: &str) -> Result<Vec<u8>, String> {
    let mut options = Options {
        font_family: FONT.into(),
        ..Options::default()
    };
    let fonts = options.fontdb_mut();
    fonts.load_font_data(dejavu::sans::regular().to_vec());
    fonts.load_font_data(dejavu::sans::bold().to_vec());
    fonts.set_sans_serif_family(FONT);
    let tree = Tree::from_str(&plain_style(svg), &options).map_err(|e| e.to_string())?;
    let size = tree.size();
    let scale = SCALE.min((MAX_PIXELS / (size.width() * size.height())).sqrt());
    let pixels = |v: f32| (v * scale).ceil().max(1.0) as u32;
    let mut map = Pixmap::new(pixels(size.width()), pixels(size.height()))
        .ok_or_else(|| format!("a picture of {size:?} has no pixels"))?;
    map.fill(Color::WHITE);
    resvg::render(
        &tree,
        Transform::from_scale(scale, scale),
        &mut map.as_mut(),
    );
    map.encode_png().map_err(|e| e.to_string())
}

/// The picture with its style sheet reduced to what the renderer knows: the variables of the light page are put in, and
/// the sheets for dark and printed pages are left out.
fn plain_style(svg: &str) -> String {
    let Some((head, rest)) = svg.split_once("<style>") else {
        return svg.into();
    };
    let Some((style, tail)) = rest.split_once("</style>") else {
        return svg.into();
    };
    format!("{head}<style>{}</style>{tail}", plain_rules(style))
}

fn plain_rules(style: &str) -> String {
    let mut variables: Vec<(&str, &str)> = Vec::new();
    let mut out = String::new();
    let mut rest = style;
    while let Some((selector, after)) = rest.split_once('{') {
        let selector = selector.trim();
        let length = block_length(after);
        let (body, tail) = after.split_at(length);
        rest = tail.strip_prefix('}').unwrap_or(tail);
        if selector == ":root" {
            variables = body
                .split(';')
                .filter_map(|d| d.split_once(':'))
                .map(|(name, value)| (name.trim(), value.trim()))
                .filter(|(name, _)| name.starts_with("--"))
                .collect();
        } else if selector.starts_with("svg") {
            out.push_str(&format!("{selector}{{{body}}}\n"));
        }
    }
    for (name, value) in variables {
        out = out.replace(&format!("var({name})"), value);
    }
    out
}

/// Where the block that was opened ends.
fn block_length(text: &str) -> usize {
    let mut depth = 1;
    for (i, c) in text.char_indices() {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            _ => {}
        }
        if depth == 0 {
            return i;
        }
    }
    text.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pixels(svg: &str) -> Pixmap {
        Pixmap::decode_png(&png(svg).expect("PNG")).expect("a picture")
    }

    fn dark(map: &Pixmap) -> usize {
        map.pixels().iter().filter(|p| p.red() < 128).count()
    }

    #[test]
    fn text_is_drawn_without_fonts_of_the_system() {
        let with = |text: &str| {
            dark(&pixels(&format!(
                r#"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 200 40"><style>svg text {{ font: 20px system-ui, sans-serif; fill: #000; }}</style><text x="5" y="28">{text}</text></svg>"#
            )))
        };
        assert_eq!(with(""), 0);
        // Every letter that reports use has a glyph of its own: none is drawn as the box of a missing one.
        let box_of_missing = with("\u{10ffff}");
        let mut widths = Vec::new();
        for c in ["x", "λ", "≤", "−", "θ", "⁻", "µ", "γ", "²", "|"] {
            let drawn = with(c);
            assert!(drawn > 0 && drawn != box_of_missing, "{c}");
            widths.push(drawn);
        }
        widths.dedup();
        assert!(widths.len() > 6, "{widths:?}");
    }

    #[test]
    fn variables_of_the_light_page_are_used() {
        let svg = r#"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 10 10"><style>:root { --a: #00f; }
@media print { :root { --a: #0f0; } svg .b { fill: #f00; } }
svg .b { fill: var(--a); }</style><rect class="b" width="10" height="10"/></svg>"#;
        let map = pixels(svg);
        assert_eq!((map.width(), map.height()), (20, 20));
        let p = map.pixel(10, 10).expect("a pixel");
        assert_eq!((p.red(), p.green(), p.blue()), (0, 0, 255));
    }

    #[test]
    fn the_end_of_the_name_decides() {
        assert_eq!(Format::of(Path::new("a.PNG")), Ok(Format::Png));
        assert_eq!(Format::of(Path::new("pipe")), Ok(Format::Svg));
        assert!(Format::of(Path::new("a.jpg")).is_err_and(|m| m.contains(".png")));
    }
}
