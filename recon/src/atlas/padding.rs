//! Colours for the texels between charts.

use mesh_core::Image;

/// Texels around a chart that repeat its border: half a texel of the coarsest level that mixes no charts.
pub(super) const PADDING: usize = 4;

/// Gives every texel that is not known the colour of those around it, of its own box first: left, top, width and height.
///
/// In a box the border of what is known grows by so many `rings` of texels; what is left there, and then what is in no box, takes
/// the mean of the least part of an image pyramid that knows any.
pub(super) fn fill(image: &mut Image, known: &[bool], boxes: &[[usize; 4]], rings: usize) {
    let side = image.width;
    let mut known = known.to_vec();
    for &[left, top, width, height] in boxes {
        let texels = |k: usize| (top + k / width) * side + left + k % width;
        let mut part = Image::new(height, width, 3);
        let mut part_known = vec![false; width * height];
        for k in 0..width * height {
            part_known[k] = known[texels(k)];
            part.data[3 * k..3 * k + 3].copy_from_slice(&image.data[3 * texels(k)..][..3]);
        }
        if !part_known.contains(&true) {
            continue;
        }
        grow(&mut part, &mut part_known, rings);
        pull(&mut part.data, &part_known, [width, height]);
        for k in 0..width * height {
            image.data[3 * texels(k)..][..3].copy_from_slice(&part.data[3 * k..3 * k + 3]);
            known[texels(k)] = true;
        }
    }
    pull(&mut image.data, &known, [side, side]);
}

/// Colours the unknown neighbours of known texels with their mean, and then, ring after ring, theirs.
fn grow(image: &mut Image, known: &mut [bool], rings: usize) {
    const AROUND: [[isize; 2]; 8] =
        [[-1, -1], [-1, 0], [-1, 1], [0, -1], [0, 1], [1, -1], [1, 0], [1, 1]];
    let (width, height) = (image.width as isize, image.height as isize);
    let neighbors = |texel: usize| {
        let (row, column) = (texel as isize / width, texel as isize % width);
        let inside = move |[i, j]: [isize; 2]| {
            let (r, c) = (row + i, column + j);
            let inside = (0..height).contains(&r) && (0..width).contains(&c);
            inside.then_some((r * width + c) as usize)
        };
        AROUND.into_iter().filter_map(inside)
    };
    // Beyond the first ring only neighbours of the last one can be next.
    let mut next: Vec<usize> = (0..known.len()).filter(|&texel| !known[texel]).collect();
    for _ in 0..rings {
        let mut found = Vec::new();
        for &texel in &next {
            let (mut sum, mut count) = ([0.0f32; 3], 0.0f32);
            for near in neighbors(texel).filter(|&near| known[near]) {
                let color = &image.data[3 * near..][..3];
                (0..3).for_each(|k| sum[k] += color[k]);
                count += 1.0;
            }
            if count > 0.0 {
                found.push((texel, sum.map(|s| s / count)));
            }
        }
        for &(texel, color) in &found {
            image.data[3 * texel..3 * texel + 3].copy_from_slice(&color);
            known[texel] = true;
        }
        let around = |&(texel, _): &(usize, [f32; 3])| neighbors(texel);
        next = found.iter().flat_map(around).filter(|&texel| !known[texel]).collect();
        next.sort_unstable();
        next.dedup();
    }
}

/// Fills what is not known of an image from its half-sized means.
fn pull(data: &mut [f32], known: &[bool], [width, height]: [usize; 2]) {
    if width * height <= 1 || known.iter().all(|&k| k) {
        return;
    }
    let half = [width.div_ceil(2), height.div_ceil(2)];
    let mut above = vec![0.0f32; 3 * half[0] * half[1]];
    let mut known_above = vec![false; half[0] * half[1]];
    for cell in 0..half[0] * half[1] {
        let (row, column) = (2 * (cell / half[0]), 2 * (cell % half[0]));
        let mut count = 0.0f32;
        for (r, c) in [(row, column), (row, column + 1), (row + 1, column), (row + 1, column + 1)] {
            if r < height && c < width && known[r * width + c] {
                (0..3).for_each(|k| above[3 * cell + k] += data[3 * (r * width + c) + k]);
                count += 1.0;
            }
        }
        if count > 0.0 {
            (0..3).for_each(|k| above[3 * cell + k] /= count);
            known_above[cell] = true;
        }
    }
    pull(&mut above, &known_above, half);
    for texel in (0..width * height).filter(|&texel| !known[texel]) {
        let cell = texel / width / 2 * half[0] + texel % width / 2;
        data[3 * texel..3 * texel + 3].copy_from_slice(&above[3 * cell..3 * cell + 3]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_is_filled_with_what_is_nearest() {
        let mut image = Image::new(31, 31, 3);
        let mut known = vec![false; 31 * 31];
        for (texel, color) in [(5 * 31 + 5, [1.0, 0.0, 0.0]), (25 * 31 + 26, [0.0, 0.0, 1.0])] {
            image.data[3 * texel..3 * texel + 3].copy_from_slice(&color);
            known[texel] = true;
        }
        let boxes = [[0, 0, 16, 16], [16, 16, 15, 15]];
        fill(&mut image, &known, &boxes, PADDING + 1);
        let at = |row: usize, column: usize| &image.data[3 * (31 * row + column)..][..3];
        assert!(image.data.chunks(3).all(|c| (c.iter().sum::<f32>() - 1.0).abs() < 1e-5));
        // A box has its own colour up to its border.
        for (row, column, color) in [(15, 15, [1.0, 0.0, 0.0]), (16, 16, [0.0, 0.0, 1.0])] {
            assert_eq!(at(row, column), color);
        }
        let mut nothing = Image::new(4, 4, 3);
        fill(&mut nothing, &[false; 16], &[[0, 0, 4, 4]], 3);
        assert!(nothing.data.iter().all(|&x| x == 0.0));
    }
}
