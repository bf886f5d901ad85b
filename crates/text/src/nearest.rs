//! Spelling suggestions for "did you mean".

/// A shorter word is a part of too many others.
const SHORTEST: usize = 3;

/// The first candidate that a word is a part of.
pub fn containing<'a>(word: &str, candidates: &[&'a str]) -> Option<&'a str> {
    let mut all = candidates.iter().filter(|c| c.contains(word));
    all.next().filter(|_| word.len() >= SHORTEST).copied()
}

/// The candidate that is meant by a misspelt word: the first that contains it, or the one with the
/// most similar spelling, if one is similar enough to suggest.
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

/// A message: there is no `what` of that name. It suggests the nearest name, and lists all.
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
