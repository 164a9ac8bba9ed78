//! The share of the work that a batch system gives this process.

use train::Shard;

/// The share that a job array of Slurm's gives this process; none outside of one. `variable` reads the environment.
///
/// Slurm counts tasks from whatever number `--array` begins with, and in steps where it has some
/// (`--array=0-14:2`): the first has the first share.
pub(crate) fn task(variable: impl Fn(&str) -> Option<String>) -> Result<Option<Shard>, String> {
    let number = |name: &str| {
        variable(name)
            .map(|text| text.parse().map_err(|_| format!("{name}: {text:?} is no whole number")))
            .transpose()
    };
    let id: Option<u64> = number("SLURM_ARRAY_TASK_ID")?;
    let count: Option<u64> = number("SLURM_ARRAY_TASK_COUNT")?;
    let Some((id, count)) = id.zip(count) else { return Ok(None) };
    let first = number("SLURM_ARRAY_TASK_MIN")?.unwrap_or(1);
    let step = number("SLURM_ARRAY_TASK_STEP")?.unwrap_or(1).max(1);
    let index = id.checked_sub(first).map(|above| above / step + 1);
    let shard = index.and_then(|index| Shard::new(index, count).ok());
    shard.map(Some).ok_or_else(|| {
        format!("SLURM_ARRAY_TASK_ID is {id}, which is none of {count} tasks from {first}; say --shard i/n")
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn the_first_task_of_an_array_has_the_first_share() {
        let of = |pairs: &[(&str, &str)]| {
            let pairs: Vec<(String, String)> = pairs
                .iter()
                .map(|(a, b)| (format!("SLURM_ARRAY_TASK_{a}"), (*b).to_owned()))
                .collect();
            task(|name| {
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
