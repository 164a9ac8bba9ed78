//! A mesh and cameras in, images out.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use datasets::View;
use diff_raster::{Faces, FacesError, Fragments, NONE};
use mesh_core::vector::interpolate;
use mesh_core::{ByteImage, Camera, DepthMap, Image, TriMesh, srgb_to_linear};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::doubled::Doubled;
use super::rendering::{NormalSpace, Rendering};
use super::shade::{Albedo, Lighting, corner_normals, encode, unit};
use super::sketch::{Sketch, bands};

/// How a mesh is drawn.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RenderOptions {
    /// The light.
    pub lighting: Lighting,
    /// What is behind the object, sRGB.
    pub background: [f32; 3],
    /// The object's colour where the mesh has none, sRGB.
    pub plain: [f32; 3],
    /// Samples per pixel and axis for the colour; odd, so that one lies at the pixel's centre.
    pub supersample: usize,
    /// Whether depth is kept.
    pub depth: bool,
    /// Whether an image with alpha is kept too.
    pub alpha: bool,
    /// Whether normals are kept, and in which frame.
    pub normals: Option<NormalSpace>,
}

impl Default for RenderOptions {
    fn default() -> Self {
        Self {
            lighting: Lighting::flat(),
            background: [0.0; 3],
            plain: [0.8; 3],
            supersample: 3,
            depth: false,
            alpha: false,
            normals: None,
        }
    }
}

impl RenderOptions {
    /// Lit by [`Lighting::studio`] before white, as pages show meshes side by side.
    pub fn studio() -> Self {
        Self { lighting: Lighting::studio(), background: [1.0; 3], ..Self::default() }
    }
}

/// Draws the mesh from one camera: what [`render_views`] gives for it.
///
/// # Errors
/// # Panics
/// # Cost
/// As [`render`].
pub fn render_view(
    mesh: &TriMesh,
    camera: &Camera,
    options: &RenderOptions,
) -> Result<View, FacesError> {
    let mut views = render_views(mesh, std::slice::from_ref(camera), options, &|_, _| ())?;
    Ok(views.swap_remove(0))
}

/// Draws the mesh from every camera, and keeps of it what a [`View`] holds.
///
/// # Errors
/// # Panics
/// # Cost
/// As [`render`].
pub fn render_views(
    mesh: &TriMesh,
    cameras: &[Camera],
    options: &RenderOptions,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Vec<View>, FacesError> {
    let renderings = render(mesh, cameras, options, progress)?;
    Ok(renderings.into_iter().map(|rendering| rendering.view).collect())
}

/// Draws the mesh from every camera; views are named by their index.
///
/// Colours are averaged over `supersample²` samples, in linear light where there is shading.
/// Masks and depth are those of the pixel's centre, which is the rule by which masks are compared
/// everywhere. Of faces with the same corners the first that faces the camera is seen, or else
/// the first. `progress` is told how many views are done, of how many, from any thread.
///
/// # Errors
/// If a face names a vertex that is not there.
///
/// # Panics
/// If `supersample` is even, or a texture does not fit its mesh.
///
/// # Cost
/// About 6 ms per core for a view of 256x256 with 3x3 samples. Memory: the views, and per thread
/// 20 bytes for each sample of the part of one view that the mesh can touch, at most 340 MB: more are drawn in bands. [`render_each`] keeps no view.
pub fn render(
    mesh: &TriMesh,
    cameras: &[Camera],
    options: &RenderOptions,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Vec<Rendering>, FacesError> {
    let scene = Scene::of(mesh, options)?;
    let done = AtomicUsize::new(0);
    Ok(cameras
        .par_iter()
        .enumerate()
        .map_init(Sketch::default, |sketch, (i, camera)| {
            let rendering = scene.draw(camera, i.to_string(), sketch);
            progress(done.fetch_add(1, Ordering::Relaxed) + 1, cameras.len());
            rendering
        })
        .collect())
}

/// Draws the mesh from every camera, as [`render`], and hands each rendering over with its index as soon as it is there, from any
/// thread: no more of them are held than there are threads.
///
/// # Errors
/// If a face names a vertex that is not there. The result within is what `take` says: after an error no more are drawn.
///
/// # Panics
/// # Cost
/// As [`render`].
pub fn render_each<E: Send>(
    mesh: &TriMesh,
    cameras: &[Camera],
    options: &RenderOptions,
    take: &(dyn Fn(usize, Rendering) -> Result<(), E> + Sync),
) -> Result<Result<(), E>, FacesError> {
    let scene = Scene::of(mesh, options)?;
    Ok(cameras.par_iter().enumerate().try_for_each_init(Sketch::default, |sketch, (i, camera)| {
        take(i, scene.draw(camera, i.to_string(), sketch))
    }))
}

struct Scene<'a> {
    mesh: &'a TriMesh,
    faces: Arc<Faces>,
    doubled: Option<Doubled>,
    albedo: Albedo,
    /// Light on each corner; `None` where colours are shown as they are, in sRGB.
    light: Option<Vec<[f32; 3]>>,
    /// Normals of each corner, where they are wanted.
    normals: Option<Vec<[[f32; 3]; 3]>>,
    background: [f32; 3],
    options: &'a RenderOptions,
}

impl<'a> Scene<'a> {
    fn of(mesh: &'a TriMesh, options: &'a RenderOptions) -> Result<Self, FacesError> {
        let times = options.supersample;
        assert!(times % 2 == 1, "render: supersample {times}, expected an odd number");
        let linear = !options.lighting.is_flat();
        Ok(Self {
            mesh,
            faces: Arc::new(Faces::of(mesh)?),
            doubled: Doubled::of(mesh),
            albedo: Albedo::of(mesh, linear, options.plain),
            light: linear.then(|| options.lighting.on(mesh)),
            normals: options.normals.map(|_| corner_normals(mesh, options.lighting.crease)),
            background: options.background.map(|v| if linear { srgb_to_linear(v) } else { v }),
            options,
        })
    }

    fn draw(&self, camera: &Camera, name: String, sketch: &mut Sketch) -> Rendering {
        let mut rendering = self.empty(camera, name);
        let positions = &self.mesh.positions;
        let shown = self.doubled.as_ref().map(|doubled| {
            let faces = Faces::new(positions.len(), &doubled.shown(self.mesh, camera));
            Arc::new(faces.expect("corners of faces that are sound"))
        });
        let faces = shown.as_ref().unwrap_or(&self.faces);
        let times = self.options.supersample;
        for part in bands(camera, positions, times) {
            sketch.draw(camera, part, positions, faces, times);
            self.resolve(&sketch.fragments, part, &mut rendering);
        }
        rendering
    }

    /// The background alone.
    fn empty(&self, camera: &Camera, name: String) -> Rendering {
        let (height, width) = (camera.height, camera.width);
        let [r, g, b] = self.background.map(|v| encode(v, self.light.is_some()));
        let picture = |pixel: &[u8]| ByteImage {
            height,
            width,
            channels: pixel.len(),
            data: pixel.repeat(height * width),
        };
        let view = View {
            crop: None,
            name,
            color: picture(&[r, g, b]),
            mask: ByteImage::new(height, width, 1),
            camera: camera.clone(),
            depth: self.options.depth.then(|| DepthMap {
                height,
                width,
                data: vec![f32::INFINITY; height * width],
            }),
        };
        Rendering {
            view,
            rgba: self.options.alpha.then(|| picture(&[r, g, b, 0])),
            normals: self.normals.is_some().then(|| Image::new(height, width, 3)),
        }
    }

    /// Makes pixels of samples, in the part of the view that was sampled.
    fn resolve(&self, fragments: &Fragments, part: [usize; 4], rendering: &mut Rendering) {
        let [top, left, rows, columns] = part;
        let (times, linear) = (self.options.supersample, self.light.is_some());
        let stride = columns * times;
        let samples = times * times;
        let share = 1.0 / samples as f32;
        for i in 0..rows {
            for j in 0..columns {
                let mut sum = [0.0; 3];
                let mut seen = 0;
                for row in i * times..(i + 1) * times {
                    let start = row * stride + j * times;
                    for k in start..start + times {
                        if fragments.face[k] != NONE {
                            let sample = self.sample(fragments, k);
                            (0..3).for_each(|c| sum[c] += sample[c]);
                            seen += 1;
                        }
                    }
                }
                if seen == 0 {
                    continue;
                }
                let view = &mut rendering.view;
                let at = (top + i) * view.mask.width + left + j;
                let behind = (samples - seen) as f32;
                for (c, out) in view.color.data[3 * at..3 * at + 3].iter_mut().enumerate() {
                    *out = encode(share * (sum[c] + behind * self.background[c]), linear);
                }
                let middle = (i * times + times / 2) * stride + j * times + times / 2;
                let object = fragments.face[middle] != NONE;
                if let Some(rgba) = &mut rendering.rgba {
                    let own = sum.map(|v| encode(v / seen as f32, linear));
                    let alpha = ((255 * seen + samples / 2) / samples) as u8;
                    let alpha = if object { alpha.max(128) } else { alpha.min(127) };
                    let pixel = [own[0], own[1], own[2], alpha];
                    rgba.data[4 * at..4 * at + 4].copy_from_slice(&pixel);
                }
                if object {
                    view.mask.data[at] = 255;
                    if let Some(depth) = &mut view.depth {
                        depth.data[at] = fragments.depth[middle];
                    }
                    if let Some(normals) = &mut rendering.normals {
                        let normal = self.normal(fragments, middle, &view.camera);
                        normals.data[3 * at..3 * at + 3].copy_from_slice(&normal);
                    }
                }
            }
        }
    }

    /// The normal of a sample, in the frame that was asked for.
    fn normal(&self, fragments: &Fragments, k: usize, camera: &Camera) -> [f32; 3] {
        let Some(normals) = &self.normals else { return [0.0; 3] };
        let b = &fragments.barycentric[3 * k..3 * k + 3];
        let world = unit(interpolate([b[0], b[1], b[2]], &normals[fragments.face[k] as usize]));
        match self.options.normals {
            Some(NormalSpace::Camera) => std::array::from_fn(|r| {
                (0..3).map(|c| camera.rotation[(r, c)] as f32 * world[c]).sum()
            }),
            _ => world,
        }
    }

    #[inline]
    fn sample(&self, fragments: &Fragments, k: usize) -> [f32; 3] {
        let face = fragments.face[k] as usize;
        let b = &fragments.barycentric[3 * k..3 * k + 3];
        let weights = [b[0], b[1], b[2]];
        let color = self.albedo.at(face, weights);
        match &self.light {
            Some(light) => {
                let light: f32 = interpolate(weights, &light[face].map(|v| [v]))[0];
                color.map(|v| (v * light).min(1.0))
            }
            None => color,
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use mesh_core::{Image, Lens, Texture, primitives};

    fn camera(width: usize, height: usize) -> Camera {
        Camera::look_at([0.3, 0.4, 4.0], [0.0; 3], [0.0, 1.0, 0.0], 0.8, width, height)
    }

    /// A ball's silhouette, depth and light are known in closed form.
    #[test]
    fn a_ball_looks_as_geometry_says() {
        let ball = primitives::icosphere(5).colored([1.0, 0.5, 0.25]);
        let options = RenderOptions { depth: true, ..RenderOptions::default() };
        let camera = camera(80, 60);
        let view = render_view(&ball, &camera, &options).unwrap();
        let mut wrong = 0;
        for k in 0..80 * 60 {
            let ray = camera.ray((k % 80) as f64 + 0.5, (k / 80) as f64 + 0.5);
            let along: f64 = (0..3).map(|a| -ray.origin[a] * ray.direction[a]).sum();
            let squared: f64 = ray.origin.iter().map(|o| o * o).sum::<f64>() - along * along;
            wrong += ((squared < 1.0) != (view.mask.data[k] == 255)) as usize;
            if squared < 0.8 {
                let t = along - (1.0 - squared).sqrt();
                let p: [f64; 3] = std::array::from_fn(|a| ray.origin[a] + t * ray.direction[a]);
                let depth = view.depth.as_ref().unwrap().data[k];
                assert!((camera.project(p).depth - f64::from(depth)).abs() < 3e-3);
                assert_eq!(view.color.data[3 * k..3 * k + 3], [255, 128, 64]);
            }
            if squared > 1.2 {
                assert_eq!(view.color.data[3 * k..3 * k + 3], [0, 0, 0]);
                assert_eq!(view.depth.as_ref().unwrap().data[k], f32::INFINITY);
            }
        }
        // Only pixels that the polygon's outline leaves out by a hair.
        assert!(wrong <= 4, "{wrong} pixels differ");
    }

    #[test]
    fn each_rendering_is_handed_over_until_one_is_refused() {
        let (ball, cameras) = (primitives::icosphere(2), vec![camera(32, 24); 5]);
        let options = RenderOptions::default();
        let views = render_views(&ball, &cameras, &options, &|_, _| ()).unwrap();
        let take = |i: usize, made: Rendering| if made.view == views[i] { Ok(()) } else { Err(i) };
        assert_eq!(render_each(&ball, &cameras, &options, &take).unwrap(), Ok(()));
        assert!(render_each(&ball, &cameras, &options, &|i, _| Err::<(), _>(i)).unwrap().is_err());
    }

    #[test]
    fn samples_are_averaged_at_the_outline() {
        let ball = primitives::icosphere(3).colored([1.0; 3]);
        let draw = |supersample| {
            let options = RenderOptions { supersample, ..RenderOptions::default() };
            render_view(&ball, &camera(64, 48), &options).unwrap()
        };
        let (hard, soft) = (draw(1), draw(3));
        assert_eq!(hard.mask, soft.mask);
        assert!(hard.color.data.iter().all(|&v| v == 0 || v == 255));
        assert!(soft.color.data.iter().any(|&v| v > 0 && v < 255));
    }

    /// Over any background the image with alpha is the image that was drawn over it.
    #[test]
    fn alpha_is_the_mask_at_one_half_and_composites_to_the_picture() {
        let ball = primitives::icosphere(3).colored([0.8, 0.4, 0.2]);
        let options = RenderOptions {
            background: [0.2, 0.4, 0.6],
            alpha: true,
            lighting: Lighting { ambient: 1.0, ..Lighting::flat() },
            ..RenderOptions::default()
        };
        let drawn = render(&ball, &[camera(70, 50)], &options, &|_, _| {}).unwrap().remove(0);
        let rgba = drawn.rgba.unwrap();
        let mut between = 0;
        for (k, pixel) in rgba.data.chunks_exact(4).enumerate() {
            assert_eq!(pixel[3] >= 128, drawn.view.mask.data[k] == 255);
            between += (pixel[3] > 0 && pixel[3] < 255) as usize;
            if pixel[3] == 0 {
                assert_eq!(pixel[..3], [51, 102, 153]);
            } else {
                assert_eq!(pixel[..3], [204, 102, 51]);
            }
        }
        assert!(between > 50, "{between} pixels of the outline");
        // The share of a pixel is off by at most one sample, where the centre decided otherwise.
        let over = rgba.over([51, 102, 153]);
        let off = over.data.iter().zip(&drawn.view.color.data).map(|(a, b)| a.abs_diff(*b)).max();
        assert!(off.unwrap() <= 153 / 9 + 2, "{off:?}");
    }

    #[test]
    fn normals_of_a_ball_point_from_its_middle() {
        let ball = primitives::icosphere(5);
        let camera = camera(80, 60);
        let draw = |space| {
            let lighting = Lighting { crease: 40.0, ..Lighting::flat() };
            let options = RenderOptions {
                depth: true,
                normals: Some(space),
                lighting,
                ..RenderOptions::default()
            };
            render(&ball, std::slice::from_ref(&camera), &options, &|_, _| {}).unwrap().remove(0)
        };
        let (world, seen) = (draw(NormalSpace::World), draw(NormalSpace::Camera));
        let depth = world.view.depth.as_ref().unwrap();
        let mut checked = 0;
        for k in 0..80 * 60 {
            let n = &world.normals.as_ref().unwrap().data[3 * k..3 * k + 3];
            let c = &seen.normals.as_ref().unwrap().data[3 * k..3 * k + 3];
            if world.view.mask.data[k] == 0 {
                assert!(n == [0.0; 3] && c == [0.0; 3]);
                continue;
            }
            let (column, row) = ((k % 80) as f64 + 0.5, (k / 80) as f64 + 0.5);
            let p = camera.unproject(column, row, f64::from(depth.data[k]));
            for a in 0..3 {
                assert!((f64::from(n[a]) - p[a]).abs() < 5e-3, "{n:?} at {p:?}");
            }
            let turned = camera.rotation * mesh_core::nalgebra::Vector3::from(p);
            assert!((0..3).all(|a| (f64::from(c[a]) - turned[a]).abs() < 5e-3));
            // What is seen of a ball faces the viewer.
            assert!(c[2] > 0.0);
            checked += 1;
        }
        assert!(checked > 500);
        let normals = seen.normal_image().unwrap();
        assert!(normals.pixel(30, 40)[2] > 250 && normals.pixel(0, 0) == [0, 0, 0]);
    }

    #[test]
    fn a_texture_lies_where_its_coordinates_say() {
        // A square over the middle of the image: red left half, green right, blue bottom row.
        let mut mesh = TriMesh::new(
            vec![[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]],
            vec![[0, 1, 2], [0, 2, 3]],
        );
        let mut image = Image::new(8, 8, 3);
        for i in 0..8 {
            for j in 0..8 {
                let channel = if i == 7 { 2 } else { usize::from(j >= 4) };
                image.data[(i * 8 + j) * 3 + channel] = 1.0;
            }
        }
        mesh.texture = Some(Texture {
            uvs: vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]],
            faces: mesh.faces.clone(),
            image,
        });
        let mut camera = camera(64, 64);
        camera.rotation = mesh_core::nalgebra::Matrix3::identity();
        camera.translation = [0.0, 0.0, -2.0].into();
        camera.lens = Lens::Orthographic { sx: 32.0, sy: 32.0, cx: 32.0, cy: 32.0 };
        let options = RenderOptions::default();
        let view = render_view(&mesh, &camera, &options).unwrap();
        assert_eq!(view.color.pixel(8, 8), [255, 0, 0]);
        assert_eq!(view.color.pixel(8, 56), [0, 255, 0]);
        assert_eq!(view.color.pixel(63, 20), [0, 0, 255]);
        assert_eq!(view.mask_pixels(), 64 * 64);
    }

    /// The part that is sampled holds all that is seen, also where the mesh leaves the image.
    #[test]
    fn nothing_is_cut_off() {
        let ball = primitives::icosphere(4).colored([1.0; 3]);
        for (x, y, z) in [(0.0, 0.0, 0.0), (1.4, 1.0, 0.0), (-1.5, 0.3, 0.5), (0.0, 0.0, 3.6)] {
            let mesh = ball.clone().translated([x, y, z]);
            let camera = camera(60, 44);
            let options = RenderOptions { depth: true, ..RenderOptions::default() };
            let view = render_view(&mesh, &camera, &options).unwrap();
            // A speck far behind the camera makes the whole image be sampled.
            let mut with_speck = mesh.clone();
            let speck = primitives::icosphere(0).colored([1.0; 3]).scaled([1e-3; 3]);
            with_speck.append(&speck.translated([0.0, 0.0, 50.0])).unwrap();
            let whole = render_view(&with_speck, &camera, &options).unwrap();
            assert_eq!(view.mask, whole.mask, "ball at {x} {y} {z}");
            assert_eq!(view.color, whole.color);
        }
    }

    #[test]
    fn threads_change_nothing() {
        let clock = crate::shapes::AlarmClock::default().build();
        let cameras = super::super::Orbit { count: 5, ..super::super::Orbit::default() }.cameras();
        let options = RenderOptions { lighting: Lighting::studio(), ..RenderOptions::default() };
        let draw = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| render_views(&clock, &cameras, &options, &|_, _| {}).unwrap())
        };
        let one = draw(1);
        assert!(one == draw(2) && one == draw(3));
        assert!(one.iter().all(|v| (0.1..0.4).contains(&(v.mask_pixels() as f64 / 65536.0))));
    }
}
