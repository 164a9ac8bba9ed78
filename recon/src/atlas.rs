//! Where the faces of a mesh lie in a texture: every face has texels of its own.

/// How the faces lie in the image: pairs of faces share a square cell, one face in each corner,
/// with a border of texels that no other face touches, so that filtering never mixes neighbours.
#[derive(Clone, Copy, Debug)]
pub struct Atlas {
    /// Side of the image.
    side: usize,
    /// Side of a cell.
    cell: usize,
    /// Cells in a row.
    columns: usize,
}

impl Atlas {
    /// Cells for `faces` in an image of `side`; `None` when they would be under 5 texels wide.
    pub fn new(faces: usize, side: usize) -> Option<Self> {
        let cells = faces.div_ceil(2);
        let columns = (cells as f64).sqrt().ceil() as usize;
        let cell = side / columns.max(1);
        (cell >= 5).then_some(Self { side, cell, columns })
    }

    /// Texels along the legs of a face.
    fn legs(&self) -> usize {
        self.cell - 3
    }

    /// First column and row of a face's cell.
    fn origin(&self, face: usize) -> [usize; 2] {
        let cell = face / 2;
        [cell % self.columns * self.cell, cell / self.columns * self.cell]
    }

    /// Calls `visit` with the texel (index in the image) and barycentric coordinates of every texel
    /// that a face may be filtered from. Outside of the face they extend its plane by a texel.
    pub fn texels(&self, face: usize, mut visit: impl FnMut(usize, [f32; 3])) {
        let [left, top] = self.origin(face);
        let n = self.legs();
        for j in 0..=n + 1 {
            for i in 0..=n + 1 - j {
                let (column, row) = if face.is_multiple_of(2) {
                    (left + i, top + j)
                } else {
                    (left + self.cell - 1 - i, top + self.cell - 1 - j)
                };
                let (u, v) = (i as f32 / n as f32, j as f32 / n as f32);
                visit(row * self.side + column, [1.0 - u - v, u, v]);
            }
        }
    }

    /// Texture coordinates of a face's corners, v up.
    pub fn corners(&self, face: usize) -> [[f32; 2]; 3] {
        let [left, top] = self.origin(face);
        let n = self.legs();
        [[0, 0], [n, 0], [0, n]].map(|[i, j]| {
            let (column, row) = if face.is_multiple_of(2) {
                (left + i, top + j)
            } else {
                (left + self.cell - 1 - i, top + self.cell - 1 - j)
            };
            let s = self.side as f32;
            [(column as f32 + 0.5) / s, 1.0 - (row as f32 + 0.5) / s]
        })
    }
}
