//! The steady state of a training loop takes no fresh block of 4 KiB or more for any loss, and the bits of
//! values and gradients do not depend on the number of threads.

use autodiff_lite::testkit::CountingAllocator;
use autodiff_lite::{Tape, Tensor};
use losses::{Directions, Matches};
use mesh_core::{SurfacePoint, Topology, primitives, sample_surface};
use ndarray::{Array2, Array4, s};

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator::new();

/// What one step needs, made once.
struct Scene {
    positions: Tensor,
    cloud: Tensor,
    image: Tensor,
    target: Tensor,
    mask: Tensor,
    depth: Tensor,
    faces: Vec<[u32; 3]>,
    topology: Topology,
    samples: Vec<SurfacePoint>,
}

impl Scene {
    fn new() -> Self {
        let ball = primitives::icosphere(4);
        let topology = Topology::new(ball.positions.len(), &ball.faces);
        let array = |points: &[[f32; 3]], scale: f32| -> Tensor {
            Array2::from_shape_fn((points.len(), 3), |(i, k)| scale * points[i][k]).into()
        };
        let image = |seed: usize| -> Tensor {
            Array4::from_shape_fn((2, 96, 160, 3), |(n, i, j, k)| {
                ((n * 31 + i * 7 + j * 13 + k * 5 + seed) % 101) as f32 / 100.0
            })
            .into()
        };
        Self {
            positions: array(&ball.positions, 1.0),
            cloud: array(&primitives::torus(1.0, 0.4, 60, 40).positions, 0.8),
            image: image(0),
            target: image(17),
            mask: image(5).slice(s![.., .., .., 0]).to_owned().into(),
            depth: image(9).slice(s![.., .., .., 0]).mapv(|v| 1.1 - v).into(),
            samples: sample_surface(&ball, 3000, 1),
            faces: ball.faces,
            topology,
        }
    }

    /// Every loss of the crate, and the gradients of all of them together.
    fn step(&self, tape: &mut Tape<f32>, matches: &mut Matches) -> Vec<u32> {
        let mut bits = Vec::new();
        {
            let x = tape.leaf(self.positions.clone());
            let image = tape.leaf(self.image.clone());
            let target = tape.constant(self.target.clone());
            let mask = tape.constant(self.mask.clone());
            // Above zero, as depth is.
            let far = tape.constant(self.depth.clone());
            let near =
                image.slice_axis(3, 0..1).reshape(&[2, 96, 160]).map(|v| v + 0.3, |_, _| 1.0);
            let cloud = tape.constant(self.cloud.clone());
            let points = losses::surface_points(x, &self.faces, &self.samples);
            matches.find(points, cloud);
            let rings = &self.topology.vertex_vertices;
            let terms = [
                losses::l1(image, target, Some(mask)),
                losses::l2(image, target, None),
                losses::ssim_loss(image, target),
                losses::mask_iou(image, target),
                losses::mask_bce(image, target),
                losses::ScaleShiftInvariant::least_squares().loss(near, far, mask),
                losses::ScaleShiftInvariant::trimmed().loss(near, far, mask),
                losses::log_depth(
                    losses::disparity(near),
                    far,
                    mask,
                    0.5,
                    losses::DepthMean::Images,
                ),
                losses::face_angle(x, &self.topology),
                losses::normal_consistency(x, &self.topology),
                losses::edge_length(x, &self.topology, 0.1),
                losses::edge_length_sum(x, &self.topology),
                losses::laplacian_squared(x, rings),
                losses::laplacian_norm(x, rings),
                losses::deformation_norm(x),
                losses::vertex_normals(x, &self.faces).square().mean(),
                losses::face_normals(x, &self.faces).square().mean(),
                losses::surface_normals(x, &self.faces, &self.samples).square().mean(),
                losses::chamfer_distance(points, cloud, matches, Directions::default()),
                losses::chamfer_normals(points, cloud, matches, Directions::default()),
            ];
            let total = terms.iter().skip(1).fold(terms[0], |sum, term| sum.add(*term));
            let gradients = total.backward();
            bits.extend(terms.iter().map(|term| term.item().to_bits()));
            for leaf in [x, image] {
                let gradient = gradients.wrt(leaf).expect("a leaf that all depend on");
                // A checksum that sees every bit and its place, in a list too short to be counted.
                let mut sum = 0u32;
                for value in gradient {
                    sum = sum.rotate_left(5) ^ value.to_bits();
                }
                bits.push(sum);
            }
        }
        tape.reset();
        bits
    }
}

// One test, since the counter is one for all threads of the process.
#[test]
fn steps_take_no_fresh_memory_and_the_same_bits_on_any_number_of_threads() {
    let scene = Scene::new();
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| {
            let mut tape = Tape::<f32>::train(0);
            let mut matches = Matches::default();
            let first = scene.step(&mut tape, &mut matches);
            for _ in 0..3 {
                scene.step(&mut tape, &mut matches);
            }
            let before = ALLOCATOR.blocks();
            for _ in 0..5 {
                assert_eq!(scene.step(&mut tape, &mut matches), first);
            }
            (first, ALLOCATOR.blocks() - before)
        })
    };
    let (one, large) = run(1);
    assert_eq!(large, 0, "fresh blocks of 4 KiB and more in five steps");
    for threads in [2, 3] {
        let (bits, large) = run(threads);
        assert_eq!(bits, one, "{threads} threads");
        assert_eq!(large, 0, "fresh blocks with {threads} threads");
    }
}
