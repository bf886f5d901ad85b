//! GLSL versions.

use std::collections::HashSet;
use std::path::Path;

use glsl_lang::lexer::Token;

use shader_text::tokens::without_comments;

const BLOCKS: &str = "GL_ARB_shader_storage_buffer_object";
const IMAGES: &str = "GL_ARB_shader_image_load_store";

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Dialect {
    /// 100 to 460. See [`Dialect::of`] for a text without `#version`.
    pub version: u16,
    pub es: bool,
}

impl Dialect {
    /// Reads `#version`. Without one, WebGL assumes GLSL ES 1.00 and OpenGL GLSL 1.10; both are
    /// parsed alike.
    pub(super) fn of(text: &str, path: &Path) -> Self {
        let text = without_comments(text);
        let line = text
            .lines()
            .map(str::trim)
            .find_map(|l| l.strip_prefix('#')?.trim_start().strip_prefix("version"));
        let mut words = line.unwrap_or("").split_whitespace();
        let version = words
            .next()
            .and_then(|v| v.parse().ok())
            // RetroArch's shaders may have it in an included file.
            .unwrap_or(match path.extension().is_some_and(|e| e == "slang") {
                true => 450,
                false => 110,
            });
        let es = version == 100 || words.next() == Some("es");
        Self { version, es }
    }

    /// The name of a token that is a keyword only in later versions, or only with an extension that
    /// is not in `extensions`.
    pub(super) fn name(self, token: &Token, extensions: &HashSet<String>) -> Option<&'static str> {
        let before = |es: u16, desktop: u16| self.version < if self.es { es } else { desktop };
        let (name, is_name) = match token {
            Token::Sample => ("sample", before(320, 400)),
            Token::Patch => ("patch", before(320, 400)),
            Token::Precise => ("precise", before(320, 400)),
            Token::Buffer => ("buffer", before(310, 430)),
            Token::Shared => ("shared", before(310, 430)),
            Token::Coherent => ("coherent", before(310, 420)),
            Token::Volatile => ("volatile", before(310, 420)),
            Token::Restrict => ("restrict", before(310, 420)),
            Token::ReadOnly => ("readonly", before(310, 420)),
            Token::WriteOnly => ("writeonly", before(310, 420)),
            Token::Subroutine => ("subroutine", before(320, 400)),
            Token::Smooth => ("smooth", before(300, 130)),
            Token::NoPerspective => ("noperspective", before(320, 130)),
            _ => return None,
        };
        let adding: &[&str] = match token {
            Token::Buffer => &[BLOCKS],
            Token::Coherent
            | Token::Volatile
            | Token::Restrict
            | Token::ReadOnly
            | Token::WriteOnly => &[BLOCKS, IMAGES],
            Token::Subroutine => &["GL_ARB_shader_subroutine"],
            _ => &[],
        };
        let is_name = is_name && !adding.iter().any(|e| extensions.contains(*e));
        is_name.then_some(name)
    }
}
