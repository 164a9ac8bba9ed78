//! Which views one is held against: all others would cost the square of their number.

/// Views that one is held against at most. So many allow little more than all do.
pub(super) const MOST: usize = 96;

/// All views but one, in their order; of more than [`MOST`] so many, evenly spread.
///
/// Each view is then a partner of as many others as any, so that sums over them can be compared.
pub(super) fn partners(k: usize, count: usize) -> impl Iterator<Item = usize> {
    let most = count.saturating_sub(1).min(MOST);
    let mut chosen: Vec<usize> =
        (1..=most).map(|step| (k + step * count / (most + 1)) % count).collect();
    // The order decides between equals.
    chosen.sort_unstable();
    chosen.into_iter()
}

/// So many of a list at most, evenly spread.
pub(super) fn spread<T: Copy>(list: &[T], most: usize) -> Vec<T> {
    let count = list.len().min(most);
    (0..count).map(|k| list[k * list.len() / count]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_views_have_all_others_and_many_have_as_many_each() {
        assert_eq!(partners(2, 5).collect::<Vec<_>>(), [0, 1, 3, 4]);
        assert_eq!(partners(0, 1).count(), 0);
        for count in [MOST, MOST + 1, 100, 192, 800] {
            let mut asked = vec![0; count];
            for k in 0..count {
                let mut chosen: Vec<usize> = partners(k, count).collect();
                chosen.dedup();
                assert_eq!(chosen.len(), MOST.min(count - 1));
                assert!(!chosen.contains(&k));
                for i in chosen {
                    asked[i] += 1;
                }
            }
            assert!(asked.iter().all(|&times| times == MOST.min(count - 1)), "{count}");
        }
    }

    #[test]
    fn what_is_spread_begins_with_the_first() {
        assert_eq!(spread(&[1, 2, 3], 4), [1, 2, 3]);
        assert_eq!(spread(&[1, 2, 3, 4, 5, 6], 3), [1, 3, 5]);
        assert_eq!(spread::<u8>(&[], 3), [0; 0]);
    }
}
