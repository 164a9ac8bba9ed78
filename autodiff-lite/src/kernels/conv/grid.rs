//! How Winograd's form cuts images into tiles.

/// Products of one tile.
pub(super) const POINTS: usize = 36;

/// The 4x4 tiles of a batch of images.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grid {
    batch: usize,
    /// Tiles along rows and columns.
    count: [usize; 2],
}

impl Grid {
    pub(super) fn new(batch: usize, size: [usize; 2]) -> Self {
        Self { batch, count: [size[0].div_ceil(4), size[1].div_ceil(4)] }
    }

    pub(super) fn tiles(&self) -> usize {
        self.batch * self.count[0] * self.count[1]
    }

    /// Image, first row and first column of a tile.
    pub(super) fn corner(&self, tile: usize) -> [usize; 3] {
        let (n, rest) =
            (tile / (self.count[0] * self.count[1]), tile % (self.count[0] * self.count[1]));
        [n, rest / self.count[1] * 4, rest % self.count[1] * 4]
    }
}
