//! Parts of an image that hang together over the edges of pixels.

/// For each pixel the number of its part, from 1 on; 0 where it belongs to none. Beside it the size of each part.
///
/// Parts are numbered as they are met, row by row.
pub(crate) fn parts(
    [height, width]: [usize; 2],
    belongs: impl Fn(usize) -> bool,
) -> (Vec<u32>, Vec<usize>) {
    let mut part = vec![0u32; height * width];
    let mut sizes = Vec::new();
    let mut stack = Vec::new();
    for start in 0..height * width {
        if part[start] != 0 || !belongs(start) {
            continue;
        }
        let number = sizes.len() as u32 + 1;
        let mut size = 0;
        part[start] = number;
        stack.push(start);
        while let Some(at) = stack.pop() {
            size += 1;
            let (i, j) = (at / width, at % width);
            let neighbours = [
                (i > 0).then(|| at - width),
                (i + 1 < height).then(|| at + width),
                (j > 0).then(|| at - 1),
                (j + 1 < width).then(|| at + 1),
            ];
            for next in neighbours.into_iter().flatten() {
                if part[next] == 0 && belongs(next) {
                    part[next] = number;
                    stack.push(next);
                }
            }
        }
        sizes.push(size);
    }
    (part, sizes)
}
