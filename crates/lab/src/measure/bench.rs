//! Draws plans together with the original, view by view: compares and times them.

use super::unsteady::Original;
use super::{Clock, Error, Session, Subject, Timing, TimingSettings, View, time};
use preshade_draw::render::Rendered;
use preshade_draw::scene::Frame;

/// A frame in the comparison. The original is the first.
pub(crate) trait Contestant<'a> {
    fn subject(&mut self) -> &mut Subject<'a>;

    /// Holds its picture of a view against the original's.
    fn hold(
        &mut self,
        view: (&View, &Frame),
        original: &Original,
        picture: &Rendered,
    ) -> Result<(), Error>;

    /// Its frame is aimed at a view.
    fn aimed(&mut self, _view: &View) {}

    /// Removes it from the comparison.
    fn quit(&mut self, error: &Error) {
        self.subject().quit(error);
    }

    /// Draws it no more, unless the adapter is lost.
    fn give_up(&mut self, error: Error) -> Result<(), Error> {
        if error.is_lost() {
            return Err(error);
        }
        self.quit(&error);
        Ok(())
    }
}

/// Whether the original is drawn twice: an adapter that does not repeat itself proves nothing.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Repeat {
    Always,
    /// Only before a variant is blamed.
    BeforeBlame,
}

/// Draws a view with all, and compares each picture with the original's. Returns the original's
/// picture. A contestant that cannot be drawn is removed.
///
/// # Errors
/// The original cannot be drawn, or the adapter is lost.
pub(crate) fn compare<'a>(
    contestants: &mut [impl Contestant<'a>],
    (view, frame): (&View, &Frame),
    repeat: Repeat,
) -> Result<Option<Original>, Error> {
    let [original, others @ ..] = contestants else {
        return Ok(None);
    };
    let Some(reference) = original.subject().draw(frame, view.order)? else {
        return Ok(None);
    };
    let mut first = Original::new(reference, original.subject().session().scene());
    if repeat == Repeat::Always
        && let Some(again) = original.subject().draw(frame, view.order)?
    {
        let again = first.repeated(again);
        original.hold((view, frame), &first, &again)?;
    }
    for other in others {
        let drawn = other.subject().draw(frame, view.order);
        other.aimed(view);
        let held = drawn.and_then(|picture| {
            let Some(picture) = picture else {
                return Ok(());
            };
            let (own, blamed) = (original.subject(), other.subject());
            let picture = first.of_variant(own, blamed, (view, frame), picture)?;
            other.hold((view, frame), &first, &picture)
        });
        if let Err(error) = held {
            other.give_up(error)?;
        }
    }
    Ok(Some(first))
}

/// Times a view with all that stand; `None` of the others. One that cannot be drawn is drawn no more.
///
/// # Errors
/// The original cannot be drawn, or the adapter is lost.
pub(crate) fn race<'a>(
    session: &Session<'_>,
    contestants: &mut [impl Contestant<'a>],
    (view, frame): (&View, &Frame),
    settings: &TimingSettings,
    tick: impl FnMut(f64),
) -> Result<(Clock, Vec<Option<Timing>>), Error> {
    session.inputs().set_frame(frame)?;
    // The fallback of a plan whose guard fails here may not build.
    for (index, contestant) in contestants.iter_mut().enumerate() {
        if let Err(error) = contestant.subject().aimed(frame, view.order) {
            match index {
                0 => return Err(error),
                _ => contestant.give_up(error)?,
            }
        }
    }
    let (mut ready, mut is_ready) = (Vec::new(), Vec::new());
    for contestant in contestants {
        let prepared = contestant.subject().aimed(frame, view.order)?;
        is_ready.push(prepared.is_some());
        ready.extend(prepared);
    }
    let (clock, timings) = time(session.gpu(), &ready, settings, tick)?;
    let mut timings = timings.into_iter();
    let of = |is_ready: bool| if is_ready { timings.next() } else { None };
    Ok((clock, is_ready.into_iter().map(of).collect()))
}
