//! Retrieval: what the nearest image of the training shows, by plain features.
//!
//! No network: an image is its pixels, averaged to a small square beside its mask. What a trained model predicts of an object
//! that it never saw should be nearer to the truth than what the likest of the objects is that it did see.

use mesh_core::ByteImage;

/// Side of the square.
const SIDE: usize = 16;

/// Images that can be asked for the nearest.
#[derive(Clone, Debug, Default)]
pub(crate) struct Nearest<P> {
    features: Vec<Vec<f32>>,
    places: Vec<P>,
}

impl<P: Copy> Nearest<P> {
    /// One more, with what is to be found.
    pub(crate) fn add(&mut self, features: Vec<f32>, place: P) {
        self.features.push(features);
        self.places.push(place);
    }

    /// What the nearest one has; the first of several.
    pub(crate) fn find(&self, features: &[f32]) -> Option<P> {
        let mut best = (f32::INFINITY, None);
        for (own, place) in self.features.iter().zip(&self.places) {
            let away: f32 = own.iter().zip(features).map(|(a, b)| (a - b) * (a - b)).sum();
            if away < best.0 {
                best = (away, Some(*place));
            }
        }
        best.1
    }
}

/// The features of a square image with three channels and its mask.
pub(crate) fn features(image: &[u8], mask: &[u8]) -> Vec<f32> {
    let side = mask.len().isqrt();
    let small = |data: &[u8], channels: usize| {
        let image = ByteImage { height: side, width: side, channels, data: data.to_vec() };
        image.resized(SIDE, SIDE).data
    };
    let bytes = [small(image, 3), small(mask, 1)].concat();
    bytes.into_iter().map(|byte| f32::from(byte) / 255.0).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_image_is_found() {
        let square = |left: usize, value: u8| {
            let inside = |k: usize| (left..left + 8).contains(&(k % 32)) && k / 32 < 12;
            let mask: Vec<u8> = (0..32 * 32).map(|k| u8::from(inside(k)) * 255).collect();
            let image: Vec<u8> = mask.iter().flat_map(|&m| [m.min(value); 3]).collect();
            features(&image, &mask)
        };
        let mut known = Nearest::default();
        assert_eq!(known.find(&square(0, 9)), None);
        for (place, left) in [0, 8, 16].into_iter().enumerate() {
            known.add(square(left, 200), place);
        }
        assert_eq!(known.find(&square(9, 190)), Some(1));
        assert_eq!(known.find(&square(16, 20)), Some(2));
        assert_eq!(square(0, 9).len(), 4 * SIDE * SIDE);
    }
}
