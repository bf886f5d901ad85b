//! A refusal as a note on the author's source.

use codespan_reporting::diagnostic::{Diagnostic, Label};
use codespan_reporting::term;
use preshade_plan::pass::Refusal;
use preshade_plan::plan::Plan;

use shader_text::excerpt::Excerpts;

/// The remedy for a refused step. `None`: the step had nothing to do.
pub fn remedy(refusal: &Refusal) -> Option<&str> {
    Some(refusal.remedy.as_str()).filter(|remedy| *remedy != "nothing to do")
}

/// The note, without a newline at its end.
pub fn rendered(refusal: &Refusal, plan: &Plan) -> String {
    let mut files = Excerpts::default();
    let mut labels = Vec::new();
    if let Some(at) = &refusal.location
        && let Some(file) = plan
            .programs
            .values()
            .flat_map(|p| p.sources().files())
            .find(|f| f.name == at.file)
    {
        let place = at.range.start as usize..at.range.end as usize;
        files.add(file.name.clone(), &file.text, std::slice::from_ref(&place));
        labels.push(Label::primary(0, files.place(0, place)));
    }
    let remedy = remedy(refusal).filter(|remedy| !remedy.is_empty());
    let remedy = remedy.map(|remedy| format!("to make it legal: {remedy}"));
    let diagnostic = Diagnostic::note()
        .with_code(format!("{}/{}", refusal.pass, refusal.code))
        .with_message(format!("does not apply: {}", refusal.reason))
        .with_labels(labels)
        .with_notes(remedy.into_iter().collect());
    let config = term::Config::default();
    term::emit_into_string(&config, &files, &diagnostic)
        .map_or_else(|_| refusal.to_string(), |s| s.trim_end().to_owned())
}
