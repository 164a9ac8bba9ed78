//! A share of a list, for several processes or machines.

use std::fmt;
use std::str::FromStr;

/// The `index`th of `count` shares, from 1: of a list every `count`th entry. The default is all of it.
///
/// ```
/// use train::Shard;
///
/// let shard: Shard = "2/3".parse()?;
/// let own: Vec<usize> = (0..8).filter(|&k| shard.has(k)).collect();
/// assert_eq!(own, [1, 4, 7]);
/// # Ok::<(), train::ShardError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    index: u64,
    count: u64,
}

/// What is no share: the text, or the numbers.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected i/n with i from 1 to n, for example 2/4")]
pub struct ShardError;

impl Default for Shard {
    fn default() -> Self {
        Self::WHOLE
    }
}

impl Shard {
    /// All of it.
    pub const WHOLE: Self = Self { index: 1, count: 1 };

    /// The `index`th of `count`.
    ///
    /// # Errors
    /// If `index` is not from 1 to `count`.
    pub fn new(index: u64, count: u64) -> Result<Self, ShardError> {
        if (1..=count).contains(&index) { Ok(Self { index, count }) } else { Err(ShardError) }
    }

    /// Whether the `k`th entry of a list, from 0, is of this share.
    pub fn has(self, k: usize) -> bool {
        k as u64 % self.count == self.index - 1
    }

    /// Whether it is all of a list.
    pub fn is_whole(self) -> bool {
        self.count == 1
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.index, self.count)
    }
}

impl FromStr for Shard {
    type Err = ShardError;

    fn from_str(text: &str) -> Result<Self, ShardError> {
        let (index, count) = text.split_once('/').ok_or(ShardError)?;
        let number = |text: &str| text.trim().parse().map_err(|_| ShardError);
        Self::new(number(index)?, number(count)?)
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
        assert_eq!("1/1".parse(), Ok(Shard::WHOLE));
    }
}
