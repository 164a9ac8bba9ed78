//! Boxes side by side on shelves.

/// Places boxes of these widths and heights in a square: its side, and the left top corner of each box.
///
/// The side is the one that is given, or the least that shelves of falling height need; `None` where it would be more than
/// `most`.
pub(super) fn pack(
    sizes: &[[usize; 2]],
    side: Option<usize>,
    most: usize,
) -> Option<(usize, Vec<[usize; 2]>)> {
    let mut order: Vec<usize> = (0..sizes.len()).collect();
    order.sort_by_key(|&k| (std::cmp::Reverse(sizes[k][1]), k));
    if let Some(side) = side {
        let (height, places) = shelves(sizes, &order, side)?;
        return (height <= side).then_some((side, places));
    }
    let area = sizes.iter().map(|[w, h]| w.saturating_mul(*h)).fold(0, usize::saturating_add);
    let widest = sizes.iter().map(|size| size[0].max(size[1])).max().unwrap_or(0);
    let mut side = ((area as f64).sqrt() as usize).max(widest).max(8).next_multiple_of(8);
    while side <= most {
        let (height, places) = shelves(sizes, &order, side)?;
        if height <= side {
            return Some((side, places));
        }
        side = (side + side / 32).max(side + 8).next_multiple_of(8);
    }
    None
}

/// Shelves of a width: how high they are together.
fn shelves(
    sizes: &[[usize; 2]],
    order: &[usize],
    width: usize,
) -> Option<(usize, Vec<[usize; 2]>)> {
    let mut places = vec![[0; 2]; sizes.len()];
    let (mut left, mut top, mut bottom) = (0, 0, 0);
    for &k in order {
        let [w, h] = sizes[k];
        if w > width {
            return None;
        }
        if left + w > width {
            (left, top) = (0, bottom);
        }
        places[k] = [left, top];
        left += w;
        bottom = bottom.max(top + h);
    }
    Some((bottom, places))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn boxes_lie_in_the_square_and_not_on_each_other() {
        let sizes: Vec<[usize; 2]> =
            (0..60usize).map(|k| [8 + 8 * (k * 7 % 5), 8 + 8 * (k * 11 % 9)]).collect();
        let (side, places) = pack(&sizes, None, 4096).unwrap();
        let mut taken = vec![false; side * side];
        for (&[w, h], &[left, top]) in sizes.iter().zip(&places) {
            for k in 0..w * h {
                let cell = (top + k / w) * side + left + k % w;
                assert!(!std::mem::replace(&mut taken[cell], true));
            }
        }
        let area: usize = sizes.iter().map(|[w, h]| w * h).sum();
        assert!(area * 10 > side * side * 7, "{area} in {side}");
        assert!(pack(&sizes, None, side - 8).is_none() || side % 8 == 0);
        assert!(pack(&sizes, Some(side), side).is_some() && pack(&sizes, Some(64), 64).is_none());
        assert_eq!(pack(&[], None, 4096).unwrap().1, Vec::<[usize; 2]>::new());
    }
}
