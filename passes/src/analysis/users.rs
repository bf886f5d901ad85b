//! A compact map from things to their users.

use std::ops::Index;

/// The users of each thing in the given order: `users[thing]`.
#[derive(Clone, Debug, Default)]
pub struct Users {
    /// Start of each thing's users, with one extra entry at the end.
    start: Vec<usize>,
    of: Vec<usize>,
}

impl Users {
    /// Builds the map for `count` things from pairs of a thing and its user.
    pub fn new(count: usize, pairs: impl Iterator<Item = (usize, usize)> + Clone) -> Self {
        let mut start = vec![0; count + 1];
        for (thing, _) in pairs.clone() {
            start[thing + 1] += 1;
        }
        for i in 0..count {
            start[i + 1] += start[i];
        }
        let mut next = start.clone();
        let mut of = vec![0; start[count]];
        for (thing, user) in pairs {
            of[next[thing]] = user;
            next[thing] += 1;
        }
        Self { start, of }
    }
}

impl Index<usize> for Users {
    type Output = [usize];

    fn index(&self, thing: usize) -> &[usize] {
        &self.of[self.start[thing]..self.start[thing + 1]]
    }
}
