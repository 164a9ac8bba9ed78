//! A share of the work, for several processes or machines.

use std::str::FromStr;

/// The `index`th of `count` shares, from 1: of a list every `count`th object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Shard {
    index: u64,
    count: u64,
}

impl Shard {
    /// All of it.
    pub(crate) const WHOLE: Self = Self { index: 1, count: 1 };

    /// The share that a job array of Slurm's gives this process; none outside of one. `variable` reads the environment.
    ///
    /// Slurm counts tasks from whatever number `--array` begins with, and in steps where it has some
    /// (`--array=0-14:2`): the first has the first share.
    pub(crate) fn of_slurm(
        variable: impl Fn(&str) -> Option<String>,
    ) -> Result<Option<Self>, String> {
        let number = |name: &str| {
            variable(name)
                .map(|text| {
                    text.parse().map_err(|_| format!("{name}: {text:?} is no whole number"))
                })
                .transpose()
        };
        let id: Option<u64> = number("SLURM_ARRAY_TASK_ID")?;
        let count: Option<u64> = number("SLURM_ARRAY_TASK_COUNT")?;
        let Some((id, count)) = id.zip(count) else { return Ok(None) };
        let first = number("SLURM_ARRAY_TASK_MIN")?.unwrap_or(1);
        let step = number("SLURM_ARRAY_TASK_STEP")?.unwrap_or(1).max(1);
        let index = id.checked_sub(first).map(|above| above / step + 1);
        let shard = index.map(|index| Self { index, count }).filter(|shard| shard.is_one());
        shard.map(Some).ok_or_else(|| {
            format!("SLURM_ARRAY_TASK_ID is {id}, which is none of {count} tasks from {first}; say --shard i/n")
        })
    }

    /// Whether the `k`th object of a list, from 0, is of this share.
    pub(crate) fn has(self, k: usize) -> bool {
        k as u64 % self.count == self.index - 1
    }

    fn is_one(self) -> bool {
        (1..=self.count).contains(&self.index)
    }
}

impl std::fmt::Display for Shard {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}/{}", self.index, self.count)
    }
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts = text.split_once('/').and_then(|(index, count)| {
            Some(Self { index: index.trim().parse().ok()?, count: count.trim().parse().ok()? })
        });
        parts
            .filter(|shard| shard.is_one())
            .ok_or_else(|| "expected i/n with i from 1 to n, for example 2/4".to_owned())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn shards_part_a_list() {
        for count in 1..6u64 {
            let shards: Vec<Shard> =
                (1..=count).map(|i| format!("{i}/{count}").parse().unwrap()).collect();
            for k in 0..20 {
                assert_eq!(shards.iter().filter(|shard| shard.has(k)).count(), 1);
            }
        }
        for wrong in ["", "2", "0/2", "3/2", "1/0", "a/b", "-1/2", "1/2/3"] {
            assert!(wrong.parse::<Shard>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn the_first_task_of_an_array_has_the_first_share() {
        let of = |pairs: &[(&str, &str)]| {
            let pairs: Vec<(String, String)> = pairs
                .iter()
                .map(|(a, b)| (format!("SLURM_ARRAY_TASK_{a}"), (*b).to_owned()))
                .collect();
            Shard::of_slurm(|name| {
                pairs.iter().find(|(known, _)| known == name).map(|(_, value)| value.clone())
            })
        };
        assert_eq!(of(&[]), Ok(None));
        assert_eq!(of(&[("ID", "3")]), Ok(None));
        assert_eq!(of(&[("ID", "3"), ("COUNT", "4")]), Ok(Some("3/4".parse().unwrap())));
        let zero = [("ID", "0"), ("COUNT", "4"), ("MIN", "0"), ("STEP", "1")];
        assert_eq!(of(&zero), Ok(Some("1/4".parse().unwrap())));
        let steps = [("ID", "14"), ("COUNT", "8"), ("MIN", "0"), ("STEP", "2")];
        assert_eq!(of(&steps), Ok(Some("8/8".parse().unwrap())));
        assert!(of(&[("ID", "0"), ("COUNT", "4")]).unwrap_err().contains("--shard"));
        assert!(of(&[("ID", "9"), ("COUNT", "4")]).is_err());
        assert!(of(&[("ID", "x"), ("COUNT", "4")]).unwrap_err().contains("whole number"));
    }
}
