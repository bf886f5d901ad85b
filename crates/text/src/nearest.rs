//! Spelling suggestions for "did you mean".

/// Shorter words occur in too many others.
const SHORTEST: usize = 3;

/// The first candidate that contains a word.
pub fn containing<'a>(word: &str, candidates: &[&'a str]) -> Option<&'a str> {
    let mut all = candidates.iter().filter(|c| c.contains(word));
    all.next().filter(|_| word.len() >= SHORTEST).copied()
}

/// The candidate that a misspelt word probably means: the first that contains it, or else the one
/// with the most similar spelling, if it is similar enough.
pub fn nearest<'a>(word: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let candidates: Vec<&str> = candidates.into_iter().collect();
    if let Some(whole) = containing(word, &candidates) {
        return Some(whole);
    }
    candidates
        .into_iter()
        .map(|c| (strsim::jaro_winkler(word, c), c))
        .filter(|(score, _)| *score > 0.75)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, c)| c)
}

/// The message for an unknown name of a `what`. Suggests the nearest name, and lists all.
pub fn unknown(what: &str, name: &str, known: &[&str]) -> String {
    let near = nearest(name, known.iter().copied())
        .map(|n| format!(" (did you mean `{n}`?)"))
        .unwrap_or_default();
    match known {
        [] => format!("there is no {what} `{name}`: there are none"),
        _ => format!(
            "there is no {what} `{name}`{near}; there are: {}",
            known.join(", ")
        ),
    }
}
