//! Where the faces of a mesh lie in a texture: every face has texels of its own.

use mesh_core::{Image, Texture};

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

    /// Column and row of a face's texel `i` texels along one leg and `j` along the other.
    fn place(&self, face: usize, [i, j]: [usize; 2]) -> [usize; 2] {
        let cell = face / 2;
        let [left, top] = [cell % self.columns * self.cell, cell / self.columns * self.cell];
        if face.is_multiple_of(2) {
            [left + i, top + j]
        } else {
            [left + self.cell - 1 - i, top + self.cell - 1 - j]
        }
    }

    /// Calls `visit` with the texel (index in the image) and barycentric coordinates of every texel
    /// that a face may be filtered from. Outside of the face they extend its plane by a texel.
    pub fn texels(&self, face: usize, mut visit: impl FnMut(usize, [f32; 3])) {
        let n = self.legs();
        for j in 0..=n + 1 {
            for i in 0..=n + 1 - j {
                let [column, row] = self.place(face, [i, j]);
                let (u, v) = (i as f32 / n as f32, j as f32 / n as f32);
                visit(row * self.side + column, [1.0 - u - v, u, v]);
            }
        }
    }

    /// The texture of so many faces with an image of the atlas's side.
    pub fn texture(&self, faces: usize, image: Image) -> Texture {
        let uvs = (0..faces).flat_map(|face| self.corners(face)).collect();
        let faces = (0..faces as u32).map(|f| [3 * f, 3 * f + 1, 3 * f + 2]).collect();
        Texture { uvs, faces, image }
    }

    /// Texture coordinates of a face's corners, v up.
    fn corners(&self, face: usize) -> [[f32; 2]; 3] {
        let (n, side) = (self.legs(), self.side as f32);
        [[0, 0], [n, 0], [0, n]].map(|corner| {
            let [column, row] = self.place(face, corner);
            [(column as f32 + 0.5) / side, 1.0 - (row as f32 + 0.5) / side]
        })
    }
}
