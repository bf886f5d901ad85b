//! Reports as HTML: one self-contained file each, without network access, readable without its
//! scripts.
//!
//! Data in, text out. [`explore`], [`verify`], [`plan`] and [`merged`] are the pages. `base.html` is the frame
//! of each, `variant.html` (filled by `section`) shows one variant with its pictures, and
//! `effects.html` shows the effects that the scene uses. `chart` and `range` draw figures, `diff`
//! shows shaders, and `words` puts contracts into words.

mod diff;
pub mod explore;
mod frontier_chart;
pub mod merged;
pub mod plan;
mod range;
mod section;
pub mod verify;
mod words;

pub use words::contract as promise;

use base64::Engine;

use super::contact_sheet;
use crate::measure::record::Picture;

/// Why a page could not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PageError {
    #[error("the report could not be written: {0}")]
    Template(#[from] askama::Error),
    #[error("a picture could not be encoded: {0}")]
    Picture(#[from] image::ImageError),
    #[error("the figures could not be written: {0}")]
    Json(#[from] serde_json::Error),
}

/// The parts of every page.
struct Shell {
    title: String,
    /// The conclusion.
    headline: String,
    /// Where and how it was measured.
    about: String,
    /// Further sentences for the reader.
    said: Vec<String>,
    /// The command that makes it again.
    command: String,
    /// Name of the file with the same data.
    file: &'static str,
    /// JSON with nothing in it that ends a script.
    data: String,
    /// Pictures that are shown more than once.
    gallery: Gallery,
}

/// Pictures shared by the page's parts, each embedded once as a background.
#[derive(Default)]
struct Gallery {
    pictures: Vec<Shared>,
    hashes: Vec<blake3::Hash>,
}

/// A picture of the gallery.
struct Shared {
    uri: String,
    size: [u32; 2],
}

impl Gallery {
    /// Number of a picture, which is added where it is not there yet.
    fn number(&mut self, picture: &Picture) -> Result<usize, PageError> {
        let hash = blake3::hash(&picture.rgba);
        if let Some(at) = self.hashes.iter().position(|h| *h == hash) {
            return Ok(at);
        }
        self.pictures.push(Shared {
            uri: data_uri(picture)?,
            size: picture.size,
        });
        self.hashes.push(hash);
        Ok(self.pictures.len() - 1)
    }
}

/// Widest picture of a page, in pixels. Larger ones are reduced by a whole factor; the full
/// pictures are in the same folder.
const WIDEST: u32 = 1280;

/// A picture as the text of a URL.
fn data_uri(picture: &Picture) -> Result<String, PageError> {
    let opaque = contact_sheet::opaque(picture.clone());
    let shown = match picture.size[0].div_ceil(WIDEST) {
        0 | 1 => opaque,
        factor => contact_sheet::reduce(&opaque, factor),
    };
    let bytes = shown.file("")?.bytes;
    let text = base64::engine::general_purpose::STANDARD.encode(bytes);
    Ok(format!("data:image/png;base64,{text}"))
}

fn data(figures: &impl serde::Serialize) -> Result<String, PageError> {
    Ok(serde_json::to_string(figures)?.replace('<', "\\u003c"))
}
