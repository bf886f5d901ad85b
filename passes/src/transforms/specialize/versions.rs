//! Creates a version of a function for each combination of known arguments.

use naga::{Function, Handle};

use super::fold::Folder;
use super::known::AbstractValue;
use preshade_dataflow::graph::FunctionId;

/// Most versions of one function. Further calls use the version without known arguments.
const MOST_VERSIONS: usize = 24;

/// A function with the abstract values of its arguments.
pub struct Version {
    arguments: Vec<AbstractValue>,
    function: Handle<Function>,
    result: AbstractValue,
}

impl<'p> Folder<'p> {
    /// The version of a function for a call's arguments, and the abstract value of its result.
    pub(super) fn version(
        &mut self,
        callee: Handle<Function>,
        arguments: Vec<AbstractValue>,
    ) -> (Handle<Function>, AbstractValue) {
        let arguments: Vec<AbstractValue> =
            arguments.into_iter().map(AbstractValue::settled).collect();
        let unknown = || vec![AbstractValue::Unknown; arguments.len()];
        let find = |versions: &[Version], arguments: &[AbstractValue]| {
            let same = versions.iter().find(|v| v.arguments == arguments);
            same.map(|v| (v.function, v.result.clone()))
        };
        let versions = self.versions.entry(callee).or_default();
        if let Some(found) = find(versions, &arguments) {
            return found;
        }
        if versions.len() >= MOST_VERSIONS {
            return match find(versions, &unknown()) {
                Some(found) => found,
                None => self.make(callee, unknown()).0,
            };
        }
        let knows = arguments.iter().any(|a| *a != AbstractValue::Unknown);
        if !knows {
            return self.make(callee, arguments).0;
        }
        let (made, changed) = self.make(callee, arguments.clone());
        if changed {
            return made;
        }
        // If nothing folds beyond the general version, all such calls share one function; the
        // result may still be known.
        let versions = self.versions.entry(callee).or_default();
        let generic = match find(versions, &unknown()) {
            Some((function, _)) => function,
            None => self.make(callee, unknown()).0.0,
        };
        let versions = self.versions.entry(callee).or_default();
        for version in versions.iter_mut().filter(|v| v.arguments == arguments) {
            version.function = generic;
        }
        (generic, made.1)
    }

    fn make(
        &mut self,
        callee: Handle<Function>,
        arguments: Vec<AbstractValue>,
    ) -> ((Handle<Function>, AbstractValue), bool) {
        let frame = self.run(FunctionId::Function(callee), arguments.clone());
        let span = self.module.functions.get_span(callee);
        let function = self.functions.append(frame.function, span);
        self.records.push(frame.record);
        let result = frame.returned.unwrap_or_default();
        self.versions.entry(callee).or_default().push(Version {
            arguments,
            function,
            result: result.clone(),
        });
        ((function, result), frame.changed)
    }

    /// Whether a version differs from the general one.
    pub(super) fn is_folded(&self, original: Handle<Function>, version: Handle<Function>) -> bool {
        let versions = self.versions.get(&original).map_or(&[][..], |v| v);
        let generic = versions
            .iter()
            .find(|v| v.arguments.iter().all(|a| *a == AbstractValue::Unknown));
        generic.is_none_or(|g| g.function != version)
    }
}
