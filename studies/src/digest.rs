//! What tables and pages are made of.

use std::collections::BTreeSet;

use super::order::Order;
use super::store::{Kept, Store};
use super::study::{Claim, Study};
use super::table::Tables;

/// Everything that the pages say.
pub(super) struct Digest<'a> {
    pub(super) study: &'a dyn Study,
    pub(super) order: &'a Order<'a>,
    pub(super) store: &'a Store,
    pub(super) kept: &'a [Kept],
    pub(super) tables: &'a Tables,
    pub(super) claims: &'a [Claim],
    /// Jobs that are still to be done.
    pub(super) left: usize,
}

impl Digest<'_> {
    /// How the results were made: names and values.
    pub(super) fn facts(&self) -> Vec<(&'static str, String)> {
        let all = |value: &dyn Fn(&Kept) -> String| {
            let values: BTreeSet<String> = self.kept.iter().map(value).collect();
            values.into_iter().filter(|v| !v.is_empty()).collect::<Vec<_>>().join(" and ")
        };
        let seeds: Vec<String> = self.order.seeds.iter().map(u64::to_string).collect();
        let seconds: f64 = self.kept.iter().map(|kept| kept.seconds).sum();
        let facts = [
            ("command", self.order.provenance.command.clone()),
            ("scale", self.order.scale.name().to_owned()),
            ("seeds", seeds.join(", ")),
            ("data", self.order.data.map(|d| d.display().to_string()).unwrap_or_default()),
            ("cpu", all(&|kept| kept.cpu.clone())),
            ("machine", all(&|kept| kept.machine.clone())),
            ("threads", all(&|kept| kept.threads.to_string())),
            ("version", all(&|kept| kept.version.clone())),
            ("commit", all(&|kept| kept.commit.clone())),
            ("time", format!("{seconds:.0} s")),
        ];
        facts.into_iter().filter(|(_, value)| !value.is_empty()).collect()
    }
}
