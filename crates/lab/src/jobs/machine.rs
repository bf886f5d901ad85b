//! Which adapters a fleet has.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use super::{Answer, Kind, Results, adapter_id};
use preshade_draw::render::{AdapterReport, Card};

pub const MACHINE_SCHEMA: &str = "preshade.machine.v1";

/// The adapters of one machine. No result depends on it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Machine {
    pub schema: String,
    pub host: String,
    pub cards: Vec<MachineCard>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MachineCard {
    pub adapter: AdapterReport,
    /// Identifies it among cards of that adapter, as [`super::Run::card`].
    pub card: String,
}

impl Machine {
    /// A machine with these cards.
    pub fn new(host: &str, cards: &[Card]) -> Self {
        let card = |card: &Card| MachineCard {
            adapter: card.report.clone(),
            card: card.address.clone(),
        };
        Self {
            schema: MACHINE_SCHEMA.to_owned(),
            host: host.to_owned(),
            cards: cards.iter().map(card).collect(),
        }
    }
}

/// An adapter of a fleet: its machines, and its finished jobs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FleetAdapter {
    pub adapter: AdapterReport,
    /// The machines that are known to have it.
    pub machines: BTreeSet<String>,
    pub cards: usize,
    /// Jobs on pictures that have a report.
    pub pictures: usize,
    /// Runs of timing jobs that have one.
    pub times: usize,
    pub failed: usize,
}

/// Host and card of each.
type Cards<'a> = BTreeSet<(&'a str, &'a str)>;

/// The adapters of results and of machines, by name.
pub fn fleet(results: &Results, machines: &[Machine]) -> Vec<FleetAdapter> {
    let mut all: BTreeMap<String, (FleetAdapter, Cards<'_>)> = BTreeMap::new();
    let known = machines.iter().flat_map(|m| &m.cards).map(|c| &c.adapter);
    for adapter in results.adapters.values().chain(known) {
        all.entry(adapter_id(adapter)).or_insert_with(|| {
            let none = FleetAdapter {
                adapter: adapter.clone(),
                machines: BTreeSet::new(),
                cards: 0,
                pictures: 0,
                times: 0,
                failed: 0,
            };
            (none, BTreeSet::new())
        });
    }
    for machine in machines {
        for card in &machine.cards {
            if let Some((_, cards)) = all.get_mut(&adapter_id(&card.adapter)) {
                cards.insert((&machine.host, &card.card));
            }
        }
    }
    for job in results.jobs.values() {
        for (id, answer) in &job.answers {
            let Some((adapter, cards)) = all.get_mut(id) else {
                continue;
            };
            let Answer::Measured { runs } = answer else {
                adapter.failed += 1;
                continue;
            };
            match job.job.kind {
                Kind::Picture => adapter.pictures += 1,
                Kind::Time => adapter.times += runs.len(),
            }
            let runs = runs.values().filter_map(|m| m.run.as_ref());
            cards.extend(runs.map(|run| (run.host.as_str(), run.card.as_str())));
        }
    }
    let counted = |(adapter, cards): (FleetAdapter, Cards<'_>)| FleetAdapter {
        machines: cards.iter().map(|(host, _)| (*host).to_owned()).collect(),
        cards: cards.len(),
        ..adapter
    };
    let mut all: Vec<FleetAdapter> = all.into_values().map(counted).collect();
    all.sort_by(|a, b| {
        let key = |f: &FleetAdapter| (f.adapter.name.clone(), f.adapter.driver.clone());
        key(a).cmp(&key(b))
    });
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::jobs::made_up::{ModelResult, adapter, results};

    #[test]
    fn a_fleet_is_what_ran_and_what_machines_have() {
        let card = |name: &str, card: &str| MachineCard {
            adapter: adapter(name),
            card: card.to_owned(),
        };
        let machines = [Machine {
            schema: MACHINE_SCHEMA.to_owned(),
            host: "desk".to_owned(),
            cards: vec![card("a", "0"), card("a", "1"), card("idle", "2")],
        }];
        let made = [
            ModelResult::Picture("a", "x", true),
            ModelResult::Time("a", "x", 2.0),
            ModelResult::Lost("b", "x"),
        ];
        let told = |machines: &[Machine]| -> Vec<String> {
            let all = fleet(&results(&made), machines);
            let line = |f: &FleetAdapter| {
                let machines: Vec<&str> = f.machines.iter().map(String::as_str).collect();
                let name = &f.adapter.name;
                let of = [f.cards, f.pictures, f.times, f.failed];
                format!("{name} {} {of:?}", machines.join("+"))
            };
            all.iter().map(line).collect()
        };
        assert_eq!(told(&[]), ["a host of a [1, 1, 1, 0]", "b  [0, 0, 0, 1]"]);
        assert_eq!(
            told(&machines),
            [
                "a desk+host of a [3, 1, 1, 0]",
                "b  [0, 0, 0, 1]",
                "idle desk [1, 0, 0, 0]"
            ]
        );
    }
}
