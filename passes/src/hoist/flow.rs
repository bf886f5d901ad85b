//! Maximum flow through a network whose capacities may grow (Dinic 1970).
//!
//! A flow stays one while capacities grow, so that the next maximum is found from where the last one stood: what a sweep of prices needs, and what a function
//! from a network to its flow cannot give. A phase costs what it visits, up to the distance of the sink, not the size of the network.

use super::users::Users;

/// An arc's index; the one after an even index runs the other way.
pub type ArcId = usize;

#[derive(Clone, Copy, Debug)]
struct Arc {
    from: usize,
    to: usize,
    /// What may still flow.
    residual: u64,
}

/// A network and a flow through it.
#[derive(Clone, Debug)]
pub struct Network {
    arcs: Vec<Arc>,
    nodes: usize,
    /// Arcs that leave each node, those that run against a flow among them; of those that there were at the last flow.
    leaving: Users,
    /// Distance from the source in arcs, of nodes visited in this phase.
    level: Vec<u32>,
    /// The first arc of each node that may still lead on in this phase.
    next: Vec<usize>,
    work: u64,
}

/// Not visited in this phase.
const FAR: u32 = u32::MAX;

impl Network {
    /// Nodes without arcs.
    pub fn new(nodes: usize) -> Self {
        Self {
            arcs: Vec::new(),
            nodes,
            leaving: Users::new(nodes, std::iter::empty()),
            level: vec![FAR; nodes],
            next: vec![0; nodes],
            work: 0,
        }
    }

    /// Adds an arc.
    pub fn arc(&mut self, from: usize, to: usize, capacity: u64) -> ArcId {
        let id = self.arcs.len();
        for (from, to, residual) in [(from, to, capacity), (to, from, 0)] {
            self.arcs.push(Arc { from, to, residual });
        }
        id
    }

    /// Lets more through an arc.
    pub fn widen(&mut self, arc: ArcId, by: u64) {
        self.arcs[arc].residual += by;
    }

    /// Number of nodes.
    pub fn nodes(&self) -> usize {
        self.nodes
    }

    /// Arcs looked at so far: the time that flows took, on any machine.
    #[cfg(test)]
    pub fn work(&self) -> u64 {
        self.work
    }

    /// Lets as much more flow as can; returns how much that is.
    pub fn augment(&mut self, source: usize, sink: usize) -> u64 {
        let arcs = self.arcs.iter().enumerate();
        if arcs.len() != self.leaving.pairs() {
            self.leaving = Users::new(self.nodes, arcs.map(|(id, arc)| (arc.from, id)));
        }
        let mut more = 0;
        loop {
            let visited = self.levels(source, sink);
            let reached = self.level[sink] != FAR;
            if reached {
                more += self.blocking(source, sink);
            }
            for node in visited {
                self.level[node] = FAR;
                self.next[node] = 0;
            }
            if !reached {
                return more;
            }
        }
    }

    /// Whether more could flow from the source to each node: the smallest source side of all minimum cuts, where the flow is greatest.
    pub fn reached(&self, source: usize) -> Vec<bool> {
        let mut reached = vec![false; self.nodes];
        let mut stack = vec![source];
        reached[source] = true;
        while let Some(node) = stack.pop() {
            for arc in &self.leaving[node] {
                let Arc { to, residual, .. } = self.arcs[*arc];
                if residual > 0 && !std::mem::replace(&mut reached[to], true) {
                    stack.push(to);
                }
            }
        }
        reached
    }

    /// Finds the distances from the source, no farther than the sink's; returns the nodes that have one.
    fn levels(&mut self, source: usize, sink: usize) -> Vec<usize> {
        self.level[source] = 0;
        let mut visited = vec![source];
        let mut at = 0;
        while let Some(node) = visited.get(at).copied() {
            at += 1;
            if self.level[node] >= self.level[sink] {
                break;
            }
            for arc in &self.leaving[node] {
                self.work += 1;
                let Arc { to, residual, .. } = self.arcs[*arc];
                if residual > 0 && self.level[to] == FAR {
                    self.level[to] = self.level[node] + 1;
                    visited.push(to);
                }
            }
        }
        visited
    }

    /// Saturates an arc of every shortest path.
    fn blocking(&mut self, source: usize, sink: usize) -> u64 {
        let mut flow = 0;
        let mut path: Vec<ArcId> = Vec::new();
        loop {
            let node = path.last().map_or(source, |arc| self.arcs[*arc].to);
            if node == sink {
                let narrowest = path.iter().map(|a| self.arcs[*a].residual).min();
                let through = narrowest.unwrap_or(0);
                flow += through;
                self.work += path.len() as u64;
                for arc in &path {
                    self.arcs[*arc].residual -= through;
                    self.arcs[*arc ^ 1].residual += through;
                }
                // On from where the path is still open.
                let full = path.iter().position(|a| self.arcs[*a].residual == 0);
                path.truncate(full.unwrap_or(0));
                continue;
            }
            match self.onward(node) {
                Some(arc) => path.push(arc),
                // Nothing leads on from here: neither does the arc to it.
                None => match path.pop() {
                    Some(arc) => self.next[self.arcs[arc ^ 1].to] += 1,
                    None => return flow,
                },
            }
        }
    }

    /// The next arc of a node that is open and leads one level on.
    fn onward(&mut self, node: usize) -> Option<ArcId> {
        while let Some(&arc) = self.leaving[node].get(self.next[node]) {
            self.work += 1;
            let Arc { to, residual, .. } = self.arcs[arc];
            if residual > 0 && self.level[to] != FAR && self.level[to] == self.level[node] + 1 {
                return Some(arc);
            }
            self.next[node] += 1;
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flow_grows_with_its_capacities() {
        let mut network = Network::new(4);
        let narrow = network.arc(0, 1, 2);
        network.arc(1, 3, 5);
        network.arc(0, 2, 4);
        network.arc(2, 3, 1);
        network.arc(2, 1, 9);
        assert_eq!(network.augment(0, 3), 6);
        assert_eq!(network.reached(0), [true, false, false, false]);
        assert_eq!(network.augment(0, 3), 0);
        network.widen(narrow, 3);
        assert_eq!(network.augment(0, 3), 0);
        assert_eq!(network.reached(0), [true, true, true, false]);
    }

    /// The second path has to take back what the first one took.
    #[test]
    fn a_flow_is_led_another_way_where_that_lets_more_through() {
        let mut network = Network::new(6);
        for (from, to) in [(0, 1), (1, 2), (2, 5), (0, 3), (3, 2), (1, 4), (4, 5)] {
            network.arc(from, to, 1);
        }
        assert_eq!(network.augment(0, 5), 2);
    }
}
