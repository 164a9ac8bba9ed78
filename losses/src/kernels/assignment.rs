//! Pairings of two point sets of one size whose distances add up to the least.

/// How a pairing is found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Assignment {
    /// The least sum there is, by shortest augmenting paths. `O(P³)` at worst, `8 P²` bytes: meant up to 2,048 points.
    ///
    /// # References
    /// Jonker, Volgenant 1987, *A shortest augmenting path algorithm for dense and sparse linear assignment problems*.
    Exact,
    /// An approximation with a bound: points bid for partners until each has one, and the mean distance is at most
    /// `(1 + excess)` times the least, or `1e-9` of the extent of both sets more than the least if that is more.
    ///
    /// # References
    /// Bertsekas 1988, *The auction algorithm: a distributed relaxation method for the assignment problem*.
    Auction {
        /// How much more than the least is allowed, as a share of it: 0.01, say.
        excess: f64,
    },
}

/// For each point of `a` its partner in `b`; each of `b` is the partner of one. Distances are not squared.
///
/// # Panics
/// If the sets differ in size, a coordinate or the square of the distance of two of them is not finite, or the excess is not positive.
pub fn assign(a: &[[f64; 3]], b: &[[f64; 3]], method: Assignment) -> Vec<u32> {
    assert_eq!(a.len(), b.len(), "a pairing needs two sets of one size");
    let finite = a.iter().chain(b).flatten().all(|x| x.is_finite());
    assert!(finite, "a pairing needs finite coordinates");
    assert!(
        a.is_empty() || across(a, b).is_finite(),
        "a pairing needs distances whose squares are finite"
    );
    match method {
        _ if a.is_empty() => Vec::new(),
        Assignment::Exact => {
            let rows = a.iter().map(|&p| b.iter().map(move |&q| distance(p, q)));
            Paths::new(a.len(), rows.flatten().collect()).solve()
        }
        Assignment::Auction { excess } => {
            assert!(excess > 0.0, "an auction needs a positive excess, found {excess}");
            auction(a, b, excess)
        }
    }
}

/// The distance between two points.
pub fn distance(p: [f64; 3], q: [f64; 3]) -> f64 {
    let d = [p[0] - q[0], p[1] - q[1], p[2] - q[2]];
    (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt()
}

const NONE: u32 = u32::MAX;

/// Shortest augmenting paths over reduced costs `c[i][j] - v[j]`.
struct Paths {
    n: usize,
    costs: Vec<f64>,
    /// Prices of the columns.
    v: Vec<f64>,
    /// The column of each row, and the row of each column.
    column: Vec<u32>,
    row: Vec<u32>,
}

impl Paths {
    fn new(n: usize, costs: Vec<f64>) -> Self {
        Self { n, costs, v: vec![0.0; n], column: vec![NONE; n], row: vec![NONE; n] }
    }

    fn solve(mut self) -> Vec<u32> {
        self.reduce_columns();
        // Twice: what the first pass displaces finds another place in the second, at less cost than a path.
        self.reduce_rows();
        self.reduce_rows();
        let free: Vec<usize> = (0..self.n).filter(|&i| self.column[i] == NONE).collect();
        let mut scratch = Search::new(self.n);
        for row in free {
            self.augment(row, &mut scratch);
        }
        self.column
    }

    fn reduced(&self, i: usize, j: usize) -> f64 {
        self.costs[i * self.n + j] - self.v[j]
    }

    /// The price of each column is its least cost; its row takes it unless it has one.
    fn reduce_columns(&mut self) {
        let mut least = vec![(f64::INFINITY, 0); self.n];
        for (i, row) in self.costs.chunks(self.n).enumerate() {
            for (least, &cost) in least.iter_mut().zip(row) {
                if cost < least.0 {
                    *least = (cost, i);
                }
            }
        }
        for (j, (cost, i)) in least.into_iter().enumerate() {
            self.v[j] = cost;
            if self.column[i] == NONE {
                (self.column[i], self.row[j]) = (j as u32, i as u32);
            }
        }
    }

    /// Each free row takes its cheapest column and lowers its price by what the next best costs more.
    fn reduce_rows(&mut self) {
        let mut free: Vec<usize> = (0..self.n).rev().filter(|&i| self.column[i] == NONE).collect();
        // With rounded prices rows could displace each other for ever.
        let mut left = 4 * self.n;
        while let Some(i) = free.pop() {
            let (mut best, mut second) = ((f64::INFINITY, 0), f64::INFINITY);
            for j in 0..self.n {
                let cost = self.reduced(i, j);
                if cost < best.0 {
                    (second, best) = (best.0, (cost, j));
                } else if cost < second {
                    second = cost;
                }
            }
            let (lowest, j) = best;
            let displaced = self.row[j];
            if displaced != NONE && (second <= lowest || left == 0) {
                continue;
            }
            left = left.saturating_sub(1);
            if second.is_finite() {
                self.v[j] -= second - lowest;
            }
            (self.column[i], self.row[j]) = (j as u32, i as u32);
            if displaced != NONE {
                self.column[displaced as usize] = NONE;
                free.push(displaced as usize);
            }
        }
    }

    /// Gives a free row a column along the shortest path, on which all rows before change theirs.
    fn augment(&mut self, start: usize, search: &mut Search) {
        let n = self.n;
        search.done.fill(false);
        for j in 0..n {
            search.reach[j] = self.reduced(start, j);
            search.from[j] = start as u32;
        }
        search.order.clear();
        let (end, length) = loop {
            let (mut next, mut length) = (0, f64::INFINITY);
            for j in 0..n {
                if !search.done[j] && search.reach[j] < length {
                    (next, length) = (j, search.reach[j]);
                }
            }
            if self.row[next] == NONE {
                break (next, length);
            }
            search.done[next] = true;
            search.order.push(next);
            let i = self.row[next] as usize;
            let offset = self.reduced(i, next) - length;
            let costs = &self.costs[i * n..(i + 1) * n];
            for j in 0..n {
                let through = costs[j] - self.v[j] - offset;
                if !search.done[j] && through < search.reach[j] {
                    search.reach[j] = through;
                    search.from[j] = i as u32;
                }
            }
        };
        for &j in &search.order {
            self.v[j] += search.reach[j] - length;
        }
        let mut j = end as u32;
        loop {
            let i = search.from[j as usize];
            self.row[j as usize] = i;
            j = std::mem::replace(&mut self.column[i as usize], j);
            if i as usize == start {
                return;
            }
        }
    }
}

/// Working memory of one path.
struct Search {
    reach: Vec<f64>,
    from: Vec<u32>,
    done: Vec<bool>,
    order: Vec<usize>,
}

impl Search {
    fn new(n: usize) -> Self {
        Self { reach: vec![0.0; n], from: vec![0; n], done: vec![false; n], order: Vec::new() }
    }
}

/// Rows bid for columns; a bid raises the price by at least the step, and the sum misses the least by `n` steps at most.
fn auction(a: &[[f64; 3]], b: &[[f64; 3]], excess: f64) -> Vec<u32> {
    let n = a.len();
    let nearest = |p: &[f64; 3]| b.iter().map(|&q| distance(*p, q)).fold(f64::INFINITY, f64::min);
    // No pairing is shorter than the way of each point to its nearest.
    let bound = a.iter().map(nearest).sum::<f64>() / n as f64;
    // Steps that vanish beside the prices would let two rows outbid each other for ever.
    let last = (excess * bound).max(1e-9 * across(a, b)).max(f64::MIN_POSITIVE);
    let (mut prices, mut column) = (vec![0.0; n], Vec::new());
    // Coarse steps first: their prices are near the final ones, and are found in few bids.
    let mut step = (across(a, b) / 4.0).max(last);
    loop {
        column = bid(a, b, step, &mut prices, column);
        if step <= last {
            return column;
        }
        step = (step / 5.0).max(last);
    }
}

/// The diagonal of the box around both sets.
fn across(a: &[[f64; 3]], b: &[[f64; 3]]) -> f64 {
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for p in a.iter().chain(b) {
        low = std::array::from_fn(|k| low[k].min(p[k]));
        high = std::array::from_fn(|k| high[k].max(p[k]));
    }
    distance(low, high)
}

fn bid(
    a: &[[f64; 3]],
    b: &[[f64; 3]],
    step: f64,
    prices: &mut [f64],
    mut column: Vec<u32>,
) -> Vec<u32> {
    let n = a.len();
    column.clear();
    column.resize(n, NONE);
    let mut row = vec![NONE; n];
    let mut free: Vec<u32> = (0..n as u32).rev().collect();
    while let Some(i) = free.pop() {
        let p = a[i as usize];
        let (mut best, mut second) = ((f64::INFINITY, 0), f64::INFINITY);
        for (j, (&q, &price)) in b.iter().zip(&*prices).enumerate() {
            let cost = distance(p, q) + price;
            if cost < best.0 {
                (second, best) = (best.0, (cost, j));
            } else if cost < second {
                second = cost;
            }
        }
        let (lowest, j) = best;
        prices[j] += step + if second.is_finite() { second - lowest } else { 0.0 };
        let displaced = std::mem::replace(&mut row[j], i);
        column[i as usize] = j as u32;
        if displaced != NONE {
            column[displaced as usize] = NONE;
            free.push(displaced);
        }
    }
    column
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn total(a: &[[f64; 3]], b: &[[f64; 3]], column: &[u32]) -> f64 {
        let mut seen: Vec<u32> = column.to_vec();
        seen.sort_unstable();
        assert!(seen.iter().enumerate().all(|(k, &j)| k as u32 == j), "no pairing: {column:?}");
        a.iter().zip(column).map(|(&p, &j)| distance(p, b[j as usize])).sum()
    }

    /// The least over all orders.
    fn brute(a: &[[f64; 3]], b: &[[f64; 3]]) -> f64 {
        let Some((&first, rest)) = a.split_first() else { return 0.0 };
        let of = |j: usize| {
            let mut others = b.to_vec();
            let q = others.remove(j);
            distance(first, q) + brute(rest, &others)
        };
        (0..b.len()).map(of).fold(f64::INFINITY, f64::min)
    }

    fn points(count: usize, seed: u64) -> Vec<[f64; 3]> {
        let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
        let mut number = || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        (0..count).map(|_| [number(), number(), number()]).collect()
    }

    proptest! {
        #[test]
        fn the_least_sum_is_found(count in 0..7_usize, seed: u64, grid: bool) {
            let round = |p: Vec<[f64; 3]>| -> Vec<[f64; 3]> {
                // Many equal distances.
                p.into_iter().map(|p| if grid { p.map(|x| (2.0 * x).round()) } else { p }).collect()
            };
            let (a, b) = (round(points(count, seed)), round(points(count, seed.wrapping_add(77))));
            let least = brute(&a, &b);
            let exact = total(&a, &b, &assign(&a, &b, Assignment::Exact));
            prop_assert!((exact - least).abs() < 1e-12, "{exact} instead of {least}");
            let near = total(&a, &b, &assign(&a, &b, Assignment::Auction { excess: 0.05 }));
            prop_assert!(near <= least * 1.05 + 1e-6 && near >= least - 1e-12, "{near} for {least}");
        }
    }

    #[test]
    fn larger_sets_agree_with_the_auction_within_its_bound() {
        for seed in 0..3 {
            let (a, b) = (points(300, seed), points(300, seed + 50));
            let exact = total(&a, &b, &assign(&a, &b, Assignment::Exact));
            let fine = total(&a, &b, &assign(&a, &b, Assignment::Auction { excess: 1e-4 }));
            assert!((exact - 1e-9..=exact * 1.0001 + 1e-6).contains(&fine), "{fine} for {exact}");
        }
        // A set with itself, shuffled, and with all points in one place.
        let (a, mut b) = (points(500, 9), points(500, 9));
        b.rotate_left(123);
        assert_eq!(total(&a, &b, &assign(&a, &b, Assignment::Exact)), 0.0);
        assert_eq!(total(&a, &b, &assign(&a, &b, Assignment::Auction { excess: 0.01 })), 0.0);
        let same = vec![[1.0, 2.0, 3.0]; 40];
        assert_eq!(total(&same, &same, &assign(&same, &same, Assignment::Exact)), 0.0);
        assert_eq!(
            total(&same, &same, &assign(&same, &same, Assignment::Auction { excess: 0.01 })),
            0.0
        );
    }

    #[test]
    fn an_auction_for_one_place_ends() {
        let (a, b) = (vec![[0.0; 3]; 3], vec![[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]);
        let column = assign(&a, &b, Assignment::Auction { excess: 0.01 });
        assert_eq!(total(&a, &b, &column), 3.0);
    }

    /// Paths of infinite length would be followed for ever.
    #[test]
    #[should_panic(expected = "squares are finite")]
    fn distances_must_be_finite() {
        let _ = assign(&[[1e200, 0.0, 0.0]; 2], &[[-1e200, 0.0, 0.0]; 2], Assignment::Exact);
    }

    #[test]
    #[should_panic(expected = "two sets of one size")]
    fn sizes_must_agree() {
        let _ = assign(&[[0.0; 3]], &[], Assignment::Exact);
    }
}
