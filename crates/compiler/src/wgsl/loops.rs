//! Restores `for` and `while` from naga's only loop:
//!
//! ```wgsl
//! loop {                          for (; i < 4i; i = i + 1i) {
//!     if (i < 4i) {                   sum = sum + f32(i);
//!     } else {                    }
//!         break;
//!     }
//!     {
//!         sum = sum + f32(i);
//!     }
//!     continuing {
//!         i = i + 1i;
//!     }
//! }
//! ```

const INDENT: &str = "    ";

/// Rewrites every such loop in a function's lines, which must have naga's indentation.
pub(crate) fn structured(mut lines: Vec<String>) -> Vec<String> {
    // Backwards: inner loops first.
    for at in (0..lines.len()).rev() {
        if lines[at].trim_start() == "loop {"
            && let Some(rewritten) = rewrite(&lines, at)
        {
            lines.splice(at..rewritten.end, rewritten.lines);
        }
    }
    lines
}

struct Rewritten {
    lines: Vec<String>,
    /// The first line after the loop.
    end: usize,
}

fn rewrite(lines: &[String], at: usize) -> Option<Rewritten> {
    let outer = &lines[at][..lines[at].len() - "loop {".len()];
    let inner = format!("{outer}{INDENT}");
    let is = |line: usize, indent: &str, text: &str| {
        lines
            .get(line)
            .and_then(|l| l.strip_prefix(indent))
            .is_some_and(|l| l == text)
    };
    let condition = lines
        .get(at + 1)?
        .strip_prefix(&inner)?
        .strip_prefix("if ")?
        .strip_suffix(" {")?;
    let head = is(at + 2, &inner, "} else {")
        && is(at + 3, &inner, "    break;")
        && is(at + 4, &inner, "}")
        && is(at + 5, &inner, "{");
    if !head {
        return None;
    }
    let close = (at + 6..lines.len()).find(|line| is(*line, &inner, "}"))?;
    let (head, end) = if is(close + 1, outer, "}") {
        (format!("{outer}while {condition} {{"), close + 2)
    } else if is(close + 1, &inner, "continuing {")
        && is(close + 3, &inner, "}")
        && is(close + 4, outer, "}")
    {
        let update = lines[close + 2].trim_start().strip_suffix(';')?;
        if update.starts_with("let ") || !update.contains(" = ") {
            return None;
        }
        let condition = bare(condition);
        (
            format!("{outer}for (; {condition}; {update}) {{"),
            close + 5,
        )
    } else {
        return None;
    };
    let mut rewritten = vec![head];
    for line in &lines[at + 6..close] {
        rewritten.push(line.strip_prefix(INDENT).unwrap_or(line).to_owned());
    }
    rewritten.push(format!("{outer}}}"));
    Some(Rewritten {
        lines: rewritten,
        end,
    })
}

/// Removes the parentheses of `(a < b)` if they enclose the whole text.
fn bare(condition: &str) -> &str {
    let Some(inner) = condition
        .strip_prefix('(')
        .and_then(|c| c.strip_suffix(')'))
    else {
        return condition;
    };
    let mut depth = 0i32;
    for c in inner.chars() {
        depth += match c {
            '(' => 1,
            ')' => -1,
            _ => 0,
        };
        if depth < 0 {
            return condition;
        }
    }
    inner
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(text: &str) -> Vec<String> {
        text.lines().map(str::to_owned).collect()
    }

    #[test]
    fn nested_loops_come_back() {
        let written = lines(
            "    loop {
        if (i < n) {
        } else {
            break;
        }
        {
            loop {
                if b {
                } else {
                    break;
                }
                {
                    f();
                }
            }
        }
        continuing {
            i = i + 1i;
        }
    }
    return;",
        );
        let authors = lines(
            "    for (; i < n; i = i + 1i) {
        while b {
            f();
        }
    }
    return;",
        );
        assert_eq!(structured(written), authors);
    }

    #[test]
    fn other_loops_stay() {
        let written =
            lines("    loop {\n        if (i < n) {\n            break;\n        }\n    }");
        assert_eq!(structured(written.clone()), written);
    }
}
