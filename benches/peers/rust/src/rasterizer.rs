//! An icosphere drawn with three channels and an antialiased silhouette, forward and backward, by del-msh-cpu.

use std::error::Error;
use std::hint::black_box;

use del_geo_core::mat4_col_major as matrix;
use del_msh_cpu::{antialias, edge2elem, edge2vtx, pix2tri};
use mesh_core::primitives::icosphere;

use crate::timing::report;

/// Nothing is seen at a pixel.
const NONE: u32 = u32::MAX;
/// Millimetres of a lens whose film is 36 wide: as far as the scene of the bench `raster` is zoomed.
const LENS: f32 = 3.4 * 18.0;
const DISTANCE: f32 = 4.0;

pub fn time() -> Result<(), Box<dyn Error>> {
    for (level, side) in [(4, 256), (5, 512)] {
        let mut scene = Scene::new(level, side).ok_or("the camera's matrix has an inverse")?;
        scene.step();
        let share = scene.faces_seen.iter().filter(|face| **face != NONE).count() as f32
            / (side * side) as f32;
        assert!((0.5..0.7).contains(&share), "{share} of the image is the sphere");
        let id = format!("raster/forward-backward/icosphere-{level}-{side}-batch-1");
        report(&id, "del-msh-cpu 0.1.53", || scene.step());
    }
    Ok(())
}

struct Scene {
    size: (usize, usize),
    faces: Vec<[u32; 3]>,
    positions: Vec<[f32; 3]>,
    edges: Vec<[u32; 2]>,
    edge_faces: Vec<[u32; 2]>,
    to_ndc: [f32; 16],
    from_ndc: [f32; 16],
    to_pixels: [f32; 16],
    faces_seen: Vec<u32>,
    depths: Vec<f32>,
    colors: Vec<f32>,
    silhouette: Vec<f32>,
    antialiased: Vec<f32>,
    color_gradient: Vec<f32>,
    mask_gradient: Vec<f32>,
    position_gradient: Vec<[f32; 3]>,
    value_gradient: Vec<f32>,
}

impl Scene {
    fn new(level: u32, side: usize) -> Option<Self> {
        let mesh = icosphere(level);
        let vertices = mesh.positions.len();
        let edges = edge2vtx::from_triangle_mesh(&mesh.faces, vertices);
        let lens = matrix::camera_perspective_blender(1.0, LENS, 0.1, 10.0, true);
        let to_ndc =
            matrix::mult_mat_col_major(&lens, &matrix::from_translate(&[0.0, 0.0, -DISTANCE]));
        let pixels = side * side;
        Some(Self {
            size: (side, side),
            edge_faces: edge2elem::from_edge2vtx_of_tri2vtx(&edges, &mesh.faces, vertices),
            edges,
            faces: mesh.faces,
            positions: mesh.positions,
            from_ndc: matrix::try_inverse_with_pivot(&to_ndc)?,
            to_pixels: matrix::mult_mat_col_major(
                &matrix::from_transform_ndc2pix((side, side)),
                &to_ndc,
            ),
            to_ndc,
            faces_seen: vec![NONE; pixels],
            depths: vec![f32::NEG_INFINITY; pixels],
            colors: vec![0.0; 3 * pixels],
            silhouette: vec![0.0; pixels],
            antialiased: vec![0.0; pixels],
            color_gradient: vec![0.01; 3 * pixels],
            mask_gradient: vec![0.02; pixels],
            position_gradient: vec![[0.0; 3]; vertices],
            value_gradient: vec![0.0; 3 * vertices],
        })
    }

    fn step(&mut self) {
        self.draw();
        self.pull();
        black_box((&self.antialiased, &self.position_gradient, &self.value_gradient));
    }

    fn draw(&mut self) {
        self.faces_seen.fill(NONE);
        self.depths.fill(f32::NEG_INFINITY);
        let (faces, positions) = (&self.faces, &self.positions);
        pix2tri::pix2tri_by_rasterization(
            &mut self.faces_seen,
            &mut self.depths,
            faces,
            positions,
            self.size,
            &self.to_ndc,
        );
        // The positions of a unit sphere are its normals, which the bench has as colours.
        let values = positions.as_flattened();
        pix2tri::interpolate(
            self.size,
            &self.faces_seen,
            faces,
            positions,
            3,
            values,
            &self.from_ndc,
            &mut self.colors,
        );
        for (inside, face) in self.silhouette.iter_mut().zip(&self.faces_seen) {
            *inside = f32::from(u8::from(*face != NONE));
        }
        self.antialiased.copy_from_slice(&self.silhouette);
        let contour = self.contour();
        antialias::antialias(
            &contour,
            &self.positions,
            &self.to_pixels,
            self.size,
            &self.faces_seen,
            &self.silhouette,
            &mut self.antialiased,
        );
    }

    fn pull(&mut self) {
        self.position_gradient.fill([0.0; 3]);
        self.value_gradient.fill(0.0);
        let contour = self.contour();
        antialias::bwd_antialias(
            &contour,
            &self.positions,
            &mut self.position_gradient,
            &self.to_pixels,
            self.size,
            &self.silhouette,
            &self.mask_gradient,
            &self.faces_seen,
        );
        pix2tri::interpolate_bwd(
            self.size,
            &self.faces_seen,
            &self.faces,
            &self.positions,
            3,
            self.positions.as_flattened(),
            &self.from_ndc,
            &self.color_gradient,
            &mut self.position_gradient,
            &mut self.value_gradient,
        );
    }

    fn contour(&self) -> Vec<[u32; 2]> {
        let Self { faces, positions, to_ndc, edges, edge_faces, .. } = self;
        edge2vtx::contour_for_triangle_mesh(faces, positions, to_ndc, edges, edge_faces)
    }
}
