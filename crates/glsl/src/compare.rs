//! Compares both readers while one replaces the other.

use std::hash::{DefaultHasher, Hash as _, Hasher as _};

use naga::Module;
use naga::valid::{Capabilities, ValidationFlags, Validator};
use preshade_ir::declared::Declared;

use super::Text;
use preshade_text::error::Error;

type Read = Result<(Vec<Module>, Declared), Error>;

fn shown(read: &Read) -> String {
    match read {
        Err(e) => format!("error {:?}: {e}\n{e:?}", e.code()),
        Ok((modules, declared)) => {
            let mut out = String::new();
            for module in modules {
                let mut module = module.clone();
                for (i, e) in module.entry_points.iter_mut().enumerate() {
                    out += &format!("// {i} {:?} {:?}\n", e.stage, e.early_depth_test);
                    e.early_depth_test = None;
                }
                match Validator::new(ValidationFlags::all(), Capabilities::all()).validate(&module)
                {
                    Err(e) => out += &format!("invalid: {e:?}\n"),
                    Ok(info) => {
                        let flags = naga::back::wgsl::WriterFlags::empty();
                        match naga::back::wgsl::write_string(&module, &info, flags) {
                            Ok(text) => out += &text,
                            Err(e) => out += &format!("unwritten: {e:?} {module:?}\n"),
                        }
                    }
                }
            }
            let mut declared = declared.clone();
            declared.mains.clear();
            out + &format!("{declared:#?}")
        }
    }
}

/// With the names of temporaries in the order of their first use.
fn normalised(text: &str) -> String {
    let mut seen: std::collections::HashMap<String, usize> = std::collections::HashMap::new();
    let mut out = String::new();
    let mut rest = text;
    while let Some(at) = rest.find("_e") {
        let digits = rest[at + 2..]
            .bytes()
            .take_while(u8::is_ascii_digit)
            .count();
        out += &rest[..at];
        let word = &rest[at..at + 2 + digits];
        let is_word = |c: Option<char>| c.is_some_and(|c| c.is_alphanumeric() || c == '_');
        let apart =
            !is_word(out.chars().last()) && !is_word(rest[at + 2 + digits..].chars().next());
        match if apart { digits } else { 0 } {
            0 => out += word,
            _ => {
                let next = seen.len();
                let n = *seen.entry(word.to_owned()).or_insert(next);
                out += &format!("_t{n}");
            }
        }
        rest = &rest[at + 2 + digits..];
    }
    out + rest
}

pub(super) fn compare(
    texts: &[Text<'_>],
    clip: Option<preshade_text::options::ClipSpace>,
    olds: [&Read; 2],
    new: &Read,
) {
    let [routed, old] = olds;
    let mut hasher = DefaultHasher::new();
    for text in texts {
        text.text.hash(&mut hasher);
    }
    format!("{clip:?}").hash(&mut hasher);
    let (r, a, b) = (shown(routed), shown(old), shown(new));
    let into = std::env::var("GLSL_COMPARE").unwrap_or_default();
    let base = format!("{:016x}", hasher.finish());
    let write = |kind: &str, ending: &str, text: &str| {
        let dir = format!("{into}/{kind}");
        let _ = std::fs::create_dir_all(&dir);
        let _ = std::fs::write(format!("{dir}/{base}.{ending}"), text);
    };
    let mut source = format!("{clip:?}");
    for text in texts {
        source += &format!("\u{1}{}\u{1}{:?}\u{1}{}", text.name, text.stage, text.text);
    }
    write("corpus", "glsl", &source);
    let judged = |prefix: &str, old: &Read, a: &str| {
        let kind = match (a == b, normalised(a) == normalised(&b), old, new) {
            (true, ..) => "same",
            (_, true, ..) => "numbers",
            (_, _, Ok(_), Ok(_)) => "differ",
            (_, _, Err(_), Err(_)) => "errors",
            (_, _, Ok(_), Err(_)) => "refused",
            (_, _, Err(_), Ok(_)) => "accepted",
        };
        let kind = format!("{prefix}{kind}");
        write(&kind, "glsl", &source.replace('\u{1}', "\n"));
        if !kind.ends_with("same") {
            write(&kind, "old", &normalised(a));
            write(&kind, "new", &normalised(&b));
        }
    };
    judged("", old, &a);
    if r != a {
        judged("routed-", routed, &r);
    }
}

#[cfg(test)]
mod tests {
    use std::panic::{AssertUnwindSafe, catch_unwind};

    use super::*;
    use crate as glsl;
    use preshade_text::options::{ClipSpace, Options};

    #[test]
    fn corpus() {
        let Ok(dir) = std::env::var("GLSL_CORPUS") else {
            return;
        };
        let mut count = 0;
        for entry in std::fs::read_dir(dir).unwrap() {
            let Ok(text) = std::fs::read_to_string(entry.unwrap().path()) else {
                continue;
            };
            let mut parts = text.split('\u{1}');
            let clip = match parts.next() {
                Some("Some(OpenGl)") => Some(ClipSpace::OpenGl),
                Some("Some(AsWritten)") => Some(ClipSpace::AsWritten),
                _ => None,
            };
            let parts: Vec<&str> = parts.collect();
            let texts: Vec<Text<'_>> = parts
                .chunks_exact(3)
                .map(|of| Text {
                    name: of[0],
                    text: of[2],
                    stage: match of[1] {
                        "Vertex" => naga::ShaderStage::Vertex,
                        _ => naga::ShaderStage::Fragment,
                    },
                    base: 0,
                })
                .collect();
            let options = Options {
                clip_space: clip,
                ..Options::default()
            };
            count += 1;
            let read = catch_unwind(AssertUnwindSafe(|| {
                glsl::compared(&texts, &options, &mut Default::default())
            }));
            if read.is_err() {
                println!("panic: {text}");
            }
        }
        println!("{count} texts");
    }
}
