//! Weights of another training, to begin with.

use std::collections::BTreeSet;

use serde::Serialize;

/// What a training that [begins with](super::Job::from) the weights of a checkpoint took from it.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
#[non_exhaustive]
pub struct Inherited {
    /// How many arrays it has from there.
    pub taken: usize,
    /// What the checkpoint does not have: these begin at random.
    pub fresh: Vec<String>,
    /// What the checkpoint has and the system does not.
    pub unused: Vec<String>,
    /// First names of the arrays that it has from there.
    #[serde(skip)]
    pub parts: BTreeSet<String>,
}

impl Inherited {
    /// Whether it has any array of a part of the model, by their first name, from there: then what is learned of that part stays, and
    /// files of weights are for others.
    pub fn has(&self, part: &str) -> bool {
        self.parts.contains(part)
    }

    /// What a user should know of it, a sentence each; nothing where all was taken.
    pub fn remarks(&self) -> Vec<String> {
        let told = |what: &str, names: &[String]| {
            let parts: BTreeSet<&str> = names.iter().map(|name| part(name)).collect();
            let parts = parts.into_iter().collect::<Vec<_>>().join(", ");
            (!names.is_empty()).then(|| format!("{what}: {parts}"))
        };
        let fresh = told("the weights do not have these parts, which begin at random", &self.fresh);
        let unused = told("the weights have these parts, which are not used", &self.unused);
        fresh.into_iter().chain(unused).collect()
    }
}

/// The part of a model that a parameter belongs to: its first name, and the number behind it.
fn part(name: &str) -> &str {
    let mut dots = name.match_indices('.').map(|(at, _)| at);
    let Some(first) = dots.next() else { return name };
    let second = dots.next().unwrap_or(name.len());
    let numbered = name[first + 1..second].bytes().all(|b| b.is_ascii_digit());
    &name[..if numbered { second } else { first }]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_named_once() {
        let names = ["stages.2.a", "stages.2.b.c", "fc.weight", "w", "stages.10.x"];
        let fresh = names.map(str::to_owned).to_vec();
        let said = Inherited { fresh, ..Inherited::default() }.remarks();
        assert_eq!(said.len(), 1);
        assert!(said[0].ends_with(": fc, stages.10, stages.2, w"), "{said:?}");
        assert_eq!(Inherited::default().remarks(), Vec::<String>::new());
    }
}
