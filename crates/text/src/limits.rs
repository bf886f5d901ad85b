//! Limits on untrusted input. A shader or scene that exceeds one is refused before anything of that
//! size is allocated. The error names the limit.

use std::fmt;

/// One limit, for listings and for the command line.
struct Named {
    name: &'static str,
    what: &'static str,
    of: fn(&mut Limits) -> &mut u64,
    strict: u64,
    default: u64,
}

const NONE: u64 = u64::MAX;

const MIB: u64 = 1 << 20;

const NAMED: [Named; 15] = [
    Named {
        name: "source-bytes",
        what: "bytes of one shader with all that it includes",
        of: |l| &mut l.source_bytes,
        strict: 256 << 10,
        default: 4 * MIB,
    },
    Named {
        name: "nesting",
        what: "brackets open at once in a shader",
        of: |l| &mut l.nesting,
        strict: 64,
        default: 180,
    },
    Named {
        name: "statements",
        what: "statements and list values of one function",
        of: |l| &mut l.statements,
        strict: 5_000,
        default: 20_000,
    },
    Named {
        name: "expressions",
        what: "expressions of a material's module",
        of: |l| &mut l.expressions,
        strict: 20_000,
        default: 1_000_000,
    },
    Named {
        name: "array-elements",
        what: "elements of one type, arrays within arrays multiplied",
        of: |l| &mut l.array_elements,
        strict: 1 << 16,
        default: 1 << 24,
    },
    Named {
        name: "file-bytes",
        what: "bytes of one file that a scene names",
        of: |l| &mut l.file_bytes,
        strict: 32 * MIB,
        default: 1024 * MIB,
    },
    Named {
        name: "texture-size",
        what: "texels along a side of a texture",
        of: |l| &mut l.texture_size,
        strict: 2048,
        default: 8192,
    },
    Named {
        name: "vertices",
        what: "vertices of all meshes",
        of: |l| &mut l.vertices,
        strict: 1 << 20,
        default: 1 << 24,
    },
    Named {
        name: "copies",
        what: "copies of one field, and instances of one draw",
        of: |l| &mut l.copies,
        strict: 50_000,
        default: 4_000_000,
    },
    Named {
        name: "draws",
        what: "draws of a frame",
        of: |l| &mut l.draws,
        strict: 5_000,
        default: 200_000,
    },
    Named {
        name: "frames",
        what: "frames of all cameras",
        of: |l| &mut l.frames,
        strict: 1_000,
        default: 20_000,
    },
    Named {
        name: "pixels",
        what: "pixels of a target, times its samples, and of the shadow map",
        of: |l| &mut l.pixels,
        strict: 1 << 22,
        default: 1 << 26,
    },
    Named {
        name: "scene-bytes",
        what: "bytes of all vertex data, texels and draws",
        of: |l| &mut l.scene_bytes,
        strict: 256 * MIB,
        default: 8192 * MIB,
    },
    Named {
        name: "seconds",
        what: "seconds that one variant may take, in a process of its own",
        of: |l| &mut l.seconds,
        strict: 120,
        default: NONE,
    },
    Named {
        name: "memory",
        what: "bytes of memory of that process, where the system tells (Linux)",
        of: |l| &mut l.memory,
        strict: 4096 * MIB,
        default: NONE,
    },
];

/// The author of a device's shaders. It decides whether wgpu compiles run-time checks (of indices,
/// loops and divisions) into them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Trust {
    /// The user's own shaders: only the checks that they need to draw the same as in a browser. For
    /// some shaders, needless checks cost more than the measured transforms gain.
    #[default]
    Own,
    /// Somebody else's shaders: all checks, as in a browser. Indices are clamped, loops end, and x
    /// / 0 is x, as in WGSL.
    Strangers,
}

/// Limits by name. [`u64::MAX`] means no limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Bytes of one shader's text, with its included files.
    pub source_bytes: u64,
    /// Brackets open at once. Above 180, naga's parser fails or exhausts its stack.
    pub nesting: u64,
    /// Statements and list values of one function. naga's parser takes quadratic time in them.
    pub statements: u64,
    /// Expressions of a module, all functions together.
    pub expressions: u64,
    /// Elements of one type. An array of arrays counts the product.
    pub array_elements: u64,
    /// Bytes of one file that a scene names.
    pub file_bytes: u64,
    /// Width and height of a texture, in texels.
    pub texture_size: u64,
    /// Vertices of all meshes of a scene together, merged meshes included.
    pub vertices: u64,
    /// Copies of one field, and instances of one draw.
    pub copies: u64,
    /// Draws of a frame.
    pub draws: u64,
    /// Frames of all cameras together, camera paths included.
    pub frames: u64,
    /// Pixels of the target times its samples, and of the light's shadow map.
    pub pixels: u64,
    /// Bytes of all vertex data, texels and draws.
    pub scene_bytes: u64,
    /// Seconds for one variant. With a limit, each variant is measured in a process of its own.
    pub seconds: u64,
    /// Bytes of memory of that process.
    pub memory: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Self::named(|n| n.default)
    }
}

/// A limit that was exceeded.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{what} would be {asked}; the limit `{limit}` is {most}")]
pub struct Exceeded {
    pub limit: &'static str,
    /// Name of the quantity that is too large.
    pub what: String,
    /// The requested size. [`u64::MAX`] means that or more.
    pub asked: u64,
    pub most: u64,
}

impl Exceeded {
    /// The command line flag that raises the limit.
    pub fn remedy(&self) -> String {
        format!("--limits {}=NUMBER allows more", self.limit)
    }
}

impl Limits {
    /// For input from strangers: enough for a material and a scene of some size, and each variant
    /// gets a process of its own.
    pub fn strict() -> Self {
        Self::named(|n| n.strict)
    }

    /// No limits except those of the languages and of WebGPU.
    pub fn none() -> Self {
        let mut all = Self::named(|_| NONE);
        // The stack limits recursion anyway.
        all.nesting = Self::default().nesting;
        all
    }

    fn named(value: impl Fn(&Named) -> u64) -> Self {
        let mut all = Self {
            source_bytes: 0,
            nesting: 0,
            statements: 0,
            expressions: 0,
            array_elements: 0,
            file_bytes: 0,
            texture_size: 0,
            vertices: 0,
            copies: 0,
            draws: 0,
            frames: 0,
            pixels: 0,
            scene_bytes: 0,
            seconds: 0,
            memory: 0,
        };
        for named in &NAMED {
            *(named.of)(&mut all) = value(named);
        }
        all
    }

    /// Reads `strict`, `vertices=100000`, or both, separated by commas, over the defaults. Numbers
    /// may end in k, M or G.
    ///
    /// # Errors
    /// An unknown name, or a value that is not a number, as a message.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut limits = Self::default();
        for part in text.split(',').map(str::trim).filter(|p| !p.is_empty()) {
            let Some((name, value)) = part.split_once('=') else {
                limits = match part {
                    "default" => Self::default(),
                    "strict" => Self::strict(),
                    "none" => Self::none(),
                    _ => {
                        return Err(format!(
                            "there are no limits `{part}`: default, strict or none, or NAME=NUMBER"
                        ));
                    }
                };
                continue;
            };
            let Some(named) = NAMED.iter().find(|n| n.name == name.trim()) else {
                let names: Vec<&str> = NAMED.iter().map(|n| n.name).collect();
                let near = crate::nearest::nearest(name.trim(), names.iter().copied())
                    .map_or(String::new(), |n| format!(" (did you mean `{n}`?)"));
                return Err(format!(
                    "there is no limit `{name}`{near}; there are: {}",
                    names.join(", ")
                ));
            };
            let most = number(value.trim()).ok_or_else(|| {
                format!("`{value}` is no whole number from 1, with k, M or G behind it or not")
            })?;
            if named.name == "nesting" && most > named.default {
                return Err(format!("nesting is {} at most", named.default));
            }
            *(named.of)(&mut limits) = most;
        }
        Ok(limits)
    }

    /// Whether each variant is measured in a process of its own.
    pub fn isolates(&self) -> bool {
        self.seconds != NONE || self.memory != NONE
    }

    /// The author of the shaders: a stranger, if variants are measured in processes of their own.
    pub fn trust(&self) -> crate::limits::Trust {
        match self.isolates() {
            true => crate::limits::Trust::Strangers,
            false => crate::limits::Trust::Own,
        }
    }

    /// A table of the limits with their descriptions and values, for listings.
    pub fn list() -> String {
        let shown = |n: u64| match n {
            NONE => "none".to_owned(),
            n => n.to_string(),
        };
        let mut lines = vec![format!("{:<16}{:>12}{:>12}", "", "default", "strict")];
        lines.extend(NAMED.iter().map(|n| {
            let (default, strict) = (shown(n.default), shown(n.strict));
            format!("{:<16}{default:>12}{strict:>12}  {}", n.name, n.what)
        }));
        lines.join("\n")
    }

    pub fn of(&self, limit: &'static str) -> u64 {
        let mut own = *self;
        let named = NAMED.iter().find(|n| n.name == limit);
        named.map_or(0, |n| *(n.of)(&mut own))
    }

    /// Whether no limit is looser than its default. Configuration files that are found
    /// automatically may not loosen limits.
    pub fn is_no_looser_than_default(&self) -> bool {
        let (mut own, mut default) = (*self, Self::default());
        NAMED
            .iter()
            .all(|n| *(n.of)(&mut own) <= *(n.of)(&mut default))
    }

    /// Fails if `asked` exceeds the named limit.
    pub fn check(
        &self,
        limit: &'static str,
        asked: u64,
        what: impl fmt::Display,
    ) -> Result<(), Exceeded> {
        let most = self.of(limit);
        if asked <= most {
            return Ok(());
        }
        Err(Exceeded {
            limit,
            what: what.to_string(),
            asked,
            most,
        })
    }
}

fn number(text: &str) -> Option<u64> {
    let (digits, unit) = match text.as_bytes().last()? {
        b'k' => (&text[..text.len() - 1], 1000),
        b'M' => (&text[..text.len() - 1], 1_000_000),
        b'G' => (&text[..text.len() - 1], 1_000_000_000),
        _ => (text, 1),
    };
    let n = digits.replace('_', "").parse::<u64>().ok()?;
    n.checked_mul(unit).filter(|n| *n > 0)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_set_and_what_differs_from_it_are_read() {
        assert_eq!(Limits::parse(""), Ok(Limits::default()));
        let limits = Limits::parse("strict, vertices=3M,seconds=7").unwrap();
        let expected = Limits {
            vertices: 3_000_000,
            seconds: 7,
            ..Limits::strict()
        };
        assert_eq!(limits, expected);
        assert!(limits.isolates() && !Limits::default().isolates());
        for (wrong, told) in [
            ("strikt", "there are no limits `strikt`"),
            ("vertexes=3", "did you mean `vertices`?"),
            ("vertices=many", "`many` is no whole number"),
            ("vertices=0", "`0` is no whole number"),
            ("vertices=99999999999999999999", "is no whole number"),
            ("vertices=99999999999999999G", "is no whole number"),
            ("nesting=5000", "nesting is 180 at most"),
        ] {
            let said = Limits::parse(wrong).unwrap_err();
            assert!(said.contains(told), "{wrong}: {said}");
        }
    }

    #[test]
    fn strict_is_nowhere_looser() {
        for n in &NAMED {
            assert!(n.strict <= n.default, "{}", n.name);
        }
    }
}
