//! Connected components of a mask.

use super::Mask;

/// The connected components of a mask.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Components {
    /// For each pixel the number of its component, from 1 on; 0 for the background.
    pub labels: Vec<u32>,
    /// How many pixels each has: that of component `n` is `sizes[n - 1]`.
    pub sizes: Vec<usize>,
}

impl Mask {
    /// The parts of the object that hang together over the sides of pixels (4-connected), numbered as they are met, row by row.
    ///
    /// # Cost
    /// `O(pixels)`.
    pub fn components(&self) -> Components {
        let (height, width) = (self.height, self.width);
        let mut labels = vec![0_u32; height * width];
        let (mut sizes, mut stack) = (Vec::new(), Vec::new());
        for start in 0..height * width {
            if labels[start] != 0 || !self.data[start] {
                continue;
            }
            let label = sizes.len() as u32 + 1;
            let mut size = 0;
            labels[start] = label;
            stack.push(start);
            while let Some(at) = stack.pop() {
                size += 1;
                let (i, j) = (at / width, at % width);
                let neighbors = [
                    (i > 0).then(|| at - width),
                    (i + 1 < height).then(|| at + width),
                    (j > 0).then(|| at - 1),
                    (j + 1 < width).then(|| at + 1),
                ];
                for next in neighbors.into_iter().flatten() {
                    if labels[next] == 0 && self.data[next] {
                        labels[next] = label;
                        stack.push(next);
                    }
                }
            }
            sizes.push(size);
        }
        Components { labels, sizes }
    }

    /// The largest of the [components](Self::components) alone; the first of those that are as large.
    #[must_use]
    pub fn largest_component(&self) -> Self {
        let Components { labels, sizes } = self.components();
        let best = (1..=sizes.len()).max_by_key(|&n| (sizes[n - 1], std::cmp::Reverse(n)));
        let data = labels.iter().map(|&label| best == Some(label as usize)).collect();
        Self { data, ..*self }
    }

    /// The background that the object encloses: that of which no way over the sides of pixels leads to the border of the image.
    #[must_use]
    pub fn holes(&self) -> Self {
        let Components { labels, sizes } = self.inverted().components();
        // The object has the label 0.
        let mut open = vec![false; sizes.len() + 1];
        open[0] = true;
        for (pixel, &label) in labels.iter().enumerate() {
            open[label as usize] |= self.is_border(pixel);
        }
        let data = labels.iter().map(|&label| !open[label as usize]).collect();
        Self { data, ..*self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_do_not_connect() {
        let text = ["##..#", "..#.#", "###.#"];
        let mask = Mask::from_fn(3, 5, |i, j| text[i].as_bytes()[j] == b'#');
        let found = mask.components();
        assert_eq!(found.sizes, [2, 3, 4]);
        assert_eq!(found.labels, [1, 1, 0, 0, 2, 0, 0, 3, 0, 2, 3, 3, 3, 0, 2]);
    }
}
