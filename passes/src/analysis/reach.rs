//! Transitive dependences over the values of a fragment stage.

use crate::analysis::values::{ValueId, Values};

/// Values and all their dependents.
pub(crate) fn with_users(values: &Values<'_, '_>, mut work: Vec<ValueId>) -> Vec<bool> {
    let users = values.users();
    let mut held = vec![false; values.values.len()];
    while let Some(id) = work.pop() {
        if !std::mem::replace(&mut held[id], true) {
            work.extend(&users[id]);
        }
    }
    held
}

/// Values and all their dependences.
pub fn with_operands(values: &Values<'_, '_>, mut work: Vec<ValueId>) -> Vec<bool> {
    let mut held = vec![false; values.values.len()];
    while let Some(id) = work.pop() {
        if !std::mem::replace(&mut held[id], true) {
            work.extend(&values.values[id].operands);
        }
    }
    held
}
