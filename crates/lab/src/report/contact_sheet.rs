//! Overdraw as colours with a legend, and the contact sheet: original, variant, difference,
//! overdraw before and after.

use crate::measure::Shading;
use crate::measure::record::{DIFFERENCE_FACTOR, Picture, Pictures};

/// The ramp ends at this count at the least, so that pictures of small overdraw compare.
pub(crate) const LEAST_SCALE: f32 = 4.0;

/// Colours from little to much, lightness rising all the way, so that they read in grey too.
const RAMP: [[f32; 3]; 5] = [
    [38.0, 33.0, 92.0],
    [112.0, 45.0, 130.0],
    [196.0, 70.0, 102.0],
    [244.0, 144.0, 66.0],
    [253.0, 240.0, 176.0],
];

const UNCOVERED: [u8; 4] = [8, 8, 12, 255];
const PAPER: [u8; 4] = [24, 24, 28, 255];
const INK: [u8; 4] = [230, 230, 235, 255];

/// The colour of a count on a logarithmic ramp that ends at `scale`.
fn color(count: f32, scale: f32) -> [u8; 4] {
    if count <= 0.0 {
        return UNCOVERED;
    }
    let t = (count.max(1.0).log2() / scale.log2()).clamp(0.0, 1.0) * (RAMP.len() - 1) as f32;
    let i = (t as usize).min(RAMP.len() - 2);
    let f = t - i as f32;
    let channel = |c: usize| (RAMP[i][c] + f * (RAMP[i + 1][c] - RAMP[i][c])).round() as u8;
    [channel(0), channel(1), channel(2), 255]
}

/// The counts of a frame as a picture, averaged over a pixel's samples, with a legend in the lower
/// left corner.
pub(crate) fn overdraw(shading: &Shading, scale: f32) -> Picture {
    let samples = shading.counts.samples.max(1) as usize;
    let mut picture = Picture {
        size: shading.counts.size,
        rgba: shading
            .counts
            .values
            .chunks(samples)
            .flat_map(|pixel| color(pixel.iter().sum::<f32>() / samples as f32, scale))
            .collect(),
    };
    legend(&mut picture, scale);
    picture
}

/// Swatches for 1, 2, 4 and so on, each with its number.
fn legend(picture: &mut Picture, scale: f32) {
    let zoom = if picture.size[0] >= 480 { 2 } else { 1 };
    let cell = 8 * zoom;
    let mut counts = Vec::new();
    let mut n = 1.0;
    while n < scale {
        counts.push(n);
        n *= 2.0;
    }
    counts.push(scale);
    let labels: Vec<String> = counts.iter().map(|n| format!("{n:.0}")).collect();
    let width: u32 = labels
        .iter()
        .map(|l| cell + text_width(l, zoom) + cell)
        .sum();
    if width + cell > picture.size[0] || 3 * cell > picture.size[1] {
        return;
    }
    let y = picture.size[1] - cell - cell / 2;
    fill(picture, [0, y - cell / 2], [width + cell, 2 * cell], PAPER);
    let mut x = cell / 2;
    for (count, label) in counts.into_iter().zip(&labels) {
        fill(picture, [x, y], [cell, cell], color(count, scale));
        x += cell + cell / 4;
        text(picture, [x, y + zoom], label, zoom);
        x += text_width(label, zoom) + cell * 3 / 4;
    }
}

/// Widest panel of a contact sheet, in pixels; larger pictures are reduced by a whole factor.
const PANEL: u32 = 480;

/// Panels a row: the pictures above, the overdraw below.
const COLUMNS: u32 = 3;

/// All pictures of a variant on one sheet, labelled.
pub(crate) fn contact(pictures: &Pictures) -> Picture {
    let scale = pictures.overdraw_scale();
    let per_pixel = |s: &Shading| s.summary().per_pixel;
    let mut panels = vec![
        ("original".to_owned(), pictures.original.clone()),
        (pictures.name.clone(), pictures.variant.clone()),
        (
            format!("difference x{DIFFERENCE_FACTOR}"),
            pictures.difference.clone(),
        ),
    ];
    for (label, shading) in [
        ("overdraw before", &pictures.overdraw_before),
        ("overdraw after", &pictures.overdraw_after),
    ] {
        if let Some(shading) = shading {
            panels.push((
                format!("{label} {:.2}", per_pixel(shading)),
                overdraw(shading, scale),
            ));
        }
    }
    if let Some(worst) = &pictures.worst {
        panels.push((format!("worst: {}", worst.view), worst.variant.clone()));
        panels.push((
            format!("difference x{DIFFERENCE_FACTOR} there"),
            worst.difference.clone(),
        ));
    }
    laid_out(panels)
}

/// Panels of one size, labelled, [`COLUMNS`] a row.
fn laid_out(panels: Vec<(String, Picture)>) -> Picture {
    let widest = panels.first().map_or(1, |(_, p)| p.size[0]);
    let factor = widest.div_ceil(PANEL).max(1);
    let panels: Vec<(String, Picture)> = panels
        .into_iter()
        .map(|(label, p)| (label, reduce(&opaque(p), factor)))
        .collect();
    let zoom = 2;
    let [w, h] = panels.first().map_or([1, 1], |(_, p)| p.size);
    let panels: Vec<(Vec<String>, Picture)> = panels
        .into_iter()
        .map(|(label, p)| (wrap(&label, (w / text_width("m", zoom)) as usize), p))
        .collect();
    let most = panels.iter().map(|(lines, _)| lines.len()).max();
    let line = (GLYPH[1] + 2) * zoom;
    let (gap, header) = (8, most.unwrap_or(1) as u32 * line + 8);
    let rows = (panels.len() as u32).div_ceil(COLUMNS);
    let size = [COLUMNS * w + (COLUMNS + 1) * gap, rows * (h + header) + gap];
    let mut sheet = Picture::filled(size, PAPER);
    for (i, (label, panel)) in (0..).zip(&panels) {
        let (x, y) = (gap + i % COLUMNS * (w + gap), i / COLUMNS * (h + header));
        paste(&mut sheet, [x, y + header], panel);
        for (row, words) in (0..).zip(label) {
            text(&mut sheet, [x, y + 6 + row * line], words, zoom);
        }
    }
    sheet
}

/// A label in lines of at most `width` characters. Breaks after a comma, a colon or a space if
/// possible.
fn wrap(label: &str, width: usize) -> Vec<String> {
    let mut rest: Vec<char> = label.chars().collect();
    let mut lines = Vec::new();
    let width = width.max(1);
    while rest.len() > width {
        let seam = rest[..width].iter().rposition(|c| ",: ".contains(*c));
        let tail = rest.split_off(seam.map_or(width, |at| at + 1));
        lines.push(rest.iter().collect());
        rest = tail;
    }
    lines.push(rest.iter().collect());
    lines
}

/// Original, variant and difference of each, a row each, labelled.
pub(crate) fn rows(variants: &[(String, &Pictures)]) -> Picture {
    let mut panels = Vec::new();
    for (label, pictures) in variants {
        let difference = format!("difference x{DIFFERENCE_FACTOR}");
        panels.push(("original".to_owned(), pictures.original.clone()));
        panels.push((label.clone(), pictures.variant.clone()));
        panels.push((difference, pictures.difference.clone()));
    }
    laid_out(panels)
}

/// Alpha is data, not coverage. The picture is opaque.
pub(super) fn opaque(mut picture: Picture) -> Picture {
    for texel in picture.rgba.as_chunks_mut::<4>().0 {
        texel[3] = 255;
    }
    picture
}

/// Averages squares of `factor` pixels.
pub(super) fn reduce(picture: &Picture, factor: u32) -> Picture {
    let [w, h] = picture.size;
    let size = [w / factor, h / factor];
    let mut rgba = Vec::with_capacity((size[0] * size[1] * 4) as usize);
    for y in 0..size[1] {
        for x in 0..size[0] {
            for c in 0..4 {
                let mut sum = 0;
                for dy in 0..factor {
                    for dx in 0..factor {
                        let at = ((y * factor + dy) * w + x * factor + dx) * 4 + c;
                        sum += u32::from(picture.rgba.get(at as usize).copied().unwrap_or(0));
                    }
                }
                rgba.push((sum / (factor * factor)) as u8);
            }
        }
    }
    Picture { size, rgba }
}

fn paste(onto: &mut Picture, [x, y]: [u32; 2], panel: &Picture) {
    for row in 0..panel.size[1] {
        let from = (row * panel.size[0] * 4) as usize;
        let to = (((y + row) * onto.size[0] + x) * 4) as usize;
        let n = (panel.size[0] * 4) as usize;
        onto.rgba[to..to + n].copy_from_slice(&panel.rgba[from..from + n]);
    }
}

fn fill(picture: &mut Picture, [x, y]: [u32; 2], [w, h]: [u32; 2], color: [u8; 4]) {
    for py in y..(y + h).min(picture.size[1]) {
        for px in x..(x + w).min(picture.size[0]) {
            let at = ((py * picture.size[0] + px) * 4) as usize;
            picture.rgba[at..at + 4].copy_from_slice(&color);
        }
    }
}

/// Width and height of a glyph, without the gap to the next.
const GLYPH: [u32; 2] = [3, 5];

fn text_width(text: &str, zoom: u32) -> u32 {
    text.chars().count() as u32 * (GLYPH[0] + 1) * zoom
}

fn text(picture: &mut Picture, [x, y]: [u32; 2], text: &str, zoom: u32) {
    for (i, c) in text.chars().enumerate() {
        let left = x + i as u32 * (GLYPH[0] + 1) * zoom;
        for (row, digit) in glyph(c).bytes().enumerate() {
            for column in 0..GLYPH[0] {
                if (digit - b'0') >> (GLYPH[0] - 1 - column) & 1 == 1 {
                    let at = [left + column * zoom, y + row as u32 * zoom];
                    fill(picture, at, [zoom, zoom], INK);
                }
            }
        }
    }
}

/// Five rows of three dots, an octal digit a row. Letters have one case.
fn glyph(c: char) -> &'static str {
    match c.to_ascii_lowercase() {
        '0' => "75557",
        '1' => "26227",
        '2' => "71747",
        '3' => "71317",
        '4' => "55711",
        '5' => "74717",
        '6' => "74757",
        '7' => "71222",
        '8' => "75757",
        '9' => "75717",
        'a' => "25755",
        'b' => "65656",
        'c' => "34443",
        'd' => "65556",
        'e' => "74647",
        'f' => "74644",
        'g' => "34553",
        'h' => "55755",
        'i' => "72227",
        'j' => "11152",
        'k' => "55655",
        'l' => "44447",
        'm' => "57755",
        'n' => "65555",
        'o' => "25552",
        'p' => "65644",
        'q' => "25563",
        'r' => "65655",
        's' => "34216",
        't' => "72222",
        'u' => "55557",
        'v' => "55552",
        'w' => "55775",
        'x' => "55255",
        'y' => "55222",
        'z' => "71247",
        '.' => "00002",
        ',' => "00024",
        ':' => "02020",
        '-' => "00700",
        '=' => "07070",
        '+' => "02720",
        '/' => "11244",
        '_' => "00007",
        _ => "00000",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use preshade_draw::render::DepthImage;

    fn shading(values: Vec<f32>, size: [u32; 2], samples: u32) -> Shading {
        Shading {
            fragments: 0,
            covered: 0,
            counts: DepthImage {
                size,
                samples,
                values,
            },
        }
    }

    fn lightness([r, g, b, _]: [u8; 4]) -> f32 {
        0.2126 * f32::from(r) + 0.7152 * f32::from(g) + 0.0722 * f32::from(b)
    }

    #[test]
    fn more_overdraw_is_lighter() {
        let shades: Vec<f32> = (0..=20).map(|n| lightness(color(n as f32, 20.0))).collect();
        assert!(shades.windows(2).all(|w| w[0] < w[1]), "{shades:?}");
    }

    #[test]
    fn samples_of_a_pixel_are_averaged() {
        let picture = overdraw(&shading(vec![4.0, 0.0, 1.0, 1.0], [2, 1], 2), 4.0);
        assert_eq!(picture.rgba[..4], color(2.0, 4.0));
        assert_eq!(picture.rgba[4..], color(1.0, 4.0));
    }

    #[test]
    fn a_large_picture_gets_a_legend_and_a_small_one_does_not() {
        let large = overdraw(&shading(vec![0.0; 200 * 40], [200, 40], 1), 8.0);
        assert!(large.rgba.as_chunks::<4>().0.contains(&INK));
        let small = overdraw(&shading(vec![0.0; 16 * 16], [16, 16], 1), 8.0);
        assert!(!small.rgba.as_chunks::<4>().0.contains(&INK));
    }

    #[test]
    fn a_long_label_is_broken_and_nothing_of_it_is_lost() {
        let name = "hoist:budget=1,finite=assumed,threshold=1 + tessellate:form=shared,level=3";
        for width in [1, 10, 28, 60, 200] {
            let lines = wrap(name, width);
            assert!(
                lines.iter().all(|l| l.chars().count() <= width),
                "{lines:?}"
            );
            assert_eq!(lines.concat(), name);
        }
        assert_eq!(
            wrap(name, 28)[..2],
            ["hoist:budget=1,", "finite=assumed,threshold=1 "]
        );
    }

    #[test]
    fn reducing_averages() {
        let mut picture = Picture::filled([4, 2], [0, 0, 0, 255]);
        fill(&mut picture, [0, 0], [1, 2], [200, 100, 0, 255]);
        let half = reduce(&picture, 2);
        assert_eq!(half.size, [2, 1]);
        assert_eq!(half.rgba, [100, 50, 0, 255, 0, 0, 0, 255]);
    }
}
