//! The box of space that a camera sees, made a cube.

use super::{Camera, Lens};
use crate::{TriMesh, VoxelGrid, voxelize_solid};

/// What a camera sees between two depths, mapped to the cube from -1 to 1.
///
/// In the cube x goes right and y *down* over the whole image, and z away from the camera, from -1 at `near`
/// to 1 at `far`. Through a pinhole z is linear in one over the depth: then the map is projective, straight
/// lines and flat faces stay straight and flat, and a mesh may be voxelised in the cube. Cells are smallest
/// near the camera. Parallel rays have z linear in depth. Orientation is kept.
///
/// This is the voxel space of Mesh R-CNN, which bounds z by what is left of depth after its matrix `K`: on
/// the renderings of 3D-R2N2, 0.67 to 0.92, which are depths of 0.6030 to 2.4414.
///
/// ```
/// use mesh_core::{Camera, CameraVolume, EmptyGrid, cubify, primitives};
///
/// let camera = Camera::look_at([0.0, 0.4, 3.0], [0.0; 3], [0.0, 1.0, 0.0], 0.9, 64, 64);
/// let volume = CameraVolume::new(camera, 1.8, 4.2);
/// let ball = primitives::icosphere(4);
/// let grid = volume.voxelize(&ball, [48; 3]);
/// // The cells of the cube, back in the world, enclose about as much as the ball.
/// let cells = volume.to_world(cubify(&grid, EmptyGrid::Nothing));
/// assert!((cells.volume() / ball.volume() - 1.0).abs() < 0.02);
/// ```
///
/// # References
/// Gkioxari, Malik, Johnson 2019, *Mesh R-CNN*, section 3.1 ("camera-aligned" voxels) and its code.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraVolume {
    /// The camera.
    pub camera: Camera,
    /// The planar depth at which z is -1.
    pub near: f64,
    /// The planar depth at which z is 1.
    pub far: f64,
}

impl CameraVolume {
    /// The volume between two depths.
    ///
    /// # Panics
    /// Unless `near < far`, both finite, and `near > 0` for a pinhole.
    pub fn new(camera: Camera, near: f64, far: f64) -> Self {
        let in_front = near > 0.0 || !camera.is_perspective();
        assert!(
            in_front && near < far && near.is_finite() && far.is_finite(),
            "CameraVolume: depths {near} to {far}, expected 0 < near < far"
        );
        Self { camera, near, far }
    }

    /// The volume whose depths just hold a ball around a point of the world.
    ///
    /// # Panics
    /// If the camera is a pinhole and the ball reaches behind it.
    pub fn around(camera: Camera, center: [f64; 3], radius: f64) -> Self {
        let depth = camera.project(center).depth;
        Self::new(camera, depth - radius, depth + radius)
    }

    /// Where a point of the world is in the cube; not a number where it is not in front of a pinhole.
    pub fn to_cube(&self, point: [f64; 3]) -> [f64; 3] {
        let seen = self.camera.project(point);
        if self.camera.is_perspective() && seen.depth <= 0.0 {
            return [f64::NAN; 3];
        }
        let x = 2.0 * seen.column / self.camera.width as f64 - 1.0;
        let y = 2.0 * seen.row / self.camera.height as f64 - 1.0;
        let ends = [self.near, self.far].map(|depth| self.linear(depth));
        [x, y, 2.0 * (self.linear(seen.depth) - ends[0]) / (ends[1] - ends[0]) - 1.0]
    }

    /// Where a point of the cube is in the world: the inverse of [`to_cube`](Self::to_cube).
    pub fn from_cube(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let [near, far] = [self.near, self.far].map(|depth| self.linear(depth));
        // `linear` is its own inverse.
        let depth = self.linear(near + 0.5 * (z + 1.0) * (far - near));
        let column = 0.5 * (x + 1.0) * self.camera.width as f64;
        let row = 0.5 * (y + 1.0) * self.camera.height as f64;
        self.camera.unproject(column, row, depth)
    }

    /// The cells of the cube whose middle is inside a closed mesh of the world: `dims` are columns, rows and
    /// steps in depth.
    ///
    /// What lies outside the volume is cut off. Faces that are not wholly in front of a pinhole are left out,
    /// so a mesh that reaches behind the camera is not closed any more.
    ///
    /// # Panics
    /// As [`voxelize_solid`].
    pub fn voxelize(&self, mesh: &TriMesh, dims: [usize; 3]) -> VoxelGrid {
        let place = |p: [f32; 3]| self.to_cube(p.map(f64::from)).map(|x| x as f32);
        let positions = mesh.positions.iter().map(|&p| place(p)).collect();
        voxelize_solid(&TriMesh::new(positions, mesh.faces.clone()), dims, Self::CUBE)
    }

    /// A mesh of the cube, such as `cubify` makes of a grid there, in the world.
    #[must_use]
    pub fn to_world(&self, mesh: TriMesh) -> TriMesh {
        mesh.map_positions(|p| self.from_cube(p.map(f64::from)).map(|x| x as f32))
    }

    /// The box that grids of this space fill.
    pub const CUBE: ([f32; 3], [f32; 3]) = ([-1.0; 3], [1.0; 3]);

    /// Depth in the measure that keeps planes flat.
    fn linear(&self, depth: f64) -> f64 {
        match self.camera.lens {
            Lens::Perspective { .. } => 1.0 / depth,
            Lens::Orthographic { .. } => depth,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::off_center;
    use super::*;
    use crate::primitives;
    use proptest::prelude::*;

    fn volume(perspective: bool) -> CameraVolume {
        let mut camera = off_center();
        if !perspective {
            camera.lens = Lens::Orthographic { sx: 12.0, sy: 11.0, cx: 30.5, cy: 27.25 };
        }
        CameraVolume::around(camera, [0.1, -0.2, 0.3], 1.4)
    }

    proptest! {
        #[test]
        fn there_and_back(p in prop::array::uniform3(-1.0..1.0_f64), perspective: bool) {
            let volume = volume(perspective);
            let back = volume.from_cube(volume.to_cube(p));
            prop_assert!((0..3).all(|k| (back[k] - p[k]).abs() < 1e-9), "{back:?} {p:?}");
            let again = volume.to_cube(volume.from_cube(p));
            prop_assert!((0..3).all(|k| (again[k] - p[k]).abs() < 1e-9), "{again:?} {p:?}");
        }

        /// Points on a line stay on a line, so faces stay flat.
        #[test]
        fn lines_stay_straight(a in prop::array::uniform3(-1.0..1.0_f64), b in prop::array::uniform3(-1.0..1.0_f64), t in 0.1..0.9_f64, perspective: bool) {
            let volume = volume(perspective);
            let middle = std::array::from_fn(|k| a[k] + t * (b[k] - a[k]));
            let [a, b, m] = [a, b, middle].map(|p| volume.to_cube(p));
            let [u, v]: [[f64; 3]; 2] = [b, m].map(|p| std::array::from_fn(|k| p[k] - a[k]));
            for k in 0..3 {
                let (i, j) = ((k + 1) % 3, (k + 2) % 3);
                prop_assert!((u[i] * v[j] - u[j] * v[i]).abs() < 1e-10);
            }
        }
    }

    #[test]
    fn the_corners_of_the_cube_are_those_of_the_image() {
        for perspective in [true, false] {
            let volume = volume(perspective);
            let seen = |p: [f64; 3]| volume.camera.project(volume.from_cube(p));
            let near = seen([-1.0, -1.0, -1.0]);
            assert!(near.column.abs() < 1e-9 && near.row.abs() < 1e-9);
            assert!((near.depth - volume.near).abs() < 1e-9);
            let far = seen([1.0, 1.0, 1.0]);
            assert!((far.column - 64.0).abs() < 1e-9 && (far.row - 48.0).abs() < 1e-9);
            assert!((far.depth - volume.far).abs() < 1e-9);
        }
    }

    /// The z of Mesh R-CNN, whose matrix leaves `1.002002 - 0.2002002 / depth` of depth.
    #[test]
    fn mesh_rcnns_z() {
        let camera = Camera::look_at([0.0, 0.0, 1.5], [0.0; 3], [0.0, 1.0, 0.0], 0.86, 137, 137);
        let [near, far] = [0.67, 0.92].map(|z: f64| 0.2002002 / (1.002002 - z));
        assert!((near - 0.6030).abs() < 1e-4 && (far - 2.4414).abs() < 1e-3, "{near} {far}");
        let volume = CameraVolume::new(camera, near, far);
        for depth in [0.7, 1.5, 2.3] {
            let z = 1.002002 - 0.2002002 / depth;
            let expected = 2.0 * (z - 0.67) / (0.92 - 0.67) - 1.0;
            let found = volume.to_cube([0.1, -0.2, 1.5 - depth]);
            assert!((found[2] - expected).abs() < 1e-9);
        }
    }

    #[test]
    fn cells_are_where_the_mesh_is() {
        let volume = volume(true);
        let ball = primitives::icosphere(4).translated([0.1, -0.2, 0.3]);
        let grid = volume.voxelize(&ball, [20, 24, 28]);
        let (mut inside, mut outside) = (0, 0);
        for z in 0..28 {
            for y in 0..24 {
                for x in 0..20 {
                    let center = volume.from_cube(grid.center([x, y, z]).map(f64::from));
                    let away = [center[0] - 0.1, center[1] + 0.2, center[2] - 0.3];
                    let radius = away.iter().map(|x| x * x).sum::<f64>().sqrt();
                    if (radius - 1.0).abs() > 0.01 {
                        assert_eq!(grid.get([x, y, z]), radius < 1.0);
                        *if radius < 1.0 { &mut inside } else { &mut outside } += 1;
                    }
                }
            }
        }
        assert!(inside > 1000 && outside > 1000, "{inside} {outside}");
    }

    #[test]
    fn what_is_behind_the_camera_is_left_out() {
        let volume = volume(true);
        let eye = volume.camera.center();
        let behind = [eye.x, eye.y, eye.z + 3.0];
        assert!(volume.to_cube(behind).iter().all(|x| x.is_nan()));
        let ball = primitives::icosphere(2).translated(behind.map(|x| x as f32));
        assert_eq!(volume.voxelize(&ball, [8; 3]).count(), 0);
    }
}
