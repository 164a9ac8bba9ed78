//! Where edges cross the lines of pixel centres, sorted along each line.

/// One place where the outline crosses a line of pixel centres, in one number whose order is that along the line: of places that are the same,
/// that of the edges.
///
/// Above stands the place, as an integer of the same order; then the edge's place in the contour, and in the last bit its direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Crossing(u64);

const SIGN: u32 = 1 << 31;
/// Room for so many crossings a line from the start: a list that grew with each longer outline would be copied in the middle of a fit.
const PER_LINE: usize = 32;

impl Crossing {
    /// At a place along the line, in pixels, of an edge that runs `upwards`, to later lines, or not.
    #[inline]
    fn new(at: f32, edge: u32, upwards: bool) -> Self {
        let bits = at.to_bits();
        // Numbers grow with their bits, negative ones fall.
        let ordered = if bits & SIGN == 0 { bits | SIGN } else { !bits };
        Self(u64::from(ordered) << 32 | u64::from(edge << 1) | u64::from(upwards))
    }

    /// Where along the line, in pixels.
    #[inline]
    pub(super) fn at(self) -> f32 {
        let ordered = (self.0 >> 32) as u32;
        f32::from_bits(if ordered & SIGN == 0 { !ordered } else { ordered & !SIGN })
    }

    /// The edge's place in the contour.
    #[inline]
    pub(super) fn edge(self) -> usize {
        (self.0 as u32 >> 1) as usize
    }

    /// The change in the number of layers in front (rows count up, columns down).
    #[inline]
    fn layers(self) -> i32 {
        if self.0 & 1 == 1 { 1 } else { -1 }
    }
}

/// The crossings of all rows, or all columns. Buffers are kept from view to view.
#[derive(Debug, Default)]
pub(super) struct Crossings {
    /// With their lines, as they are found; behind those of the last search are others, of no account.
    found: Vec<(u32, Crossing)>,
    /// Line by line, in order.
    sorted: Vec<Crossing>,
    /// Where each line ends in them, and one more, which is empty.
    ends: Vec<u32>,
}

impl Crossings {
    /// Finds the crossings of `edges`, each from an end to the other, with every `stride`-th of so many lines across an axis: rows across 0,
    /// columns across 1.
    pub(super) fn find(
        &mut self,
        edges: &[[[f32; 3]; 2]],
        axis: usize,
        lines: usize,
        stride: usize,
    ) {
        let Self { found, ends, .. } = self;
        let across = 1 - axis;
        ends.clear();
        ends.resize(lines + 1, 0);
        // The lines in the middle of each run of `stride`.
        let phase = stride / 2;
        let mut count = 0;
        for (edge, [a, b]) in edges.iter().enumerate() {
            let upwards = b[across] > a[across];
            let (low, high) = if upwards { (a[across], b[across]) } else { (b[across], a[across]) };
            // Lines with low <= line + 0.5 < high: the half-open rule closes every loop.
            let (begin, end) = (line_from(low, lines), line_from(high, lines));
            let derivative = (b[axis] - a[axis]) / (b[across] - a[across]);
            let crossed = |line: usize| {
                let at = a[axis] + (line as f32 + 0.5 - a[across]) * derivative;
                (line as u32, Crossing::new(at, edge as u32, upwards))
            };
            let mut line = begin;
            if stride > 1 {
                line += (phase + stride - begin % stride) % stride;
            }
            let room = count + end.saturating_sub(line) + 1;
            if found.len() < room {
                found.resize((2 * room).max(PER_LINE * lines), (0, Crossing(0)));
            }
            // Whether an edge crosses a line or none cannot be guessed: where it crosses none, what is written is overwritten.
            loop {
                found[count] = crossed(line);
                let crosses = line < end;
                count += usize::from(crosses);
                ends[line.min(lines)] += u32::from(crosses);
                line += stride;
                if line >= end {
                    break;
                }
            }
        }
        self.sort(count);
    }

    /// The first so many of those found, by line, then along it.
    fn sort(&mut self, count: usize) {
        let Self { found, sorted, ends } = self;
        let found = &found[..count];
        let mut total = 0;
        for end in ends.iter_mut() {
            total += std::mem::replace(end, total);
        }
        // Any filling: every slot is written below.
        sorted.resize(found.len(), Crossing(0));
        for &(line, crossing) in found {
            let slot = &mut ends[line as usize];
            sorted[*slot as usize] = crossing;
            *slot += 1;
        }
        let mut begin = 0;
        for &end in ends.iter() {
            sorted[begin..end as usize].sort_unstable();
            begin = end as usize;
        }
    }

    /// Calls `visit` for each crossing that borders the silhouette with its line, and with `+1` where outwards is along the line and `-1`
    /// where it is against it.
    pub(super) fn walk(&self, mut visit: impl FnMut(usize, Crossing, f32)) {
        let mut begin = 0;
        for (line, &end) in self.ends.iter().enumerate() {
            let mut layers = 0;
            for &crossing in &self.sorted[begin..end as usize] {
                let before = layers;
                layers += crossing.layers();
                match (before, layers) {
                    (0, _) => visit(line, crossing, -1.0),
                    (_, 0) => visit(line, crossing, 1.0),
                    _ => {}
                }
            }
            begin = end as usize;
        }
    }
}

/// The first of so many lines of pixel centres that is not before a place.
#[inline]
pub(super) fn line_from(at: f32, lines: usize) -> usize {
    // Rounded up by hand: most builds call a function to do it.
    let at = (at - 0.5).clamp(0.0, lines as f32);
    let whole = at as u32;
    (whole + u32::from((whole as f32) < at)) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_holds_a_crossing_in_its_order() {
        let places = [f32::NEG_INFINITY, -7.5, -0.25, -0.0, 0.0, 1e-30, 3.5, f32::INFINITY];
        let mut before = None;
        for at in places {
            for edge in [0, 5, (1 << 31) - 1] {
                let crossing = Crossing::new(at, edge, edge == 5);
                let found = (crossing.at(), crossing.edge() as u32, crossing.layers());
                assert_eq!(found, (at, edge, if edge == 5 { 1 } else { -1 }));
                assert!(before < Some(crossing), "{at}, {edge}");
                before = Some(crossing);
            }
        }
    }

    /// A square around the middle of the image, and one beside it, which turns the other way.
    #[test]
    fn lines_enter_and_leave_what_they_cross() {
        let square = |x: f32| {
            let corners = [[x, 1.0, 1.0], [x + 2.0, 1.0, 1.0], [x + 2.0, 3.0, 1.0], [x, 3.0, 1.0]];
            [0, 1, 2, 3].map(|k| [corners[k], corners[(k + 1) % 4]])
        };
        let mut edges = square(1.0).to_vec();
        edges.extend(square(4.0).map(|[a, b]| [b, a]));
        let mut crossings = Crossings::default();
        crossings.find(&edges, 0, 5, 1);
        let mut found = Vec::new();
        crossings.walk(|line, crossing, outward| found.push((line, crossing.at(), outward)));
        let row = |line| [(line, 1.0, -1.0), (line, 3.0, 1.0), (line, 4.0, -1.0), (line, 6.0, 1.0)];
        assert_eq!(found, [row(1), row(2)].concat());
    }
}
