//! Maximum flow through a network with growing capacities (Dinic 1970).
//!
//! A flow stays valid while capacities grow, so the next maximum starts from the last one. A sweep
//! of prices needs this; a function from a network to its flow could not provide it. A phase costs
//! as much as the nodes it visits, up to the sink's distance, not the size of the network.

/// An arc: its ends and capacity.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Arc {
    pub from: usize,
    pub to: usize,
    pub capacity: u64,
}

/// An arc or its reverse, sorted by source node so that a walk reads memory in order.
#[derive(Clone, Copy, Debug)]
struct Half {
    to: u32,
    /// Index of the reverse edge.
    back: u32,
    /// Residual capacity.
    residual: u64,
}

#[derive(Clone, Copy, Debug)]
struct FlowNode {
    /// The first half-arc; the node's half-arcs end where the next node's begin.
    first: u32,
    /// Distance from the source in arcs, or [`FAR`].
    level: u32,
    /// The next half-arc to try in this phase.
    next: u32,
}

/// A network and a flow through it.
#[derive(Clone, Debug)]
pub(crate) struct Network {
    /// The nodes and a sentinel.
    nodes: Vec<FlowNode>,
    halves: Vec<Half>,
    /// Position of each arc among the halves, in the order of the input.
    places: Vec<u32>,
    work: u64,
}

/// Not visited in this phase.
const FAR: u32 = u32::MAX;

impl Network {
    /// A network without flow. Arcs keep their index in `arcs`.
    pub fn new(nodes: usize, arcs: &[Arc]) -> Self {
        let mut first = vec![0_u32; nodes + 1];
        for arc in arcs {
            first[arc.from + 1] += 1;
            first[arc.to + 1] += 1;
        }
        for i in 0..nodes {
            first[i + 1] += first[i];
        }
        let mut free = first.clone();
        let mut take = |node: usize| {
            free[node] += 1;
            free[node] - 1
        };
        let none = Half {
            to: 0,
            back: 0,
            residual: 0,
        };
        let mut halves = vec![none; 2 * arcs.len()];
        let mut places = Vec::with_capacity(arcs.len());
        for arc in arcs {
            let (there, back) = (take(arc.from), take(arc.to));
            let (from, to) = (arc.from as u32, arc.to as u32);
            halves[there as usize] = Half {
                to,
                back,
                residual: arc.capacity,
            };
            halves[back as usize] = Half {
                to: from,
                back: there,
                residual: 0,
            };
            places.push(there);
        }
        let node = |first| FlowNode {
            first,
            level: FAR,
            next: first,
        };
        Self {
            nodes: first.into_iter().map(node).collect(),
            halves,
            places,
            work: 0,
        }
    }

    /// Raises the capacity of an arc.
    pub fn widen(&mut self, arc: usize, by: u64) {
        self.halves[self.places[arc] as usize].residual += by;
    }

    /// Number of arcs visited so far: a machine-independent measure of time.
    #[cfg(test)]
    pub fn work(&self) -> u64 {
        self.work
    }

    /// Augments the flow to its maximum; returns the increase.
    pub fn augment(&mut self, source: usize, sink: usize) -> u64 {
        let mut more = 0;
        loop {
            let visited = self.levels(source, sink);
            let reached = self.nodes[sink].level != FAR;
            if reached {
                more += self.blocking(source, sink);
            }
            for node in visited {
                let node = &mut self.nodes[node as usize];
                node.level = FAR;
                node.next = node.first;
            }
            if !reached {
                return more;
            }
        }
    }

    /// Whether residual capacity connects the source with each node. At maximum flow this is the
    /// smallest source side of all minimum cuts.
    pub fn reached(&self, source: usize) -> Vec<bool> {
        let mut reached = vec![false; self.nodes.len() - 1];
        let mut stack = vec![source];
        reached[source] = true;
        while let Some(node) = stack.pop() {
            for half in &self.halves[self.leaving(node)] {
                let to = half.to as usize;
                if half.residual > 0 && !std::mem::replace(&mut reached[to], true) {
                    stack.push(to);
                }
            }
        }
        reached
    }

    /// The half-arcs of a node.
    fn leaving(&self, node: usize) -> std::ops::Range<usize> {
        self.nodes[node].first as usize..self.nodes[node + 1].first as usize
    }

    /// Computes distances from the source up to the sink's; returns the nodes that have one.
    fn levels(&mut self, source: usize, sink: usize) -> Vec<u32> {
        self.nodes[source].level = 0;
        let mut visited = vec![source as u32];
        let mut at = 0;
        while let Some(node) = visited.get(at).map(|node| *node as usize) {
            at += 1;
            let level = self.nodes[node].level;
            if level >= self.nodes[sink].level {
                break;
            }
            for half in &self.halves[self.leaving(node)] {
                self.work += 1;
                let to = &mut self.nodes[half.to as usize].level;
                if half.residual > 0 && *to == FAR {
                    *to = level + 1;
                    visited.push(half.to);
                }
            }
        }
        visited
    }

    /// Saturates an arc of every shortest path.
    fn blocking(&mut self, source: usize, sink: usize) -> u64 {
        let mut flow = 0;
        let mut path: Vec<usize> = Vec::new();
        loop {
            let node = path
                .last()
                .map_or(source, |half| self.halves[*half].to as usize);
            if node == sink {
                let narrowest = path.iter().map(|half| self.halves[*half].residual).min();
                let through = narrowest.unwrap_or(0);
                flow += through;
                self.work += path.len() as u64;
                for half in &path {
                    let back = self.halves[*half].back as usize;
                    self.halves[*half].residual -= through;
                    self.halves[back].residual += through;
                }
                // Continue where the path is still open.
                let full = path
                    .iter()
                    .position(|half| self.halves[*half].residual == 0);
                path.truncate(full.unwrap_or(0));
                continue;
            }
            match self.onward(node) {
                Some(half) => path.push(half),
                // A dead end: remove the arc that leads here.
                None => match path.pop() {
                    Some(half) => {
                        let back = self.halves[half].back as usize;
                        let from = self.halves[back].to as usize;
                        self.nodes[from].next += 1;
                    }
                    None => return flow,
                },
            }
        }
    }

    /// The next open half-arc to the next level.
    fn onward(&mut self, node: usize) -> Option<usize> {
        let end = self.nodes[node + 1].first;
        while self.nodes[node].next < end {
            self.work += 1;
            let half = self.nodes[node].next as usize;
            let Half { to, residual, .. } = self.halves[half];
            let level = self.nodes[to as usize].level;
            if residual > 0 && level != FAR && level == self.nodes[node].level + 1 {
                return Some(half);
            }
            self.nodes[node].next += 1;
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arc((from, to, capacity): (usize, usize, u64)) -> Arc {
        Arc { from, to, capacity }
    }

    #[test]
    fn a_flow_grows_with_its_capacities() {
        let arcs = [(0, 1, 2), (1, 3, 5), (0, 2, 4), (2, 3, 1), (2, 1, 9)];
        let mut network = Network::new(4, &arcs.map(arc));
        assert_eq!(network.augment(0, 3), 6);
        assert_eq!(network.reached(0), [true, false, false, false]);
        assert_eq!(network.augment(0, 3), 0);
        network.widen(0, 3);
        assert_eq!(network.augment(0, 3), 0);
        assert_eq!(network.reached(0), [true, true, true, false]);
    }

    /// The second path has to reroute the first one.
    #[test]
    fn a_flow_is_led_another_way_where_that_lets_more_through() {
        let arcs = [(0, 1), (1, 2), (2, 5), (0, 3), (3, 2), (1, 4), (4, 5)];
        let mut network = Network::new(6, &arcs.map(|(from, to)| arc((from, to, 1))));
        assert_eq!(network.augment(0, 5), 2);
    }
}
