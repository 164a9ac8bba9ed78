//! A whole training step of img2mesh: three views to one mesh, four losses, backward, Adam.
//!
//! The work of the peer's step: images and renderings of 128x128, a small CNN, two layers of
//! attention of width 256, an icosphere of 642 vertices, colours and soft silhouettes.

use benches::{TrainingStep, criterion, pool, yardsticks};
use models::img2mesh::{Img2Mesh, Img2MeshConfig, SilhouetteKind};

fn config(batch: usize) -> Img2MeshConfig {
    Img2MeshConfig {
        features: 256,
        image_size: 128,
        render_size: 128,
        views: 3,
        layers: 2,
        heads: 4,
        feed_forward: 512,
        level: 3,
        silhouette: SilhouetteKind::Soft,
        synthetic_views: 8 * batch,
        ..Img2MeshConfig::default()
    }
}

fn main() {
    let mut criterion = criterion();
    yardsticks(&mut criterion, "img2mesh");
    let mut group = criterion.benchmark_group("img2mesh");
    for batch in [1, 4] {
        let mut step = TrainingStep::<Img2Mesh>::new(&config(batch), batch);
        group.bench_function(format!("training-step/batch-{batch}/2t"), |bencher| {
            pool(2).install(|| bencher.iter(|| step.run()));
        });
    }
    group.finish();
    criterion.final_summary();
}
