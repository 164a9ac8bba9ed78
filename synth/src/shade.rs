//! Light on a mesh: what each corner of each face looks like, from wherever it is seen.

use mesh_core::vector::{dot, interpolate, sub};
use mesh_core::{TriMesh, bilinear_repeat, linear_to_srgb, srgb_to_linear};
use serde::{Deserialize, Serialize};

/// Light that does not depend on the viewer, so that all views of a surface agree.
///
/// A surface of linear albedo `a` and unit normal `n` shows
///
/// ```text
/// a · (ambient + Σ strength · max(0, n · direction))
/// ```
///
/// There is no default: no light at all would be one, and what it draws is black.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lighting {
    /// Light from everywhere; 1 alone shows colours as they are.
    pub ambient: f32,
    /// Lights from far away.
    #[serde(default)]
    pub lamps: Vec<Lamp>,
    /// Faces that meet at more than this angle have a sharp edge between them, degrees.
    #[serde(default)]
    pub crease: f32,
}

/// A light from far away.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Lamp {
    /// Where it is, seen from the object; of any length but zero.
    pub direction: [f32; 3],
    /// Light on a surface that faces it.
    pub strength: f32,
}

impl Lighting {
    /// No shading: colours as they are, for judging colours.
    pub fn flat() -> Self {
        Self { ambient: 1.0, lamps: Vec::new(), crease: 0.0 }
    }

    /// A bright room with a key light from the upper left front and a weak one from behind.
    pub fn studio() -> Self {
        let lamp = |direction, strength| Lamp { direction, strength };
        Self {
            ambient: 0.55,
            lamps: vec![lamp([-0.5, 0.8, 0.9], 0.45), lamp([0.7, 0.2, -0.8], 0.2)],
            crease: 40.0,
        }
    }

    /// Little light from everywhere and much from two sides, for looking at shapes from all around.
    pub fn shape() -> Self {
        let lamp = |direction, strength| Lamp { direction, strength };
        Self {
            ambient: 0.25,
            lamps: vec![lamp([-0.5, 0.8, 0.9], 0.7), lamp([0.7, 0.3, -0.8], 0.45)],
            crease: 40.0,
        }
    }

    /// What an image of this mesh is to be lit by: its colours as they are, since light was in them when they were
    /// taken; and where it has none, light that shows its shape.
    pub fn for_mesh(mesh: &TriMesh) -> Self {
        if mesh.colors.is_some() || mesh.texture.is_some() { Self::flat() } else { Self::shape() }
    }

    /// A light beside the camera's place, for looking at shapes.
    pub fn headlight(toward_camera: [f32; 3]) -> Self {
        Self {
            ambient: 0.35,
            lamps: vec![Lamp { direction: toward_camera, strength: 0.65 }],
            crease: 40.0,
        }
    }

    /// Whether colours come out as they are.
    pub fn is_flat(&self) -> bool {
        self.lamps.is_empty() && self.ambient == 1.0
    }

    /// Light on each corner of each face, `[F, 3]`.
    pub(crate) fn on(&self, mesh: &TriMesh) -> Vec<[f32; 3]> {
        if self.lamps.is_empty() {
            return vec![[self.ambient; 3]; mesh.faces.len()];
        }
        let lamps: Vec<([f32; 3], f32)> =
            self.lamps.iter().map(|lamp| (unit(lamp.direction), lamp.strength)).collect();
        let shade = |normal: [f32; 3]| {
            lamps.iter().fold(self.ambient, |sum, &(direction, strength)| {
                sum + strength * dot(normal, direction).max(0.0)
            })
        };
        corner_normals(mesh, self.crease).into_iter().map(|normals| normals.map(shade)).collect()
    }
}

/// The normal at each corner of each face: the mean over the faces around the vertex that meet
/// this one at less than the crease angle, weighted by area.
pub(crate) fn corner_normals(mesh: &TriMesh, crease: f32) -> Vec<[[f32; 3]; 3]> {
    let scaled: Vec<[f32; 3]> = mesh
        .faces
        .iter()
        .map(|face| {
            let [a, b, c] = face.map(|v| mesh.positions[v as usize]);
            let (p, q) = (sub(b, a), sub(c, a));
            [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]]
        })
        .collect();
    let units: Vec<[f32; 3]> = scaled.iter().map(|&n| unit(n)).collect();
    // Faces around each vertex, as offsets into one list.
    let mut offsets = vec![0usize; mesh.positions.len() + 1];
    for &v in mesh.faces.iter().flatten() {
        offsets[v as usize + 1] += 1;
    }
    for v in 0..mesh.positions.len() {
        offsets[v + 1] += offsets[v];
    }
    let mut around = vec![0u32; 3 * mesh.faces.len()];
    let mut next = offsets.clone();
    for (f, face) in mesh.faces.iter().enumerate() {
        for &v in face {
            around[next[v as usize]] = f as u32;
            next[v as usize] += 1;
        }
    }
    let least = crease.to_radians().cos();
    mesh.faces
        .iter()
        .enumerate()
        .map(|(f, face)| {
            face.map(|v| {
                let mut sum = [0.0; 3];
                for &g in &around[offsets[v as usize]..offsets[v as usize + 1]] {
                    if g as usize == f || dot(units[g as usize], units[f]) >= least {
                        (0..3).for_each(|k| sum[k] += scaled[g as usize][k]);
                    }
                }
                unit(sum)
            })
        })
        .collect()
}

/// What the surface itself looks like.
pub(crate) enum Albedo {
    /// A colour for each corner of each face.
    Corners(Vec<[[f32; 3]; 3]>),
    /// An image, and where each corner of each face lies in it, in its pixels from the top left.
    Texture { height: usize, width: usize, data: Vec<[f32; 3]>, corners: Vec<[[f32; 2]; 3]> },
}

impl Albedo {
    /// In linear light where light is to be multiplied, in sRGB where it is not.
    pub(crate) fn of(mesh: &TriMesh, linear: bool, plain: [f32; 3]) -> Self {
        let space = |c: [f32; 3]| if linear { c.map(srgb_to_linear) } else { c };
        if let Some(texture) = &mesh.texture {
            let image = &texture.image;
            let (height, width, channels) = (image.height, image.width, image.channels);
            let pixel = |p: &[f32]| space(std::array::from_fn(|k| p[k.min(channels - 1)]));
            return Self::Texture {
                height,
                width,
                data: image.data.chunks_exact(channels.max(1)).map(pixel).collect(),
                corners: texture
                    .faces
                    .iter()
                    .map(|face| {
                        face.map(|uv| {
                            let [u, v] = texture.uvs[uv as usize];
                            [u * width as f32 - 0.5, (1.0 - v) * height as f32 - 0.5]
                        })
                    })
                    .collect(),
            };
        }
        Self::Corners(match &mesh.colors {
            Some(colors) => {
                let colors: Vec<_> = colors.iter().map(|&c| space(c)).collect();
                mesh.faces.iter().map(|face| face.map(|v| colors[v as usize])).collect()
            }
            None => vec![[space(plain); 3]; mesh.faces.len()],
        })
    }

    /// The colour at a point of a face.
    #[inline]
    pub(crate) fn at(&self, face: usize, weights: [f32; 3]) -> [f32; 3] {
        match self {
            Self::Corners(colors) => interpolate(weights, &colors[face]),
            Self::Texture { height, width, data, corners } => {
                let place = interpolate(weights, &corners[face]);
                bilinear_repeat([*width, *height], place, |i, j| data[i * width + j])
            }
        }
    }
}

/// What averages of samples are stored as.
pub(crate) fn encode(value: f32, linear: bool) -> u8 {
    let value = if linear { linear_to_srgb(value.clamp(0.0, 1.0)) } else { value };
    (value.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
}

pub(crate) fn unit(v: [f32; 3]) -> [f32; 3] {
    let length = dot(v, v).sqrt();
    if length > 0.0 { v.map(|x| x / length) } else { [0.0; 3] }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a file leaves out must not turn the light off.
    #[test]
    fn there_is_no_light_by_default() {
        let read = |text: &str| toml::from_str::<Lighting>(text);
        assert!(read("").is_err() && read("crease = 40.0").is_err());
        assert_eq!(read("ambient = 1.0").ok(), Some(Lighting::flat()));
        let mut mesh = mesh_core::primitives::icosphere(0);
        assert_eq!(Lighting::for_mesh(&mesh), Lighting::shape());
        mesh.colors = Some(vec![[0.5; 3]; 12]);
        assert!(Lighting::for_mesh(&mesh).is_flat());
    }

    #[test]
    fn light_falls_off_with_the_angle() {
        let ball = mesh_core::primitives::icosphere(3);
        let light = Lighting {
            ambient: 0.25,
            lamps: vec![Lamp { direction: [0.0, 2.0, 0.0], strength: 0.5 }],
            crease: 60.0,
        };
        for (face, values) in ball.faces.iter().zip(light.on(&ball)) {
            for (&v, value) in face.iter().zip(values) {
                let expected = 0.25 + 0.5 * ball.positions[v as usize][1].max(0.0);
                assert!((value - expected).abs() < 0.02, "{value} {expected}");
            }
        }
    }

    #[test]
    fn creases_stay_sharp_and_curves_smooth() {
        let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let cube = mesh_core::primitives::extrude(&square, 1.0).expect("a square");
        for normals in corner_normals(&cube, 40.0) {
            for n in normals {
                assert!(n.iter().any(|v| v.abs() > 0.999), "{n:?} is not along an axis");
            }
        }
        let smooth = corner_normals(&cube, 100.0);
        assert!(smooth.iter().flatten().all(|n| n.iter().all(|v| v.abs() < 0.95)));
    }
}
